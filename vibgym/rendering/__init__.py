"""State to picture: arrays in SI units in, pixels out.

Knows nothing of environments, tasks or scenes. Names are looked up on first use, so that importing this package costs
neither pygame nor numba: pygame is an optional dependency, needed once a painter or a window is constructed.
"""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from vibgym.rendering.raster import Marks, rasterise
    from vibgym.rendering.view import Scenery, Side, SurfacePainter, View, Zone
    from vibgym.rendering.window import Window

__all__ = ["Marks", "Scenery", "Side", "SurfacePainter", "View", "Window", "Zone", "rasterise"]

_HOMES = {
    "Marks": "raster",
    "Scenery": "view",
    "Side": "view",
    "SurfacePainter": "view",
    "View": "view",
    "Window": "window",
    "Zone": "view",
    "rasterise": "raster",
}


def __getattr__(name: str) -> object:
    if name not in _HOMES:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    value = getattr(importlib.import_module(f"{__name__}.{_HOMES[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return sorted(set(globals()) | set(__all__))
