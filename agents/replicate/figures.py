"""The thesis's figures beside ours, by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from agents.replicate import (
    camera_chain,
    element_size,
    friction_radius,
    parameter_study,
    quantisation_figure,
    speed_ratio,
    squeeze_figure,
    steady_velocity,
    transient,
    velocity_figure,
)
from agents.replicate.figure import Figure
from vibgym.registry import Registry

FIGURES: Registry[Callable[[], Figure]] = Registry(
    "figure",
    {
        "transient": transient.draw,
        "steady_velocity": steady_velocity.draw,
        "speed_ratio": speed_ratio.draw,
        "centroid_error": quantisation_figure.draw,
        "camera_chain": camera_chain.draw,
        "parameter_study": parameter_study.draw,
        "element_size": element_size.draw,
        "friction_radius": friction_radius.draw,
        "velocity": velocity_figure.draw,
        "squeeze": squeeze_figure.draw,
    },
)
"""One module for each, whose ``draw()`` makes it in seconds; add a line here, where it stands in the thesis."""
