"""Result of a fit from its last linearization: values, intervals, and what the recording does not determine."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from vibgym.identification.guess import wrapped
from vibgym.identification.law import applied
from vibgym.identification.segments import LONG
from vibgym.identification.solver import Estimate, System
from vibgym.physics.core.hardware import FORMS
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

if TYPE_CHECKING:
    from vibgym.identification.fit import Fit

UNKNOWN = 0.3
"""Posterior over prior deviation from which on a parameter counts as not identified."""

COUPLED = 0.98
"""Absolute correlation from which on only a combination of two parameters is identified."""

AMBIGUOUS = 6.0
"""Chi squared above the best below which a form of the dead zone is not excluded."""

LEVEL = 1.959964
"""Half the width of a 95 % interval, in standard deviations."""


ADVICE = {
    "friction": "parts that coast on elements at rest",
    "horizontal_amplitude": "runs at full amplitude, at more than half the top speed",
    "gain": "commands at several amplitudes above the dead zone",
    "phase": "commands above the dead zone",
    "dead_zone": "amplitudes from 0 to 0.2 mm, each for some periods",
    "camera_scale": "paths over the whole surface with different commands on neighbouring elements",
    "camera_turn": "paths over the whole surface with different commands on neighbouring elements",
    "camera_x": "different commands on neighbouring elements along x",
    "camera_y": "different commands on neighbouring elements along y",
}
"""What a recording must contain to identify a parameter."""


@dataclass(frozen=True)
class Fitted:
    """Result of :func:`fit`.

    Attributes:
        values: estimates by name: ``friction``, ``frequency`` (Hz),
            ``horizontal_amplitude`` (m), ``gain``, ``phase`` (rad), ``dead_zone`` (m), ``dead_zone_form``, ``latency``
            (periods), ``gain_spread``, ``phase_spread`` (rad), ``camera_scale``, ``camera_turn`` (rad), ``camera_x``,
            ``camera_y`` (m), ``max_amplitude`` (m, of the elements), ``noise_position`` (m), ``noise_heading`` (rad),
            ``friction_law`` (kind or ``"constant"``); with a law that the recording requires ``rise`` and ``rise_speed`` (m/s),
            see :class:`vibgym.scene.friction_laws.Stribeck`. With several kinds of parts, these three and friction end in
            ``.<name>``.
        intervals: 95 % intervals (low, high) of all numbers but ``latency`` and ``max_amplitude``.
        correlation: of the estimates, by pairs of names.
        surface: the table with fitted amplitude and frequency; ``max_amplitude`` is that of the elements, which a gain above 1
            lets exceed that of commands, ``actuators["limit"]``.
        actuators: setting of environments: prototype actuators with the fitted values.
        parts: with the fitted friction, and with a friction law if the recording requires one.
        elements: (rows, columns, 2) relative gain and phase error (rad) of each element, shrunk towards 0.
        element_deviations: (rows, columns, 2) their standard deviations; those of elements without data equal the spreads.
        unidentified: what the recording does not determine, and which recording would.
        notes: gaps, assumptions and warnings.
        residuals: (n, 6) cycle, part, measured x and y (m), residual along x and y (m) of every image used.
        alternatives: for latencies and forms of the dead zone that were tried, chi squared above the best; for constant
            friction, chi squared above that of the best friction law.
    """

    values: dict[str, Any]
    intervals: dict[str, tuple[float, float]]
    correlation: dict[tuple[str, str], float]
    surface: Surface
    actuators: dict[str, Any]
    parts: tuple[Part, ...]
    elements: np.ndarray
    element_deviations: np.ndarray
    unidentified: dict[str, str]
    notes: list[str]
    residuals: np.ndarray
    alternatives: dict[str, float]


class Outcome:
    """Values and intervals at an estimate.

    Args:
        problem: what was fitted.
        now, system: estimate, and the problem linearized there.
        zone: 95 % interval of a hard dead zone (m), which has no derivative; None for other forms.
    """

    def __init__(self, problem: Fit, now: Estimate, system: System, zone: tuple[float, float] | None) -> None:
        self.problem, self.solver, self.now, self.system, self.zone = problem, problem.solver, now, system, zone
        self.fixed = problem.fixed(now)
        _, self.covariance = self.solver.posterior(system, now, self.fixed)
        for law in problem.laws.values():  # laws of several kinds are independent, but for the other parameters
            change = self.covariance @ law.products
            self.covariance = self.covariance + change @ law.covariance @ change.T
        self.deviation = np.sqrt(np.diag(self.covariance))

    def fitted(self) -> Fitted:
        """Return values, intervals and everything else."""
        problem, now, deviation = self.problem, self.now, self.deviation
        vector, shared = now.parameters.vector(), len(problem.names)
        values: dict[str, Any] = {}
        intervals: dict[str, tuple[float, float]] = {}
        for k, name in enumerate(problem.names):
            ends = vector[k] + LEVEL * deviation[k] * np.array([-1.0, 0.0, 1.0])
            low, value, high = (_physical(name, end) for end in ends)
            values[name], intervals[name] = value, (low, high)
        if self.zone is not None:
            intervals["dead_zone"] = self.zone
        values["frequency"] = 1.0 / problem.timing.period
        slack = LEVEL * problem.timing.deviation / problem.timing.period**2
        intervals["frequency"] = values["frequency"] - slack, values["frequency"] + slack
        values["latency"], values["dead_zone_form"] = now.parameters.latency, now.parameters.dead_zone_form
        self.add_spreads(values, intervals)
        self.add_laws(values, intervals)
        free = self.solver.freedom(self.system, self.covariance)
        for k, name in enumerate(("noise_position", "noise_heading")):
            value, factor = float(now.noise[k]), math.exp(LEVEL / math.sqrt(2.0 * free[k]))
            values[name], intervals[name] = value, (value / factor, value * factor)
        relative = deviation[:shared] / now.prior.deviation
        product = np.maximum(np.outer(deviation[:shared], deviation[:shared]), 1e-300)
        correlation, names = self.covariance[:shared, :shared] / product, list(enumerate(problem.names))
        pairs = {(a, b): float(correlation[i, j]) for i, a in names for j, b in names}
        relation = np.array([1.0 / now.parameters.gain, 1.0])  # of gains, from absolute to relative errors
        elements = now.parameters.elements * relation
        element_deviations = deviation[shared:].reshape(elements.shape)
        unidentified = self.unidentified(relative, pairs, element_deviations)
        element_deviations = element_deviations * relation
        fitted = replace(
            problem.surface, horizontal_amplitude=now.parameters.horizontal_amplitude, max_amplitude=problem.limit
        )
        values["max_amplitude"] = problem.limit
        return Fitted(
            values, intervals, pairs, fitted, self.actuators(), self.parts(), elements, element_deviations,
            unidentified, self.notes(), self.residual_rows(), problem.alternatives,
        )  # fmt: skip

    def add_spreads(self, values: dict[str, Any], intervals: dict[str, Any]) -> None:
        """Add the standard deviations of the elements' errors; their effective number is the information of the recording."""
        now, shared = self.now, len(self.problem.names)
        for k, name in enumerate(("gain_spread", "phase_spread")):
            spread = float(now.prior.spread[k])
            known = 1.0 - self.deviation[shared + k :: 2] ** 2 / spread**2
            relative = LEVEL / math.sqrt(2.0 * max(float((known**2).sum()), 0.5))
            spread /= now.parameters.gain if name == "gain_spread" else 1.0
            values[name], intervals[name] = spread, (spread * math.exp(-relative), spread * math.exp(relative))

    def add_laws(self, values: dict[str, Any], intervals: dict[str, Any]) -> None:
        """Add the friction laws, and their parameters where friction depends on speed."""
        for kind, name in enumerate(self.problem.names[: len(self.problem.kinds)]):
            label, law = name.removeprefix("friction"), self.problem.laws.get(kind)
            known = self.problem.kinds[kind].friction_law
            values[f"friction_law{label}"] = "constant" if known is None else str(known["kind"])
            if law is not None:
                rise, speed = LEVEL * np.sqrt(np.diag(law.covariance))
                values[f"rise{label}"], values[f"rise_speed{label}"] = law.rise, law.speed
                intervals[f"rise{label}"] = law.rise - rise, law.rise + rise
                intervals[f"rise_speed{label}"] = law.speed * math.exp(-speed), law.speed * math.exp(speed)

    def unidentified(
        self, relative: np.ndarray, pairs: dict[tuple[str, str], float], deviations: np.ndarray
    ) -> dict[str, str]:
        """Return parameters, and pairs of them, that the recording does not determine, and which recording would."""
        problem, now, advice = self.problem, self.now, {}
        for k, name in enumerate(problem.names):
            if relative[k] > UNKNOWN and k not in self.fixed:
                advice[name] = ADVICE[name.partition(".")[0]]
        for i, a in enumerate(problem.names):
            for b in problem.names[i + 1 :]:
                if abs(pairs[a, b]) > COUPLED and a not in advice and b not in advice:
                    advice[f"{a} and {b}"] = f"only a combination is determined; {ADVICE[a.partition('.')[0]]}"
        missing = int((deviations[..., 0] > 0.8 * now.prior.spread[0]).sum())
        if missing:
            advice[f"{missing} of {deviations[..., 0].size} elements"] = "a recording in which parts visit them longer"
        advice["static friction"] = "none on this table: parts slide at all times" if all(
            problem.nominal.slides_permanently(kind.static_friction) for kind in problem.kinds
        ) else "a recording at a lower frequency, in which parts stick"  # fmt: skip
        advice["gravity, element size, mass, limit of commands"] = "none: they are taken as given"
        width = 0.0 if self.zone is None else self.zone[1] - self.zone[0]
        if width > 2.0 * LEVEL * UNKNOWN * 1e-3 * now.prior.deviation[problem.names.index("dead_zone")]:
            advice["dead_zone"] = ADVICE["dead_zone"]
        if sum(problem.alternatives[f"{form} dead zone"] < AMBIGUOUS for form in FORMS) > 1:
            advice["dead_zone_form"] = ADVICE["dead_zone"]
        return advice

    def actuators(self) -> dict[str, Any]:
        """Return prototype actuators with the fitted values, as a setting of environments."""
        problem, p = self.problem, self.now.parameters
        elements = p.elements * np.array([1.0 / p.gain, 1.0]) + np.array([1.0, 0.0])
        elements[..., 0] = np.maximum(elements[..., 0], 0.0)
        return {
            "kind": "prototype", "dead_zone": min(p.dead_zone, 0.99 * problem.sheet.limit), "dead_zone_form": p.dead_zone_form,
            "limit": min(problem.sheet.limit, problem.limit), "latency": p.latency,
            "gain_spread": 0.0, "phase_spread": 0.0, "resolution": problem.sheet.resolution, "gain": p.gain,
            "phase": wrapped(p.phase), "elements": elements.round(5).tolist(),
        }  # fmt: skip

    def parts(self) -> tuple[Part, ...]:
        """Return the parts with the fitted friction, and friction law."""
        problem = self.problem
        pairs = zip(self.now.parameters.friction, problem.kinds, strict=True)
        factors = [float(new) / kind.friction for new, kind in pairs]
        parts = []
        for part, k in zip(problem.parts, problem.kind_of, strict=True):
            friction, static = factors[k] * part.friction, factors[k] * part.static_friction
            part = replace(part, friction=friction, static_friction=static)
            parts.append(applied(part, problem.laws[k].law) if k in problem.laws else part)
        return tuple(parts)

    def notes(self) -> list[str]:
        """Return remarks about the recording."""
        used = sum(len(segment.instant) for segment in self.solver.plant.segments)
        seen = int(np.isfinite(self.problem.log.pose[..., 0]).sum())
        notes = [f"{used} of {seen} poses used, in {len(self.solver.plant.segments)} segments of up to {LONG} periods"]
        notes += [f"gap of {lost} cycles after row {row}" for row, lost in self.problem.timing.gaps.tolist()]
        if self.problem.sheet.bandwidth is not None:
            notes.append("the bandwidth of the actuators is not modelled")
        return notes + self.problem.remarks

    def residual_rows(self) -> np.ndarray:
        """Return the rows of :attr:`Fitted.residuals`."""
        rows = []
        for k, residual in zip(self.system.which, self.system.residuals, strict=True):
            segment = self.solver.plant.segments[k]
            head = np.column_stack(
                [segment.first + segment.instant, np.full(len(residual), segment.part), segment.pose[:, :2]]
            )
            rows.append(np.column_stack([head, residual[:, :2]]))
        return np.concatenate(rows)


def _physical(name: str, value: float) -> float:
    """Return a number of :meth:`Parameters.vector` in its unit."""
    if name == "dead_zone":
        return max(1e-3 * value, 0.0)
    logarithm = name.startswith("friction") or name in ("horizontal_amplitude", "gain", "camera_scale")
    return math.exp(value) if logarithm else float(value)
