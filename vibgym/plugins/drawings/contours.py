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
from shapely.geometry.polygon import orient

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


class Stroke(NamedTuple):
    """A line or curve of a drawing.

    Attributes:
        points: (n, 2) mm: the ends of a line, or fine samples of a curve.
        label: where it is in the file, such as ``LINE 2F``.
    """

    points: np.ndarray
    label: str


def outline_of(
    strokes: Sequence[Stroke],
    tolerance: float,
    gap: float,
    bridge: float = 0.0,
    part: int | None = None,
    faults: Sequence[Fault] = (),
) -> tuple[list[np.ndarray], Counter[str]]:
    """Return the outline of a part (n, 2) mm, counter-clockwise, with its holes, clockwise; and notes with their numbers.

    Notes are gaps beyond ``gap``, strokes that are drawn twice, and parts that are not selected.

    Args:
        tolerance: mm, of flattened curves.
        gap: mm, between ends that are joined.
        bridge: mm, between ends that a line joins, with a note.
        part: number among several, largest first.
        faults: that reading has found.

    Raises:
        ValueError: faults, all of them, or several parts of which none is selected.
    """
    strokes, notes = _without_duplicates(strokes, gap)
    pairs, open_ends, gaps = _joints(strokes, gap, bridge)
    alone = {a // 2 for a, b in pairs if b == a ^ 1}
    lines = [flattened(stroke.points, tolerance, k in alone) for k, stroke in enumerate(strokes)]
    lines = _joined(lines, pairs, gap, bridge)
    merged = shapely.get_parts(shapely.line_merge(shapely.MultiLineString(lines)))
    rings = shapely.remove_repeated_points(merged, gap)
    tree = shapely.STRtree([shapely.LineString(stroke.points) for stroke in strokes])
    labels = np.array([strokes[k].label for k in tree.nearest(shapely.get_point(rings, 0))])
    closed, whole = shapely.is_closed(rings), shapely.get_num_coordinates(rings) > 3
    for k in np.flatnonzero(closed & ~whole if open_ends else ~(closed & whole)):
        text = f"{labels[k]} encloses no area within the tolerance"
        open_ends.append(Fault(text, np.array(rings[k].coords[0])))
    polygons: Any = np.array([shapely.Polygon(ring) for ring in rings[closed & whole]], dtype=object)
    faults = [*faults, *open_ends, *_crossings(polygons, [stroke.label for stroke in strokes], tree, tolerance)]
    if faults:
        raise refusal(faults, [stroke.points for stroke in strokes])
    rings, others = _chosen(polygons, labels[closed & whole], part)
    return rings, notes + gaps + Counter({"parts that are not selected": others})


def _joints(
    strokes: Sequence[Stroke], gap: float, bridge: float
) -> tuple[list[tuple[int, int]], list[Fault], Counter[str]]:
    """Return the pairs of ends that join, faults, and notes on gaps beyond ``gap``; stroke k has the ends 2 k and 2 k + 1.

    Ends are joined to the nearest first: those that coincide, those within ``gap``, and those within ``bridge``. Strokes
    shorter than ``gap`` are left out where their neighbours join. Faults are open ends, more than two ends that meet, and
    strokes without length.
    """
    faults, notes, joints = list[Fault](), Counter[str](), list[tuple[int, int]]()
    ends = np.array([stroke.points[[0, -1]] for stroke in strokes]).reshape(-1, 2)
    length = [float(np.hypot(*np.diff(stroke.points, axis=0).T).sum()) for stroke in strokes]
    free, left_out = set(range(len(ends))), set[int]()
    for reach in (COINCIDENT * gap, gap, bridge):
        at = np.array(sorted(free), dtype=int)
        near = at[KDTree(ends[at]).query_pairs(reach, output_type="ndarray")]
        for group in networkx.connected_components(networkx.Graph(near.tolist())):
            short = {k for k in group if k ^ 1 in group and length[k // 2] <= min(reach, gap)}
            if len(group) > 2:
                left_out |= short
            meeting = sorted(group - left_out)
            names = [strokes[k // 2].label for k in meeting]
            if len(meeting) == 2 and (away := math.dist(*ends[meeting])) > reach:
                continue
            free -= group
            if len(meeting) > 2:
                text = f"{len(meeting)} ends meet at {_place(ends[meeting[0]])}: {', '.join(dict.fromkeys(names))}"
                faults.append(Fault(text, ends[meeting[0]]))
            elif group == short:
                faults.append(Fault(f"{strokes[min(group) // 2].label} has no length", ends[min(group)]))
            elif len(meeting) == 2:
                joints.append((meeting[0], meeting[1]))
                if reach > gap:
                    notes[f"gap of {away:.3g} mm between {names[0]} and {names[1]}"] += 1
    present = np.array(sorted(set(range(len(ends))) - left_out), dtype=int)
    for k in sorted(free):
        distance = np.hypot(*(ends[present] - ends[k]).T)
        nearest = int(np.argsort(distance)[1])
        away, label, other = distance[nearest], strokes[k // 2].label, strokes[present[nearest] // 2].label
        hint = " (gap_mm= joins them)" if bridge < away <= BRIDGED else ""
        text = f"{label} ends at {_place(ends[k])}, {away:.3g} mm from the next end, of {other}{hint}"
        faults.append(Fault(f"open contour: {text}", ends[k]))
    return joints, faults, notes


def _joined(lines: list[np.ndarray], pairs: list[tuple[int, int]], gap: float, bridge: float) -> list[np.ndarray]:
    """Return those lines (n, 2) that join, with ends that coincide, and lines that close gaps.

    Two straight lines are joined at their intersection, or halfway if that is not within ``bridge`` of both ends.
    """
    bridges = []
    for a, b in pairs:
        one, other = lines[a // 2][:: 1 if a % 2 else -1], lines[b // 2][:: -1 if b % 2 else 1]
        end, begin = one[-1], other[0]  # views
        if math.dist(end, begin) > gap:
            if len(one) > 2 or len(other) > 2:
                bridges.append(np.array([end, begin]))
                continue
            along = np.column_stack([end - one[0], begin - other[1]])
            corner = 0.5 * (end + begin)
            if np.linalg.det(along):
                meeting = end + np.linalg.solve(along, begin - end)[0] * along[:, 0]
                corner = meeting if max(math.dist(meeting, end), math.dist(meeting, begin)) <= bridge else corner
            end[:] = corner
        begin[:] = end
    return [lines[k] for k in sorted({end // 2 for pair in pairs for end in pair})] + bridges


def _without_duplicates(strokes: Sequence[Stroke], gap: float) -> tuple[list[Stroke], Counter[str]]:
    """Return strokes, each once, and notes on those that coincide with one before them, in either sense."""
    kept, notes = dict[bytes, Stroke](), Counter[str]()
    for stroke in strokes:
        points = np.rint(stroke.points / (COINCIDENT * gap)) + 0.0  # no negative zeros
        key = min(points.tobytes(), points[::-1].tobytes())
        if kept.setdefault(key, stroke) is not stroke:
            notes[f"{stroke.label.partition(' ')[0]} drawn twice"] += 1
    return list(kept.values()), notes


def flattened(points: np.ndarray, tolerance: float, closed: bool) -> np.ndarray:
    """Return a stroke (n, 2) mm, which may be a contour by itself, as a polyline within the tolerance and with its area.

    Curves become chords of half their samples, of a quarter, and so on; corners between two chords are then moved to the outer
    side by the area that the chords cut off.
    """
    if len(points) == 2:
        return points.copy()
    at = _chords(points, SAGITTA * tolerance)
    area = np.array(
        [outlines.signed_area(points[a : b + 1] - points[a]) for a, b in pairwise(at)] + [0.0] * (not closed)
    )
    corners = points[at[: len(area)]]
    along = (np.roll(corners, -1, axis=0) - corners) @ [1.0, 1j]
    free = np.abs(np.angle(along * np.roll(along, 1).conj())) < SHARP
    if not closed:
        free[[0, -1]] = False
    share = area / np.maximum(free.astype(int) + np.roll(free, -1), 1)  # of a corner of an edge
    across = np.roll(corners, -1, axis=0) - np.roll(corners, 1, axis=0)
    moved = np.where(free, 2.0 * (share + np.roll(share, 1)) / np.maximum((across**2).sum(axis=1), 1e-300), 0.0)
    corners = corners + moved[:, None] * np.column_stack([across[:, 1], -across[:, 0]])
    return corners[[*range(len(corners)), 0]] if closed else corners


def _chords(points: np.ndarray, sagitta: float) -> list[int]:
    """Return the indices of the corners of chords within the sagitta, at least two chords; by halving."""
    corners, pending = [0], [(0, len(points) - 1)]
    while pending:
        a, b = pending.pop()
        whole = b - a == len(points) - 1
        if b - a > 1 and (whole or _bulge(points[a : b + 1]) > sagitta):
            middle = (a + b) // 2
            pending += [(middle, b), (a, middle)]
        else:
            corners.append(b)
    return corners


def _bulge(points: np.ndarray) -> float:
    """Return the largest distance of points from the chord between the first and the last one."""
    return float(shapely.distance(shapely.LineString(points[[0, -1]]), shapely.points(points)).max())


def _crossings(polygons: Any, labels: list[str], tree: Any, tolerance: float) -> list[Fault]:
    """Return the faults of contours that cross or touch themselves or one another.

    Args:
        labels, tree: of the strokes.
    """
    reasons = [reason.partition("[") for reason in shapely.is_valid_reason(polygons)]
    places = [np.array(place[:-1].split(), float) for what, _, place in reasons if place]
    borders = shapely.get_exterior_ring(polygons[shapely.is_valid(polygons)])
    pairs = shapely.STRtree(borders).query(borders, "intersects").T
    places += [shapely.get_coordinates(shapely.intersection(*borders[[a, b]]))[0] for a, b in pairs.tolist() if a < b]
    faults = []
    for place in places:
        point = shapely.Point(place)
        near = sorted({int(tree.nearest(point)), *tree.query(point, "dwithin", distance=tolerance).tolist()})
        names = list(dict.fromkeys(labels[k] for k in near))
        what = f"{' and '.join(names)} intersect" if len(names) > 1 else f"{names[0]} intersects itself"
        faults.append(Fault(f"self-intersecting outline: {what} near {_place(place)}", place))
    return faults


def _chosen(polygons: Any, labels: np.ndarray, part: int | None) -> tuple[list[np.ndarray], int]:
    """Return the outer contour of a part and those inside it, and the number of other parts.

    Raises:
        ValueError: several parts, or no part of this number.
    """
    inner, outer = shapely.STRtree(polygons).query(polygons, "within")
    inside = [set(outer[(inner == k) & (outer != k)].tolist()) for k in range(len(polygons))]
    rims = [k for k, around in enumerate(inside) if len(around) % 2 == 0]
    rims.sort(key=lambda k: -polygons[k].area)
    if part is None and len(rims) > 1:
        listed = []
        for number, k in enumerate(rims[:LISTED]):
            x, y, right, top = polygons[k].bounds
            where = f"from {_place((x, y))}, with {labels[k]}" + ", in a hole" * bool(inside[k])
            listed.append(f"{number}: {right - x:.4g} x {top - y:.4g} mm, {polygons[k].area:.4g} mm^2, {where}")
        raise checks.conflict(f"{len(rims)} parts in one file, select one by part=: {'; '.join(listed)}")
    rim = rims[checks.count("part", 0 if part is None else part, least=0, most=len(rims) - 1)]
    holes = [shapely.get_exterior_ring(polygons[k]) for k, around in enumerate(inside) if around == inside[rim] | {rim}]
    whole = orient(shapely.Polygon(polygons[rim].exterior, holes))
    return [np.array(interior.coords)[:-1] for interior in (whole.exterior, *whole.interiors)], len(rims) - 1


def _place(point: Sequence[float] | np.ndarray) -> str:
    return f"({point[0]:.6g}, {point[1]:.6g}) mm"
