"""Figs. 5.19 to 5.21, 5.24 and 5.25: step responses of the reduced and the real plant, PID and state space controller."""

from __future__ import annotations

from collections.abc import Mapping

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import PidController, RealPlant, ReducedPlant, Response, StateController, step_response
from studies.thesis.figure import Comparison, Figure, Picture, of_number, of_range
from studies.thesis.state_feedback import Observer
from vibgym import Surface
from vibgym.scene.parts import shipped_part

STEP, SECONDS = 0.3, 10.0  # m, s
LIMIT = 0.25e-3
"""m, the amplitude at which the velocities of fig. 5.20 stay below 0.25 m/s; at lift-off they reach 0.30 m/s."""

ACCELERATION = 1.8
"""m/s^2, of the aluminium block at rest with that amplitude."""

FINE = 1e-3
"""s, period that approximates continuous time."""


def pid_responses() -> Mapping[str, Response]:
    """Return the step responses of the PID controller by name."""
    period, part = Surface().period, shipped_part("aluminium_block")

    def real(late: bool, limit: float | None) -> Response:
        plant = RealPlant(part, limit=limit)
        return step_response(PidController(period, late=late), plant, STEP, SECONDS, Observer(period))

    return {
        "reduced": step_response(PidController(FINE, late=False), ReducedPlant(FINE), STEP, SECONDS, None),
        "real": real(False, LIMIT),
        "lift-off": real(False, None),
        "reduced, limited": step_response(
            PidController(period, late=False), ReducedPlant(period, ACCELERATION), STEP, SECONDS, None
        ),
        "reduced, discrete": step_response(PidController(period), ReducedPlant(period), STEP, SECONDS, None),
        "real, discrete": real(True, LIMIT),
    }


def draw_pid() -> Figure:
    """Compute and plot the step responses of the PID controller (figs. 5.19 to 5.21)."""
    runs = pid_responses()
    peak = {name: float(run.position.max()) for name, run in runs.items()}
    over = {name: 100.0 * float(run.overshoot(STEP)[0]) for name, run in runs.items()}
    fastest = {name: float(runs[name].velocity.max()) for name in ("real", "lift-off")}
    first = float(runs["real"].wanted[0, 0])
    return Figure(
        title="Figs. 5.19 to 5.21: PID controller, reduced and real plant",
        shows="Steps of the set position with kP = 12, kI = 8, kD = 6 (three poles at -2 rad/s). The reduced plant is a double "
        "integrator; the real one is preceded by saturation and the inverse of the frictional process, with an observer, "
        "L = [10, 25], whose input is the acceleration after saturation. Fig. 5.21 has the discrete form 5.81. The curves are "
        "lost; the ends of their axes are bounds on their peaks.",
        comparisons=(
            of_number("Overshoot of the reduced plant (eq. 5.74 in closed form)", 20.6, over["reduced"], "%", 1),
            of_range("Peak of the reduced plant, by the axis of fig. 5.19", 0.35, 0.40, peak["reduced"], "m"),
            of_range("Peak of the real plant, by the axis of fig. 5.19", 0.40, 0.45, peak["real"], "m"),
            of_range("Largest velocity, by the axis of fig. 5.20, limit 0.25 mm", 0.20, 0.25, fastest["real"], "m/s"),
            of_range("The same with the limit at lift-off, 0.40 mm", 0.20, 0.25, fastest["lift-off"], "m/s"),
            of_range(
                "Peak with the discrete form, reduced plant (fig. 5.21)", 0.40, 0.45, peak["reduced, discrete"], "m"
            ),
            of_range("Peak with the discrete form, real plant (fig. 5.21)", 0.50, 0.60, peak["real, discrete"], "m"),
            Comparison(
                "Overshoot of the reduced plant whose acceleration alone is limited, to 1.8 m/s^2",
                "not given",
                f"{over['reduced, limited']:.1f} %",
                "the main cause of the real plant's overshoot is the top speed, not the limit on acceleration",
            ),
            Comparison(
                "Largest wanted acceleration",
                "axis ends at 4 m/s^2",
                f"{first:.0f} m/s^2 in the first period, {float(runs['real'].wanted[1, 0]):.1f} m/s^2 in the second",
                "the derivative term of the first period exceeds the axis",
            ),
        ),
        differs=f"The reduced plant overshoots by {over['reduced']:.1f} %, as in closed form. Integral windup makes the real "
        f"plant overshoot by {over['real']:.0f} % with amplitudes up to 0.25 mm and by {over['lift-off']:.0f} % up to "
        "lift-off; the velocity axis of fig. 5.20 fits the former only. The discrete form overshoots by "
        f"{over['reduced, discrete']:.0f} % on the reduced plant, within its axis. One axis of fig. 5.21 ends at 0.6 m: if it "
        "is the real plant's, the overshoot in the thesis was at least two thirds; here it is "
        f"{over['real, discrete']:.0f} %.",
        assumed=(
            "The step is 0.3 m: the set position on the axes of figs. 5.19 and 5.24. The part is the aluminium block.",
            "The thesis gives no value for the limit in these simulations; 0.25 mm is from figs. 7.8 to 7.10.",
            "The continuous-time loop on the real plant has a period of 40 ms, without the additional period of eq. 5.81.",
            "The assignment of the two axes of fig. 5.21 to the plants is lost.",
        ),
        pictures=(
            Picture(
                _plot_pid(runs),
                "Top: positions of the reduced and the real plant (left fig. 5.19, right fig. 5.21, both with the limit at "
                "0.25 mm; dotted: limit at lift-off). Bottom: wanted acceleration and acceleration after saturation, actual "
                "and estimated velocity (fig. 5.20).",
            ),
        ),
    )


