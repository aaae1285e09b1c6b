"""Figs. 5.19 to 5.21: step responses of the reduced and the real plant with the PID controller."""

from __future__ import annotations

from collections.abc import Mapping

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import PidController, RealPlant, ReducedPlant, Response, step_response
from studies.thesis.figure import Figure, figure
from vibgym import Surface
from vibgym.scene.parts import shipped_part

STEP, SECONDS = 0.3, 10.0  # m, s
LIMIT = 0.25e-3
"""m, the amplitude at which the velocities of fig. 5.20 stay below 0.25 m/s; at lift-off they reach 0.30 m/s."""

ACCELERATION = 1.8
"""m/s^2, of the aluminium block at rest with that amplitude."""

FINE = 1e-3
"""s, period that approximates continuous time."""


def responses() -> Mapping[str, Response]:
    """Return the step responses by name."""
    period, part = Surface().period, shipped_part("aluminium_block")

    def run(plant: ReducedPlant | RealPlant, late: bool = False) -> Response:
        return step_response(PidController(plant.period, late=late), plant, STEP, SECONDS)

    return {
        "reduced": run(ReducedPlant(FINE)),
        "real": run(RealPlant(part, limit=LIMIT)),
        "lift-off": run(RealPlant(part, limit=None)),
        "reduced, limited": run(ReducedPlant(period, ACCELERATION)),
        "reduced, discrete": run(ReducedPlant(period), late=True),
        "real, discrete": run(RealPlant(part, limit=LIMIT), late=True),
    }


def draw() -> Figure:
    """Compute and plot the step responses."""
    runs = responses()
    names = {name: name.replace(", ", "_").replace("-", "_") for name in runs}
    values = {
        **{f"peak_{names[name]}": float(run.position.max()) for name, run in runs.items()},
        **{f"over_{names[name]}": 100.0 * float(run.overshoot(STEP)[0]) for name, run in runs.items()},
        **{f"fastest_{names[name]}": float(runs[name].velocity.max()) for name in ("real", "lift-off")},
        "wanted": runs["real"].wanted[:2, 0],
    }
    return figure("pid_step", values, [_plot(runs)])


def _plot(runs: Mapping[str, Response]) -> bytes:
    picture = new_figure(7.6, 4.6)
    panels = picture.subplots(2, 2)
    real = runs["real"]
    shown = (
        (panels[0, 0], (("reduced", INK, "-"), ("real", SUCCESS, "-"), ("lift-off", SUCCESS, ":"))),
        (panels[0, 1], (("reduced, discrete", INK, "-"), ("real, discrete", SUCCESS, "-"))),
    )
    for axes, lines in shown:
        for name, colour, line in lines:
            axes.plot(runs[name].time, runs[name].position, color=colour, linestyle=line, linewidth=1.2, label=name)
        axes.axhline(STEP, color=MUTED, linewidth=0.6)
        axes.set_ylim(0.0, 0.48)
        style(axes, ylabel="position, m")
    panels[1, 0].plot(real.time, real.wanted, color=FAILURE, linewidth=1.0, label="wanted")
    panels[1, 0].plot(real.time, real.given, color=SUCCESS, linewidth=1.2, label="after saturation")
    panels[1, 0].set_ylim(-3.0, 4.0)
    style(panels[1, 0], xlabel="time, s", ylabel="acceleration, m/s^2")
    panels[1, 1].plot(real.time, real.velocity, color=SUCCESS, linewidth=1.2, label="actual")
    panels[1, 1].plot(real.time, real.estimate, color=FAILURE, linewidth=1.0, linestyle="--", label="observer")
    style(panels[1, 1], xlabel="time, s", ylabel="velocity, m/s")
    for axes in panels.flat:
        axes.set_xlim(0.0, SECONDS)
        axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(picture)
