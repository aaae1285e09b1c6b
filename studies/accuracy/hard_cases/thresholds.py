"""Slip that passes through zero, and table accelerations at the limits of static and sliding friction."""

from __future__ import annotations

import math

import numpy as np
from scipy.integrate import solve_ivp

from studies.accuracy.hard_cases.case import (
    FINE,
    HardCase,
    Outcome,
    Path,
    Scene,
    against_reference,
    at_most,
    follow,
    one_element,
    random_drive,
    table_velocity,
    threshold,
)  # fmt: skip
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

MU = 0.6


def block(friction: float = MU, static: float | None = None) -> Part:
    return Part.rectangle(0.050, 0.035, friction=friction, static_friction=static)


# -- slip through zero -------------------------------------------------------------------------------------------------


def through_zero(surface: Surface, friction: float, instant: float) -> tuple[complex, complex, complex]:
    """Start velocity from which slip is exactly zero at ``instant`` (in periods), and displacement and velocity at the end.

    On a surface at rest, as complex numbers. Before the instant ``n = u / |u|`` is against the table's acceleration, after
    it along; both halves are integrated away from the instant, where they are smooth.
    """
    w, needed, held = (
        surface.angular_frequency,
        surface.table_speed * surface.angular_frequency,
        friction * surface.gravity,
    )
    zero = instant * surface.period
    ahead = -np.exp(1j * w * zero)  # direction of the table's acceleration at the instant

    def part(t: float) -> tuple[complex, complex]:
        """Velocity and displacement from the instant on (or back) to ``t``."""
        side = math.copysign(1.0, t - zero)
        first = 1e-9 * surface.period * side

        def slope(t: float, y: np.ndarray) -> list[complex]:
            return [-needed * np.exp(1j * w * t) - held * y[0] / abs(y[0]), y[0]]

        slip = ahead * (needed - side * held) * first
        found = solve_ivp(
            slope, (zero + first, t), [slip, 0.5 * slip * first], method="DOP853", rtol=1e-12, atol=1e-16
        ).y[:, -1]  # fmt: skip
        table = 1j * surface.table_speed * np.exp(1j * w * t)
        moved = surface.horizontal_amplitude * (np.exp(1j * w * t) - np.exp(1j * w * zero))
        return table - found[0], moved - found[1]

    start, behind = part(0.0)
    end, rest = part(surface.period)
    return start, rest - behind, end


def passing(knobs: dict[str, int], bound: float) -> Outcome:
    surface, worst = one_element(), 0.0
    for instant in np.linspace(0.03, 0.97, 24):
        start, moved, _ = through_zero(surface, MU, float(instant))
        path = follow(Scene(surface, block(), [1, 1, 0.3], [start.real, start.imag, 0], 0, 0, 1), **knobs)
        worst = max(worst, abs(complex(*(path.pose[-1, :2] - 1.0)) - moved))
        if path.sticking[-1]:
            raise ArithmeticError(f"held at {instant:.3f} of the period, where a_h w^2 exceeds mu_0 g")
    return at_most(worst, bound, "m", "24 instants, against integration from the instant in both directions")


# -- a_h w^2 at the limits ---------------------------------------------------------------------------------------------


def stuck_or_not(share: float, sticks: bool) -> Outcome:
    """Wrong answers among many frictions and frequencies, starting on the table's velocity with a_h w^2 = share mu_0 g."""
    wrong = tried = 0
    for static in np.linspace(0.1, 1.5, 15):
        for frequency in (5.0, 10.0, 25.0, 40.0):
            surface = Surface(horizontal_amplitude=share * threshold(static, frequency), frequency=frequency)
            scene = Scene(surface, block(0.9 * static, static), [0.4, 0.1, 0.3], table_velocity(surface), 0, 0, 3)
            tried += 1
            wrong += bool(follow(scene).sticking[-1]) != sticks
    return at_most(wrong, 0, f"of {tried}", "stays" if sticks else "lets go")


def sliding_at(share: float, periods: int = 800, **knobs: int) -> tuple[Path, Surface]:
    surface = one_element(horizontal_amplitude=share * threshold(MU))
    return follow(Scene(surface, block(MU, 0.7), [1, 1, 0.3], [0, 0, 0], 0, 0, periods), **knobs), surface


def slip_of(path: Path, surface: Surface) -> np.ndarray:
    return np.hypot(*(np.array(table_velocity(surface)) - path.velocity)[:, :2].T)


def above_sliding_limit(share: float) -> Outcome:
    """Goes on for ever with slip sqrt((a_h w^2)^2 - (mu g)^2) / w."""
    path, surface = sliding_at(share)
    if path.sticking.any():
        raise ArithmeticError("static friction caught a part that slides above mu g")
    expected = math.sqrt(share**2 - 1.0) * MU * surface.gravity / surface.angular_frequency
    return at_most(abs(slip_of(path, surface)[-1] / expected - 1.0), 1e-2, "of slip", f"slip {expected:.3g} m/s")


