"""Parts released with a tilt: how soon they land, and what that does to their heading; and which of them do not land."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from studies.accuracy.rigid.body import RIM, Body, disc, prism
from studies.accuracy.rigid.cases import BLOCKS, body_of, tilted_starts, transport
from studies.accuracy.rigid.motion import RESTITUTION, SAG, STEP, simulate
from vibgym.scene.parts import shipped_part
from vibgym.scene.surface import Surface

TILTS = (1.0, 3.0, 5.0)  # deg
DRIVES = {"table only": 0.0, "half": 0.5, "full": 1.0}
HEADING_TIMES = (0.2, 1.0)  # s
STARTS = 48
SLENDER_STARTS = 8
SLENDER_TILT = 5.0  # deg
DISC_RADIUS, HALF_WIDTH, FRICTION = 0.020, 0.010, 0.6
DISC_RATIOS = (0.25, 0.4, 0.5, 0.7, 0.9, 1.25)
SQUARE_RATIOS = (1.0, 1.2, 1.4)


@dataclass(frozen=True)
class Release:
    """Statistics over starts of one part, tilt and drive.

    Attributes:
        variant: what differs from the reference as it comes; empty for nothing.
        landing_ms, landing_95_ms: median and 95th percentile of the time from release to the first quiet period.
        spin: rad/s, standard deviation about zero of the spin at landing.
        heading: deg, standard deviation of the change of heading after each of :data:`HEADING_TIMES`.
        heading_shift: deg, its mean, likewise.
        tilted: how many had not landed 1 s after the release.  toppled: how many fell over.
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
    """Release a body from ``tilt`` deg on a level surface."""
    surface = Surface()
    plates = transport(surface, DRIVES[drive])
    velocity = surface.idle_velocity(body.friction)
    begins = tilted_starts(body, plates, math.radians(tilt), starts, velocity)
    duration = HEADING_TIMES[-1] + plates.period  # a landing at 1 s is seen a period later
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


def blocks(progress: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Both blocks of the thesis, from every tilt, under every drive; and what the reference's own choices are worth."""
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
    return [asdict(each) for each in found]


def slender(progress: Callable[[str], Any]) -> list[dict[str, Any]]:
    """Discs and square blocks by height: how many are still tilted 1 s after the release."""
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
    return [asdict(each) for each in found]
