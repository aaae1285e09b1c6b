"""Surface, parts and their geometry."""

from vibgym.scene.hulls import hulls_of
from vibgym.scene.library import shapes
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

__all__ = ["Part", "Surface", "hulls_of", "shapes"]