def _plot_pid(runs: Mapping[str, Response]) -> bytes:
    figure = new_figure(7.6, 4.6)
    panels = figure.subplots(2, 2)
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
    return png(figure)


def state_space_responses() -> Mapping[str, Response]:
    """Return the step responses of the state space controller by plant."""
    period, part = Surface().period, shipped_part("aluminium_block")
    real = RealPlant(part, limit=LIMIT)
    return {
        "reduced": step_response(StateController(), ReducedPlant(FINE), STEP, SECONDS, None),
        "real": step_response(StateController(), real, STEP, SECONDS, Observer(period)),
    }


def draw_state_space() -> Figure:
    """Compute and plot the step responses of the state space controller (figs. 5.24 and 5.25)."""
    runs = state_space_responses()
    over = {name: 100.0 * float(run.overshoot(STEP)[0]) for name, run in runs.items()}
    real = runs["real"]
    first, most = float(real.wanted[0, 0]), float(real.amplitude.max())
    limited = real.time[(real.wanted - real.given)[:, 0] > 1e-3]
    until = f"until {limited[-1] + 0.04:.2f} s" if len(limited) else "never"
    return Figure(
        title="Figs. 5.24 and 5.25: state space controller, reduced and real plant",
        shows="The same step with state feedback R = [4, 4], both poles at -2 rad/s, and the same observer. Without an "
        "integral there is no windup: the axes of both plants end at the set position, 0.3 m.",
        comparisons=(
            of_number("Overshoot of the reduced plant", 0.0, max(over["reduced"], 0.0), "%", 2),
            of_number("Overshoot of the real plant, by the axis of fig. 5.24", 0.0, max(over["real"], 0.0), "%", 2),
            of_number(
                "First wanted acceleration, R1 times the step (axis of fig. 5.25: above 1)", 1.2, first, "m/s^2", 2
            ),
            Comparison(
                "Wanted acceleration and acceleration after saturation differ",
                "at the beginning",
                f"{until}; amplitudes reach {1e3 * most:.2f} mm",
                "none: the first is the largest" if len(limited) else "all are within 0.25 mm",
            ),
        ),
        differs=f"Both plants come to rest without overshoot ({over['real']:.2f} % on the real plant).",
        assumed=(
            "Step, part and limit as in figs. 5.19 to 5.21.",
            "The duration of saturation in fig. 5.25 is lost with its curves.",
        ),
        pictures=(
            Picture(
                _plot_state_space(runs),
                "Left: positions (fig. 5.24). Right: wanted acceleration and acceleration after saturation (fig. 5.25).",
            ),
        ),
    )


def _plot_state_space(runs: Mapping[str, Response]) -> bytes:
    figure = new_figure(7.6, 2.6)
    panels = figure.subplots(1, 2)
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
    return png(figure)
