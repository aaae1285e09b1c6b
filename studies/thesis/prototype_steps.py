"""Figs. 7.8 to 7.10: step responses on the prototype, and the form of dead zone that fits the measurements."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.closed_loop import CONTROLLERS, RealPlant, Response, controller, step_response
from studies.thesis.figure import Figure, figure
from studies.thesis.velocity import DEAD_ZONE
from vibgym.physics.core.hardware import FORMS
from vibgym.scene.parts import shipped_part

STEP, SECONDS, LAST = 0.2, 20.0, 10.0  # m, s, s
LIMIT, LATENCY = 0.25e-3, 1  # m, periods
NOISE = 0.5e-3
"""m, about half a pixel of the prototype's camera."""

MACHINES = 10
"""Number of simulated machines; elements differ by 5 % and 5 deg between machines."""

WIDTHS = (0.05e-3, 0.075e-3, 0.1e-3)  # m, of the table

MEASURED = (5.9, 26.8)  # mm, residuals of the state space controller in the thesis


def responses(
    name: str, *, step: float = STEP, width: float = DEAD_ZONE, form: str = "hard", noise: float = 0.0
) -> Response:
    """Return the step responses of a controller on all machines.

    Args:
        name: among :data:`CONTROLLERS`.
        step: m.
        width: m, of the dead zone.
        form: among :data:`vibgym.physics.core.hardware.FORMS`.
        noise: m, of measured positions.
    """
    plant = RealPlant(
        shipped_part("aluminium_block"), worlds=MACHINES, limit=LIMIT, dead_zone=width, dead_zone_form=form, latency=LATENCY,
        noise=noise, gain_spread=0.05, phase_spread=np.radians(5.0),
    )  # fmt: skip
    return step_response(controller(name), plant, step, SECONDS)


def median_range(values: np.ndarray, unit: str = "mm") -> str:
    """Format the median and range over machines."""
    low, middle, high = np.percentile(1e3 * values, [0.0, 50.0, 100.0])
    return f"{middle:.1f} {unit} ({low:.1f} to {high:.1f})"


def overshoot(run: Response, step: float = STEP) -> float:
    """Return the median overshoot, %."""
    return 100.0 * float(np.median(run.overshoot(step)))


def residual(run: Response) -> float:
    """Return the median residual, mm."""
    return 1e3 * float(np.median(run.residual(STEP, LAST)))


def draw() -> Figure:
    """Plot responses without and with a dead zone, and tabulate the residuals for all forms."""
    runs = {
        (name, form, width): responses(name, form=form, width=width)
        for name in CONTROLLERS for form in FORMS for width in (*WIDTHS, DEAD_ZONE)
    }  # fmt: skip
    free = {name: responses(name, width=0.0) for name in CONTROLLERS}
    pid, state = ({form: runs[name, form, DEAD_ZONE] for form in FORMS} for name in CONTROLLERS)
    stuck = state["hard"]
    varied = {(form, width): residual(runs["state space", form, width]) for form in FORMS for width in WIDTHS}
    near, far = (_nearest(varied, measured) for measured in MEASURED)
    values = {
        "over": overshoot(pid["hard"]),
        "far_over": overshoot(responses("PID", step=0.3), 0.3),
        "noisy": residual(responses("PID", noise=NOISE)),
        **{f"pid_{form}": residual(run) for form, run in pid.items()},
        **{f"state_{form}": residual(run) for form, run in state.items()},
        # the amplitude is above the dead zone initially
        "separated": float(np.median(stuck.time[np.argmax(stuck.amplitude < DEAD_ZONE, axis=0)])),
        "near": near,
        "far": far,
        "estimated": median_range(stuck.rms(stuck.estimate, LAST), "mm/s"),
    }
    rows = [
        {
            "Form": form, "Width": f"{1e3 * width:.3f} mm",
            "PID: overshoot": f"{overshoot(runs['PID', form, width]):.0f} %",
            "PID: residual": median_range(runs["PID", form, width].residual(STEP, LAST)),
            "State space: residual": median_range(runs["state space", form, width].residual(STEP, LAST)),
            "PID: velocity": _velocity(runs["PID", form, width]),
            "State space: velocity": _velocity(runs["state space", form, width]),
        }
        for form in FORMS for width in WIDTHS
    ]  # fmt: skip
    shown = {
        name: {"no dead zone": free[name], "hard": zone["hard"], "soft": zone["soft"]}
        for name, zone in zip(CONTROLLERS, (pid, state), strict=True)
    }
    return figure("prototype_steps", values, [_plot(shown)], rows)


def _velocity(run: Response) -> str:
    return median_range(run.rms(run.velocity, LAST), "mm/s")


def _nearest(residuals: Mapping[tuple[str, float], float], measured: float) -> str:
    """Return the dead zone whose residual (mm) is closest to a measured one, as text."""
    form, width = min(residuals, key=lambda key: abs(residuals[key] - measured))
    return f"{form}, {1e3 * width:.3f} mm wide: {residuals[form, width]:.1f} mm"


def _plot(shown: Mapping[str, Mapping[str, Response]]) -> bytes:
    picture = new_figure(7.6, 5.2)
    panels = picture.subplots(3, 2, sharex=True, sharey="row")
    for column, (name, runs) in enumerate(shown.items()):
        for (label, run), colour, line in zip(runs.items(), (INK, FAILURE, SUCCESS), ("-", "-", "--"), strict=True):
            for row, values in enumerate((run.position, run.velocity, 1e3 * run.amplitude)):
                panels[row, column].plot(
                    run.time, values[:, 0], color=colour, linestyle=line, linewidth=1.0, label=label
                )
        panels[0, column].axhline(STEP, color=MUTED, linewidth=0.6)
        panels[2, column].axhline(1e3 * DEAD_ZONE, color=MUTED, linewidth=0.6)
        style(panels[2, column], xlabel="time, s")
        panels[0, column].legend(frameon=False, fontsize=7.5, labelcolor=MUTED, title=name, title_fontsize=7.5)
    for row, label in enumerate(("position, m", "velocity, m/s", "amplitude, mm")):
        style(panels[row, 0], ylabel=label)
        style(panels[row, 1])
    panels[2, 1].set_xlim(0.0, SECONDS)
    return png(picture)
