"""Invariants of any motion: finite numbers, energy, the sign of friction's power, monotone slip."""

from __future__ import annotations

import math

import numpy as np

from studies.accuracy.hard_cases.case import (
    Outcome,
    at_most,
    block,
    case,
    one_element,
    random_drive,
    sound,
    threshold,
)  # fmt: skip
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
            given = -force_x * ux - force_y * uy + torque * spin
            most = 2.0 * surface.gravity * (math.hypot(ux, uy) + abs(spin) * part.radius)
            if not math.isfinite(given):
                raise ArithmeticError(f"power {given} at slip ({ux:g}, {uy:g}) m/s, {spin:g} rad/s")
            worst = max(worst, given / most)
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
