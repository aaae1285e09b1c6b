"""Parts released with a tilt on level ground: the equivalent impulse of planar models, and landing times.

``python -m studies.tilting impulse``: fit an impulse of spin and velocity that gives a planar part the same deviations of
heading and position after a second, and at most the spin after two periods, when all parts have landed. The planar model
gives the effect of unit impulses; the rest of the heading's deviation is an instantaneous rotation. Deviations are printed
per root of a degree, as in :mod:`vibgym.physics.planar.impulse`.

``python -m studies.tilting landing``: landing times and spreads of heading against the stored figures of the compliant
reference (:mod:`studies.accuracy.rigid`), whose spreads are accurate to a tenth (48 starts per case). The reference has 113
springs; a second landing time is computed with its four corners alone, the only possible contacts of a rigid bottom on level
ground.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from studies.accuracy import rigid
from studies.accuracy.rigid.motion import simulate
from studies.accuracy.rigid.studies import BLOCKS, DRIVES, STARTS, TRANSPORT, body_of, tilted_starts, transport
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

SURFACE = Surface(rows=32, columns=32)
"""Large enough that no part reaches a border within a second."""

TILTS = (0.5, 1.0, 2.0, 3.0, 5.0)  # deg
SHARES = (0.0, 0.5, 1.0)
LANDED, LATER = 2, 25
"""Periods."""

LONG_ENOUGH = 0.16
"""s, a period after all have landed."""


class Track(NamedTuple):
    """Effect of a disturbance at the end of every period: differences from the same part undisturbed."""

    heading: np.ndarray  # (periods, worlds) rad
    way: np.ndarray  # (periods, worlds, 2) m
    spin: np.ndarray  # (periods, worlds) rad/s


def starts(part: Part, worlds: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Return poses (worlds, 1, 3) in the middle of the table, any heading, and velocities of a part that idles."""
    pose = np.zeros((worlds, 1, 3))
    pose[..., :2] = 0.5 * SURFACE.width
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, 1))
    return pose, np.append(SURFACE.idle_velocity(part.friction), 0.0)


def leans(tilt: float, worlds: int, rng: np.random.Generator) -> np.ndarray:
    """Return tilts (worlds, 1, 2) rad in any direction."""
    way = rng.uniform(-math.pi, math.pi, (worlds, 1))
    return tilt * np.stack([np.cos(way), np.sin(way)], axis=-1)


def release(part: Part, tilt: float, share: float, worlds: int, periods: int, seed: int) -> Track:
    """Return the effect of a tilt (rad) on plates with equal motion at a share of the largest amplitude."""
    rng = np.random.default_rng(seed)
    pose, velocity = starts(part, worlds, rng)
    tipped, calm = (Simulator(SURFACE, part, worlds=worlds, model="tilting") for _ in range(2))
    for simulator in (tipped, calm):
        simulator.reset(pose, velocity)
    tipped.tip(slice(None), leans(tilt, worlds, rng))
    return follow(tipped, calm, share, rng.uniform(-math.pi, math.pi), periods)


def after_impulse(part: Part, impulse: np.ndarray, share: float) -> Track:
    """Return the effect of an impulse (velocity x and y, spin) on a part of the planar model."""
    pose, velocity = starts(part, 1, np.random.default_rng(0))
    disturbed, calm = (Simulator(SURFACE, part) for _ in range(2))
    calm.reset(pose, velocity)
    disturbed.reset(pose, velocity + impulse)
    return follow(disturbed, calm, share, 1.0, LATER)


def follow(disturbed: Simulator, calm: Simulator, share: float, phase: float, periods: int) -> Track:
    """Advance both simulators and return their differences."""
    amplitude = share * (SURFACE.max_amplitude or 0.0)
    states = []
    for _ in range(periods):
        for simulator in (disturbed, calm):
            simulator.advance(amplitude, phase)
        pose, velocity = disturbed.pose - calm.pose, disturbed.velocity - calm.velocity
        states.append((pose[:, 0, 2], pose[:, 0, :2], velocity[:, 0, 2]))
    return Track(*(np.array(series) for series in zip(*states, strict=True)))


# -- impulse --------------------------------------------------------------------------------------------------------------


