"""What the thesis says of figs. 3.15 to 3.20, beside tall and flat cylinders."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from studies.thesis.cylinder import REVOLUTION
from studies.thesis.cylinder_geometry import (
    FREQUENCY,
    KNOCKS,
    TILT,
    Candidate,
    all_directions,
    knocked,
    let_go,
    phi_change,
    undriven_frequency,
)
from studies.thesis.cylinder_tables import knocks, phi_range, span
from studies.thesis.figure import Comparison

SLIGHT = 1e-5
"""m, a table's motion that is just enough to keep a cylinder without rotation from coming down flat."""


def of_geometry(tall: Sequence[Candidate], flat: Sequence[Candidate]) -> tuple[Comparison, ...]:
    """What tells the size of the cylinder."""
    fall = {each: math.degrees(float(np.ptp(knocked(each.cylinder, KNOCKS[-1]).tilt))) for each in (*tall, *flat)}
    top = {each: max(math.degrees(run.tilt.max()) for run in knocks(each.cylinder)) for each in (*tall, *flat)}
    change = {each: phi_change(let_go(each.cylinder, each.tilt)) / 2.5 for each in (*tall, *flat)}
    nearest = min(flat, key=lambda each: abs(change[each] - 0.09))
    return (
        Comparison(
            "Fig. 3.15: frequency of the tilt",
            f"{FREQUENCY} Hz",
            "; ".join(f"({each.size}) from {math.degrees(each.tilt):.1f} deg" for each in (*tall, *flat)),
            "all of these have it (radius, centre height): it does not fix the cylinder",
        ),
        Comparison(
            "Fig. 3.19: how far the tilt goes from 5 deg after psi' = -270 deg/s",
            "the same tilt at all times",
            f"tall ones {span([fall[each] for each in tall])} deg; flat ones {max(fall[each] for each in flat):.5f} deg",
            "their heights are chosen for it: only flat ones keep it",
        ),
        Comparison(
            "Fig. 3.19: largest tilt of all eight starts",
            "its axes end at 10 deg",
            f"tall ones {span([top[each] for each in tall])} deg; flat ones {span([top[each] for each in flat])} deg",
            "only flat ones stay on the axes",
        ),
        Comparison(
            "Fig. 3.20: phi' of these starts",
            "-2.6 to -2.4 rev/s are the axis's labels",
            f"tall ones {phi_range([run for each in tall for run in knocks(each.cylinder)])}; flat ones "
            f"{phi_range([run for each in flat for run in knocks(each.cylinder)])}",
            "only flat ones stay near the labels",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from -2.5 rev/s",
            "at most about 9 % of where it starts",
            f"tall ones {span([100.0 * change[each] for each in tall])} %; flat ones "
            + ", ".join(f"{100.0 * change[each]:.1f} % ({each.size})" for each in flat),
            f"{nearest.size} is nearest",
        ),
    )


def of_trends(tall: Candidate, flat: Candidate) -> tuple[Comparison, ...]:
    """What the thesis says of any of them, for one of either kind."""
    still = [phi_change(run) for run in all_directions(flat.cylinder, flat.tilt, SLIGHT, spin=0.0)]
    by_tilt = [undriven_frequency(flat.cylinder, math.radians(each)) for each in (2.0, 5.0, 10.0)]
    by_spin = [undriven_frequency(flat.cylinder, flat.tilt, each * REVOLUTION) for each in (1.0, 2.5, 5.0)]
    poses = [
        let_go(each.cylinder, math.radians(tilt), azimuth=0.25 * REVOLUTION * turn)
        for each in (tall, flat) for tilt in (2.0, 5.0) for turn in range(4)
    ]  # fmt: skip
    apart = max(float(np.abs(run.tilt - poses[k - k % 4].tilt).max()) for k, run in enumerate(poses))
    least = [math.degrees(knocked(flat.cylinder, each).tilt.min()) for each in KNOCKS[:2]]
    tall_least = [math.degrees(knocked(tall.cylinder, each).tilt.min()) for each in KNOCKS[:2]]
    fading = max(let_go(each.cylinder, each.tilt, duration=1.0).energy_error for each in (tall, flat))
    return (
        Comparison(
            "Fig. 3.15: frequency by the largest tilt (2, 5, 10 deg, the flat one)",
            "falls with it",
            ", ".join(f"{each:.1f}" for each in by_tilt) + " Hz",
            "agrees",
        ),
        Comparison(
            "Fig. 3.16: frequency by |phi'| (1, 2.5, 5 rev/s, the flat one)",
            "rises with it",
            ", ".join(f"{each:.2f}" for each in by_spin) + " Hz",
            "agrees from 2.5 rev/s; slower ones are a little faster than that again",
        ),
        Comparison(
            "Fig. 3.16: change of phi' from 0",
            "at most 0.09 rev/s",
            f"{span(still, 2)} rev/s (the flat one, table by {1e3 * SLIGHT:.2f} mm)",
            "of the same size; over a table at rest it comes down flat, so the thesis's moved",
        ),
        Comparison(
            "Figs. 3.17 and 3.18: four directions of the first lean, 2 and 5 deg",
            "hardly differ; labels of phi' from -2.5 to -2.35 rev/s",
            f"tilts {math.degrees(apart):.2g} deg apart; phi' {phi_range(poses)}",
            "agrees, over a table at rest",
        ),
        Comparison(
            "Fig. 3.19: which comes closest to standing, theta' or psi' = 100 deg/s (first and second panel)",
            "theta', very close",
            f"{least[0]:.2f} and {least[1]:.2f} deg (flat); {tall_least[0]:.2f} and {tall_least[1]:.2f} deg (tall)",
            f"not reproduced by the flat one, from {math.degrees(TILT):.0f} deg on a table at rest",
        ),
        Comparison(
            "Does the tilting fade? Error of the energy after 1 s, over the tilt's own",
            "it does not fade by itself",
            f"{fading:.0e}",
            "agrees: nothing takes energy from a rim that rolls",
        ),
    )
