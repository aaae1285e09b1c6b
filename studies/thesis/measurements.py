"""Published measurements of the thesis's machine, with their uncertainty, and the ranges of its parameters.

The curves of figs. 7.2 to 7.10 are lost in the text at hand. What is left are printed numbers, statements that compare
experiment and simulation, and the ticks of the axes. Each has half the width of the interval in which the true value lies:
rounding of printed numbers, or the reading error assumed for a statement or an axis.
"""

from __future__ import annotations

import math
from typing import NamedTuple

PRINTED, STATED, AXIS = "printed", "statement", "axis"


class ThesisMeasurement(NamedTuple):
    """Measured value, range or bound."""

    experiment: str  # among EXPERIMENTS
    what: str  # quantity and conditions
    low: float  # smallest and largest value, equal for a single one; infinite where there is no bound
    high: float
    error: float  # half the width of the interval around them in which the true value lies
    unit: str
    source: str  # section, figure or equation
    kind: str  # PRINTED, STATED or AXIS; see the module

    def residual(self, value: float) -> float:
        """Return the signed distance of a model's value to the range in units of the error; up to 1 agrees."""
        return (value - min(max(value, self.low), self.high)) / self.error

    def text(self) -> str:
        """Return range and error as text."""
        if self.low == -math.inf:
            middle = f"at most {self.high:g}"
        elif self.low == self.high:
            middle = f"{self.low:g}"
        else:
            middle = f"{self.low:g} to {self.high:g}"
        return f"{middle} ± {self.error:g} {self.unit}"


EXPERIMENTS = ("friction", "steady", "top speed", "steps", "squeeze")

AMPLITUDES = (0.12, 0.15, 0.20, 0.25, 0.30, 0.35, 0.39)
"""mm, above the 0.1 mm from which the thesis calls the agreement in fig. 7.3 satisfactory, up to the end of its axis."""

VISIBLE = 10.0
"""mm/s, a tenth of the distance between two ticks in fig. 7.3: a larger difference of two curves is visible."""

MEASUREMENTS: dict[str, ThesisMeasurement] = {
    "coefficient": ThesisMeasurement(
        "friction", "coefficient fitted to the radius, 2 to 10 Hz", 0.58, 0.58, 0.005, "", "7.1", PRINTED),
    "window": ThesisMeasurement("friction", "sweep up against sweep down", -math.inf, 0.0, 0.2, "Hz", "7.1, fig. 7.2", STATED),
    "departure": ThesisMeasurement(
        "friction", "radius against that of the fit, rms of sliding parts", -math.inf, 0.0, 0.06, "mm", "fig. 7.2", STATED),
    **{f"steady {at:.2f}": ThesisMeasurement(
        "steady", f"speed at {at:.2f} mm minus simulated", 0.0, 0.0, VISIBLE, "mm/s", "fig. 7.3", STATED) for at in AMPLITUDES},
    "steady 0.08": ThesisMeasurement(
        "steady", "speed at 0.08 mm minus simulated", -math.inf, 0.0, VISIBLE, "mm/s", "fig. 7.3", STATED),
    "top": ThesisMeasurement("top speed", "largest speed of parts", 350.0, 350.0, 5.0, "mm/s", "abstract, table 1.1", PRINTED),
    "overshoot": ThesisMeasurement("steps", "PID: overshoot", 50.0, 50.0, 5.0, "%", "7.3.2", PRINTED),
    "excess": ThesisMeasurement(
        "steps", "PID: overshoot minus simulated, 'a little larger'", 0.0, 10.0, 2.0, "%", "7.3.2", STATED),
    "early": ThesisMeasurement(
        "steps", "PID: position at 1 s minus simulated, 'slightly slower'", -30.0, 0.0, 15.0, "mm", "fig. 7.8", STATED),
    "peak": ThesisMeasurement("steps", "PID: largest position", 400.0, 500.0, 10.0, "mm", "fig. 7.8", AXIS),
    "fastest": ThesisMeasurement("steps", "PID: largest velocity", 200.0, 300.0, 10.0, "mm/s", "fig. 7.8", AXIS),
    "residual": ThesisMeasurement("steps", "PID: rms position error, last 10 s", 6.2, 6.2, 2.0, "mm", "7.3.2", PRINTED),
    "state early": ThesisMeasurement(
        "steps", "state space: position at 1 s minus simulated", 0.0, 0.0, 15.0, "mm", "fig. 7.9", STATED),
    "separated": ThesisMeasurement("steps", "state space: amplitude below 0.1 mm", 1.2, 1.2, 0.1, "s", "7.3.2", PRINTED),
    "state residual": ThesisMeasurement(
        "steps", "state space: rms position error, last 10 s", 5.9, 26.8, 1.0, "mm", "7.3.2, two runs", PRINTED),
    "squeeze y": ThesisMeasurement("squeeze", "standard deviation of y after 2 s", -math.inf, 5.0, 0.5, "mm", "7.2.2", STATED),
    "squeeze heading": ThesisMeasurement(
        "squeeze", "standard deviation of the heading, median after 2 s", -math.inf, 22.5, 2.0, "deg", "7.2.2", STATED),
}  # fmt: skip
"""Fitted measurements. The error of the PID's residual is the scatter of simulated machines of equal settings."""


class Range(NamedTuple):
    """Range of a parameter in SI units, and its source."""

    low: float
    high: float
    unit: str
    scale: float  # of the unit in tables
    source: str


BOX: dict[str, Range] = {
    "friction": Range(0.5, 0.8, "", 1.0, "dotted lines of fig. 7.2; at a slip of 0.1 m/s, of that experiment"),
    "horizontal_amplitude": Range(2.65e-3, 2.75e-3, "mm", 1e3, "2.7 mm, rounded; fixed by the cranks (6.4.1)"),
    "frequency": Range(24.5, 25.5, "Hz", 1.0, "25 Hz, rounded"),
    "gain": Range(0.6, 1.1, "", 1.0, "no value in the thesis; assumed"),
    "dead_zone": Range(0.03e-3, 0.1e-3, "mm", 1e3, "amplitudes below 0.1 mm are not realised (7.2, 7.3)"),
    "limit": Range(0.2e-3, 0.3e-3, "mm", 1e3, "axes of figs. 7.8 to 7.10"),
    "step": Range(0.2, 0.34, "m", 1.0, "axes of figs. 7.8 to 7.10"),
    "rise": Range(0.0, 4.0, "", 1.0, "no value in the thesis; assumed"),
    "speed": Range(0.03, 0.8, "m/s", 1.0, "no value in the thesis; assumed"),
    "shape": Range(0.5, 4.0, "", 1.0, "no value in the thesis; all that the law permits"),
    "top_frequency": Range(25.0, 35.0, "Hz", 1.0, "inverter (6.4.1) without a stated range; assumed"),
}
"""Parameters of a machine and their ranges."""