def deviations(part: Part, tilt: float, share: float, worlds: int) -> tuple[float, float, float, float]:
    """Return deviations: spin after landing (rad/s), heading (rad) then and after a second, position after a second (m)."""
    track = release(part, math.radians(tilt), share, worlds, LATER, seed=round(10 * tilt))
    spin, then = track.spin[LANDED - 1].std(), track.heading[LANDED - 1].std()
    return float(spin), float(then), float(track.heading[-1].std()), float(track.way[-1].std(axis=0).mean())


def transfer(part: Part, share: float) -> tuple[float, float, float]:
    """Return the effect of unit impulses, from small ones: share of the spin after landing, heading after a second, and
    displacement (m) after a second by an impulse of 1 m/s."""
    spin = after_impulse(part, np.array([0.0, 0.0, 0.1]), share)
    push = after_impulse(part, np.array([0.01, 0.0, 0.0]), share)
    kept, turned = float(spin.spin[LANDED - 1, 0]) / 0.1, float(spin.heading[-1, 0]) / 0.1
    return kept, turned, float(np.hypot(*push.way[-1, 0])) / 0.01


def impulse(worlds: int = 400) -> None:
    """Print the table and the deviations of the impulse per root of a degree."""
    print(
        "part, amplitude, tilt | spin at 80 ms, heading then, heading at 1 s, place at 1 s | impulse: spin, velocity, heading"
    )
    rows = []
    for name in reversed(BLOCKS):
        part = shipped_part(name)
        for share in SHARES:
            kept, turned, travelled = transfer(part, share)
            for tilt in TILTS:
                spin, then, later, way = deviations(part, tilt, share, worlds)
                sudden = min(spin / kept, later / turned)
                turn = math.sqrt(max(later * later - (turned * sudden) ** 2, 0.0))
                rows.append(np.array((sudden, way / travelled, turn)) / math.sqrt(tilt))
                print(
                    f"{name:16} {share:.1f} {tilt:.1f} deg | {spin:.2f} rad/s {math.degrees(then):.2f} deg "
                    f"{math.degrees(later):.2f} deg {1e3 * way:.2f} mm | {sudden:.2f} rad/s "
                    f"{1e3 * way / travelled:.1f} mm/s {math.degrees(turn):.2f} deg"
                )
    spin, velocity, heading = np.median(rows, axis=0)
    print(f"per root of a degree: SPIN {spin:.3g} rad/s, SPEED {velocity:.3g} m/s; of the heading {heading:.3g} rad")


# -- landing -----------------------------------------------------------------------------------------------------------


def released(part: str, tilt: float, drive: str, worlds: int) -> tuple[float, float, float]:
    """Return median and largest landing time (ms) and deviation of the heading after a second (deg)."""
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
    """Return the median landing time (ms) of the reference on its corners alone."""
    body = body_of(shipped_part(part), corners_only=True)
    plates, velocity = transport(SURFACE, DRIVES[drive]), SURFACE.idle_velocity(body.friction)
    begins = tilted_starts(body, plates, math.radians(tilt), STARTS, velocity)
    return 1e3 * float(np.median([simulate(body, plates, begin, LONG_ENOUGH).landing for begin in begins]))


def landing(worlds: int = 400) -> None:
    """Print every case, and the ranges of the ratios."""
    ratios = []
    print("part, tilt, drive | landing: ours (longest), reference, on corners | heading after 1 s: ours, reference")
    for row in rigid.stored()["blocks"]["rows"]:
        if row["variant"]:
            continue
        median, longest, heading = released(row["part"], row["tilt_deg"], row["drive"], worlds)
        corners = on_corners(row["part"], row["tilt_deg"], row["drive"])
        ratios.append((median / row["landing_ms"], median / corners, heading / row["heading"][1]))
        case = f"{row['part']:16} {row['tilt_deg']:g} deg {row['drive']:10}"
        times = f"{median:5.1f} ({longest:5.1f}) {row['landing_ms']:5.1f} {corners:5.1f} ms"
        print(f"{case} | {times} | {heading:5.2f} {row['heading'][1]:5.2f} deg", flush=True)
    for name, column in zip(("landing", "landing, on corners", "heading"), np.array(ratios).T, strict=True):
        print(f"{name}: {column.min():.2f} to {column.max():.2f} of the reference, median {np.median(column):.2f}")
