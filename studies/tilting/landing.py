"""Landing times and spreads of heading against the compliant reference: ``python -m studies.tilting landing``.

The reference's figures are those that are stored (:mod:`studies.accuracy.rigid`): 48 starts a case, so that its spreads are
good to a tenth. It stands on 113 springs; beside them, computed here, how soon it lands on its four corners alone, which are
all that can touch of a rigid bottom above level ground.
"""

from __future__ import annotations

import math

import numpy as np

from studies.accuracy.rigid import stored
from studies.accuracy.rigid.cases import TRANSPORT, body_of, tilted_starts, transport
from studies.accuracy.rigid.motion import simulate
from studies.accuracy.rigid.releases import DRIVES, STARTS
from studies.tilting.releases import SURFACE, leans, starts
from vibgym import Simulator
from vibgym.scene.parts import shipped_part

LONG_ENOUGH = 0.16
"""s, by which all have landed, and a period more."""


def released(part: str, tilt: float, drive: str, worlds: int) -> tuple[float, float, float]:
    """Median and largest landing time (ms) and deviation of the heading after a second (deg)."""
    rng, body = np.random.default_rng(5), shipped_part(part)
    pose, velocity = starts(body, worlds, rng)
    simulator = Simulator(SURFACE, body, worlds=worlds, model="tilting")
    simulator.reset(pose, velocity)
    simulator.tip(slice(None), leans(math.radians(tilt), worlds, rng))
    simulator.advance(DRIVES[drive] * (SURFACE.max_amplitude or 0.0), TRANSPORT, 25)
    landing = 1e3 * simulator.time_tilted
    turned = (simulator.pose - pose)[:, 0, 2]
    return float(np.median(landing)), float(landing.max()), math.degrees(float(turned.std()))


def on_corners(part: str, tilt: float, drive: str) -> float:
    """ms, median landing time of the reference if it stands on its corners alone."""
    body = body_of(shipped_part(part), corners_only=True)
    plates, velocity = transport(SURFACE, DRIVES[drive]), SURFACE.idle_velocity(body.friction)
    begins = tilted_starts(body, plates, math.radians(tilt), STARTS, velocity)
    return 1e3 * float(np.median([simulate(body, plates, each, LONG_ENOUGH).landing for each in begins]))


def main(worlds: int = 400) -> None:
    """Print every case, and the ratios' ranges."""
    ratios = []
    print("part, tilt, drive | landing: ours (longest), reference, on corners | heading after 1 s: ours, reference")
    for row in stored.load()["blocks"]["rows"]:
        if row["variant"]:
            continue
        median, longest, heading = released(row["part"], row["tilt_deg"], row["drive"], worlds)
        corners = on_corners(row["part"], row["tilt_deg"], row["drive"])
        ratios.append((median / row["landing_ms"], median / corners, heading / row["heading"][1]))
        case = f"{row['part']:16} {row['tilt_deg']:g} deg {row['drive']:10}"
        landing = f"{median:5.1f} ({longest:5.1f}) {row['landing_ms']:5.1f} {corners:5.1f} ms"
        print(f"{case} | {landing} | {heading:5.2f} {row['heading'][1]:5.2f} deg", flush=True)
    for name, column in zip(("landing", "landing, on corners", "heading"), np.array(ratios).T, strict=True):
        print(f"{name}: {column.min():.2f} to {column.max():.2f} of the reference, median {np.median(column):.2f}")
