"""Singulate: take a crowd of parts apart."""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks.many import ManyTask


class Singulate(ManyTask):
    """All distances between present parts above the largest dimension of an element, sqrt(2) x element_size; none has fallen.

    Then no two parts touch the same element, and each can be moved on its own (thesis, section 4.1). Parts start in one
    cluster, in touch.
    """

    SETTINGS = ("slots", "walls", "randomize")
    ZONES = False

    def __init__(self, surface: Surface, parts: Sequence[Part], **settings: Any) -> None:
        super().__init__(surface, parts, start="crowded", **settings)

    def apart(self) -> float:
        return math.sqrt(2.0) * self.surface.element_size
