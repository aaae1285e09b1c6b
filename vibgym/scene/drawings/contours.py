"""Strokes of a drawing: flattened, joined to closed contours, and nested to an outline with holes; lengths in mm."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.scene import outlines
from vibgym.scene.drawings.records import Fault, refusal

SAMPLES = 1024
"""Samples of a full turn, or of a curve, before it is flattened."""

SAGITTA = 0.75
"""Largest sagitta of a chord over the tolerance: balancing moves corners by up to 4/3 of it."""

SMOOTH, SHARP = 0.02, 1.0
"""rad: turns at joints of two curves that are still smooth, and from which on a corner of chords is not moved."""

COINCIDENT = 0.01
"""Ends of strokes that are closer than this share of the gap coincide."""

BRIDGED = 1.0
"""mm: open ends up to this distance apart get a hint to join them."""

LISTED = 20
"""Most parts of a file that an error lists."""

FREE, LEFT_OUT, AT_FAULT = -1, -2, -3
"""Instead of the partner of an end: none yet, that of a stroke without length, one of several."""


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


def outline_of(
    strokes: Sequence[Stroke],
    tolerance: float,
    gap: float,
    bridge: float = 0.0,
    part: int | None = None,
    faults: Sequence[Fault] = (),
) -> tuple[list[np.ndarray], Counter[str]]:
    """Return the outline of a part (n, 2) mm, counter-clockwise, with its holes, clockwise; and notes with their numbers.

    Args:
        tolerance: mm, of flattened curves.
        gap: mm, between ends that are joined.
        bridge: mm, between ends that a line joins, with a note.
        part: number among several, largest first.
        faults: that reading has found.

    Raises:
        ValueError: faults, all of them, or several parts of which none is selected.
    """
    joined, found, notes = loops(strokes, gap, bridge)
    contours = [flattened(loop, tolerance) for loop in joined]
    found = [*faults, *found]
    most = outlines.MOST_CORNERS
    for points, labels in contours:
        if len(points) > most:
            text = (
                f"the contour with {labels[0]} has {len(points)} corners, more than {most}: give a larger tolerance_mm"
            )
            found.append(Fault(text, points[0]))
    found += _crossings([each for each in contours if len(each.points) <= most])
    if found:
        raise refusal(found, [each.points for each in strokes])
    rings, others = _chosen(contours, part)
    return rings, notes + Counter({"parts that are not selected": others})


def loops(
    strokes: Sequence[Stroke], gap: float, bridge: float = 0.0
) -> tuple[list[list[Stroke]], list[Fault], Counter[str]]:
    """Return the closed loops of strokes, each turned so that it begins where the one before ends; faults; and notes.

    Ends are joined to the nearest first: those that coincide, those within ``gap``, and those within ``bridge``. Strokes
    shorter than ``gap`` are left out where their neighbours join. Faults are open ends, more than two ends that meet, and
    contours without length. Notes are gaps beyond ``gap`` and strokes that are drawn twice.
    """
    from scipy.spatial import KDTree

    strokes, notes = _without_duplicates(strokes, gap)
    faults = list[Fault]()
    ends = np.array([point for each in strokes for point in (each.points[0], each.points[-1])]).reshape(-1, 2)
    length = [_length(each) for each in strokes]
    partner = np.full(len(ends), FREE)
    for reach in (COINCIDENT * gap, gap, bridge):
        free = np.flatnonzero(partner == FREE)
        pairs = free[KDTree(ends[free]).query_pairs(reach, output_type="ndarray")]
        beside = np.unique(pairs[pairs[:, 0] // 2 != pairs[:, 1] // 2] // 2)
        alone = (partner.reshape(-1, 2) == FREE).all(axis=1)
        partner.reshape(-1, 2)[[k for k in beside if length[k] <= min(reach, gap) and alone[k]]] = LEFT_OUT
        pairs = pairs[(partner[pairs] == FREE).all(axis=1)]
        count = np.bincount(pairs.ravel(), minlength=len(ends))
        for a, b in pairs[(count[pairs] == 1).all(axis=1)]:
            partner[a], partner[b] = b, a
            if reach > gap:
                away, names = np.hypot(*(ends[a] - ends[b])), f"{strokes[a // 2].label} and {strokes[b // 2].label}"
                notes[f"gap of {away:.3g} mm between {names}"] += 1
        for k in np.flatnonzero(count > 1):
            if partner[k] == FREE:
                near = np.unique(pairs[(pairs == k).any(axis=1)])
                names = ", ".join(dict.fromkeys(strokes[j // 2].label for j in near))
                faults.append(Fault(f"{len(near)} ends meet at {_place(ends[near[0]])}: {names}", ends[k]))
                partner[near] = AT_FAULT
    present = np.flatnonzero(partner != LEFT_OUT)
    for k in np.flatnonzero(partner == FREE):
        away = np.where(present == k, np.inf, np.hypot(*(ends[present] - ends[k]).T))
        label, other = strokes[k // 2].label, strokes[present[away.argmin()] // 2].label
        hint = " (gap_mm= joins them)" if bridge < away.min() <= BRIDGED else ""
        text = f"{label} ends at {_place(ends[k])}, {away.min():.3g} mm from the next end, of {other}{hint}"
        faults.append(Fault(f"open contour: {text}", ends[k]))
    found, left = list[list[Stroke]](), {int(k) // 2 for k in present}
    while left:
        first = at = min(left)
        loop, end = list[Stroke](), 2 * at + 1
        while at in left:
            left.remove(at)
            loop.append(strokes[at] if end % 2 else strokes[at]._replace(points=strokes[at].points[::-1]))
            begin = int(partner[end])
            at, end = (-1, end) if begin < 0 else (begin // 2, begin ^ 1)
        if at == first:
            closed = _bridged(loop, gap, bridge)
            if closed:
                found.append(closed)
            else:
                faults.append(Fault(f"{loop[0].label} has no length", loop[0].points[0]))
    return found, faults, notes


def _length(stroke: Stroke) -> float:
    return float(np.hypot(*np.diff(stroke.points, axis=0).T).sum())


def _bridged(loop: list[Stroke], gap: float, bridge: float) -> list[Stroke]:
    """Return a loop without strokes shorter than ``gap``, whose gaps are closed.

    Two lines are joined at their intersection, or halfway if that is not within ``bridge`` of both ends; curves by a line.
    """
    kept, at = list[Stroke](), loop[0].points[0]
    for stroke in loop:
        if _length(stroke) > gap or np.hypot(*(stroke.points[-1] - at)) > gap:
            kept.append(stroke._replace(points=stroke.points.copy()))
            at = stroke.points[-1]
    found = list[Stroke]()
    for stroke, after in zip(kept, [*kept[1:], *kept[:1]], strict=True):
        found.append(stroke)
        end, begin = stroke.points[-1], after.points[0]
        if np.hypot(*(begin - end)) > gap:
            (ax, ay), (bx, by), (x, y) = end - stroke.points[-2], after.points[1] - begin, begin - end
            cross = ax * by - ay * bx
            corner = end + (x * by - y * bx) / (cross or math.inf) * np.array([ax, ay])
            if not cross or np.hypot(*(np.array([end, begin]) - corner).T).max() > bridge:
                corner = 0.5 * (end + begin)
            if not (stroke.curved or after.curved):
                stroke.points[-1] = after.points[0] = corner
            else:
                found.append(Stroke(np.array([end, begin]), False, f"the gap after {stroke.label}"))
    return found


def _without_duplicates(strokes: Sequence[Stroke], gap: float) -> tuple[list[Stroke], Counter[str]]:
    """Return strokes, each once, and notes on those that coincide with one before them, in either sense."""
    kept, notes = dict[bytes, Stroke](), Counter[str]()
    for stroke in strokes:
        points = np.rint(stroke.points / (COINCIDENT * gap)) + 0.0  # no negative zeros
        key = min(points.tobytes(), points[::-1].tobytes())
        if kept.setdefault(key, stroke) is not stroke:
            notes[f"{stroke.label.partition(' ')[0]} drawn twice"] += 1
    return list(kept.values()), notes


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


def _crossings(contours: list[Contour]) -> list[Fault]:
    """Return the faults of contours that cross or touch themselves or one another."""
    import shapely

    alone = [_crossing([each]) for each in contours]
    simple = [each for each, fault in zip(contours, alone, strict=True) if fault is None]
    rings = np.array([shapely.LinearRing(each.points) for each in simple], dtype=object)
    pairs = shapely.STRtree(rings).query(rings, "intersects").T
    faults = [*alone, *(_crossing([simple[a], simple[b]]) for a, b in pairs if a < b)]
    return [each for each in faults if each is not None]


def _crossing(contours: list[Contour]) -> Fault | None:
    """Return the first crossing of a contour, or of two that are simple."""
    fault = outlines.faulty_edges([each.points - contours[0].points[0] for each in contours])
    if fault is None:
        return None
    labels = [label for each in contours for label in each.labels]
    place = np.concatenate([each.points for each in contours])[fault[1]]
    one, other = labels[fault[0]], labels[fault[1]]
    what = f"{one} intersects itself" if one == other else f"{one} and {other} intersect"
    return Fault(f"self-intersecting outline: {what} near {_place(place)}", place)


def _chosen(contours: list[Contour], part: int | None) -> tuple[list[np.ndarray], int]:
    """Return the outer contour of a part and those inside it, and the number of other parts.

    Raises:
        ValueError: several parts, or no part of this number.
    """
    import shapely

    polygons = np.array([shapely.Polygon(each.points) for each in contours], dtype=object)
    inner, outer = shapely.STRtree(polygons).query(polygons, "within")
    inside = [set(outer[(inner == k) & (outer != k)].tolist()) for k in range(len(contours))]
    rims = [k for k, each in enumerate(inside) if len(each) % 2 == 0]
    rims.sort(key=lambda k: -polygons[k].area)
    if part is None and len(rims) > 1:
        listed = []
        for number, k in enumerate(rims[:LISTED]):
            low, size = contours[k].points.min(axis=0), np.ptp(contours[k].points, axis=0)
            where = f"from {_place(low)}, with {contours[k].labels[0]}" + ", in a hole" * bool(inside[k])
            listed.append(f"{number}: {size[0]:.4g} x {size[1]:.4g} mm, {polygons[k].area:.4g} mm^2, {where}")
        raise checks.conflict(f"{len(rims)} parts in one file, select one by part=: {'; '.join(listed)}")
    rim = rims[checks.count("part", 0 if part is None else part, least=0, most=len(rims) - 1)]
    holes = [k for k, each in enumerate(inside) if each == inside[rim] | {rim}]
    return [contours[rim].points, *(contours[k].points[::-1] for k in holes)], len(rims) - 1


def _place(point: np.ndarray) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"
