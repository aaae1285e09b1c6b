"""The kick by which planar models stand in for a tilt: ``python -m studies.tilting kick``.

Parts are let go from tilts on level ground. A kick of spin and velocity at once shall leave a planar part with the same
deviations of
heading and place a second later, and no more spin than they have after two periods, when all have landed: what unit kicks do is
measured with the planar model, and the deviations follow; what the spin leaves of the heading's is a turn at once. They are
printed per root of a degree, as :mod:`vibgym.physics.planar.kick` has them.
"""

from __future__ import annotations

import math

import numpy as np

from studies.tilting.releases import kicked, release
from vibgym import Part
from vibgym.scene.parts import shipped_part

PARTS = ("steel_block", "aluminium_block")
TILTS = (0.5, 1.0, 2.0, 3.0, 5.0)  # deg
SHARES = (0.0, 0.5, 1.0)
LANDED, LATER = 2, 25
"""Periods."""


def deviations(part: Part, tilt: float, share: float, worlds: int) -> tuple[float, float, float, float]:
    """Of spin after landing (rad/s), heading (rad) then and after a second, and each component of place after a second (m)."""
    track = release(part, math.radians(tilt), share, worlds, LATER, seed=round(10 * tilt))
    spin, then = track.spin[LANDED - 1].std(), track.heading[LANDED - 1].std()
    return float(spin), float(then), float(track.heading[-1].std()), float(track.way[-1].std(axis=0).mean())


def transfer(part: Part, share: float) -> tuple[float, float, float]:
    """What a kick of spin leaves of it after landing, the heading that it makes until a second later, and the way (m) that a
    kick of velocity (1 m/s) makes by then; small kicks, so that all is linear."""
    spin = kicked(part, np.array([0.0, 0.0, 0.0, 0.1]), share, 1.0, LATER)
    push = kicked(part, np.array([0.0, 0.01, 0.0, 0.0]), share, 1.0, LATER)
    return (
        float(spin.spin[LANDED - 1, 0]) / 0.1, float(spin.heading[-1, 0]) / 0.1,
        float(np.hypot(*push.way[-1, 0])) / 0.01,
    )  # fmt: skip


def fit(part: Part, tilt: float, share: float, worlds: int) -> tuple[float, float, float]:
    """Deviations of the kick: spin (rad/s), velocity (m/s), heading (rad)."""
    spin, _, later, way = deviations(part, tilt, share, worlds)
    kept, turned, travelled = transfer(part, share)
    kick = min(spin / kept, later / turned)
    return kick, way / travelled, math.sqrt(max(later * later - (turned * kick) ** 2, 0.0))


def main(worlds: int = 400) -> None:
    """Print the table and the figures per root of a degree."""
    print(
        "part, amplitude, tilt | spin at 80 ms, heading then, heading at 1 s, place at 1 s | kick: spin, velocity, heading"
    )
    rows = []
    for name in PARTS:
        part = shipped_part(name)
        for share in SHARES:
            for tilt in TILTS:
                spin, then, later, way = deviations(part, tilt, share, worlds)
                kick = fit(part, tilt, share, worlds)
                rows.append(np.array(kick) / math.sqrt(tilt))
                print(
                    f"{name:16} {share:.1f} {tilt:.1f} deg | {spin:.2f} rad/s {math.degrees(then):.2f} deg "
                    f"{math.degrees(later):.2f} deg {1e3 * way:.2f} mm | {kick[0]:.2f} rad/s {1e3 * kick[1]:.1f} mm/s "
                    f"{math.degrees(kick[2]):.2f} deg"
                )
    spin, velocity, heading = np.median(rows, axis=0)
    print(f"per root of a degree: SPIN {spin:.3g} rad/s, SPEED {velocity:.3g} m/s; of the heading {heading:.3g} rad")
