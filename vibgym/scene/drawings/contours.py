"""Strokes of a drawing: flattened, joined to closed contours, and nested to an outline with holes; lengths in mm."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.scene import outlines

SAMPLES = 1024
"""Samples of a full turn, or of a curve, before it is flattened."""

SAGITTA = 0.75
"""Largest sagitta of a chord over the tolerance: balancing moves corners by up to 4/3 of it."""

SMOOTH, SHARP = 0.02, 1.0
"""rad: turns at joints of two curves that are still smooth, and from which on a corner of chords is not moved."""


class Stroke(NamedTuple):
    """A line or curve of a drawing.

    Attributes:
        points: (n, 2) mm, fine samples; two of a line.
        curved: whether it is a curve.
        label: where it is in the file, such as ``LINE 2F``.
    """

    points: np.ndarray
    curved: bool
    label: str


class Contour(NamedTuple):
    """A closed contour, counter-clockwise.

    Attributes:
        points: (n, 2) mm.
        labels: of the stroke of each edge.
    """

    points: np.ndarray
    labels: list[str]


def outline_of(strokes: list[Stroke], tolerance: float, gap: float) -> list[np.ndarray]:
    """Return the outline of a part (n, 2) mm, counter-clockwise, and then its holes, clockwise.

    Args:
        tolerance: mm, of flattened curves.
        gap: mm, between ends that are joined.

    Raises:
        ValueError: no strokes, or not exactly one part.
    """
    if not strokes:
        raise checks.conflict("the drawing has no outline: no lines or curves")
    contours = [flattened(loop, tolerance) for loop in loops(strokes, gap)]
    for contour in contours:
        if len(contour.points) > outlines.MOST_CORNERS:
            raise checks.conflict(
                f"the contour with {contour.labels[0]} has {len(contour.points)} corners, more than "
                f"{outlines.MOST_CORNERS}: simplify it or give a larger tolerance_mm"
            )
    _check_crossings(contours)
    return _nested(contours)


def loops(strokes: list[Stroke], gap: float) -> list[list[Stroke]]:
    """Return the closed loops of strokes, each turned so that it begins where the one before ends.

    Raises:
        ValueError: a stroke without length, duplicates, an open end, or more than two strokes that meet.
    """
    for stroke in strokes:
        if np.hypot(*np.diff(stroke.points, axis=0).T).sum() <= gap:
            raise checks.conflict(f"{stroke.label} has no length")
    open_ones = [each for each in strokes if np.hypot(*(each.points[-1] - each.points[0])) > gap]
    _check_duplicates(strokes, gap)
    ends = np.array([point for each in open_ones for point in (each.points[0], each.points[-1])]).reshape(-1, 2)
    partner = np.full(len(ends), -1)
    for k, end in enumerate(ends):
        away = np.hypot(*(ends - end).T)
        near = np.flatnonzero(away <= gap)
        if len(near) > 2:
            names = ", ".join(dict.fromkeys(open_ones[j // 2].label for j in near))
            raise checks.conflict(f"{len(near)} ends meet at {_place(end)}: {names}")
        if len(near) < 2:
            away[k] = np.inf
            label, other = open_ones[k // 2].label, open_ones[int(away.argmin()) // 2].label
            raise checks.conflict(
                f"open contour: {label} ends at {_place(end)}, {away.min():.3g} mm from the next end, of {other}"
            )
        partner[k] = near[0] if near[1] == k else near[1]
    found = [[each] for each in strokes if np.hypot(*(each.points[-1] - each.points[0])) <= gap]
    left = set(range(len(open_ones)))
    while left:
        first = at = min(left)
        loop, end = list[Stroke](), 2 * at + 1
        while at in left:
            left.remove(at)
            stroke = open_ones[at]
            loop.append(stroke if end % 2 else stroke._replace(points=stroke.points[::-1]))
            begin = int(partner[end])
            at, end = begin // 2, begin ^ 1
        assert at == first  # every end has one partner
        found.append(loop)
    return found


def _check_duplicates(strokes: list[Stroke], gap: float) -> None:
    boxes = np.array([[*each.points.min(axis=0), *each.points.max(axis=0)] for each in strokes])
    for k, stroke in enumerate(strokes):
        for j in np.flatnonzero(np.abs(boxes[:k] - boxes[k]).max(axis=1) <= 10.0 * gap):
            other = strokes[j].points
            if _same(stroke.points, other, gap) or _same(stroke.points, other[::-1], gap):
                same = stroke.label == strokes[j].label
                what = "passes the same line twice" if same else f"duplicates {strokes[j].label}"
                raise checks.conflict(f"{stroke.label} {what}")


def _same(one: np.ndarray, other: np.ndarray, gap: float) -> bool:
    """Return whether two curves coincide at their ends and quarters; a closed one may begin anywhere."""
    picked = [each[np.linspace(0, len(each) - 1, 5).astype(int)] for each in (one, other)]
    if np.hypot(*(one[-1] - one[0])) <= gap:
        return all(np.hypot(*(other - point).T).min() <= 10.0 * gap for point in picked[0])
    return bool(np.hypot(*(picked[0] - picked[1]).T).max() <= gap)


def flattened(loop: list[Stroke], tolerance: float) -> Contour:
    """Return a loop as a polygon within the tolerance and with its area.

    Curves become chords of half their samples, of a quarter, and so on; corners between two chords of a curve are then moved
    to its outer side by the area that the chords cut off.
    """
    corners, labels, lost, curved, owner = list[np.ndarray](), list[str](), list[float](), list[bool](), list[int]()
    for k, stroke in enumerate(loop):
        at = _chords(stroke.points, SAGITTA * tolerance) if stroke.curved else list(range(len(stroke.points)))
        for a, b in zip(at, at[1:], strict=False):
            corners.append(stroke.points[a])
            labels.append(stroke.label)
            curved.append(stroke.curved)
            owner.append(k)
            lost.append(outlines.signed_area(stroke.points[a : b + 1] - stroke.points[a]) if b > a + 1 else 0.0)
    points, areas, round_ = np.array(corners), np.array(lost), np.array(curved)
    along = np.roll(points, -1, axis=0) - points
    angle = np.arctan2(along[:, 1], along[:, 0])
    turn = np.abs((angle - np.roll(angle, 1) + np.pi) % (2.0 * np.pi) - np.pi)
    joint = np.array(owner) != np.roll(owner, 1)
    joint[0] = True
    # At a joint of two curves without a corner, the outline turns by no more than beside it.
    usual = np.maximum(np.roll(turn, 1), np.roll(turn, -1))
    free = round_ & np.roll(round_, 1) & (turn < SHARP) & (~joint | (turn <= 1.5 * usual + SMOOTH))
    shares = free.astype(int) + np.roll(free, -1)  # of the two corners of an edge
    each = np.where(shares > 0, areas / np.maximum(shares, 1), 0.0)
    area = np.where(free, each + np.roll(each, 1), 0.0)
    across = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    length = np.hypot(*across.T)
    normal = np.column_stack([across[:, 1], -across[:, 0]]) / np.where(length > 0.0, length, 1.0)[:, None]
    points = points + (2.0 * area / np.where(length > 0.0, length, 1.0))[:, None] * normal
    if outlines.signed_area(points) < 0.0:
        return Contour(points[::-1], labels[-2::-1] + labels[-1:])
    return Contour(points, labels)


def _chords(points: np.ndarray, sagitta: float) -> list[int]:
    """Return the indices of the corners of chords within the sagitta, at least two chords; by halving."""
    found, pending = [0], [(0, len(points) - 1)]
    while pending:
        a, b = pending.pop()
        whole = b - a == len(points) - 1
        if b - a > 1 and (whole or _bulge(points[a : b + 1]) > sagitta):
            middle = (a + b) // 2
            pending += [(middle, b), (a, middle)]
        else:
            found.append(b)
    return found


def _bulge(points: np.ndarray) -> float:
    """Return the largest distance of points from the chord between the first and the last one."""
    along, off = points[-1] - points[0], points - points[0]
    share = np.clip(off @ along / max(float(along @ along), 1e-300), 0.0, 1.0)
    return float(np.hypot(*(off - share[:, None] * along).T).max())


def _check_crossings(contours: list[Contour]) -> None:
    fault = outlines.faulty_edges([each.points - contours[0].points[0] for each in contours])
    if fault is None:
        return
    labels = [label for each in contours for label in each.labels]
    points = np.concatenate([each.points for each in contours])
    one, other = labels[fault[0]], labels[fault[1]]
    what = f"{one} intersects itself" if one == other else f"{one} and {other} intersect"
    raise checks.conflict(f"self-intersecting outline: {what} near {_place(points[fault[1]])}")


def _nested(contours: list[Contour]) -> list[np.ndarray]:
    """Return the outer contour, and those inside it.

    Raises:
        ValueError: several outer contours, or contours inside holes.
    """
    inside = [
        [k for k, outer in enumerate(contours) if k != j and outlines.contains(outer.points, each.points[:1])[0]]
        for j, each in enumerate(contours)
    ]
    depth = [len(each) for each in inside]
    outer = [k for k, each in enumerate(depth) if each == 0]
    if len(outer) > 1:
        names = ", ".join(contours[k].labels[0] for k in outer[:5]) + (", ..." if len(outer) > 5 else "")
        raise checks.conflict(f"{len(outer)} parts in one file, with {names}: one part a file")
    if max(depth) > 1:
        label = contours[depth.index(max(depth))].labels[0]
        raise checks.conflict(f"the contour with {label} is inside a hole: one part a file")
    return [contours[outer[0]].points, *(each.points[::-1] for k, each in enumerate(contours) if k != outer[0])]


def _place(point: np.ndarray) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"
