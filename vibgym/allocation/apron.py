"""Elements around a part that go on with the field under it.

Plates circle with the table, and parts travel within a step: they come to lie on elements that bear nothing of them now. On
those at rest a rigid part would find a step as high as its field. So each does what the field under the part, a push and a
turn, is at its place.
"""

from __future__ import annotations

import math

from vibgym.allocation.cut import cut_parts
from vibgym.kernels.jit import borrowing


@borrowing
def field_under(pieces, first, last, columns, push):
    """The push and turn that the elements' pushes (rows, columns, 2) under one part come nearest to.

    Args:
        pieces, first, last: those of the part.

    Returns:
        Push x and y, and turn, of which an element at ``r`` radii of gyration has ``turn z^ x r``.
    """
    area, x, y, torque, square = 0.0, 0.0, 0.0, 0.0, 0.0
    for i in range(first, last):
        e, share, ax, ay = pieces.element[i], pieces.share[i], pieces.lever[i, 0], pieces.lever[i, 1]
        px, py = push[e // columns, e % columns, 0], push[e // columns, e % columns, 1]
        area, x, y = area + share, x + share * px, y + share * py
        torque += ax * py - ay * px
        square += (ax * ax + ay * ay) / share
    return x / area, y / area, torque / max(square, 1e-300)


@borrowing
def spread_fields(start, stop, outlines, grown, least, most, pose, present, pieces, around, mark, push):
    """Let elements around parts, which lie under none, go on with the part's field.

    Args:
        start, stop: worlds.
        outlines, grown: of :func:`vibgym.allocation.cut.outlines_of`, of the parts and of parts as large as their aprons.
        least, most: amplitudes of elements that move, over the surface's largest.
        pose: (worlds, parts, 3).  present: (worlds, parts) bool.
        pieces, around: scratch, for either.
        mark: (elements,) bool scratch, False, and left so.
        push: (worlds, rows, columns, 2), changed in place.
    """
    columns = outlines.columns
    for w in range(start, stop):
        count, beside = cut_parts(outlines, pose[w], present[w], pieces), cut_parts(grown, pose[w], present[w], around)
        for i in range(count):
            mark[pieces.element[i]] = True
        first, at = 0, 0
        while first < count:  # part by part: pieces stand in their order
            part, last = pieces.part[first], first
            while last < count and pieces.part[last] == part:
                last += 1
            x, y, turn = field_under(pieces, first, last, columns, push[w])
            first = last
            while at < beside and around.part[at] <= part:
                e, share, mine = around.element[at], around.share[at], around.part[at] == part
                ax, ay = around.lever[at, 0] / share, around.lever[at, 1] / share
                at += 1
                if mark[e] or not mine:
                    continue
                px, py = x - turn * ay, y + turn * ax
                size = math.sqrt(px * px + py * py)
                scale = min(size, most) / size if size > 0.0 and size >= least else 0.0
                push[w, e // columns, e % columns, 0], push[w, e // columns, e % columns, 1] = scale * px, scale * py
                mark[e] = True  # the first part's: its neighbour leaves it alone
        for j in range(beside):
            mark[around.element[j]] = False
        for i in range(count):
            mark[pieces.element[i]] = False