def at_sliding_limit() -> Outcome:
    """Exactly at mu g slip dies down as 2 mu g / (w^2 t) and is never caught."""
    path, surface = sliding_at(1.0)
    if path.sticking.any():
        raise ArithmeticError(f"caught in period {int(np.argmax(path.sticking))}")
    time = surface.period * np.arange(len(path.velocity))
    # 1 / slip grows by w^2 / (2 mu g) a second; the start only shifts it.
    growth = np.polyfit(time[100:], 1.0 / slip_of(path, surface)[100:], 1)[0]
    expected = surface.angular_frequency**2 / (2.0 * MU * surface.gravity)
    return at_most(abs(growth / expected - 1.0), 1e-2, "of rate", "slip ~ 1 / t over 800 periods")


def below_sliding_limit(share: float) -> Outcome:
    """Caught, no later than slip can last: with lag phi it falls by (1 - share cos phi) mu g a second."""
    path, surface = sliding_at(share)
    slowest = (1.0 - share) * MU * surface.gravity
    bound = (surface.table_speed / slowest) / surface.period + 1.0
    caught = int(np.argmax(path.sticking)) if path.sticking.any() else math.inf
    stays = bool(path.sticking[int(min(caught, 800)) :].all())
    return Outcome(caught, bound, "periods", caught <= bound and stays, "until it is caught, for good")


def _stick_and_slip() -> Scene:
    surface = Surface(horizontal_amplitude=1.1 * threshold(MU))
    return Scene(
        surface, block(MU, 0.65), [0.4, 0.1, 0.3], table_velocity(surface), *random_drive(surface, 3), 5
    )  # fmt: skip


def _vanishing() -> Scene:
    surface = Surface(horizontal_amplitude=0.4 * threshold(MU))
    start = table_velocity(surface)
    return Scene(surface, block(MU, 0.65), [0.4, 0.1, 0.3], start, surface.lift_off_amplitude, 1.0, 5)


CASES = (
    HardCase(
        "slip through zero, not held",
        "Slip passes exactly through zero where friction cannot hold the part: is the path right and nothing held?",
        lambda: passing({}, 1e-4),
    ),
    HardCase(
        "slip through zero, not held, fine steps",
        "Does the path through exact zero of slip converge?",
        lambda: passing(FINE, 1e-6),
    ),
    *against_reference(
        "caught on a moving table",
        "Is a part that slides below the limit caught at the right time and place?",
        lambda: Scene(
            Surface(horizontal_amplitude=0.9 * threshold(MU)), block(), [0.4, 0.1, 0.3], [0.1, -0.05, 2.0], 0, 0, 6
        ),
    ),
    *against_reference(
        "stick and slip in every period",
        "Holding and letting go many times on vibrating elements: do errors pile up?",
        _stick_and_slip,
    ),
    *against_reference(
        "pressure that vanishes while it sticks",
        "Elements at lift-off take all static friction away for an instant: is the part let go and caught rightly?",
        _vanishing,
    ),
    HardCase(
        "just below mu_0 g",
        "Does a part that sticks stay stuck a billionth below the limit of static friction?",
        lambda: stuck_or_not(1 - 1e-9, True),
    ),
    HardCase(
        "exactly mu_0 g",
        "At the limit itself static friction still holds (thesis eq. 3.23): does rounding break it?",
        lambda: stuck_or_not(1.0, True),
    ),
    HardCase(
        "just above mu_0 g",
        "Does a part let go a billionth above the limit of static friction?",
        lambda: stuck_or_not(1 + 1e-9, False),
    ),
    *(
        HardCase(
            f"mu g, {share - 1:.0e} above",
            "A part that slides goes on sliding just above mu g: is it caught by mistake?",
            lambda share=share: above_sliding_limit(share),
        )
        for share in (1 + 1e-2, 1 + 1e-4)
    ),
    HardCase(
        "exactly mu g",
        "At the limit slip dies down for ever and never ends: is it caught by mistake?",
        at_sliding_limit,
    ),
    *(
        HardCase(
            f"mu g, {1 - share:.0e} below",
            "Just below mu g nothing can go on sliding: is the part caught in time?",
            lambda share=share: below_sliding_limit(share),
        )
        for share in (1 - 1e-2, 1 - 1e-4)
    ),
)


def _frictionless() -> Outcome:
    surface = Surface()
    amplitude, phase = random_drive(surface, 5)
    velocity = np.array([0.11, -0.02, 3.0])
    sim = Simulator(surface, block(0.0))
    sim.reset([0.4, 0.1, 0.3], velocity)
    sim.advance(amplitude, phase, 50)
    if not (sim.velocity[0, 0] == velocity).all():
        raise ArithmeticError(f"velocity became {sim.velocity[0, 0]}")
    expected = [0.4, 0.1, 0.3] + velocity * 50 * surface.period
    return at_most(np.abs(sim.pose[0, 0] - expected).max(), 1e-13 * 50, "m, rad", "50 periods; velocity bit for bit")


def _random(friction: float) -> Scene:
    surface = Surface()
    return Scene(surface, block(friction), [0.4, 0.1, 0.3], [0.0, 0.0, 2.0], *random_drive(surface, 6), 4)


CASES += (
    HardCase("mu = 0", "Without friction nothing may change a part's velocity.", _frictionless),
    *against_reference("mu = 0.01", "Almost no friction: is its small effect right?", lambda: _random(0.01)),
    *against_reference(
        "mu = 2", "Friction beyond the table's acceleration at times: still right?", lambda: _random(2.0)
    ),
    *against_reference(
        "mu = 10",
        "Friction far beyond the table's acceleration, sticking most of the time: still right, no hang?",
        lambda: _random(10.0),
    ),
)
