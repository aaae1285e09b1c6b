"""What is on the table and how it moves on: surface, parts, simulator."""

from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.simulator import Simulator
from vibgym.scene.surface import Surface

__all__ = ["Part", "Simulator", "Surface", "hulls_of"]
