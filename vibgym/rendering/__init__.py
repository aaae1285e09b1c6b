"""Pictures of a state, from arrays in SI units.

Names are imported on first use: this package imports neither numba nor pygame. Painters and windows need pygame, an optional
dependency.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vibgym.rendering.raster import Marks, rasterise
    from vibgym.rendering.side import Side
    from vibgym.rendering.view import Scenery, SurfacePainter, View, Zone
    from vibgym.rendering.window import Window

__all__ = ["Marks", "Scenery", "Side", "SurfacePainter", "View", "Window", "Zone", "rasterise"]

_HOMES: dict[str, str] = dict.fromkeys(("Scenery", "SurfacePainter", "View", "Zone"), "view")
_HOMES |= {"Marks": "raster", "Side": "side", "Window": "window", "rasterise": "raster"}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value
