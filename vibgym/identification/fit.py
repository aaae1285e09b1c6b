"""Fit of a machine's parameters to a recording."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
from scipy.stats import chi2

from vibgym import checks
from vibgym.actuators import actuators_from
from vibgym.identification.guess import CAMERA, LARGEST_ZONE, first_estimates, latencies_of, starts_of, wrapped
from vibgym.identification.log import Log
from vibgym.identification.plant import Parameters, Plant
from vibgym.identification.result import ADVICE, Fitted
from vibgym.identification.segments import LONG, SHORT, segments_of, timing_of
from vibgym.identification.solver import Estimate, Prior, Solver, System
from vibgym.physics.core.hardware import FORMS, HARD
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

FEW = 60
"""Segments for the comparison of latencies."""

ZONES = 31
"""Dead zones in a scan."""

FINER = 3
"""Most scans of a hard dead zone, each of the interval that the one before has left."""

DEVIATIONS = {
    "friction": 0.5, "horizontal_amplitude": 0.3, "gain": 0.5, "phase": 3.0, "dead_zone": 0.15, "camera_scale": 0.05,
    "camera_turn": 0.1, "camera_x": 0.02, "camera_y": 0.02,
}  # fmt: skip
"""Standard deviations of the weak prior, in the units of :meth:`Parameters.vector`: about the nominal values."""

UNKNOWN = 0.3
"""Posterior over prior deviation from which on a parameter counts as not identified."""

COUPLED = 0.98
"""Absolute correlation from which on only a combination of two parameters is identified."""

AMBIGUOUS = 6.0
"""Chi squared above the best below which a form of the dead zone is not excluded."""

EXCLUDED = 300.0
"""The same, above which a form is not tried again."""

LEVEL = 1.959964
"""Half the width of a 95 % interval, in standard deviations."""

TRIES, NEARLY = 15, 0.99
"""Most steps for a latency, and ratio of costs after and before a step from which on it has converged."""

ROUNDS = 12
"""Most steps with elements after form and dead zone have been chosen."""

SETTLED = 0.1
"""Step over standard deviation, of all shared parameters, below which the fit has converged."""


def fit(
    log: Log,
    surface: Surface | None = None,
    parts: Part | Sequence[Part] | None = None,
    *,
    report: Callable[[str], object] | None = None,
) -> Fitted:
    """Estimate the parameters of a machine from a recording.

    Least squares on the simulator by multiple shooting: the recording is cut into segments with free initial states, and all
    segments and finite differences are simulated in one batch. Known and not fitted: gravity, size of the elements, outlines of
    the parts, and limit and resolution of the amplitudes. The table's period is that of the commands.

    Args:
        log: the recording.
        surface, parts: nominal ones; None: those of the recording.
        report: called with a line about each stage.

    Raises:
        ValueError: commands for another surface, other parts, or too little data.
    """
    checks.instance("log", log, Log)
    nominal: Surface = log.surface if surface is None else checks.instance("surface", surface, Surface)
    parts = log.parts if parts is None else (parts,) if isinstance(parts, Part) else tuple(parts)
    return _Job(log, nominal, parts, report or (lambda line: None)).run()


class _Job:
    """A fit in progress."""

    def __init__(self, log: Log, surface: Surface, parts: tuple[Part, ...], report: Callable[[str], object]) -> None:
        _check_machine(log, surface, parts)
        self.log, self.nominal, self.parts, self.report = log, surface, parts, report
        self.timing = timing_of(log, surface.period)
        frequency = 1.0 / self.timing.period
        lift_off = surface.gravity / (2.0 * math.pi * frequency) ** 2
        self.surface = replace(
            surface, frequency=frequency, max_amplitude=min(surface.max_amplitude or math.inf, lift_off)
        )
        self.kinds, self.kind_of = kinds_of(parts, Part.same_as)
        self.sheet = actuators_from(log.settings["actuators"], surface, 1, 1).data_sheet
        self.latencies = latencies_of(self.sheet)
        self.names = [*_friction_names(self.kinds), *Parameters.GLOBALS]
        self.zone = self.names.index("dead_zone")
        self.alternatives: dict[str, float] = {}

    def solver(self, length: int) -> Solver:
        """Return the solver for segments of a length."""
        segments = segments_of(self.log, self.timing, self.parts, self.surface.element_size, self.latencies, length)
        limit = self.sheet.limit
        plant = Plant(self.log, segments, length, self.surface, self.kinds, limit, self.sheet.resolution)
        return Solver(plant, [kind.symmetry != 0 for kind in self.kinds])

    def run(self) -> Fitted:
        """Return the result."""
        solver = self.solver(SHORT)
        now = self.with_latency(solver)
        everything = range(len(solver.plant.segments))
        for _ in range(2):  # again with a better dead zone, whose form may be far from the nominal one
            now = self.improve(solver, now, everything, ROUNDS, elements=False)
            now = self.with_zone(solver, now, everything, solver.linearize(everything, now, False))
            for form in FORMS:
                self.alternatives.pop(f"{form} dead zone", None)  # elements may decide otherwise
        now = self.improve(solver, now, everything, ROUNDS, elements=False)
        self.report(f"short segments: {self.describe(now)}")
        known = {(each.part, each.first): start for each, start in zip(solver.plant.segments, now.starts, strict=True)}
        solver = self.solver(LONG)
        segments, everything = solver.plant.segments, range(len(solver.plant.segments))
        starts = starts_of(segments, now.parameters, self.surface, self.kinds)
        for k, each in enumerate(segments):
            starts[k] = known.get((each.part, each.first), starts[k])
        now = self.improve(solver, replace(now, starts=starts), everything, 2, elements=False)
        now = self.improve(solver, now, everything, 2, elements=True)
        self.report(f"long segments: {self.describe(now)}")
        system = solver.linearize(everything, now, True)
        for _ in range(2):  # a form that fits better once the elements' errors are known is tried in a second round
            now = self.with_zone(solver, now, everything, system)
            now = self.improve(solver, now, everything, ROUNDS, elements=True)
            system = solver.linearize(everything, now, True)
            if self.forms(solver, now, everything, system)[0][1] == now.parameters.dead_zone_form:
                break
        self.report(f"final: {self.describe(now)}")
        return self.result(solver, now, everything, system)

    def describe(self, now: Estimate) -> str:
        """Return a line with the main values."""
        p = now.parameters
        friction = ", ".join(f"{each:.4f}" for each in p.friction)
        return (
            f"friction {friction}, a_h {1e3 * p.horizontal_amplitude:.4f} mm, gain {p.gain:.4f}, phase {p.phase:.4f}, "
            f"{p.dead_zone_form} dead zone {1e3 * p.dead_zone:.4f} mm, latency {p.latency}, "
            f"noise {1e3 * now.noise[0]:.4f} mm, spread {now.prior.spread.round(4)}"
        )

    def fixed(self, now: Estimate) -> list[int]:
        """Return the indices of parameters without derivatives: a hard dead zone has steps."""
        return [self.zone] if now.parameters.dead_zone_form == FORMS[HARD] else []

    def improve(self, solver: Solver, now: Estimate, which: Sequence[int], steps: int, *, elements: bool) -> Estimate:
        """Return the estimate after Gauss-Newton steps, with its noise."""
        fixed = self.fixed(now)
        for _ in range(steps):
            done = solver.step(which, now, elements=elements, fixed=fixed, spreads=elements)
            now = solver.with_noise(which, done.estimate, done.residuals, done.free)
            self.report(
                f"  chi squared {done.before:.1f} -> {done.after:.1f}, moved {done.moved:.2f}: {self.describe(now)}"
            )
            if done.moved < SETTLED:
                break
        return now

    def with_latency(self, solver: Solver) -> Estimate:
        """Return a first estimate, with the latency that describes the recording best."""
        first = first_estimates(self.log, solver.plant.segments, self.surface, self.kinds, self.sheet)
        rng = np.random.default_rng(0)
        count = len(solver.plant.segments)
        which = sorted(rng.permutation(count)[: min(FEW, count)].tolist())
        tried = []
        for parameters in first:
            starts = starts_of(solver.plant.segments, parameters, self.surface, self.kinds)
            now = Estimate(parameters, starts, np.array([1e-3, 1e-2]), self.prior(parameters))
            for _ in range(TRIES):
                done = solver.step(which, now, elements=False, fixed=self.fixed(now))
                now, cost = done.estimate, done.after
                if cost > NEARLY * done.before:
                    break
            now = solver.with_noise(which, now, done.residuals, done.free)
            tried.append((cost, now))
            self.report(f"latency {parameters.latency}: chi squared {cost:.1f} at 1 mm: {self.describe(now)}")
        best, now = min(tried, key=lambda each: each[0])
        scale = (1e-3 / now.noise[0]) ** 2
        for cost, each in tried:
            self.alternatives[f"latency {each.parameters.latency}"] = float((cost - best) * scale)
        return now

    def prior(self, parameters: Parameters) -> Prior:
        """Return the weak prior about the nominal values."""
        mean = replace(
            parameters, friction=np.array([kind.friction for kind in self.kinds]), gain=1.0, camera=CAMERA
        ).vector()
        amplitude = self.names.index("horizontal_amplitude")
        mean[amplitude] = math.log(self.nominal.horizontal_amplitude)
        mean[self.zone] = 1e3 * max(self.sheet.dead_zone, 1e-4)
        deviation = np.array([DEVIATIONS[name.partition(".")[0]] for name in self.names])
        return Prior(mean, deviation, np.array([0.05, 0.1]))

    def forms(
        self, solver: Solver, now: Estimate, which: Sequence[int], system: System
    ) -> list[tuple[float, str, float]]:
        """Return chi squared, form and width (m) of dead zones, the best first; those excluded before are not tried again."""
        most = min(LARGEST_ZONE, self.sheet.limit)
        zones, found = np.linspace(0.0, most, ZONES), []
        for form in [each for each in FORMS if self.alternatives.get(f"{each} dead zone", 0.0) < EXCLUDED]:
            costs = solver.scan(which, now, zones, form, system, [self.zone])
            found.append((float(costs.min()), form, float(zones[costs.argmin()])))
        found.sort()
        for cost, form, _ in found:
            self.alternatives[f"{form} dead zone"] = cost - found[0][0]
        self.report("dead zones: " + ", ".join(f"{f} {1e3 * z:.3f} mm {c - found[0][0]:+.1f}" for c, f, z in found))
        return found

    def with_zone(self, solver: Solver, now: Estimate, which: Sequence[int], system: System) -> Estimate:
        """Return the estimate with the form and width of the dead zone that describe the recording best."""
        _, form, zone = self.forms(solver, now, which, system)[0]
        now = replace(now, parameters=replace(now.parameters, dead_zone_form=form, dead_zone=zone))
        if form == FORMS[HARD]:
            now, _ = self.hard_zone(solver, now, which, system)
        return now

    def hard_zone(
        self, solver: Solver, now: Estimate, which: Sequence[int], system: System
    ) -> tuple[Estimate, tuple[float, float]]:
        """Return the estimate with a finely scanned hard dead zone, and its 95 % interval."""
        low, high = 0.0, min(LARGEST_ZONE, self.sheet.limit)
        most, interval = high, (low, high)
        for _ in range(FINER):
            zones = np.linspace(low, high, ZONES)
            costs, step = solver.scan(which, now, zones, FORMS[HARD], system, [self.zone]), zones[1] - zones[0]
            chance = np.exp(-0.5 * (costs - costs.min()))
            chance /= chance.sum()
            first, last = (int(np.searchsorted(np.cumsum(chance), share)) for share in (0.025, 0.975))
            low, high = max(zones[first] - step, 0.0), min(zones[last] + step, most)
            interval = float(low), float(high)
            now = replace(now, parameters=replace(now.parameters, dead_zone=float(chance @ zones)))
            if last - first > ZONES // 4:  # resolved
                break
        return now, interval

    def result(self, solver: Solver, now: Estimate, which: Sequence[int], system: System) -> Fitted:
        """Return values, intervals and everything else, from the problem linearized at the estimate."""
        fixed = self.fixed(now)
        _, covariance = solver.posterior(system, now, fixed)
        vector, shared = now.parameters.vector(), len(self.names)
        deviation = np.sqrt(np.diag(covariance))
        values: dict[str, Any] = {}
        intervals: dict[str, tuple[float, float]] = {}
        for k, name in enumerate(self.names):
            ends = vector[k] + LEVEL * deviation[k] * np.array([-1.0, 0.0, 1.0])
            low, value, high = (self.physical(name, each) for each in ends)
            values[name], intervals[name] = value, (low, high)
        if fixed:
            now, intervals["dead_zone"] = self.hard_zone(solver, now, which, system)
            values["dead_zone"] = now.parameters.dead_zone
        values["frequency"] = 1.0 / self.timing.period
        slack = LEVEL * self.timing.deviation / self.timing.period**2
        intervals["frequency"] = values["frequency"] - slack, values["frequency"] + slack
        values["latency"], values["dead_zone_form"] = now.parameters.latency, now.parameters.dead_zone_form
        self.add_spreads(now, system, covariance, values, intervals)
        free = solver.freedom(which, system, covariance)
        for k, name in enumerate(("noise_position", "noise_heading")):
            low, high = np.sqrt(free[k] / chi2.ppf([0.975, 0.025], free[k]))
            values[name], intervals[name] = float(now.noise[k]), (float(now.noise[k] * low), float(now.noise[k] * high))
        relative = deviation[:shared] / now.prior.deviation
        correlation = covariance[:shared, :shared] / np.maximum(
            np.outer(deviation[:shared], deviation[:shared]), 1e-300
        )
        pairs = {(a, b): float(correlation[i, j]) for i, a in enumerate(self.names) for j, b in enumerate(self.names)}
        relation = np.array([1.0 / now.parameters.gain, 1.0])  # of gains, from absolute to relative errors
        elements = now.parameters.elements * relation
        element_deviations = deviation[shared:].reshape(elements.shape)
        unidentified = self.unidentified(relative, pairs, now, element_deviations, fixed, intervals["dead_zone"])
        element_deviations = element_deviations * relation
        fitted = replace(self.surface, horizontal_amplitude=now.parameters.horizontal_amplitude)
        return Fitted(
            values, intervals, pairs, fitted, self.actuators(now), self.fitted_parts(now), elements, element_deviations,
            unidentified, self.notes(solver, now, which), _residual_rows(solver, which, system), self.alternatives,
        )  # fmt: skip

    def physical(self, name: str, value: float) -> float:
        """Return a number of :meth:`Parameters.vector` in its unit."""
        if name == "dead_zone":
            return max(1e-3 * value, 0.0)
        logarithm = name.startswith("friction") or name in ("horizontal_amplitude", "gain", "camera_scale")
        return math.exp(value) if logarithm else float(value)

    def add_spreads(
        self, now: Estimate, system: System, covariance: np.ndarray, values: dict[str, Any], intervals: dict[str, Any]
    ) -> None:
        """Add the standard deviations of the elements' errors; their effective number is the information of the recording."""
        shared = len(self.names)
        for k, name in enumerate(("gain_spread", "phase_spread")):
            spread = float(now.prior.spread[k])
            known = 1.0 - np.diag(covariance)[shared + k :: 2] / spread**2
            relative = LEVEL / math.sqrt(2.0 * max(float((known**2).sum()), 0.5))
            spread /= now.parameters.gain if name == "gain_spread" else 1.0
            values[name], intervals[name] = spread, (spread * math.exp(-relative), spread * math.exp(relative))

    def unidentified(
        self,
        relative: np.ndarray,
        pairs: Mapping[tuple[str, str], float],
        now: Estimate,
        deviations: np.ndarray,
        fixed: Sequence[int],
        interval: tuple[float, float],
    ) -> dict[str, str]:
        """Return parameters, and pairs of them, that the recording does not determine, and which recording would."""
        found = {}
        for k, name in enumerate(self.names):
            if relative[k] > UNKNOWN and k not in fixed:
                found[name] = ADVICE[name.partition(".")[0]]
        for i, a in enumerate(self.names):
            for b in self.names[i + 1 :]:
                if abs(pairs[a, b]) > COUPLED and a not in found and b not in found:
                    found[f"{a} and {b}"] = f"only a combination is determined; {ADVICE[a.partition('.')[0]]}"
        missing = int((deviations[..., 0] > 0.8 * now.prior.spread[0]).sum())
        if missing:
            found[f"{missing} of {deviations[..., 0].size} elements"] = "a recording in which parts visit them longer"
        found["static friction"] = "none on this table: parts slide at all times" if all(
            self.nominal.slides_permanently(kind.static_friction) for kind in self.kinds
        ) else "a recording at a lower frequency, in which parts stick"  # fmt: skip
        found["gravity, element size, mass, limit"] = "none: they are taken as given"
        low, high = interval
        if fixed and high - low > 2.0 * LEVEL * UNKNOWN * 1e-3 * DEVIATIONS["dead_zone"]:
            found["dead_zone"] = ADVICE["dead_zone"]
        if sum(self.alternatives[f"{form} dead zone"] < AMBIGUOUS for form in FORMS) > 1:
            found["dead_zone_form"] = ADVICE["dead_zone"]
        return found

    def actuators(self, now: Estimate) -> dict[str, Any]:
        """Return prototype actuators with the fitted values, as a setting of environments."""
        p = now.parameters
        elements = p.elements * np.array([1.0 / p.gain, 1.0]) + np.array([1.0, 0.0])
        elements[..., 0] = np.maximum(elements[..., 0], 0.0)
        return {
            "kind": "prototype", "dead_zone": min(p.dead_zone, 0.99 * self.sheet.limit), "dead_zone_form": p.dead_zone_form,
            "limit": min(self.sheet.limit, float(self.surface.max_amplitude or math.inf)), "latency": p.latency,
            "gain_spread": 0.0, "phase_spread": 0.0, "resolution": self.sheet.resolution, "gain": p.gain,
            "phase": wrapped(p.phase), "elements": elements.round(5).tolist(),
        }  # fmt: skip

    def fitted_parts(self, now: Estimate) -> tuple[Part, ...]:
        """Return the parts with the fitted friction."""
        factors = [float(new) / kind.friction for new, kind in zip(now.parameters.friction, self.kinds, strict=True)]
        return tuple(
            replace(part, friction=factors[k] * part.friction, static_friction=factors[k] * part.static_friction)
            for part, k in zip(self.parts, self.kind_of, strict=True)
        )

    def notes(self, solver: Solver, now: Estimate, which: Sequence[int]) -> list[str]:
        """Return remarks about the recording."""
        used = sum(len(each.instant) for each in solver.plant.segments)
        seen = int(np.isfinite(self.log.pose[..., 0]).sum())
        notes = [f"{used} of {seen} poses used, in {len(solver.plant.segments)} segments of up to {LONG} periods"]
        notes += [f"gap of {lost} cycles after row {row}" for row, lost in self.timing.gaps.tolist()]
        if self.sheet.bandwidth is not None:
            notes.append("the bandwidth of the actuators is not modelled")
        return notes


