"""Studies of the rigid reference: releases with a tilt, and the difference of the planar model, which presses evenly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy.rigid import housner
from studies.accuracy.rigid.body import RIM, Body, disc, prism
from studies.accuracy.rigid.motion import RESTITUTION, SAG, STEP, Plates, Start, level, simulate, touching
from vibgym.scene.parts import Part, shipped_part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

Progress = Callable[[str], Any]
Rows = list[dict[str, Any]]

BLOCKS = ("aluminium_block", "steel_block")
TRANSPORT = math.radians(270.0)
"""Phase of the vertical motion that carries parts along +x, thesis section 3.4."""

FIRST_SEED = 300_000


def body_of(part: Part, corners_only: bool = False) -> Body:
    """Return a part with straight edges as the reference's body, of uniform density."""
    return prism(part.outline, part.height, part.friction, mass=part.mass, corners_only=corners_only)


def transport(surface: Surface, share: float) -> Plates:
    """Return one wide plate on the surface's motion, at a share of the largest vertical amplitude."""
    scale = share * surface.full_scale
    return level(
        1, 1, scale * math.cos(TRANSPORT), scale * math.sin(TRANSPORT), size=4.0, amplitude=surface.horizontal_amplitude,
        frequency=surface.angular_frequency, gravity=surface.gravity, ramp=0.0,
    )  # fmt: skip


def idle(surface: Surface, friction: float) -> tuple[float, float]:
    """Return the velocity, m/s, of a part that slides in place."""
    x, y = surface.idle_velocity(friction)
    return float(x), float(y)


def tilted_starts(body: Body, plates: Plates, tilt: float, count: int, velocity: np.ndarray) -> list[Start]:
    """Return bodies in the middle of one wide plate, tilted by ``tilt`` rad towards evenly spread directions, touching it.

    Headings are drawn.
    """
    rng = np.random.default_rng(FIRST_SEED)
    found = []
    for k in range(count):
        heading = rng.uniform(-math.pi, math.pi)
        lean = heading + 2.0 * math.pi * (k + rng.uniform()) / count
        found.append(touching(body, plates, 2.0, 2.0, heading, tilt, lean, (float(velocity[0]), float(velocity[1]))))
    return found


def rocking(progress: Progress) -> Rows:
    """Measure Housner's block with decreasing sag."""
    found = []
    for slenderness in (3.0, 2.0):
        for sag in (8e-7, 2e-7, 5e-8):
            progress(f"Housner, {slenderness:g}, sag {sag:g} m")
            share, wanted = housner.measured(slenderness, sag), housner.expected(slenderness)
            found.append({"slenderness": slenderness, "sag_um": 1e6 * sag, "left": share, "wanted": wanted})
    return found


# -- releases ----------------------------------------------------------------------------------------------------------

TILTS = (1.0, 3.0, 5.0)  # deg
DRIVES = {"table only": 0.0, "half": 0.5, "full": 1.0}
HEADING_TIMES = (0.2, 1.0)  # s
STARTS = 48
SLENDER_STARTS = 8
SLENDER_TILT = 5.0  # deg
DISC_RADIUS, HALF_WIDTH, FRICTION = 0.020, 0.010, 0.6
DISC_RATIOS = (0.25, 0.4, 0.5, 0.7, 0.9, 1.25)
SQUARE_RATIOS = (1.0, 1.2, 1.4)


class Release(NamedTuple):
    """Statistics over starts of one part, tilt and drive.

    Attributes:
        variant: difference from the default reference, or "".
        landing_ms, landing_95_ms: median and 95th percentile of the time from release to the first quiet period.
        spin: rad/s, standard deviation about zero of the spin at landing.
        heading: deg, standard deviation of the change of heading after each of :data:`HEADING_TIMES`.
        heading_shift: deg, its mean, likewise.
        tilted: number of bodies that had not landed 1 s after the release.
        toppled: number of bodies that fell over.
    """

    part: str
    tilt_deg: float
    drive: str
    variant: str
    starts: int
    landing_ms: float | None
    landing_95_ms: float | None
    spin: float | None
    heading: list[float]
    heading_shift: list[float]
    tilted: int
    toppled: int


