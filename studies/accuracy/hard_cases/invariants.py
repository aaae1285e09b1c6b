"""Invariants of any motion: finite numbers, energy, power of friction; a million periods, large steps, any mass."""

from __future__ import annotations

import functools
import math
import os
import tracemalloc
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy.hard_cases.case import (
    Outcome,
    at_most,
    block,
    case,
    gap,
    one_element,
    random_drive,
    sound,
    table_velocity,
    threshold,
)
from vibgym.physics.core.drive import new_phasors, polar_drive
from vibgym.physics.planar.contact_area import cells_across, new_cut, points_at
from vibgym.physics.planar.wrench import sliding_wrench
from vibgym.scene.bodies import body_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator


def kinetic_energy(part: Part, velocity: np.ndarray) -> np.ndarray:
    """Return the kinetic energy over mass, m^2/s^2, of velocities (..., 3)."""
    return 0.5 * (velocity[..., 0] ** 2 + velocity[..., 1] ** 2 + part.gyration * velocity[..., 2] ** 2)


@case("energy on a still table", "Does friction ever add kinetic energy on a still table?")
def still_table() -> Outcome:
    """Return the largest rise in a period, over the initial energy. Vibrating elements do no work on a still table."""
    worst, worlds, part = 0.0, 64, block()
    for frequency in (25.0, 400.0):
        surface = Surface(horizontal_amplitude=0.0, frequency=frequency)
        rng = np.random.default_rng(1)
        sim = Simulator(surface, part, worlds=worlds)
        low, high = [0.1, 0.3 * surface.depth, -3.0], [0.9 * surface.width, 0.7 * surface.depth, 3.0]
        velocity = rng.uniform(-1.0, 1.0, (worlds, 1, 3)) * [0.4, 0.4, 40.0]
        sim.reset(rng.uniform(low, high, (worlds, 1, 3)), velocity)
        shape = (worlds, surface.rows, surface.columns)
        drive = rng.uniform(0.0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
        energy = kinetic_energy(part, sim.velocity)
        begun = energy.max()
        for _ in range(60):
            sim.advance(*drive)
            after = kinetic_energy(part, sim.velocity)
            worst = max(worst, float((after - energy).max() / begun))
            energy = after
            sound(sim)
    return at_most(worst, 1e-15, "of energy", "128 worlds, fields at random")


@case("two motions approach", "Does friction drive two motions of one part apart?")
def approach() -> Outcome:
    """Friction is monotone in slip, so under equal pressure the distance between two motions does not grow.

    Distance in velocity, ``|v1 - v2|^2 + k^2 (omega1 - omega2)^2``, on one element, table moving, full amplitude.
    """
    surface, part, worst = one_element(), block(), 0.0
    rng, worlds = np.random.default_rng(2), 64
    sim = Simulator(surface, part, worlds=worlds, steps=100, substeps=2)
    velocity = rng.uniform(-1.0, 1.0, (worlds, 1, 3)) * [0.5, 0.5, 20.0]
    sim.reset([1.0, 1.0, 0.3], velocity)

    def distance() -> np.ndarray:
        now = sim.velocity[:, 0]
        return np.sqrt(2.0 * kinetic_energy(part, now[:, None] - now))

    before = distance()
    for _ in range(20):
        sim.advance(surface.lift_off_amplitude, 1.5 * math.pi)
        sound(sim)
        after = distance()
        worst = max(worst, float((after - before).max()))
        before = after
    note = "2016 pairs of different headings, equal pressure"
    return at_most(worst / surface.table_speed, 1e-4, "of table speed", note)


@case(
    "power of friction",
    "Does friction ever do positive work in the table's frame, however small or large slip is?",
)
def power() -> Outcome:
    """Return the largest power on a part, over the largest that friction can dissipate."""
    surface, rng, worst = Surface(), np.random.default_rng(3), -math.inf
    table, w = surface.table(), surface.angular_frequency
    for part in (block(), Part.disc(0.02, friction=2.0)):
        body = body_of(part)
        cut = new_cut(len(body.outline), cells_across(table, body, 2))
        phasors = new_phasors(1, cells_across(table, body, 1))
        amplitude, phase = random_drive(surface, 17)
        drive = polar_drive(amplitude[None], phase[None], w)
        for _ in range(400):
            x, y, heading = rng.uniform([0, 0, -3], [surface.width, surface.depth, 3])
            n = points_at(table, body, int(rng.integers(1, 3)), drive, 0, x, y, heading, cut, phasors, 0)
            ux, uy = rng.normal(size=2) * 10.0 ** rng.uniform(-9, 1)
            spin, at = rng.normal() * 10.0 ** rng.uniform(-9, 3), rng.uniform(0, 2 * math.pi)
            weight, px, py = cut.points
            force_x, force_y, torque = sliding_wrench(
                weight, px, py, cut.phasor_c, cut.phasor_s, n, table.gravity, math.cos(at), math.sin(at), ux, uy, spin
            )
            # In the table's frame the part moves with -u and spin.
            output = -force_x * ux - force_y * uy + torque * spin
            most = 2.0 * surface.gravity * (math.hypot(ux, uy) + abs(spin) * part.radius)
            if not math.isfinite(output):
                raise ArithmeticError(f"power {output} at slip ({ux:g}, {uy:g}) m/s, {spin:g} rad/s")
            worst = max(worst, output / most)
    return at_most(worst, 0.0, "of 2 mu g |u|", "800 states, slip over ten orders of magnitude")


def _some_part(rng: np.random.Generator, friction: float) -> Part:
    """Return a part with a star-shaped outline of 1 to 300 mm."""
    corners, size = int(rng.integers(3, 12)), 10.0 ** rng.uniform(-3.0, -0.5)
    gaps = rng.uniform(0.3, 1.0, corners)
    angle = 2.0 * math.pi * np.cumsum(gaps) / gaps.sum()
    far = size * rng.uniform(0.5, 1.0, corners)
    outline = np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1)
    return Part.polygon(outline, friction=friction, static_friction=friction * float(rng.choice([1.0, 1.2])))


