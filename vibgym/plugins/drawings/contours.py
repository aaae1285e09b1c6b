"""Strokes of a drawing: flattened, joined to closed contours, and nested to an outline with holes; lengths in mm."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, NamedTuple

import networkx
import numpy as np
import shapely
from scipy.spatial import KDTree

from vibgym import checks
from vibgym.plugins.drawings.records import Fault, refusal
from vibgym.scene import outlines

SAMPLES = 1024
"""Samples of a full turn, or of a curve, before it is flattened."""

SAGITTA = 0.75
"""Largest sagitta of a chord over the tolerance: balancing moves corners by up to 4/3 of it."""

SHARP = 1.0
"""rad: turn from which on a corner of chords is not moved."""

COINCIDENT = 0.01
"""Ends of strokes that are closer than this share of the gap coincide."""

BRIDGED = 1.0
"""mm: open ends up to this distance apart get a hint to join them."""

LISTED = 20
"""Most parts of a file that an error lists."""

NONE, LEFT_OUT, AT_FAULT = -1, -2, -3
"""Instead of the partner of an end: none yet, that of a stroke without length, one of several."""


class Stroke(NamedTuple):
    """A line or curve of a drawing.

    Attributes:
        points: (n, 2) mm: the ends of a line, or fine samples of a curve.
        label: where it is in the file, such as ``LINE 2F``.
    """

    points: np.ndarray
    label: str

    @property
    def curved(self) -> bool:
        """Whether it is a curve."""
        return len(self.points) > 2


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
    rings = [flattened(loop, tolerance) for loop in joined]
    flat = [loop[0] for loop, ring in zip(joined, rings, strict=True) if len(ring) < 3]
    found += [Fault(f"{each.label} encloses no area", each.points[0]) for each in flat]
    faults = [*faults, *found, *_crossings([ring for ring in rings if len(ring) > 2], strokes, tolerance)]
    if faults:
        raise refusal(faults, [each.points for each in strokes])
    rings, others = _chosen(rings, [loop[0].label for loop in joined], part)
    return rings, notes + Counter({"parts that are not selected": others})


def loops(
    strokes: Sequence[Stroke], gap: float, bridge: float = 0.0
) -> tuple[list[list[Stroke]], list[Fault], Counter[str]]:
    """Return the closed loops of strokes, each turned so that it begins where the one before ends; faults; and notes.

    Ends are joined to the nearest first: those that coincide, those within ``gap``, and those within ``bridge``. Strokes
    shorter than ``gap`` are left out where their neighbours join. Faults are open ends, more than two ends that meet, and
    contours without length. Notes are gaps beyond ``gap`` and strokes that are drawn twice.
    """
    strokes, notes = _without_duplicates(strokes, gap)
    faults = list[Fault]()
    ends = np.array([each.points[[0, -1]] for each in strokes]).reshape(-1, 2)
    length = [_length(each) for each in strokes]
    partner = np.full(len(ends), NONE)
    for reach in (COINCIDENT * gap, gap, bridge):
        free = np.flatnonzero(partner == NONE)
        pairs = free[KDTree(ends[free]).query_pairs(reach, output_type="ndarray")]
        for group in networkx.connected_components(networkx.Graph(pairs.tolist())):
            short = {k for k in group if k ^ 1 in group and length[k // 2] <= min(reach, gap)}
            if len(group) > 2:
                partner[list(short)] = LEFT_OUT
                group = group - short
            meeting = sorted(group)
            names = [strokes[k // 2].label for k in meeting]
            if len(meeting) > 2:
                text = f"{len(meeting)} ends meet at {_place(ends[meeting[0]])}: {', '.join(dict.fromkeys(names))}"
                faults.append(Fault(text, ends[meeting[0]]))
                partner[meeting] = AT_FAULT
            elif len(meeting) == 2 and (away := math.dist(*ends[meeting])) <= reach:
                partner[meeting] = meeting[::-1]
                if reach > gap:
                    notes[f"gap of {away:.3g} mm between {names[0]} and {names[1]}"] += 1
    present = np.flatnonzero(partner != LEFT_OUT)
    for k in np.flatnonzero(partner == NONE):
        (_, away), (_, nearest) = KDTree(ends[present]).query(ends[k], 2)
        label, other = strokes[k // 2].label, strokes[present[nearest] // 2].label
        hint = " (gap_mm= joins them)" if bridge < away <= BRIDGED else ""
        text = f"{label} ends at {_place(ends[k])}, {away:.3g} mm from the next end, of {other}{hint}"
        faults.append(Fault(f"open contour: {text}", ends[k]))
    found, left = list[list[Stroke]](), {int(k) // 2 for k in present}
    while left:
        first = at = min(left)
        loop, end = list[Stroke](), 2 * at + 1
        while at in left:
            left.remove(at)
            loop.append(strokes[at] if end % 2 else strokes[at]._replace(points=strokes[at].points[::-1]))
            at, end = int(partner[end]) // 2, int(partner[end]) ^ 1
        if at == first:
            if closed := _bridged(loop, gap, bridge):
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
        if _length(stroke) > gap or math.dist(stroke.points[-1], at) > gap:
            kept.append(stroke._replace(points=stroke.points.copy()))
            at = stroke.points[-1]
    found = list[Stroke]()
    for stroke, after in zip(kept, [*kept[1:], *kept[:1]], strict=True):
        found.append(stroke)
        end, begin = stroke.points[-1], after.points[0]
        if math.dist(end, begin) > gap:
            if stroke.curved or after.curved:
                found.append(Stroke(np.array([end, begin]), f"the gap after {stroke.label}"))
                continue
            along = np.column_stack([end - stroke.points[-2], begin - after.points[1]])
            corner = 0.5 * (end + begin)
            if np.linalg.det(along):
                meeting = end + np.linalg.solve(along, begin - end)[0] * along[:, 0]
                corner = meeting if max(math.dist(meeting, end), math.dist(meeting, begin)) <= bridge else corner
            stroke.points[-1] = after.points[0] = corner
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


def flattened(loop: list[Stroke], tolerance: float) -> np.ndarray:
    """Return a loop as a polygon (n, 2) mm, counter-clockwise, within the tolerance and with its area.

    Curves become chords of half their samples, of a quarter, and so on; corners between two chords of a curve are then moved
    to its outer side by the area that the chords cut off.
    """
    corners, lost, owner = list[np.ndarray](), list[float](), list[int]()
    for k, stroke in enumerate(loop):
        at = _chords(stroke.points, SAGITTA * tolerance) if stroke.curved else [0, len(stroke.points) - 1]
        corners.append(stroke.points[at[:-1]])
        lost += [outlines.signed_area(stroke.points[a : b + 1] - stroke.points[a]) for a, b in pairwise(at)]
        owner += [k] * (len(at) - 1)
    points, area, curve = np.concatenate(corners), np.array(lost), np.array(owner)
    along = (np.roll(points, -1, axis=0) - points) @ [1.0, 1j]
    turn = np.abs(np.angle(along * np.roll(along, 1).conj()))
    free = (turn < SHARP) & (curve == np.roll(curve, 1))
    share = area / np.maximum(free.astype(int) + np.roll(free, -1), 1)  # of a corner of an edge
    across = np.roll(points, -1, axis=0) - np.roll(points, 1, axis=0)
    moved = np.where(free, 2.0 * (share + np.roll(share, 1)) / np.maximum((across**2).sum(axis=1), 1e-300), 0.0)
    points = points + moved[:, None] * np.column_stack([across[:, 1], -across[:, 0]])
    return points[::-1] if outlines.signed_area(points) < 0.0 else points


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
    return float(shapely.distance(shapely.LineString(points[[0, -1]]), shapely.points(points)).max())


def _crossings(rings: list[np.ndarray], strokes: Sequence[Stroke], tolerance: float) -> list[Fault]:
    """Return the faults of contours that cross or touch themselves or one another."""
    polygons: Any = np.array([shapely.Polygon(each) for each in rings], dtype=object)
    reasons = [each.partition("[") for each in shapely.is_valid_reason(polygons)]
    places = [np.array(place[:-1].split(), float) for what, _, place in reasons if place]
    borders = shapely.get_exterior_ring(polygons[shapely.is_valid(polygons)])
    pairs = shapely.STRtree(borders).query(borders, "intersects").T
    places += [shapely.get_coordinates(shapely.intersection(*borders[[a, b]]))[0] for a, b in pairs.tolist() if a < b]
    tree, faults = shapely.STRtree([shapely.LineString(each.points) for each in strokes]), []
    for place in places:
        point = shapely.Point(place)
        near = sorted({int(tree.nearest(point)), *tree.query(point, "dwithin", distance=tolerance).tolist()})
        names = list(dict.fromkeys(strokes[k].label for k in near))
        what = f"{' and '.join(names)} intersect" if len(names) > 1 else f"{names[0]} intersects itself"
        faults.append(Fault(f"self-intersecting outline: {what} near {_place(place)}", place))
    return faults


def _chosen(rings: list[np.ndarray], labels: list[str], part: int | None) -> tuple[list[np.ndarray], int]:
    """Return the outer contour of a part and those inside it, and the number of other parts.

    Raises:
        ValueError: several parts, or no part of this number.
    """
    polygons = np.array([shapely.Polygon(each) for each in rings], dtype=object)
    inner, outer = shapely.STRtree(polygons).query(polygons, "within")
    inside = [set(outer[(inner == k) & (outer != k)].tolist()) for k in range(len(rings))]
    rims = [k for k, each in enumerate(inside) if len(each) % 2 == 0]
    rims.sort(key=lambda k: -polygons[k].area)
    if part is None and len(rims) > 1:
        listed = []
        for number, k in enumerate(rims[:LISTED]):
            low, size = rings[k].min(axis=0), np.ptp(rings[k], axis=0)
            where = f"from {_place(low)}, with {labels[k]}" + ", in a hole" * bool(inside[k])
            listed.append(f"{number}: {size[0]:.4g} x {size[1]:.4g} mm, {polygons[k].area:.4g} mm^2, {where}")
        raise checks.conflict(f"{len(rims)} parts in one file, select one by part=: {'; '.join(listed)}")
    rim = rims[checks.count("part", 0 if part is None else part, least=0, most=len(rims) - 1)]
    holes = [k for k, each in enumerate(inside) if each == inside[rim] | {rim}]
    return [rings[rim], *(rings[k][::-1] for k in holes)], len(rims) - 1


def _place(point: np.ndarray) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"
