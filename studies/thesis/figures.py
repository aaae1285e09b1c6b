"""Reproduced figures of the thesis by name, in the order of the page, and the page."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from agents.evaluation.pages import data_address, render
from studies.thesis import (
    camera_chain,
    centroid_error,
    control_cycle,
    cylinder_figure,
    element_size,
    friction_radius,
    parameter_study,
    prototype_steps,
    simulated_steps,
    speed_ratio,
    squeeze,
    steady_velocity,
    transient,
    velocity,
)
from studies.thesis.figure import Figure
from vibgym import files
from vibgym.registry import Registry

PAGE = "replicate.html"

FIGURES: Registry[Callable[[], Figure]] = Registry(
    "figure",
    {
        "transient": transient.draw,
        "steady_velocity": steady_velocity.draw,
        "speed_ratio": speed_ratio.draw,
        "cylinder": cylinder_figure.draw,
        "camera_chain": camera_chain.draw,
        "centroid_error": centroid_error.draw,
        "pid_step": simulated_steps.draw_pid,
        "state_space_step": simulated_steps.draw_state_space,
        "parameter_study": parameter_study.draw,
        "element_size": element_size.draw,
        "friction_radius": friction_radius.draw,
        "velocity": velocity.draw,
        "squeeze": squeeze.draw,
        "control_cycle": control_cycle.draw,
        "prototype_steps": prototype_steps.draw,
    },
)
"""Functions that compute and draw a figure, each in seconds, in the order of the thesis."""


def write(output: Path, names: Sequence[str] | None = None) -> Path:
    """Draw all figures, or those of ``names``, write the page into a directory and return its path.

    Raises:
        ValueError: an unknown figure.  vibgym.files.WriteError: the page cannot be written.
    """
    chosen = {name: FIGURES.choose("figure", name) for name in (FIGURES if names is None else names)}
    figures = []
    for name, draw in chosen.items():
        figure = draw()
        pictures = [(data_address(each.png), each.caption) for each in figure.pictures]
        command = f"python -m studies.thesis --figure {name}"
        figures.append({"name": name, "figure": figure, "pictures": pictures, "command": command})
    text = render(Path(__file__).with_name("replicate.html.j2"), figures=figures)
    path = files.output_directory(output) / PAGE
    files.write_atomically(path, text)
    return path
