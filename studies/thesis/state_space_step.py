"""Figs. 5.24 and 5.25: step responses with the state space controller, of the reduced and of the real plant."""

from __future__ import annotations

from collections.abc import Mapping

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import RealPlant, ReducedPlant, Response, StateController, step_response
from studies.thesis.figure import Comparison, Figure, Picture, of_number
from studies.thesis.pid_step import FINE, LIMIT, SECONDS, STEP
from studies.thesis.state_feedback import Observer
from vibgym import Surface
from vibgym.scene.parts import shipped_part


def responses() -> Mapping[str, Response]:
    """Step responses by plant."""
    period, part = Surface().period, shipped_part("aluminium_block")
    real = RealPlant(part, limit=LIMIT)
    return {
        "reduced": step_response(StateController(), ReducedPlant(FINE), STEP, SECONDS, None),
        "real": step_response(StateController(), real, STEP, SECONDS, Observer(period)),
    }


def draw() -> Figure:
    """Positions, accelerations and amplitudes."""
    runs = responses()
    over = {name: 100.0 * float(run.overshoot(STEP)[0]) for name, run in runs.items()}
    real = runs["real"]
    asked, most = float(real.wanted[0, 0]), float(real.amplitude.max())
    limited = real.time[(real.wanted - real.given)[:, 0] > 1e-3]
    until = f"until {limited[-1] + 0.04:.2f} s" if len(limited) else "never"
    return Figure(
        title="Figs. 5.24 and 5.25: state space controller, reduced and real plant",
        shows="The same step with state feedback R = [4, 4], both poles at -2 rad/s, and the same observer. Without an "
        "integral nothing winds up: the axes of both plants end at the set position, 0.3 m.",
        comparisons=(
            of_number("Overshoot of the reduced plant", 0.0, max(over["reduced"], 0.0), "%", 2),
            of_number("Overshoot of the real plant, by the axis of fig. 5.24", 0.0, max(over["real"], 0.0), "%", 2),
            of_number(
                "Acceleration asked for at first, R1 times the step (axis of fig. 5.25: above 1)",
                1.2,
                asked,
                "m/s^2",
                2,
            ),
            Comparison(
                "Asked for and saturated accelerations differ",
                "at the beginning",
                f"{until}; amplitudes reach {1e3 * most:.2f} mm",
                "none: the largest demand is the first" if len(limited) else "the demand stays within 0.25 mm",
            ),
        ),
        differs=f"Both plants come to rest without overshoot (ours: {over['real']:.2f} % on the real plant).",
        assumed=(
            "Step, part and limit as in figs. 5.19 to 5.21.",
            "How long accelerations were saturated in fig. 5.25 is lost with its curves.",
        ),
        pictures=(
            Picture(
                _plot(runs),
                "Left: positions (fig. 5.24). Right: acceleration asked for and after saturation (fig. 5.25).",
            ),
        ),
    )


def _plot(runs: Mapping[str, Response]) -> bytes:
    figure = new_figure(7.6, 2.6)
    panels = figure.subplots(1, 2)
    for (name, run), colour in zip(runs.items(), (INK, SUCCESS), strict=True):
        panels[0].plot(run.time, run.position, color=colour, linewidth=1.2, label=name)
    panels[0].axhline(STEP, color=MUTED, linewidth=0.6)
    real = runs["real"]
    panels[1].plot(real.time, real.wanted, color=FAILURE, linewidth=1.0, label="asked for")
    panels[1].plot(real.time, real.given, color=SUCCESS, linewidth=1.2, label="after saturation")
    for axes, label in zip(panels, ("position, m", "acceleration, m/s^2")):
        style(axes, xlabel="time, s", ylabel=label)
        axes.set_xlim(0.0, SECONDS)
        axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(figure)