@case("anything at all", "Scenes over many orders of magnitude: NaN, a hang, or a gain of energy?")
def anything() -> Outcome:
    """Count random scenes with numbers that are not finite or with a gain of energy."""
    rng, wrong, note, tried = np.random.default_rng(4), 0, "", 0
    for k in range(200):
        friction = float(rng.choice([0.0, 0.01, 0.3, 0.6, 2.0, 10.0]))
        frequency = float(10.0 ** rng.uniform(0.0, 2.0))
        surface = Surface(
            rows=int(rng.integers(1, 9)),
            columns=int(rng.integers(1, 9)),
            element_size=float(10.0 ** rng.uniform(-2, 0)),
            horizontal_amplitude=float(rng.choice([0.0, 1.0, 3.0])) * threshold(max(friction, 0.01), frequency),
            frequency=frequency,
        )
        part = _some_part(rng, friction)
        if part.radius > 2.0 * (surface.width + surface.depth):
            continue  # refused as far too large for the surface
        tried += 1
        sim = Simulator(surface, part)
        velocity = rng.normal(size=3) * [1.0, 1.0, 1.0 / part.radius] * 10.0 ** rng.uniform(-3, 1)
        sim.reset([rng.uniform(0, surface.width), rng.uniform(0, surface.depth), rng.uniform(-3, 3)], velocity)
        speed = math.sqrt(2.0 * float(kinetic_energy(part, velocity)))
        sim.advance(*random_drive(surface, k), 10)
        try:
            sound(sim)
        except ArithmeticError as error:
            wrong, note = wrong + 1, f"{note} {k}: {error};"
            continue
        # Friction dissipates energy at every point faster than the table; only slower ones can gain, up to its speed.
        after = math.sqrt(2.0 * float(kinetic_energy(part, sim.velocity).max()))
        if after > 1.0001 * (speed + 2.0 * surface.table_speed):
            wrong, note = wrong + 1, f"{note} {k}: {speed:.3g} became {after:.3g} m/s;"
    return at_most(wrong, 0, f"of {tried}", note or "ten periods each")


MU = 0.6
MILLION = 1_000_000
LATE_PERIODS = 2_500_000
"""1e5 s on the prototype's 25 Hz."""

# -- a million periods -------------------------------------------------------------------------------------------------


class LongRun(NamedTuple):
    """A part that circles on a surface at rest, every 1e5 periods: velocity, position, period mean, memory."""

    velocity: np.ndarray
    pose: np.ndarray
    mean_velocity: np.ndarray
    radius: float  # m, mu g / w^2
    speed: float  # m/s, of the circle
    time: float  # s, by the simulator's clock
    grown: float  # bytes in 1e5 periods, the larger of resident and traced


def _resident() -> int:
    """Return the process's resident memory in bytes, 0 where the system has no /proc."""
    try:
        with open("/proc/self/statm", encoding="utf-8") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except OSError:
        return 0


