"""Checks of poses: centres on the surface, parts that do not overlap."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.physics.contacts.hulls import Hulls, all_gaps, load_hulls, place_hulls, wall_gap
from vibgym.scene.hulls import WALLS
from vibgym.scene.kinds import Kinds
from vibgym.scene.surface import Surface

AT_REST = 1e-4
"""m, largest overlap of a start: that of parts at rest in contact."""

IN_MOTION = 1e-3
"""m, largest overlap in a state of a simulation with contacts."""


def apart(surface: Surface, parts: int) -> np.ndarray:
    """Return poses (parts, 3) of parts before the first reset: a single one in the middle, several in a row or a grid."""
    columns = int(np.ceil(np.sqrt(parts * surface.width / surface.depth)))
    rows = -(-parts // columns)
    index = np.arange(parts)
    x = (index % columns + 0.5) * surface.width / columns
    y = (index // columns + 0.5) * surface.depth / rows
    if parts == 1:
        x, y = np.array([0.5 * surface.width]), np.array([0.5 * surface.depth])
    return np.column_stack([x, y, np.zeros(parts)])


def check_centres(name: str, pose: np.ndarray, surface: Surface) -> None:
    """Check that the centres of poses (..., 3) are on the surface.

    Raises:
        ValueError: names the first of them.
    """
    off = (pose[..., 0] < 0) | (pose[..., 0] > surface.width) | (pose[..., 1] < 0) | (pose[..., 1] > surface.depth)
    if off.any():
        allowed = f"centres on the surface, x in [0, {surface.width:g}] and y in [0, {surface.depth:g}]"
        raise checks.refuse(name, pose[off][0].tolist(), allowed)


def check(
    name: str,
    hulls: Hulls,
    surface: Surface,
    parts: Kinds,
    walls: Sequence[str],
    pose: np.ndarray,
    away: np.ndarray,
    allowed: float,
) -> None:
    """Check that parts do not overlap at their poses.

    Args:
        name: of the argument.
        pose: (worlds, parts, 3).
        away: (worlds, parts) bool, parts that are not checked.
        allowed: m of overlap; of small parts at most a quarter of their radius, half of it in motion.

    Raises:
        ValueError: the deepest overlap is too deep; names world, parts and amount.
    """
    worlds, n = pose.shape[:2]
    share = (0.25 if allowed <= AT_REST else 0.5) * np.broadcast_to(hulls.every.radius[parts.kind], (worlds, n))
    if n > 1:
        gaps = np.empty((worlds, n, n))
        all_gaps(hulls, np.ascontiguousarray(pose), gaps)
        gaps[away] = np.inf
        gaps.transpose(0, 2, 1)[away] = np.inf
        excess = gaps + np.minimum(allowed, np.minimum(share[:, :, None], share[:, None, :]))
        if excess.min() < 0.0:
            world, i, j = (int(k) for k in np.unravel_index(int(excess.argmin()), excess.shape))
            other = parts.parts(world)[j].name
            raise _refuse(name, world, parts, i, f"part {j} ({other!r})", -gaps[world, i, j])
    placed = np.empty_like(hulls.corner)
    for wall in walls:
        for world, part in np.argwhere(~away).tolist():
            load_hulls(hulls, world)
            place_hulls(hulls, part, *pose[world, part], placed)
            gap = wall_gap(hulls, placed, part, WALLS.index(wall), surface.width, surface.depth)
            if gap < -min(allowed, share[world, part]):
                raise _refuse(name, world, parts, part, f"the {wall} wall", -gap)


def _refuse(name: str, world: int, parts: Kinds, i: int, other: str, amount: float) -> checks.Refused:
    got = f"part {i} ({parts.parts(world)[i].name!r}) and {other} overlapping by {1e3 * amount:.3g} mm in world {world}"
    return checks.Refused(f"{name}: got {got}; allowed: parts that do not overlap (touching is allowed)")