def release(
    name: str, body: Body, tilt: float, drive: str, starts: int, variant: str = "", *, step: float = STEP, sag: float = SAG,
    restitution: float = RESTITUTION,
) -> Release:  # fmt: skip
    """Return the statistics of a body released from ``tilt`` deg on a level surface."""
    surface = Surface()
    plates = transport(surface, DRIVES[drive])
    velocity = surface.idle_velocity(body.friction)
    begins = tilted_starts(body, plates, math.radians(tilt), starts, velocity)
    duration = HEADING_TIMES[-1] + plates.period  # a landing at 1 s is detected a period later
    tracks = [simulate(body, plates, each, duration, step=step, sag=sag, restitution=restitution) for each in begins]
    landed = [each for each in tracks if each.landing <= HEADING_TIMES[-1]]
    at = [round(time / plates.period) for time in HEADING_TIMES]
    turned = np.degrees([[track.heading[k] - track.heading[0] for k in at] for track in tracks])
    times = 1e3 * np.array([track.landing for track in landed])
    return Release(
        name, tilt, drive, variant, starts,
        float(np.median(times)) if landed else None,
        float(np.quantile(times, 0.95)) if landed else None,
        float(np.sqrt(np.mean([track.landing_spin**2 for track in landed]))) if landed else None,
        turned.std(axis=0, ddof=1).tolist(), turned.mean(axis=0).tolist(),
        len(tracks) - len(landed), sum(track.toppled for track in tracks),
    )  # fmt: skip


def blocks(progress: Progress) -> Rows:
    """Measure both blocks from every tilt, under every drive; and the influence of the reference's constants."""
    found = []
    for name in BLOCKS:
        body = body_of(shipped_part(name))
        for tilt in TILTS:
            for drive in DRIVES:
                progress(f"{name}, {tilt:g} deg, {drive}")
                found.append(release(name, body, tilt, drive, STARTS))
        corners = body_of(shipped_part(name), corners_only=True)
        for variant, (other, knobs) in {
            "half the step": (body, {"step": STEP / 2}),
            "four times stiffer": (body, {"sag": SAG / 4, "step": STEP / 2}),
            "on four corners": (corners, {}),
            "restitution 0": (body, {"restitution": 0.0}),
            "restitution 0.5": (body, {"restitution": 0.5}),
        }.items():
            progress(f"{name}, 3 deg, full, {variant}")
            found.append(release(name, other, 3.0, "full", STARTS, variant, **knobs))
    return [each._asdict() for each in found]


def slender(progress: Progress) -> Rows:
    """Measure discs and square blocks by height: number still tilted 1 s after the release."""
    found = []
    stiffer: dict[str, Any] = {"variant": "four times stiffer", "sag": SAG / 4, "step": STEP / 2}
    for drive in ("table only", "full"):
        for ratio in DISC_RATIOS:
            progress(f"disc {ratio:g}, {drive}")
            body, finer = (disc(DISC_RADIUS, 2 * ratio * DISC_RADIUS, FRICTION, rim=rim) for rim in (RIM, 2 * RIM))
            more: dict[str, Any] = {"variant": f"{2 * RIM} points on the rim"}
            for each, knobs in ((body, {}), (finer, more), (body, stiffer)):
                found.append(release(f"disc {ratio:g}", each, SLENDER_TILT, drive, SLENDER_STARTS, **knobs))
        for ratio in SQUARE_RATIOS:
            progress(f"square {ratio:g}, {drive}")
            outline = HALF_WIDTH * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
            body = prism(outline, 2 * ratio * HALF_WIDTH, FRICTION)
            for knobs in ({}, stiffer):
                found.append(release(f"square {ratio:g}", body, SLENDER_TILT, drive, SLENDER_STARTS, **knobs))
    return [each._asdict() for each in found]