@functools.cache
def long_run() -> LongRun:
    surface = one_element(0.5, frequency=10.0)  # a million periods are 1e5 s
    sim = Simulator(surface, block(), threads=1)
    sim.reset([0.25, 0.25, 0.3], [*surface.idle_velocity(MU), 0])
    sim.advance(0.0, 0.0, 1000)
    states = [(sim.velocity[0, 0], sim.pose[0, 0], sim.mean_velocity[0, 0])]
    tracing = tracemalloc.is_tracing()
    if not tracing:
        tracemalloc.start()
    memory = [(tracemalloc.get_traced_memory()[0], _resident())]
    for _ in range(10):
        sim.advance(0.0, 0.0, MILLION // 10)
        memory.append((tracemalloc.get_traced_memory()[0], _resident()))
        sound(sim)
        states.append((sim.velocity[0, 0], sim.pose[0, 0], sim.mean_velocity[0, 0]))
    # A leak grows in every interval, other allocations of the process in few: the median separates them.
    grown = float(np.median(np.diff(memory, axis=0), axis=0).max())
    if not tracing:
        tracemalloc.stop()
    w = surface.angular_frequency
    radius = MU * surface.gravity / w**2
    velocity, pose, mean = (np.array(series) for series in zip(*states, strict=True))
    return LongRun(velocity, pose, mean, radius, radius * w, sim.time, grown)


@case("a million periods: phase", "Does the phase of a steady motion creep over a million periods?")
def long_phase() -> Outcome:
    run = long_run()
    crept = np.abs(run.velocity - run.velocity[0]).max() / run.speed
    return at_most(crept, 1e-9, "of speed", "velocity at the period's start")


@case("a million periods: place", "Does a part that circles in place wander over a million periods?")
def long_place() -> Outcome:
    run = long_run()
    drift = np.abs(run.pose[:, :2] - run.pose[0, :2]).max() / run.radius
    turned = float(np.abs(run.pose[:, 2] - run.pose[0, 2]).max())
    note = f"radius {1e3 * run.radius:.3g} mm; turned {turned:.1g} rad"
    # A drift of one rounding a period: 1e6 * 1e-16 m against millimetres.
    return at_most(drift + turned, 1e-6, "of radius", note)


@case(
    "a million periods: mean velocity",
    "Does a part that circles in place have a mean velocity after a million periods?",
)
def long_mean() -> Outcome:
    run = long_run()
    return at_most(np.abs(run.mean_velocity[:, :2]).max() / run.speed, 1e-9, "of speed", "mean over one period")


@case("a million periods: radius", "Is the circle still mu g / w^2 after a million periods?")
def long_radius() -> Outcome:
    run = long_run()
    return at_most(abs(np.hypot(*run.velocity[-1, :2]) / run.speed - 1.0), 1e-3, "of speed", "mu g / w after the run")


@case("a million periods: memory", "Does memory grow while the clock runs?")
def long_memory() -> Outcome:
    return at_most(long_run().grown / (MILLION // 10), 2.0, "bytes a period")


# -- late ----------------------------------------------------------------------------------------------------------------


def _now_and_late(
    surface: Surface, pose: Any, velocity: Any, late_periods: int, drive: tuple[Any, Any], periods: int
) -> tuple[Simulator, Simulator]:
    """Return simulators after ``periods`` from the same state, once at time 0 and once after ``late_periods``."""
    early, late = (Simulator(surface, block()) for _ in range(2))
    early.reset(pose, velocity)
    late.set_state({**early.get_state(), "periods": late_periods})
    for sim in (early, late):
        sim.advance(*drive, periods)
        sound(sim)
    return early, late


@case("at 1e5 s, state set", "Do results depend on absolute time?")
def late_state() -> Outcome:
    surface = Surface()
    drive = random_drive(surface, 15)
    early, late = _now_and_late(surface, [0.4, 0.1, 0.3], [0, 0, 2], LATE_PERIODS, drive, 20)
    wrong = int((early.pose != late.pose).sum() + (early.velocity != late.velocity).sum())
    wrong += int(abs(late.time - 1e5 - 20 * surface.period) > 1e-9)
    return at_most(wrong, 0, "numbers", "state carried to 1e5 s, then 20 periods")


@case(
    "at 1e5 s, by advancing",
    "Is the clock right after a million periods, and does the motion there depend on time?",
)
def late_run() -> Outcome:
    run, surface = long_run(), one_element(0.5, frequency=10.0)
    if abs(run.time - 1e5 - 100.0) > 1e-6:
        raise ArithmeticError(f"time is {run.time!r} s after 1 001 000 periods of 0.1 s")
    drive = (0.1 * surface.lift_off_amplitude, 0.4)
    fresh, old = _now_and_late(surface, run.pose[-1], run.velocity[-1], MILLION + 1000, drive, 5)
    return at_most(int((fresh.pose != old.pose).sum()), 0, "numbers", f"reached by advancing, t = {run.time:g} s")


# -- steps that are too large --------------------------------------------------------------------------------------------

OVERSIZED_BOUND = 1e-3
"""m in ten periods, farthest point of the part; about a pixel of the prototype's camera, 3 % of the part's displacement."""


def _worlds(kind: str, count: int = 16) -> tuple[Surface, Part, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(11)
    surface, velocity, part = Surface(), np.zeros((count, 1, 3)), block(0.58)
    if kind == "stick and slip":
        surface = Surface(horizontal_amplitude=1.2 * threshold(MU))
        part, velocity[:] = block(MU, 0.63), table_velocity(surface)
    elif kind == "small part":
        part = Part.rectangle(0.015, 0.012, friction=0.58)
    elif kind == "spin":
        velocity[..., 2] = rng.uniform(-60.0, 60.0, (count, 1))
    pose = rng.uniform([0.1, 0.06, -3], [0.7, 0.14, 3], (count, 1, 3))
    amplitude = rng.uniform(0.0, surface.lift_off_amplitude, (count, surface.rows, surface.columns))
    return surface, part, pose, velocity, amplitude, rng.uniform(-math.pi, math.pi, amplitude.shape)


def coarse_errors(kind: str) -> dict[tuple[int, int], float]:
    """Return the worst error (m, farthest point) after ten periods for small ``steps`` and ``substeps``; NaN where refused.

    Against steps fine enough that their own error does not count; 16 worlds with fields at random.
    """
    surface, part, pose, velocity, amplitude, phase = _worlds(kind)

    def end(**knobs: Any) -> np.ndarray:
        sim = Simulator(surface, part, worlds=len(pose), **knobs)
        sim.reset(pose, velocity)
        sim.advance(amplitude, phase, 10)
        sound(sim)
        return sim.pose

    exact, errors = end(steps=200, substeps=2), {}
    for steps in range(1, 7):
        for substeps in (1, 2, 4):
            try:
                errors[steps, substeps] = gap(part, end(steps=steps, substeps=substeps), exact)
            except ValueError as error:
                if "steps" not in str(error):
                    raise
                errors[steps, substeps] = math.nan
    return errors


@case(
    "oversized steps: {}",
    "Few steps and substeps a period: refused or right, with nothing in between?",
    ("block",), ("small part",), ("spin",), ("stick and slip",),
)  # fmt: skip
def oversized(kind: str) -> Outcome:
    errors = coarse_errors(kind)
    wrong = {knobs: error for knobs, error in errors.items() if error > OVERSIZED_BOUND}
    worst = max([error for error in errors.values() if not math.isnan(error)], default=0.0)
    listed = ", ".join(f"{steps}x{substeps} {1e3 * error:.2g}" for (steps, substeps), error in wrong.items())
    refused = sum(map(math.isnan, errors.values()))
    note = f"{refused} of {len(errors)} refused" + (
        f"; wrong without a word (steps x substeps mm): {listed}" if wrong else ""
    )
    return at_most(worst, OVERSIZED_BOUND, "m", note)


# -- mass ----------------------------------------------------------------------------------------------------------------


@case("one gram and one ton", "Does mass, which cancels, change the motion?")
def mass() -> Outcome:
    surface, ends = Surface(horizontal_amplitude=1.1 * threshold(MU)), []
    amplitude, phase = random_drive(surface, 16)
    for kilograms in (1e-3, 1.0, 1e3):
        sim = Simulator(surface, block(MU, 0.63, mass=kilograms))
        sim.reset([0.4, 0.1, 0.3], [0, surface.table_speed, 1])
        sim.advance(amplitude, phase, 20)
        sound(sim)
        ends.append(np.concatenate([sim.pose.ravel(), sim.velocity.ravel()]))
    wrong = int((ends[0] != ends[1]).sum() + (ends[0] != ends[2]).sum())
    return at_most(wrong, 0, "numbers", "1 g, 1 kg, 1 t; 20 periods of sticking and sliding")
