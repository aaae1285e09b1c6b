"""Studies of the rigid reference: releases with a tilt, and the difference of the planar model, which presses evenly."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

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
    starts = []
    for k in range(count):
        heading = rng.uniform(-math.pi, math.pi)
        lean = heading + 2.0 * math.pi * (k + rng.uniform()) / count
        starts.append(touching(body, plates, 2.0, 2.0, heading, tilt, lean, (float(velocity[0]), float(velocity[1]))))
    return starts


def rocking(progress: Progress) -> Rows:
    """Measure Housner's block with decreasing sag."""
    progress("Housner")
    return [
        {
            "slenderness": slenderness, "sag_um": 1e6 * sag, "left": housner.measured(slenderness, sag),
            "wanted": housner.expected(slenderness),
        }
        for slenderness in (3.0, 2.0) for sag in (8e-7, 2e-7, 5e-8)
    ]  # fmt: skip


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


def release(
    name: str, body: Body, tilt: float, drive: str, starts: int, variant: str = "", *, step: float = STEP, sag: float = SAG,
    restitution: float = RESTITUTION,
) -> dict[str, Any]:  # fmt: skip
    """Return statistics of a body released from ``tilt`` deg on a level surface.

    Landing times (ms, from release to the first quiet period) and the spin then (rad/s, standard deviation about zero) are
    None if no body lands. ``heading`` and ``heading_shift`` are standard deviation and mean of its change (deg) after each
    of :data:`HEADING_TIMES`; ``tilted`` bodies have not landed 1 s after the release. ``variant`` names differences from the
    default reference.
    """
    surface = Surface()
    plates = transport(surface, DRIVES[drive])
    velocity = surface.idle_velocity(body.friction)
    begins = tilted_starts(body, plates, math.radians(tilt), starts, velocity)
    duration = HEADING_TIMES[-1] + plates.period  # a landing at 1 s is detected a period later
    tracks = [simulate(body, plates, start, duration, step=step, sag=sag, restitution=restitution) for start in begins]
    landed = [track for track in tracks if track.landing <= HEADING_TIMES[-1]]
    at = [round(time / plates.period) for time in HEADING_TIMES]
    turned = np.degrees([[track.heading[k] - track.heading[0] for k in at] for track in tracks])
    times = 1e3 * np.array([track.landing for track in landed])
    return {
        "part": name,
        "tilt_deg": tilt,
        "drive": drive,
        "variant": variant,
        "starts": starts,
        "landing_ms": float(np.median(times)) if landed else None,
        "landing_95_ms": float(np.quantile(times, 0.95)) if landed else None,
        "spin": float(np.sqrt(np.mean([track.landing_spin**2 for track in landed]))) if landed else None,
        "heading": turned.std(axis=0, ddof=1).tolist(),
        "heading_shift": turned.mean(axis=0).tolist(),
        "tilted": len(tracks) - len(landed),
        "toppled": sum(track.toppled for track in tracks),
    }


STIFFER: dict[str, Any] = {"variant": "four times stiffer", "sag": SAG / 4, "step": STEP / 2}


def blocks(progress: Progress) -> Rows:
    """Measure both blocks from every tilt, under every drive; and the influence of the reference's constants."""
    rows = []
    for name in BLOCKS:
        body, corners = (body_of(shipped_part(name), corners_only=only) for only in (False, True))
        progress(name)
        rows += [release(name, body, tilt, drive, STARTS) for tilt in TILTS for drive in DRIVES]
        variants: list[tuple[Body, dict[str, Any]]] = [
            (body, {"variant": "half the step", "step": STEP / 2}),
            (body, STIFFER),
            (corners, {"variant": "on four corners"}),
            (body, {"variant": "restitution 0", "restitution": 0.0}),
            (body, {"variant": "restitution 0.5", "restitution": 0.5}),
        ]
        for other, knobs in variants:
            progress(f"{name}, 3 deg, full, {knobs['variant']}")
            rows.append(release(name, other, 3.0, "full", STARTS, **knobs))
    return rows


def slender(progress: Progress) -> Rows:
    """Measure discs and square blocks by height: number still tilted 1 s after the release."""
    rows = []
    square = HALF_WIDTH * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    for drive in ("table only", "full"):
        for ratio in DISC_RATIOS:
            progress(f"disc {ratio:g}, {drive}")
            body, finer = (disc(DISC_RADIUS, 2 * ratio * DISC_RADIUS, FRICTION, rim=rim) for rim in (RIM, 2 * RIM))
            more: dict[str, Any] = {"variant": f"{2 * RIM} points on the rim"}
            for other, knobs in ((body, {}), (finer, more), (body, STIFFER)):
                rows.append(release(f"disc {ratio:g}", other, SLENDER_TILT, drive, SLENDER_STARTS, **knobs))
        for ratio in SQUARE_RATIOS:
            progress(f"square {ratio:g}, {drive}")
            body = prism(square, 2 * ratio * HALF_WIDTH, FRICTION)
            for knobs in ({}, STIFFER):
                rows.append(release(f"square {ratio:g}", body, SLENDER_TILT, drive, SLENDER_STARTS, **knobs))
    return rows


# -- fields ------------------------------------------------------------------------------------------------------------

AMPLITUDES = (1.0, 0.25, 0.1)
FIELDS = 24
DURATION = 1.0  # s
RAMP = 3e-3  # m
UNIFORM_PERIODS = 10
FINE = {"steps": 64, "substeps": 2, "pieces": 2}
"""Knobs of the planar model with negligible step error."""


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
    progress("uniform")
    return [{"part": name, **uniform_gap(shipped_part(name))} for name in BLOCKS]


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
    return [_gap(name, amplitude, progress) for name in BLOCKS for amplitude in AMPLITUDES]


def _gap(name: str, amplitude: float, progress: Progress) -> dict[str, Any]:
    """Return medians over fields of random amplitude, up to a share of the largest, and phase, after :data:`DURATION`.

    ``travel``: displacement of the planar model's part. ``gap``: planar model and reference, with 95th percentiles. ``step``:
    the reference against itself with half the step. ``stiff``: that against itself four times stiffer. Fields in which a part
    is ``lost`` (it fell or toppled) are left out.
    """
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
        moved = np.diff([pose, planar, *(end for end, _, _ in runs)], axis=0)
        rows.append([*np.hypot(*moved[:, :2].T), *np.abs(moved[:, 2]), runs[0][1]])
    table = np.array(rows) * ([1e3] * 4 + [math.degrees(1.0)] * 5)
    median, most = np.median(table, axis=0).tolist(), np.quantile(table, 0.95, axis=0).tolist()
    travel, gap, step, stiff, _, gap_deg, step_deg, stiff_deg, tilt = median
    return {
        "part": name, "amplitude": amplitude, "fields": FIELDS, "lost": lost, "travel_mm": travel, "gap_mm": gap,
        "gap_deg": gap_deg, "gap_95_mm": most[1], "gap_95_deg": most[5], "step_mm": step, "step_deg": step_deg,
        "stiff_mm": stiff, "stiff_deg": stiff_deg, "largest_tilt_deg": tilt,
    }  # fmt: skip


STUDIES: dict[str, Callable[[Progress], Rows]] = {
    "housner": rocking,
    "uniform": uniform,
    "random_fields": random_fields,
    "blocks": blocks,
    "slender": slender,
}
