"""Singulate: take a heap of parts apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.arranged import ArrangedTask
from vibgym.tasks.base import HOLD_PERIODS


class Singulate(ArrangedTask):
    """All distances between present parts above the largest dimension of an element, sqrt(2) x element_size; none has fallen.

    Then no two parts touch the same element, and each can be moved on its own (thesis, section 4.1). Parts start in one
    heap, in touch.

    Args:
        randomize, slots, hold: see :class:`ArrangedTask`.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Sequence[Part],
        *,
        randomize: Any = None,
        slots: int | None = None,
        hold: int = HOLD_PERIODS,
    ) -> None:
        apart = math.sqrt(2.0) * surface.element_size
        super().__init__(surface, parts, start="crowded", randomize=randomize, slots=slots, apart=apart, hold=hold)
