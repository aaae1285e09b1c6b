"""Friction at its limits: slip through zero, thresholds of sticking and sliding, lift-off, opposed elements, and fast spins."""

from __future__ import annotations

import cmath
import math

import numpy as np
from scipy.integrate import solve_ivp

from studies.accuracy.hard_cases.case import (
    CASES,
    FINE,
    Outcome,
    Path,
    Scene,
    against_reference,
    at_most,
    block,
    case,
    follow,
    one_element,
    random_drive,
    sound,
    table_velocity,
    threshold,
)
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

MU = 0.6
START = [0.4, 0.1, 0.3]

# -- slip through zero -------------------------------------------------------------------------------------------------


def through_zero(surface: Surface, friction: float, instant: float) -> tuple[complex, complex, complex]:
    """Return the velocity at the start from which slip is zero at ``instant`` (in periods), and displacement and velocity
    at the end, as complex numbers.

    The surface's elements rest. Before the instant ``n = u / |u|`` is opposite to the table's acceleration, afterwards along
    it. Both halves are smooth, and integrated away from the instant.
    """
    w, held = surface.angular_frequency, friction * surface.gravity
    needed = surface.table_speed * w
    zero = instant * surface.period
    ahead = -np.exp(1j * w * zero)  # direction of the table's acceleration at the instant

    def part(t: float) -> tuple[complex, complex]:
        """Return velocity and displacement from the instant on (or back) to ``t``."""
        side = math.copysign(1.0, t - zero)
        first = 1e-9 * surface.period * side

        def slope(t: float, y: np.ndarray) -> list[complex]:
            return [-needed * np.exp(1j * w * t) - held * y[0] / abs(y[0]), y[0]]

        slip = ahead * (needed - side * held) * first
        state = [slip, 0.5 * slip * first]
        end = solve_ivp(slope, (zero + first, t), state, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
        table = 1j * surface.table_speed * np.exp(1j * w * t)
        moved = surface.horizontal_amplitude * (np.exp(1j * w * t) - np.exp(1j * w * zero))
        return table - end[0], moved - end[1]

    start, behind = part(0.0)
    end, rest = part(surface.period)
    return start, rest - behind, end


@case("slip through zero, not held, fine steps", "Does the path through exact zero of slip converge?", (FINE, 1e-6))
@case(
    "slip through zero, not held",
    "Slip passes exactly through zero where friction cannot hold the part: is the path right and nothing held?",
    ({}, 1e-4),
)
def passing(knobs: dict[str, int], bound: float) -> Outcome:
    surface, worst = one_element(), 0.0
    for instant in np.linspace(0.03, 0.97, 24):
        start, moved, _ = through_zero(surface, MU, float(instant))
        path = follow(Scene(surface, block(), [1, 1, 0.3], [start.real, start.imag, 0], 0, 0, 1), **knobs)
        worst = max(worst, abs(complex(*(path.pose[-1, :2] - 1.0)) - moved))
        if path.sticking[-1]:
            raise ArithmeticError(f"held at {instant:.3f} of the period, where a_h w^2 exceeds mu_0 g")
    return at_most(worst, bound, "m", "24 instants, against integration from the instant in both directions")


# -- against the reference ---------------------------------------------------------------------------------------------


def _caught() -> Scene:
    surface = Surface(horizontal_amplitude=0.9 * threshold(MU))
    return Scene(surface, block(), START, [0.1, -0.05, 2.0], 0, 0, 6)


def _stick_and_slip() -> Scene:
    surface = Surface(horizontal_amplitude=1.1 * threshold(MU))
    return Scene(surface, block(MU, 0.65), START, table_velocity(surface), *random_drive(surface, 3), 5)


def _vanishing() -> Scene:
    surface = Surface(horizontal_amplitude=0.4 * threshold(MU))
    return Scene(surface, block(MU, 0.65), START, table_velocity(surface), surface.lift_off_amplitude, 1.0, 5)


def _random(friction: float) -> Scene:
    surface = Surface()
    return Scene(surface, block(friction), START, [0.0, 0.0, 2.0], *random_drive(surface, 6), 4)


for _name, _question, _make in (
    ("caught on a moving table", "Is a part that slides below the limit caught at the right time and place?", _caught),
    ("stick and slip in every period", "Holding and letting go many times on vibrating elements: do errors pile up?",
     _stick_and_slip),
    ("pressure that vanishes while it sticks",
     "Elements at lift-off take all static friction away for an instant: is the part let go and caught rightly?",
     _vanishing),
    ("mu = 0.01", "Almost no friction: is its small effect right?", lambda: _random(0.01)),
    ("mu = 2", "Friction beyond the table's acceleration at times: still right?", lambda: _random(2.0)),
    ("mu = 10", "Friction far beyond the table's acceleration, sticking most of the time: still right, no hang?",
     lambda: _random(10.0)),
):  # fmt: skip
    CASES += against_reference(_name, _question, _make)


@case("mu = 0", "Without friction nothing may change a part's velocity.")
def frictionless() -> Outcome:
    surface = Surface()
    velocity = np.array([0.11, -0.02, 3.0])
    path = follow(Scene(surface, block(0.0), START, velocity, *random_drive(surface, 5), 50))
    if not (path.velocity == velocity).all():
        raise ArithmeticError(f"velocity became {path.velocity[-1]}")
    expected = START + velocity * 50 * surface.period
    return at_most(np.abs(path.pose[-1] - expected).max(), 1e-13 * 50, "m, rad", "50 periods; velocity bit for bit")


# -- a_h w^2 at the limits ---------------------------------------------------------------------------------------------


@case("just above mu_0 g", "Does a part let go a billionth above the limit of static friction?", (1 + 1e-9, False))
@case(
    "exactly mu_0 g",
    "At the limit itself static friction still holds (thesis eq. 3.23): does rounding break it?",
    (1.0, True),
)
@case(
    "just below mu_0 g",
    "Does a part that sticks stay stuck a billionth below the limit of static friction?",
    (1 - 1e-9, True),
)
def stuck_or_not(share: float, sticks: bool) -> Outcome:
    """Count wrong answers among many frictions and frequencies, from the table's velocity with a_h w^2 = share mu_0 g."""
    wrong = tried = 0
    for static in np.linspace(0.1, 1.5, 15):
        for frequency in (5.0, 10.0, 25.0, 40.0):
            surface = Surface(horizontal_amplitude=share * threshold(static, frequency), frequency=frequency)
            path = follow(Scene(surface, block(0.9 * static, static), START, table_velocity(surface), 0, 0, 3))
            tried += 1
            wrong += bool(path.sticking[-1]) != sticks
    return at_most(wrong, 0, f"of {tried}", "stays" if sticks else "lets go")


def sliding_at(share: float) -> tuple[Path, Surface]:
    surface = one_element(horizontal_amplitude=share * threshold(MU))
    return follow(Scene(surface, block(MU, 0.7), [1, 1, 0.3], [0, 0, 0], 0, 0, 800)), surface


def slip_of(path: Path, surface: Surface) -> np.ndarray:
    return np.hypot(*(np.array(table_velocity(surface)) - path.velocity)[:, :2].T)


@case(
    "mu g, {:.0e} above",
    "A part that slides goes on sliding just above mu g: is it caught by mistake?",
    (1e-2,),
    (1e-4,),
)
def above_sliding_limit(above: float) -> Outcome:
    """Slip stays at sqrt((a_h w^2)^2 - (mu g)^2) / w."""
    path, surface = sliding_at(1 + above)
    if path.sticking.any():
        raise ArithmeticError("static friction caught a part that slides above mu g")
    expected = math.sqrt((1 + above) ** 2 - 1.0) * MU * surface.gravity / surface.angular_frequency
    return at_most(abs(slip_of(path, surface)[-1] / expected - 1.0), 1e-2, "of slip", f"slip {expected:.3g} m/s")


@case("exactly mu g", "At the limit slip dies down for ever and never ends: is it caught by mistake?")
def at_sliding_limit() -> Outcome:
    """Slip dies down as 2 mu g / (w^2 t)."""
    path, surface = sliding_at(1.0)
    if path.sticking.any():
        raise ArithmeticError(f"caught in period {int(np.argmax(path.sticking))}")
    time = surface.period * np.arange(len(path.velocity))
    # 1 / slip grows by w^2 / (2 mu g) a second; the start only shifts it.
    growth = np.polyfit(time[100:], 1.0 / slip_of(path, surface)[100:], 1)[0]
    expected = surface.angular_frequency**2 / (2.0 * MU * surface.gravity)
    return at_most(abs(growth / expected - 1.0), 1e-2, "of rate", "slip ~ 1 / t over 800 periods")


@case("mu g, {:.0e} below", "Just below mu g nothing can go on sliding: is the part caught in time?", (1e-2,), (1e-4,))
def below_sliding_limit(below: float) -> Outcome:
    """With lag phi slip falls by (1 - share cos phi) mu g a second, which bounds the time."""
    path, surface = sliding_at(1 - below)
    slowest = (1.0 - (1 - below)) * MU * surface.gravity
    bound = (surface.table_speed / slowest) / surface.period + 1.0
    caught = int(np.argmax(path.sticking)) if path.sticking.any() else math.inf
    stays = bool(path.sticking[int(min(caught, 800)) :].all())
    return Outcome(caught, bound, "periods", caught <= bound and stays, "until it is caught, for good")


L = 0.026
STEADY = {0.3: (0.30485, 4.96), 0.6: (0.30438, 9.93), 0.9: (0.30359, 14.94)}
"""Speed (m/s) and direction (deg) of the steady mean velocity by friction coefficient, at full amplitude and alpha = 270
degrees, from an integration of thesis eqs. 3.26 and 3.27."""


@case("a_v exactly at lift-off", "Pressure touches zero: is the motion still right?")
def at_lift_off() -> Outcome:
    """Compare the steady mean velocity at full amplitude with ``STEADY``; each period starts at the middle."""
    surface, worst = one_element(), 0.0
    middle = 0.5 * surface.width
    for friction, (speed, degrees) in STEADY.items():
        expected = cmath.rect(speed, math.radians(degrees))
        sim = Simulator(surface, block(friction))
        for _ in range(40):
            sim.reset([middle, middle, 0.3], sim.velocity if sim.time else [expected.real, expected.imag, 0])
            sim.advance(surface.lift_off_amplitude, 1.5 * math.pi)
            sound(sim)
        worst = max(worst, abs(complex(*sim.mean_velocity[0, 0, :2]) - expected) / speed)
    return at_most(worst, 1e-3, "of speed", "steady mean velocity for mu = 0.3, 0.6, 0.9; pressure touches zero")


@case("a_v above lift-off", "A part would leave the surface: is that refused, by name, before anything moves?")
def beyond_lift_off() -> Outcome:
    surface, missing = Surface(), []
    above = surface.lift_off_amplitude * (1 + 1e-9)
    sim = Simulator(surface, block())
    one = np.zeros((8, 32))
    one[3, 7] = above
    start = sim.pose
    calls = [
        ("amplitude", lambda value=level: sim.advance(value, 0.0))
        for level in (above, 1.0, one, -1e-12, math.nan, math.inf)
    ]
    for name, call in (*calls, ("max_amplitude", lambda: Surface(max_amplitude=above))):
        try:
            call()
            missing.append(name)
        except ValueError as error:
            if not str(error).startswith(f"{name} must be"):
                missing.append(str(error))
    moved = (sim.pose != start).any() or sim.time != 0.0
    return Outcome(len(missing) + moved, 0, "of 7", not missing and not moved, "; ".join(missing))


# -- four elements against each other ----------------------------------------------------------------------------------

SQUARE = Part.rectangle(2 * L, 2 * L, friction=0.6)
TANGENTIAL = [math.pi - math.pi / 4 * k for k in (-3, -1, 3, 1)]
"""alpha(-r) = alpha(r) + pi. A phase alpha pushes a resting part along -(sin alpha, cos alpha): here to the left of r."""


def four(surface: Surface, phases: list[float]) -> tuple[np.ndarray, np.ndarray]:
    """Return full amplitude on the four elements around the grid corner (12, 4); phases from the lower left, row by row."""
    amplitude, phase = np.zeros((8, 32)), np.zeros((8, 32))
    amplitude[3:5, 11:13] = surface.lift_off_amplitude
    phase[3:5, 11:13] = np.reshape(phases, (2, 2))
    return amplitude, phase


@case("four elements in opposite phase, pure torque", "Do opposed elements cancel in force and add up in torque?")
def pure_torque() -> Outcome:
    """Compare torque with first order in eps = mu g / (a_h w^2), which is accurate to a few eps for low friction; no force.

    From the piece's mean acceleration -(mu a / 2) (S, C) at its centroid, all quarters of a square of side 2 L:
    ``mu A / 2 * sqrt(2) L / 2 / k^2``.
    """
    friction, periods = 0.001, 5
    surface, square = Surface(), Part.rectangle(2 * L, 2 * L, friction=friction)
    amplitude, phase = four(surface, TANGENTIAL)
    radius = friction * surface.gravity / surface.angular_frequency**2
    start = surface.idle_velocity(friction)
    pose = [12 * L + start[1] / surface.angular_frequency, 4 * L - start[0] / surface.angular_frequency, 0.0]
    path = follow(Scene(surface, square, pose, [*start, 0], amplitude, phase, periods))
    expected = 0.5 * friction * surface.gravity * math.sqrt(0.5) * L / square.gyration
    # From period means, since torque oscillates; spin is damped by mu g / (2 a_h w).
    turned = np.diff(path.pose[:, 2])
    damping = friction * surface.gravity / (2.0 * surface.table_speed)
    rate = (turned[-1] - turned[0]) / surface.period / ((periods - 1) * surface.period)
    rate += damping * turned.mean() / surface.period
    drift = np.hypot(*(path.pose[-1] - path.pose[0])[:2]) / periods / (2 * math.pi * radius)
    if drift > 0.01:
        raise ArithmeticError(f"drifts by {drift:.3g} of its circle in a period")
    note = f"eps = 1.5e-4; drift {drift:.2g} of its circle a period"
    return at_most(abs(rate / expected - 1.0), 0.01, "of torque", note)


def _four(phases: list[float]) -> Scene:
    surface = Surface()
    return Scene(surface, SQUARE, [12 * L, 4 * L, 0.0], [0, 0, 0], *four(surface, phases), 5)


CASES += against_reference(
    "four elements in opposite phase, tangential",
    "Is a part at the meeting point of four opposed elements right?",
    lambda: _four(TANGENTIAL),
)
CASES += against_reference(
    "four elements in opposite phase, chequered",
    "Opposed neighbours: force and torque nearly cancel; is what is left right?",
    lambda: _four([0, math.pi, math.pi, 0]),
)

# -- spin --------------------------------------------------------------------------------------------------------------


def _spinning() -> Scene:
    surface, part = Surface(), block()
    spin = 10.0 * surface.table_speed / part.radius
    return Scene(surface, part, [0.4, 0.1, 0.3], [0, 0, spin], *random_drive(surface, 14), 3)


CASES += against_reference(
    "spin of ten times the table's speed",
    "Corners ten times faster than the table: is friction over the area still right?",
    _spinning,
    pieces=32,
)


@case("spin on a still table", "Does a spinning disc stop after the right angle, in place, and exactly?")
def spun_out() -> Outcome:
    """omega falls by (4/3) mu g / r a second, down to exactly 0."""
    surface, radius, friction = one_element(horizontal_amplitude=0.0), 0.03, 0.6
    disc = Part.disc(radius, friction=friction)
    slowing, worst = 4.0 * friction * surface.gravity / (3.0 * radius), 0.0
    for spin in (1.0, 30.0, 10 * Surface().table_speed / radius):
        periods = math.ceil(spin / slowing / surface.period) + 1
        path = follow(Scene(surface, disc, [1, 1, 0], [0, 0, spin], 0, 0, periods))
        worst = max(worst, abs(path.pose[-1, 2] / (spin**2 / (2 * slowing)) - 1.0))
        if (path.velocity[-1] != 0.0).any() or np.abs(path.pose[-1, :2] - 1.0).max() > 1e-9:
            raise ArithmeticError(f"spin {spin:g} rad/s: ends at {path.pose[-1]} with {path.velocity[-1]}")
    return at_most(worst, 1e-2, "of angle", "the torque's area integral has an error of its own")


@case("slide and spin on a still table, fine pieces", "Does that ratio converge?", ({"pieces": 64}, 0.01))
@case(
    "slide and spin on a still table",
    "Do sliding and spinning of a disc end at the same instant, with speeds in the known ratio?",
    ({}, 0.05),
)
def slides_and_spins(knobs: dict[str, int], bound: float) -> Outcome:
    """Sliding and spinning end together, at v / (omega r) = 0.653, which a disc that has it keeps (Farkas et al. 2003)."""
    surface, radius = one_element(0.12, horizontal_amplitude=0.0, frequency=400.0), 0.03
    disc, worst = Part.disc(radius, friction=0.6), 0.0
    for speed, spin in ((0.653 * 0.3, 10.0), (0.653 * 0.6, 20.0), (0.3, 10.0), (0.1, 10.0)):
        path = follow(Scene(surface, disc, [0.04, 0.06, 0], [speed, 0, spin], 0, 0, 80), **knobs)
        slides, spins = path.velocity[:, 0] != 0.0, path.velocity[:, 2] != 0.0
        if (slides != spins).any() or slides[-1]:
            raise ArithmeticError("sliding and spinning do not end together")
        ratio = path.velocity[slides, 0] / (path.velocity[slides, 2] * radius)
        if abs(ratio[0] - 0.653) < 1e-9:
            worst = max(worst, float(np.abs(ratio / 0.653 - 1.0).max()))
        elif not abs(ratio[-1] - 0.653) < 0.8 * abs(ratio[0] - 0.653):
            raise ArithmeticError(f"v / (omega r) goes from {ratio[0]:.3f} to {ratio[-1]:.3f}")
    return at_most(worst, bound, "of 0.653", "kept until the end by two motions, approached by two")
