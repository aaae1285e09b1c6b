"""The thesis's figures beside ours, by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from agents.replicate import camera_chain, quantisation_figure, velocity_figure
from agents.replicate.figure import Figure
from vibgym.registry import Registry

FIGURES: Registry[Callable[[], Figure]] = Registry(
    "figure",
    {
        "centroid_error": quantisation_figure.draw,
        "camera_chain": camera_chain.draw,
        "velocity": velocity_figure.draw,
    },
)
"""One module for each, whose ``draw()`` makes it in seconds; add a line here, where it stands in the thesis."""
