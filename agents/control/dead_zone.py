"""Which element does what when elements cannot do little: the allocators for a dead zone.

Below a smallest amplitude d an element does little or nothing, so the phasors of least norm (:mod:`agents.control.allocation`)
are lost where little is wanted, and that is what holds a part short of its goal. Where an element does less than it is told,
but something, it is told more. Where it does nothing, elements rest or move with an amplitude of at least d, some against
others, found by :mod:`agents.control.projections`.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from agents.control.allocation import Allocator
from agents.control.pieces import new_pieces, outlines_of
from agents.control.projections import Limits, new_work, serve, start_table
from agents.task_info import TaskInfo
from vibgym import Surface, checks
from vibgym.scene.parts import Part

MARGIN = 0.1
"""Share of a hard dead zone by which elements stay clear of it: no two are alike."""

INVERSES: Mapping[str, Callable[[np.ndarray], np.ndarray]] = {"soft": np.sqrt, "cubic": np.cbrt}
"""What to command, over d, for an amplitude below d: dead zones that make ``a^2 / d`` or ``a^3 / d^2`` of an amplitude a."""


class DeadZoneAllocator(Allocator):
    """Turns wanted accelerations into ``"phasor"`` actions of elements that rest or move far enough.

    Args:
        surface, parts: the scene.
        rule: ``"solve"``, see :data:`agents.control.allocation.RULES`: parts that share elements are always served together.
        least: smallest amplitude of elements that move, over the surface's largest.
        most: the largest that they realise, likewise.

    Raises:
        ValueError: another rule, or a smallest amplitude above the largest.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], rule: str, *, least: float, most: float = 1.0) -> None:
        super().__init__(surface, parts, checks.choice("rule, with a dead zone,", rule, ("solve",)))
        most = checks.number("most", most, above=0.0, most=1.0)
        least = checks.number("least", least, least=0.0, most=most)
        self.outlines = outlines_of(surface, self.parts)
        slots = len(new_pieces(surface, self.parts).part)
        self.limits = Limits(least, most, start_table(slots, 2.0 * least))

    def pushes(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Pushes (worlds, rows, columns, 2) that do what the parts want as nearly as elements can, each zero or of a length
        within the limits. Elements rest under parts that want nothing, but where these share elements with others."""
        surface = self.surface
        push = np.empty((len(pose), surface.rows, surface.columns, 2))
        pieces = new_pieces(surface, self.parts)  # anew, since several threads may use a policy
        work = new_work(len(self.parts), surface.rows * surface.columns, len(pieces.part))
        given = (np.ascontiguousarray(each) for each in (pose, present, wanted))
        serve(self.outlines, self.limits, *given, pieces, work, push)
        return push


class SoftAllocator(Allocator):
    """Turns wanted accelerations into ``"phasor"`` actions of elements that do too little of small amplitudes.

    Args:
        surface, parts, rule: of the base class.
        width: amplitude below which they do, over the surface's largest.
        form: among :data:`INVERSES`.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], rule: str, *, width: float, form: str) -> None:
        super().__init__(surface, parts, rule)
        self.width, self.inverse = width, INVERSES[checks.choice("form", form, tuple(INVERSES))]

    def pushes(self, pose: np.ndarray, present: np.ndarray, wanted: np.ndarray) -> np.ndarray:
        """Pushes to command, so that elements do what the base class asks for."""
        push = super().pushes(pose, present, wanted)
        share = np.sqrt((push**2).sum(axis=-1, keepdims=True)) / self.width
        inside = (share > 0.0) & (share < 1.0)
        share[~inside] = 1.0
        return push * (self.inverse(share) / share)


def strongest(info: TaskInfo) -> float:
    """Largest amplitude of the elements over the surface's."""
    assert info.surface.max_amplitude is not None
    return min(info.hardware.limit / info.surface.max_amplitude, 1.0) if info.surface.max_amplitude > 0.0 else 1.0


def allocator_for(info: TaskInfo, rule: str) -> Allocator:
    """The allocator that knows what the actuators' data sheet says of small and large amplitudes.

    Raises:
        ValueError: a rule that it does not have.
    """
    sheet, most, largest = info.hardware, strongest(info), info.surface.max_amplitude
    assert largest is not None
    if sheet.dead_zone == 0.0:
        return Allocator(info.surface, info.parts, rule)
    if sheet.dead_zone_form != "hard":
        return SoftAllocator(info.surface, info.parts, rule, width=sheet.dead_zone / largest, form=sheet.dead_zone_form)
    # Commands are rounded to the resolution before the dead zone takes what is small.
    least = ((1.0 + MARGIN) * sheet.dead_zone + 0.5 * sheet.resolution) / largest
    return DeadZoneAllocator(info.surface, info.parts, rule, least=min(least, most), most=most)
