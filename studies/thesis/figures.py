"""The thesis's figures beside ours, by name, in the order of the page."""

from __future__ import annotations

from collections.abc import Callable

from studies.thesis import (
    camera_chain,
    centroid_error,
    control_cycle,
    cylinder_figure,
    element_size,
    friction_radius,
    parameter_study,
    pid_step,
    prototype_steps,
    speed_ratio,
    squeeze,
    state_space_step,
    steady_velocity,
    transient,
    velocity,
)
from studies.thesis.figure import Figure
from vibgym.registry import Registry

FIGURES: Registry[Callable[[], Figure]] = Registry(
    "figure",
    {
        "transient": transient.draw,
        "steady_velocity": steady_velocity.draw,
        "speed_ratio": speed_ratio.draw,
        "cylinder": cylinder_figure.draw,
        "camera_chain": camera_chain.draw,
        "centroid_error": centroid_error.draw,
        "pid_step": pid_step.draw,
        "state_space_step": state_space_step.draw,
        "parameter_study": parameter_study.draw,
        "element_size": element_size.draw,
        "friction_radius": friction_radius.draw,
        "velocity": velocity.draw,
        "squeeze": squeeze.draw,
        "control_cycle": control_cycle.draw,
        "prototype_steps": prototype_steps.draw,
    },
)
"""One module for each, whose ``draw()`` makes it in seconds; add a line here, where it stands in the thesis."""
