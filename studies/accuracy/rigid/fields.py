"""How far the planar model, which presses evenly, is from a rigid part: in uniform fields and in random ones."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from studies.accuracy.rigid.cases import BLOCKS, FIRST_SEED, TRANSPORT, body_of, plates_of
from studies.accuracy.rigid.motion import SAG, STEP, simulate, touching
from vibgym.scene.parts import Part, shipped_part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

AMPLITUDES = (1.0, 0.25, 0.1)
FIELDS = 24
DURATION = 1.0  # s
RAMP = 3e-3  # m
UNIFORM_PERIODS = 10
FINE = {"steps": 64, "substeps": 2, "pieces": 2}
"""Knobs of the planar model where its own steps should not count."""


@dataclass(frozen=True)
class Gap:
    """Differences after :data:`DURATION`, medians over fields.

    Attributes:
        amplitude: share of the largest.
        travel_mm: how far the planar model's part goes.
        gap_mm, gap_deg: planar model and reference.  gap_95_mm, gap_95_deg: 95th percentiles.
        step_mm, step_deg: reference and itself with half the step: what of it is reproducible.
        stiff_mm, stiff_deg: reference at half the step and itself four times stiffer.
        largest_tilt_deg: median of the reference's largest tilt.
        lost: fields in which the part fell, or toppled; they are left out.
    """

    part: str
    amplitude: float
    fields: int
    lost: int
    travel_mm: float
    gap_mm: float
    gap_deg: float
    gap_95_mm: float
    gap_95_deg: float
    step_mm: float
    step_deg: float
    stiff_mm: float
    stiff_deg: float
    largest_tilt_deg: float


def planar_pose(
    surface: Surface, part: Part, c: np.ndarray, s: np.ndarray, pose: np.ndarray, periods: int, **knobs: Any
) -> np.ndarray:
    """Pose (x, y, heading) that the planar model ends with, from the velocity of sliding in place."""
    simulator = Simulator(surface, part, threads=1, **knobs)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    simulator.advance(np.hypot(c, s) / surface.angular_frequency**2, np.arctan2(s, c), periods)
    return simulator.pose.reshape(3)


def rigid_pose(
    surface: Surface, part: Part, c: np.ndarray, s: np.ndarray, pose: np.ndarray, periods: int, *, ramp: float = RAMP,
    step: float = STEP, sag: float = SAG,
) -> tuple[np.ndarray, float, bool]:  # fmt: skip
    """The same of the reference, with its largest tilt (rad) and whether it toppled."""
    body, plates = body_of(part), plates_of(surface, c, s, ramp)
    velocity = surface.idle_velocity(part.friction)
    start = touching(body, plates, *map(float, pose), velocity=(float(velocity[0]), float(velocity[1])), sag=sag)
    track = simulate(body, plates, start, periods * surface.period, step=step, sag=sag)
    turned = pose[2] + track.heading[-1] - track.heading[0]
    return np.array([*track.position[-1, :2], turned]), track.largest_tilt, track.toppled


def uniform(progress: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Full transport: the difference as a share of the way."""
    found = []
    for name in BLOCKS:
        progress(f"uniform, {name}")
        found.append({"part": name, **uniform_gap(shipped_part(name))})
    return found


def uniform_gap(part: Part, periods: int = UNIFORM_PERIODS) -> dict[str, float]:
    """Way of a part in full transport, and how far the planar model and the reference differ, as a share of it."""
    surface = Surface()
    shape = (surface.rows, surface.columns)
    c, s = (np.full(shape, surface.full_scale * f(TRANSPORT)) for f in (math.cos, math.sin))
    pose = np.array([0.3, 0.1, 0.0])
    planar = planar_pose(surface, part, c, s, pose, periods, **FINE)
    rigid, half = (rigid_pose(surface, part, c, s, pose, periods, step=step)[0] for step in (STEP, STEP / 2))
    way = float(np.hypot(*(planar - pose)[:2]))
    off, own = (float(np.hypot(*(b - a)[:2])) / way for a, b in ((planar, rigid), (rigid, half)))
    return {"way_mm": 1e3 * way, "gap": off, "step": own, "turned_deg": math.degrees(abs(rigid[2] - planar[2]))}


def random_fields(progress: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Every plate with an amplitude and a phase of its own, drawn evenly, for both blocks and all amplitudes."""
    return [asdict(_gap(name, amplitude, progress)) for name in BLOCKS for amplitude in AMPLITUDES]


def _gap(name: str, amplitude: float, progress: Callable[[str], Any]) -> Gap:
    surface, part = Surface(), shipped_part(name)
    periods = round(DURATION / surface.period)
    rows, lost = [], 0
    for k in range(FIELDS):
        progress(f"random fields, {name}, amplitude {amplitude:g}: {k}")
        rng = np.random.default_rng([FIRST_SEED, k])  # the same fields at all amplitudes and for all parts
        shape = (surface.rows, surface.columns)
        size, phase = rng.uniform(0, amplitude * surface.full_scale, shape), rng.uniform(-math.pi, math.pi, shape)
        middle = np.array([surface.width, surface.depth]) * rng.uniform((0.2, 0.4), (0.8, 0.6))
        pose = np.array([*middle, rng.uniform(-math.pi, math.pi)])
        c, s = size * np.cos(phase), size * np.sin(phase)
        planar = planar_pose(surface, part, c, s, pose, periods)
        runs = [
            rigid_pose(surface, part, c, s, pose, periods, step=step, sag=sag)
            for step, sag in ((STEP, SAG), (STEP / 2, SAG), (STEP / 2, SAG / 4))
        ]
        if any(toppled for _, _, toppled in runs) or not np.isfinite(planar).all():
            lost += 1
            continue
        ends = [pose, planar, *(end for end, _, _ in runs)]
        moved = [(float(np.hypot(*(b - a)[:2])), abs(b[2] - a[2])) for a, b in zip(ends[:-1], ends[1:], strict=True)]
        rows.append([*(value for pair in moved for value in pair), runs[0][1]])
    table = np.array(rows) * ([1e3, math.degrees(1.0)] * 4 + [math.degrees(1.0)])
    half, most = np.median(table, axis=0).tolist(), np.quantile(table, 0.95, axis=0).tolist()
    way, (gap_mm, gap_deg, step_mm, step_deg, stiff_mm, stiff_deg, tilt) = half[0], half[2:]
    return Gap(
        name,
        amplitude,
        FIELDS,
        lost,
        way,
        gap_mm,
        gap_deg,
        most[2],
        most[3],
        step_mm,
        step_deg,
        stiff_mm,
        stiff_deg,
        tilt,
    )
