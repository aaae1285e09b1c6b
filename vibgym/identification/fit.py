"""Fit of a machine's parameters to a recording."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np

from vibgym import checks
from vibgym.actuators import ACTUATORS
from vibgym.identification import law
from vibgym.identification.guess import CAMERA, LARGEST_ZONE, first_estimates, latencies_of, starts_of
from vibgym.identification.log import Log
from vibgym.identification.outcome import Fitted, Outcome
from vibgym.identification.plant import Parameters, Plant
from vibgym.identification.segments import LONG, SHORT, segments_of, timing_of
from vibgym.identification.solver import Estimate, Prior, Progress, Solver, System
from vibgym.physics.core.hardware import FORMS, HARD
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

FEW, SOME = 60, 120
"""Short segments for the comparison of latencies, and of dead zones before the elements are known."""

ZONES = 31
"""Dead zones in a scan."""

FINER = 3
"""Most scans of a hard dead zone, each of the interval that the one before has left."""

COARSE, HALVINGS = 4, 3
"""Limits of the elements that are tried first, and times that the distance between them is halved."""

REQUIRED = 13.41
"""Decrease of chi squared from which on the elements' limit is not the nominal one, as of a friction law."""

UNLIMITED = 0.9
"""Share of the nominal limit below which no element reaches its own limit."""

EXCLUDED = 300.0
"""Chi squared above that of the best form of the dead zone, above which a form is not tried again."""

TRIES, NEARLY = 15, 0.99
"""Most steps for a latency, and ratio of costs after and before a step from which on it has converged."""

DEVIATIONS = {
    "friction": 0.5, "horizontal_amplitude": 0.3, "gain": 0.5, "phase": 3.0, "dead_zone": 0.15, "camera_scale": 0.05,
    "camera_turn": 0.1, "camera_x": 0.02, "camera_y": 0.02,
}  # fmt: skip
"""Standard deviations of the weak prior, in the units of :meth:`Parameters.vector`: about the nominal values."""

LAWS = 6
"""Most steps of a friction law."""

ROUNDS = 12
"""Most steps with elements after form and dead zone have been chosen."""

NEAR = 0.5
"""Step over standard deviation, of all shared parameters, below which later steps use its derivatives."""

SETTLED, ENOUGH = 0.02, 1.0
"""Step over standard deviation, of all shared parameters, and decrease of chi squared, below which the fit has converged."""

MAX_NOISE = ("noise_position", 3e-3, "m"), ("noise_heading", 0.1, "rad")
"""Largest plausible standard deviations of measured positions and headings."""

UNSETTLED, ASTRAY = 0.2, 1.0
"""Step over standard deviation above which it has not, and above which intervals have no meaning."""

OUTSIDE = 0.05
"""m beyond the table at which a part may be measured: an offset of the camera."""

ERRATIC = 0.3
"""Heading changes between images, in periods of the part's symmetry, that a tenth may exceed; of random ones, 0.45."""

KNOWN = 1.05
"""Lift-off over the nominal limit up to which the elements' limit is the nominal one."""


def fit(
    log: Log,
    surface: Surface | None = None,
    parts: Part | Sequence[Part] | None = None,
    *,
    report: Callable[[str], object] | None = None,
    force: bool = False,
) -> Fitted:
    """Estimate the parameters of a machine from a recording.

    Least squares on the simulator by multiple shooting: the recording is cut into segments with free initial states, and all
    segments and finite differences are simulated in one batch. Known and not fitted: gravity, size of the elements, outlines of
    the parts, and limit and resolution of the commanded amplitudes. The table's period is that of the commands.

    Args:
        log: the recording.
        surface, parts: nominal ones; None: those of the recording.
        report: called with a line about each stage.
        force: return a result that is not to be used, with the reason among its notes.

    Raises:
        ValueError: commands for another surface, other parts, other units or axes, or too little data; without ``force`` also a
            fit that has not converged, or has more noise than a camera.
    """
    checks.instance("log", log, Log)
    nominal: Surface = log.surface if surface is None else checks.instance("surface", surface, Surface)
    parts = log.parts if parts is None else (parts,) if isinstance(parts, Part) else tuple(parts)
    job = Fit(log, nominal, parts, report or (lambda line: None))
    fitted = job.run()
    for k, (name, most, unit) in enumerate(MAX_NOISE):
        if fitted.values[name] > most:
            job.faults.insert(k, f"{name} is {fitted.values[name]:.3g} {unit}, at most {most:g} {unit} are plausible")
    if job.faults and not force:
        faults = "; ".join(job.faults)
        raise checks.conflict(f"log: {faults}: check units, axes and nominal settings (force=True returns the result)")
    return replace(fitted, notes=[*fitted.notes, *job.faults])