def _check_machine(log: Log, surface: Surface, parts: Sequence[Part]) -> None:
    """Raise ValueError for a recording of another machine."""
    shape = log.amplitude.shape[1:]
    if shape != (surface.rows, surface.columns):
        raise checks.refuse(
            "log",
            f"commands for {shape[0]} x {shape[1]} elements",
            f"of this surface, {surface.rows} x {surface.columns}",
        )
    if log.surface.element_size != surface.element_size:
        got = f"elements of {log.surface.element_size:g} m"
        raise checks.refuse("log", got, f"of this surface, with elements of {surface.element_size:g} m")
    assert surface.max_amplitude is not None
    most = float(log.amplitude.max())
    if most > surface.max_amplitude * (1.0 + 1e-6):
        raise checks.refuse("log.amplitude", f"{most:g} m", f"at most the surface's {surface.max_amplitude:g} m")
    if len(parts) != log.pose.shape[1]:
        raise checks.refuse("parts", f"{len(parts)}", f"the {log.pose.shape[1]} of the recording, in its order")
    if surface.horizontal_amplitude == 0.0:
        raise checks.refuse("surface.horizontal_amplitude", 0.0, "above 0: a still table does not move parts")


def _friction_names(kinds: Sequence[Part]) -> list[str]:
    """Return a name for the friction of each kind."""
    if len(kinds) == 1:
        return ["friction"]
    names = [f"friction.{kind.name}" for kind in kinds]
    return [name if names.count(name) == 1 else f"{name}-{k}" for k, name in enumerate(names)]


def _residual_rows(solver: Solver, which: Sequence[int], system: System) -> np.ndarray:
    """Return the rows of :attr:`Fitted.residuals`."""
    rows = []
    for k, residual in zip(which, system.residuals, strict=True):
        each = solver.plant.segments[k]
        head = np.column_stack([each.first + each.instant, np.full(len(residual), each.part), each.pose[:, :2]])
        rows.append(np.column_stack([head, residual[:, :2]]))
    return np.concatenate(rows)
