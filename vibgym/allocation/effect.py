"""What given pushes of the elements make of the parts: the other way round from :mod:`vibgym.allocation.projections`."""

from __future__ import annotations

from vibgym.allocation.cut import cut_parts
from vibgym.kernels.jit import borrowing


@borrowing
def effects(outlines, pose, present, push, gain, pieces, effect):
    """Pushes that parts get, near rest and to first order, see :meth:`vibgym.allocation.Allocator.effect`.

    Args:
        outlines: of :func:`vibgym.allocation.cut.outlines_of`.
        pose: (worlds, parts, 3).  present: (worlds, parts) bool.
        push: (worlds, elements, 2) over full amplitude.
        gain: (worlds, elements) what elements make of their phasors.
        pieces: scratch.
        effect: (worlds, parts, 3), overwritten.
    """
    for w in range(pose.shape[0]):
        effect[w] = 0.0
        for i in range(cut_parts(outlines, pose[w], present[w], pieces)):
            p, e = pieces.part[i], pieces.element[i]
            x, y = gain[w, e] * push[w, e, 0], gain[w, e] * push[w, e, 1]
            effect[w, p, 0] += pieces.share[i] * x
            effect[w, p, 1] += pieces.share[i] * y
            effect[w, p, 2] += pieces.lever[i, 0] * y - pieces.lever[i, 1] * x


@borrowing
def reaches(outlines, pose, present, pieces, reach):
    """Largest pushes that turn parts, of elements that all do their utmost; see :meth:`vibgym.allocation.Allocator.reach`.

    Args:
        outlines, pose, present, pieces: see :func:`effects`.
        reach: (worlds, parts), overwritten.
    """
    for w in range(pose.shape[0]):
        reach[w] = 0.0
        for i in range(cut_parts(outlines, pose[w], present[w], pieces)):
            reach[w, pieces.part[i]] += (pieces.lever[i, 0] ** 2 + pieces.lever[i, 1] ** 2) ** 0.5