class Fit:
    """A fit in progress: a recording, the nominal machine, and results that are not numbers.

    Args:
        log: the recording.
        surface, parts: nominal ones.
        report: called with a line about each stage.

    Attributes:
        surface: with the frequency of the recording, and lift-off as its largest amplitude; ``nominal`` without.
        limit: m, largest amplitude of the elements; commands have that of ``nominal``, which need not be the same.
        kinds, kind_of: different parts, and the kind of each part.
        sheet: data sheet of the nominal actuators.
        names: of the shared parameters, in the order of :meth:`Parameters.vector`; ``zone``: index of the dead zone.
        solver, everything: of the present segments, and their numbers.
        alternatives: see :class:`vibgym.identification.Fitted`.
        remarks: notes about the fit.
        faults: reasons not to use its result.
        laws: friction laws by kind, of those that require one.

    Raises:
        ValueError: commands for another surface, other parts, or too little data.
    """

    def __init__(self, log: Log, surface: Surface, parts: tuple[Part, ...], report: Callable[[str], object]) -> None:
        _check_machine(log, surface, parts)
        self.log, self.nominal, self.parts, self.report = log, surface, parts, report
        self.timing = timing_of(log, surface.period)
        frequency = 1.0 / self.timing.period
        lift_off = surface.gravity / (2.0 * math.pi * frequency) ** 2
        self.surface = replace(surface, frequency=frequency, max_amplitude=lift_off)
        nominal_limit = min(surface.max_amplitude or math.inf, lift_off)
        self.limit = lift_off if lift_off > KNOWN * nominal_limit else nominal_limit
        self.kinds, self.kind_of = kinds_of(parts, Part.same_as)
        self.sheet = ACTUATORS.make("actuators", log.settings["actuators"], surface, 1, 1).data_sheet
        self.latencies = latencies_of(self.sheet)
        self.names = [*_friction_names(self.kinds), *Parameters.GLOBALS]
        self.zone = self.names.index("dead_zone")
        self.alternatives: dict[str, float] = {}
        self.remarks: list[str] = []
        self.faults: list[str] = []
        self.laws: dict[int, law.Rise] = {}

    def fixed(self, now: Estimate) -> list[int]:
        """Return the indices of parameters without derivatives: a hard dead zone has steps."""
        return [self.zone] if now.parameters.dead_zone_form == FORMS[HARD] else []

    def use_segments(self, length: int) -> None:
        """Cut the recording into segments of a length, and set :attr:`solver` and :attr:`everything`."""
        segments = segments_of(self.log, self.timing, self.parts, self.surface.element_size, self.latencies, length)
        limits, fine = (self.sheet.limit, self.sheet.resolution), length == LONG
        plant = Plant(self.log, segments, length, self.surface, self.kinds, *limits, fine=fine)
        plant.top = self.limit
        self.solver, self.everything = Solver(plant, [kind.symmetry != 0 for kind in self.kinds]), range(len(segments))

    def run(self) -> Fitted:
        """Return the result."""
        self.use_segments(SHORT)
        now, some = self.with_latency(), self.drawn(SOME)
        for _ in range(2):  # again with a better dead zone, whose form may be far from the nominal one
            now = self.improve(now, elements=False).estimate
            now = self.with_zone(now, self.solver.linearize(some, now, False))
            for form in FORMS:
                self.alternatives.pop(f"{form} dead zone", None)  # elements may decide otherwise
        # Long segments have several minima, so elements are fitted to short ones first.
        now = self.improve(now).estimate
        now = self.with_zone(now, self.solver.linearize(self.everything, now, True))
        now = self.improve(now).estimate
        self.report(f"short segments: {self.describe(now)}")
        short = zip(self.solver.plant.segments, now.starts, strict=True)
        known = {(segment.part, segment.first): start for segment, start in short}
        self.use_segments(LONG)
        segments = self.solver.plant.segments
        starts = starts_of(segments, now.parameters, self.surface)
        for k, segment in enumerate(segments):
            starts[k] = known.get((segment.part, segment.first), starts[k])
        done = self.with_limit(self.improve(replace(now, starts=starts)))
        self.report(f"long segments: {self.describe(done.estimate)}")
        system = self.solver.linearize(self.everything, done.estimate, True)
        for _ in range(2):  # a form that fits better once the elements' errors are known is tried in a second round
            tried = self.improve(self.with_zone(done.estimate, system))
            worse = sum(len(segment.pose) for segment in segments) * (misfit(tried.estimate) - misfit(done.estimate))
            if worse >= 0.0:  # the choice was by linear fits, which mislead far from the solution
                kept, form = (solution.estimate.parameters.dead_zone_form for solution in (done, tried))
                self.alternatives[f"{form} dead zone"], self.alternatives[f"{kept} dead zone"] = worse, 0.0
                break
            done, system = tried, self.linearized(tried)
            if self.forms(done.estimate, system)[0][1] == done.estimate.parameters.dead_zone_form:
                break
        done, system = self.with_laws(done, system)
        now = done.estimate
        if done.moved > UNSETTLED:
            messages = self.faults if done.moved > ASTRAY else self.remarks
            messages.append(f"the fit has not converged: its last step was {done.moved:.2g} standard deviations")
        self.report(f"final: {self.describe(now)}")
        now, zone = self.hard_zone(now, system) if self.fixed(now) else (now, None)
        return Outcome(self, now, system, zone).fitted()

    def linearized(self, done: Progress) -> System:
        """Return the problem linearized after a step, near the solution with the derivatives that the step has used."""
        derivatives = done.derivatives if done.moved < NEAR else None
        return self.solver.linearize(self.everything, done.estimate, True, derivatives)

    def with_laws(self, done: Progress, system: System) -> tuple[Progress, System]:
        """Return progress and linearized problem with friction laws of the kinds of parts for which they are required.

        Laws that parts have are taken as given.
        """
        for kind, name in enumerate(self.names[: len(self.kinds)]):
            if self.kinds[kind].friction_law is not None:
                continue
            now = done.estimate
            rise = law.likeliest(self.solver, now, system, self.fixed(now), kind)
            self.alternatives[f"constant {name}"] = rise.gain
            if rise.gain < law.SIGNIFICANT:
                self.remarks.append(f"{name}: no dependence on the speed of the slip is required")
                continue
            old = rise
            for _ in range(LAWS):
                self.kinds[kind] = self.solver.plant.kinds[kind] = law.applied(self.kinds[kind], rise.law)
                done = self.improve(done.estimate)
                now, system = done.estimate, self.linearized(done)
                old, rise = rise, law.improved(self.solver, now, system, self.fixed(now), kind, rise)
                self.report(f"friction law: {old.law}, chi squared {rise.gain:.2f} less by the next step")
                if rise.gain < SETTLED:
                    break
            else:
                self.faults.append(f"{name}: the fit of its rise has not converged, do not use these parameters")
            self.laws[kind] = rise._replace(rise=old.rise, speed=old.speed)
            self.remarks.append(f"{name}: a dependence on the speed of the slip is required, see its rise")
        return done, system

    def drawn(self, most: int) -> list[int]:
        """Return the numbers of at most ``most`` segments, spread over the recording."""
        return sorted(np.random.default_rng(0).permutation(len(self.everything))[:most].tolist())

    def describe(self, now: Estimate) -> str:
        """Return a line with the main values."""
        p = now.parameters
        friction = ", ".join(f"{coefficient:.4f}" for coefficient in p.friction)
        return (
            f"friction {friction}, a_h {1e3 * p.horizontal_amplitude:.4f} mm, gain {p.gain:.4f}, phase {p.phase:.4f}, "
            f"{p.dead_zone_form} dead zone {1e3 * p.dead_zone:.4f} mm, latency {p.latency}, "
            f"noise {1e3 * now.noise[0]:.4f} mm, spread {now.prior.spread.round(4)}"
        )

    def improve(self, now: Estimate, *, elements: bool = True) -> Progress:
        """Return the last of at most :data:`ROUNDS` Gauss-Newton steps with all segments, its estimate with its noise.

        Steps near the solution use the derivatives of the one before, which cost most of the time.
        """
        solver, which, derivatives = self.solver, self.everything, None
        now = solver.with_noise(which, now, solver.residuals(which, now))  # else the elements would explain misfits
        for _ in range(ROUNDS):
            again = derivatives is not None
            fixed = self.fixed(now)
            done = solver.step(which, now, elements=elements, fixed=fixed, spreads=elements, derivatives=derivatives)
            now = solver.with_noise(which, done.estimate, done.residuals, done.free)
            derivatives = done.derivatives if done.moved < NEAR and done.after < done.before else None
            less = f"chi squared {done.before:.1f} -> {done.after:.1f}, moved {done.moved:.2f}"
            self.report(f"  {less}: {self.describe(now)}")
            stuck = done.after >= done.before
            if (done.moved < SETTLED and done.before - done.after < ENOUGH) or (stuck and not again):
                break
        return done._replace(estimate=now)

    def with_latency(self) -> Estimate:
        """Return a first estimate, with the latency that describes the recording best."""
        solver = self.solver
        first = first_estimates(self.log, solver.plant.segments, self.surface, self.kinds, self.sheet)
        which, tried = self.drawn(FEW), []
        amplitude = self.names.index("horizontal_amplitude")  # far from the solution friction and gain replace it
        for parameters in first:
            starts = starts_of(solver.plant.segments, parameters, self.surface)
            now = Estimate(parameters, starts, np.array([1e-3, 1e-2]), self.prior(parameters))
            for _ in range(TRIES):
                done = solver.step(which, now, elements=False, fixed=[*self.fixed(now), amplitude])
                now, cost = done.estimate, done.after
                if cost > NEARLY * done.before:
                    break
            now = solver.with_noise(which, now, done.residuals, done.free)
            tried.append((cost, now))
            self.report(f"latency {parameters.latency}: chi squared {cost:.1f} at 1 mm: {self.describe(now)}")
        best, now = min(tried, key=lambda candidate: candidate[0])
        scale = (1e-3 / now.noise[0]) ** 2
        for cost, estimate in tried:
            self.alternatives[f"latency {estimate.parameters.latency}"] = float((cost - best) * scale)
        return now

    def prior(self, parameters: Parameters) -> Prior:
        """Return the weak prior about the nominal values."""
        friction = np.array([kind.friction for kind in self.kinds])
        mean = replace(parameters, friction=friction, gain=1.0, camera=CAMERA).vector()
        amplitude = self.names.index("horizontal_amplitude")
        mean[amplitude] = math.log(self.nominal.horizontal_amplitude)
        mean[self.zone] = 1e3 * max(self.sheet.dead_zone, 1e-4)
        deviation = np.array([DEVIATIONS[name.partition(".")[0]] for name in self.names])
        return Prior(mean, deviation, np.array([0.05, 0.1]))

    def forms(self, now: Estimate, system: System) -> list[tuple[float, str, float]]:
        """Return chi squared, form and width (m) of dead zones, the best first; those excluded before are not tried again."""
        most = min(LARGEST_ZONE, self.sheet.limit)
        zones, forms = np.linspace(0.0, most, ZONES), []
        for form in [known for known in FORMS if self.alternatives.get(f"{known} dead zone", 0.0) < EXCLUDED]:
            costs = self.zone_costs(now, system, form, zones)
            forms.append((float(costs.min()), form, float(zones[costs.argmin()])))
        forms.sort()
        for cost, form, _ in forms:
            self.alternatives[f"{form} dead zone"] = cost - forms[0][0]
        self.report("dead zones: " + ", ".join(f"{f} {1e3 * z:.3f} mm {c - forms[0][0]:+.1f}" for c, f, z in forms))
        return forms

    def zone_costs(self, now: Estimate, system: System, form: str, zones: np.ndarray) -> np.ndarray:
        """Return chi squared (zones,) of dead zones (m) of a form, with all other unknowns fitted linearly."""
        parameters = replace(now.parameters, dead_zone_form=form)
        predicted = self.solver.plant.predict(system.which, parameters, now.starts, zones)
        products, _ = self.solver.scan(now, system, predicted, [self.zone])
        return np.diag(products)

    def with_zone(self, now: Estimate, system: System) -> Estimate:
        """Return the estimate with the form and width of the dead zone that describe the recording best."""
        _, form, zone = self.forms(now, system)[0]
        now = replace(now, parameters=replace(now.parameters, dead_zone_form=form, dead_zone=zone))
        if form == FORMS[HARD]:
            now, _ = self.hard_zone(now, system)
        return now

    def with_limit(self, now: Progress) -> Progress:
        """Return progress with the elements' limit that describes the recording best: :attr:`limit`, which is set.

        It is the nominal one unless another is required: that of lift-off if it suffices, else one between. Each is fitted:
        linear fits mislead, since the gain has no effect on commands that are cut.
        """
        nominal, highest = float(self.nominal.max_amplitude or 0.0), self.limit
        plant = self.solver.plant
        poses, tried = sum(len(segment.pose) for segment in plant.segments), {highest: now}

        def costs(limits: Sequence[float]) -> dict[float, float]:
            for self.limit in set(limits) - set(tried):
                plant.top = self.limit
                tried[self.limit] = self.improve(now.estimate)
                self.report(f"limit {1e3 * self.limit:.4f} mm: {self.describe(tried[self.limit].estimate)}")
            misfits = {limit: misfit(solution.estimate) for limit, solution in tried.items()}
            return {limit: poses * (cost - min(misfits.values())) for limit, cost in misfits.items()}

        gains = now.estimate.parameters.gain + now.estimate.parameters.elements[..., 0]
        if highest <= nominal or (gains * self.log.amplitude.max(axis=0)).max() < UNLIMITED * nominal:
            self.limit = plant.top = min(nominal, highest)  # without effect
            return now
        excess = costs(np.linspace(nominal, highest, COARSE).tolist())
        for _ in range(HALVINGS if min(excess[nominal], excess[highest]) > REQUIRED else 0):
            limits = sorted(excess)
            k = limits.index(min(excess, key=excess.__getitem__))
            excess = costs([0.5 * (a + b) for a, b in itertools.pairwise(limits[max(k - 1, 0) : k + 2])])
        suffice = [limit for limit in (nominal, highest) if excess[limit] < REQUIRED]
        self.limit = plant.top = [*suffice, min(excess, key=excess.__getitem__)][0]
        if self.limit > nominal:
            reached = f"{1e3 * self.limit:.3g} mm, whose error is not in the intervals"
            own = "they reach no limit" if suffice else reached
            self.remarks.append(f"elements exceed the nominal max_amplitude, {1e3 * nominal:.3g} mm: {own}")
        return tried[self.limit]

    def hard_zone(self, now: Estimate, system: System) -> tuple[Estimate, tuple[float, float]]:
        """Return the estimate with a finely scanned hard dead zone, and its 95 % interval."""
        low, high = 0.0, min(LARGEST_ZONE, self.sheet.limit)
        most, interval = high, (low, high)
        for _ in range(FINER):
            zones = np.linspace(low, high, ZONES)
            costs, step = self.zone_costs(now, system, FORMS[HARD], zones), zones[1] - zones[0]
            chance = np.exp(-0.5 * (costs - costs.min()))
            chance /= chance.sum()
            first, last = (int(np.searchsorted(np.cumsum(chance), share)) for share in (0.025, 0.975))
            low, high = max(zones[first] - step, 0.0), min(zones[last] + step, most)
            interval = float(low), float(high)
            now = replace(now, parameters=replace(now.parameters, dead_zone=float(chance @ zones)))
            if last - first > ZONES // 4:  # resolved
                break
        return now, interval


