"""Slip that passes through zero, and table accelerations at the limits of static and sliding friction."""

from __future__ import annotations

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
    table_velocity,
    threshold,
)  # fmt: skip
from vibgym.scene.surface import Surface

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
        found = solve_ivp(slope, (zero + first, t), state, method="DOP853", rtol=1e-12, atol=1e-16).y[:, -1]
        table = 1j * surface.table_speed * np.exp(1j * w * t)
        moved = surface.horizontal_amplitude * (np.exp(1j * w * t) - np.exp(1j * w * zero))
        return table - found[0], moved - found[1]

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