# -- fields ------------------------------------------------------------------------------------------------------------

AMPLITUDES = (1.0, 0.25, 0.1)
FIELDS = 24
DURATION = 1.0  # s
RAMP = 3e-3  # m
UNIFORM_PERIODS = 10
FINE = {"steps": 64, "substeps": 2, "pieces": 2}
"""Knobs of the planar model with negligible step error."""


class Gap(NamedTuple):
    """Differences after :data:`DURATION`, medians over fields.

    Attributes:
        amplitude: share of the largest.
        travel_mm: displacement of the planar model's part.
        gap_mm, gap_deg, gap_95_mm, gap_95_deg: planar model and reference, and 95th percentiles.
        step_mm, step_deg: reference against itself with half the step.
        stiff_mm, stiff_deg: reference at half the step against itself four times stiffer.
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
    """Return the final pose (x, y, heading) of the planar model, from the velocity of sliding in place."""
    simulator = Simulator(surface, part, threads=1, **knobs)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    simulator.advance(np.hypot(c, s) / surface.angular_frequency**2, np.arctan2(s, c), periods)
    return simulator.pose.reshape(3)


def rigid_pose(
    surface: Surface, part: Part, c: np.ndarray, s: np.ndarray, pose: np.ndarray, periods: int, *, step: float = STEP,
    sag: float = SAG,
) -> tuple[np.ndarray, float, bool]:  # fmt: skip
    """Return the final pose of the reference, its largest tilt (rad) and whether it toppled."""
    body, velocity = body_of(part), idle(surface, part.friction)
    plates = Plates(
        c, s, surface.element_size, surface.horizontal_amplitude, surface.angular_frequency, surface.gravity, RAMP
    )  # fmt: skip
    start = touching(body, plates, *map(float, pose), velocity=velocity, sag=sag)
    track = simulate(body, plates, start, periods * surface.period, step=step, sag=sag)
    turned = pose[2] + track.heading[-1] - track.heading[0]
    return np.array([*track.position[-1, :2], turned]), track.largest_tilt, track.toppled


def uniform(progress: Progress) -> Rows:
    """Measure full transport."""
    found = []
    for name in BLOCKS:
        progress(f"uniform, {name}")
        found.append({"part": name, **uniform_gap(shipped_part(name))})
    return found


def uniform_gap(part: Part, periods: int = UNIFORM_PERIODS) -> dict[str, float]:
    """Return the displacement in full transport, and the difference of planar model and reference as a share of it."""
    surface = Surface()
    shape = (surface.rows, surface.columns)
    c, s = (np.full(shape, surface.full_scale * f(TRANSPORT)) for f in (math.cos, math.sin))
    pose = np.array([0.3, 0.1, 0.0])
    planar = planar_pose(surface, part, c, s, pose, periods, **FINE)
    rigid, half = (rigid_pose(surface, part, c, s, pose, periods, step=step)[0] for step in (STEP, STEP / 2))
    way = float(np.hypot(*(planar - pose)[:2]))
    off, own = (float(np.hypot(*(b - a)[:2])) / way for a, b in ((planar, rigid), (rigid, half)))
    return {"way_mm": 1e3 * way, "gap": off, "step": own, "turned_deg": math.degrees(abs(rigid[2] - planar[2]))}


def random_fields(progress: Progress) -> Rows:
    """Measure random amplitude and phase of every plate, for both blocks and all amplitudes."""
    return [_gap(name, amplitude, progress)._asdict() for name in BLOCKS for amplitude in AMPLITUDES]


def _gap(name: str, amplitude: float, progress: Progress) -> Gap:
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
    return Gap(name, amplitude, FIELDS, lost, half[0], half[2], half[3], most[2], most[3], *half[4:])


STUDIES: dict[str, Callable[[Progress], Rows]] = {
    "housner": rocking,
    "uniform": uniform,
    "random_fields": random_fields,
    "blocks": blocks,
    "slender": slender,
}