def _check_machine(log: Log, surface: Surface, parts: Sequence[Part]) -> None:
    """Raise ValueError for a recording of another machine."""
    shape = log.amplitude.shape[1:]
    if shape != (surface.rows, surface.columns):
        got = f"commands for {shape[0]} x {shape[1]} elements"
        raise checks.refuse("log", got, f"of this surface, {surface.rows} x {surface.columns}")
    if log.surface.element_size != surface.element_size:
        got = f"elements of {log.surface.element_size:g} m"
        raise checks.refuse("log", got, f"of this surface, with elements of {surface.element_size:g} m")
    assert surface.max_amplitude is not None
    most = float(log.amplitude.max())
    if most > surface.max_amplitude * (1.0 + 1e-6):
        raise checks.refuse("log.amplitude", f"{most:g} m", f"at most the surface's {surface.max_amplitude:g} m")
    if len(parts) != log.pose.shape[1]:
        raise checks.refuse("parts", f"{len(parts)}", f"the {log.pose.shape[1]} of the recording, in its order")
    size, place = np.array([surface.width, surface.depth]), log.pose[..., :2]
    off = ((place < -OUTSIDE) | (place > size + OUTSIDE)).any(axis=2)
    if off.any():
        row, part = np.argwhere(off)[0].tolist()
        x, y = place[row, part].tolist()
        allowed = f"in m, on the table of {size[0]:g} x {size[1]:g} m or at most {OUTSIDE:g} m outside"
        raise checks.refuse("log.pose", f"x {x:g}, y {y:g} in row {row}", allowed)
    if np.abs(log.phase).max() > 2.0 * math.pi:
        raise checks.refuse("log.phase", f"{np.abs(log.phase).max():g}", "in [-2 pi, 2 pi] rad")
    for k, part in enumerate(parts):
        heading = log.pose[np.isfinite(log.pose[:, k, 2]), k, 2]
        turns = np.abs(np.diff(heading)) * max(part.symmetry, 1) / (2.0 * math.pi)
        if part.symmetry and len(turns) and np.quantile(np.abs(turns - np.round(turns)), 0.9) > ERRATIC:
            got = f"headings of part {k} that change at random between images, from {heading.min():g} to {heading.max():g}"
            raise checks.refuse("log.pose", got, "headings in rad, one image a period")
    if surface.horizontal_amplitude == 0.0:
        raise checks.refuse("surface.horizontal_amplitude", 0.0, "above 0: a still table does not move parts")


def _friction_names(kinds: Sequence[Part]) -> list[str]:
    """Return a name for the friction of each kind."""
    if len(kinds) == 1:
        return ["friction"]
    names = [f"friction.{kind.name}" for kind in kinds]
    return [name if names.count(name) == 1 else f"{name}-{k}" for k, name in enumerate(names)]


def misfit(now: Estimate) -> float:
    """Return -2 log likelihood over the number of poses, but for a constant, of an estimate with its noise."""
    return float(np.log(now.noise**2) @ [2.0, 1.0])
