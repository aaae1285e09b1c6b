"""Figs. 5.24 and 5.25: step responses of the reduced and the real plant with the state space controller."""

from __future__ import annotations

from collections.abc import Mapping

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import RealPlant, ReducedPlant, Response, StateController, step_response
from studies.thesis.figure import Figure, figure
from studies.thesis.pid_step import FINE, LIMIT, SECONDS, STEP
from vibgym.scene.parts import shipped_part


def responses() -> Mapping[str, Response]:
    """Return the step responses by plant."""
    plants = {"reduced": ReducedPlant(FINE), "real": RealPlant(shipped_part("aluminium_block"), limit=LIMIT)}
    return {name: step_response(StateController(), plant, STEP, SECONDS) for name, plant in plants.items()}


def draw() -> Figure:
    """Compute and plot the step responses."""
    runs = responses()
    real = runs["real"]
    limited = real.time[(real.wanted - real.given)[:, 0] > 1e-3]
    values = {
        **{f"over_{name}": max(100.0 * float(run.overshoot(STEP)[0]), 0.0) for name, run in runs.items()},
        "first": float(real.wanted[0, 0]),
        "until": f"until {limited[-1] + 0.04:.2f} s" if len(limited) else "never",
        "amplitude": 1e3 * real.amplitude.max(),
        "limited": "none: the first is the largest" if len(limited) else "all are within 0.25 mm",
    }
    return figure("state_space_step", values, [_plot(runs)])


def _plot(runs: Mapping[str, Response]) -> bytes:
    picture = new_figure(7.6, 2.6)
    panels = picture.subplots(1, 2)
    for (name, run), colour in zip(runs.items(), (INK, SUCCESS), strict=True):
        panels[0].plot(run.time, run.position, color=colour, linewidth=1.2, label=name)
    panels[0].axhline(STEP, color=MUTED, linewidth=0.6)
    real = runs["real"]
    panels[1].plot(real.time, real.wanted, color=FAILURE, linewidth=1.0, label="wanted")
    panels[1].plot(real.time, real.given, color=SUCCESS, linewidth=1.2, label="after saturation")
    for axes, label in zip(panels, ("position, m", "acceleration, m/s^2")):
        style(axes, xlabel="time, s", ylabel=label)
        axes.set_xlim(0.0, SECONDS)
        axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(picture)
