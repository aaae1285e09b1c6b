"""Rendering in a browser: the scripts, and the scene that ``table.js`` and ``side.js`` draw."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from vibgym.rendering import colours
from vibgym.rendering.view import Scenery

HERE = Path(__file__).parent

SCRIPTS = ("shapes", "table", "side")
"""Scripts in the order of their dependencies."""


def script_path(name: str) -> Path:
    """Return the file of one of :data:`SCRIPTS`."""
    return HERE / f"{name}.js"


def drawn_scene(scenery: Scenery) -> dict[str, Any]:
    """Return the static scene for JSON: table, walls, zones, outlines, colours; lengths in m."""
    return {
        "rows": scenery.rows,
        "columns": scenery.columns,
        "size": scenery.element_size,
        "walls": list(scenery.walls),
        "outlines": [np.round(outline, 6).tolist() for outline in scenery.outlines],
        "tints": [tint_of(kind) for kind in scenery.kinds],
        "zones": [
            {"box": [*zone.low, *zone.high], "tint": tint_of(zone.kind), "label": zone.label} for zone in scenery.zones
        ],
        "goalSize": scenery.goal_size,
        "tolerance": scenery.tolerance or 0.0,
        "asked": list(scenery.asked),
    }


def tint_of(kind: int) -> list[str]:
    """Return the colour of a kind, and that of text on it."""
    colour = colours.PARTS[kind % len(colours.PARTS)]
    return [_hex(colour), _hex(colours.INK if colours.is_light(colour) else colours.PAPER)]


def _hex(colour: Any) -> str:
    return "#{:02x}{:02x}{:02x}".format(*colour)
