"""Reference: one part in planar contact with the elements, resolved in time, sliding and sticking; slow and independent.

It shares no code with the kernels of ``vibgym.physics``: shapely cuts the contact area at every evaluation, friction is
integrated over it in closed form, SciPy's DOP853 advances slip and its events end it.

A sliding part whose slip falls below a small threshold sticks if static friction can hold it (the needed wrench is within the
limit surface of ``mu_0``); otherwise it continues to slide. A stuck part moves with the table until the needed wrench leaves
that surface. It then starts to slide along the slip acceleration that is consistent with its friction ``mu``.

The threshold is ``100 tolerance`` times the scale of velocity ``a_h w + mu_0 g / w``. Friction is monotone in slip and
therefore does not drive two motions of one part apart. An error of slip at the threshold is not amplified: the error of
position is at most that times the duration.

The error is estimated by a second run with a hundred times the tolerance, its threshold and a coarser cubature: three times
the difference. That is about the error of the coarse run; the returned run is more accurate.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.integrate import solve_ivp
from scipy.optimize import brentq, minimize_scalar

from studies.accuracy.contact import COARSE, FINE, Contact, Cubature, Cutter
from studies.accuracy.limit_surface import Grip, escape, load
from vibgym import checks

SAMPLES = 96
"""Times per period at which static friction of a stuck part is checked."""

ROUNDING = 1e-11
"""Tolerance of the load, so that a wrench exactly on the limit surface is held."""

_MIN_STEPS, _COARSE_STEPS = 20, 12  # in a period, so that no step misses a short contact
_RESTARTS = 1000  # changes between sticking and sliding in one period before the run gives up
_CAUTION = 3.0  # for the difference of two runs: at element edges the error is not proportional to the tolerance
_STIFF_UNTIL = 1e-3  # slip over the scale of velocity: below, direction settles fast and an implicit method is used


class Trajectory(NamedTuple):
    """A part's motion at the boundaries of the periods."""

    pose: np.ndarray  # (periods + 1, 3) x, y (m) of the centre of mass and heading (rad)
    velocity: np.ndarray  # (periods + 1, 3), m/s and rad/s, at the instant
    sticking: np.ndarray  # (periods + 1,) whether the part moves with the table at that instant
    fallen: bool  # whether the centre of mass has left the support; from then on the part rests at that pose
    fall_time: float  # s, or NaN
    switches: np.ndarray  # (n, 2) time (s), and 1 where sticking begins, 0 where sliding begins
    error: np.ndarray  # (periods + 1, 3) estimated error of ``pose``; zeros without estimate


def integrate(
    surface: Any,
    part: Any,
    pose: Any,
    velocity: Any,
    amplitude: Any,
    phase: Any,
    periods: int,
    *,
    tolerance: float = 1e-9,
    estimate: bool = True,
    incline: Any = (0.0, 0.0),
    patches: Any = 1.0,
) -> Trajectory:
    """Return the motion of one part over whole periods under a held drive, from time 0.

    Args:
        surface, part: a ``Surface`` and a ``Part`` of ``vibgym.scene``; only their plain attributes are read.
        pose, velocity: (3,) at the start, m and rad, m/s and rad/s, in the world frame.
        amplitude, phase: broadcastable to (rows, columns): vertical motion ``a_v cos(wt + alpha)`` of the elements, m
            and rad.
        periods: duration.
        tolerance: relative, of every step; absolute ones follow from the scales of length and velocity of the drive.
        incline: (2,) m/s^2, constant acceleration of the part.
        patches: broadcastable to (rows, columns): factor of every element on both coefficients of friction.
        estimate: run again at ``100 tolerance`` for :attr:`Trajectory.error`; costs about half as much again.

    Raises:
        ValueError: a bad argument, a drive beyond lift-off.
        RuntimeError: sticking and sliding alternate without end.
    """
    pose = checks.array("pose", pose, (3,))
    velocity = checks.array("velocity", velocity, (3,))
    shape = (surface.rows, surface.columns)
    highest = surface.lift_off_amplitude * (1.0 + 1e-12)
    amplitude = checks.array("amplitude", amplitude, shape, least=0.0, most=highest)
    phase = checks.array("phase", phase, shape)
    periods = checks.count("periods", periods)
    incline = checks.array("incline", incline, (2,))
    patches = checks.array("patches", patches, shape, least=0.0)
    tolerance = checks.number("tolerance", tolerance, least=1e-12, most=1e-4)
    scene = surface, part, amplitude, phase, incline, patches
    run = _Run(scene, tolerance, FINE, _MIN_STEPS).go(pose, velocity, periods)
    if not estimate:
        return run
    rough = 100.0 * tolerance
    coarse = _Run(scene, rough, COARSE, _COARSE_STEPS).go(pose, velocity, periods)
    return run._replace(error=_CAUTION * np.abs(run.pose - coarse.pose))


class _Run:
    """One motion of one part, on one surface, under one held drive.

    The state ``y`` is pose and velocity, (6,): x, y (m), heading (rad), their rates. Wrenches are per unit mass. Twists and
    wrenches are scaled by the radius of gyration, as in :mod:`studies.accuracy.limit_surface`.

    Args:
        scene: surface, part, amplitude, phase, incline, patches as for :func:`integrate`.
        tolerance: relative.
        cubature: of the contact area.
        least_steps: in a period.
    """

    def __init__(self, scene: tuple, tolerance: float, cubature: Cubature, least_steps: int) -> None:
        surface, part, amplitude, phase, self.incline, self.patches = scene
        self.w = w = 2.0 * math.pi * surface.frequency
        self.period = 1.0 / surface.frequency
        self.radius = surface.horizontal_amplitude
        self.gravity = surface.gravity
        self.lift_c = amplitude * np.cos(phase) * w**2  # z'' = -lift_c cos wt + lift_s sin wt
        self.lift_s = amplitude * np.sin(phase) * w**2
        self.friction, self.static = part.friction, part.static_friction
        self.gyration = math.sqrt(part.gyration)
        self.cutter = Cutter(surface, part, cubature)
        self.tolerance = tolerance
        self.longest = self.period / least_steps
        strongest = max(max(self.static, 1e-3) * self.gravity, float(np.hypot(*self.incline)))
        self.scale = self.radius * self.w + strongest / self.w  # of velocity, m/s
        self.threshold = 100.0 * tolerance * self.scale
        length = self.scale / self.w
        self.absolute = tolerance * np.array(
            [length, length, length / self.gyration, self.scale, self.scale, self.scale / self.gyration]
        )
        self.switches: list[tuple[float, float]] = []
        self.fall_time = math.nan
        self.now = 0.0  # start of the current period, s

    # -- forces --------------------------------------------------------------------------------------------------------

    def table(self, t: float) -> np.ndarray:
        """Return displacement and velocity of the table."""
        c, s = self.radius * math.cos(self.w * t), self.radius * math.sin(self.w * t)
        return np.array([c, s, -self.w * s, self.w * c])

    def contact(self, y: np.ndarray) -> Contact | None:
        """Return the contact area at a state; None off the surface."""
        return self.cutter.cut(y[0], y[1], y[2])

    def grip(self, contact: Contact, t: float, friction: float) -> Grip:
        """Return the function from scaled slip twist to scaled friction wrench; the supported area carries the load."""
        i, j = contact.element.T
        normal = self.gravity - self.lift_c[i, j] * math.cos(self.w * t) + self.lift_s[i, j] * math.sin(self.w * t)
        pressure = friction * self.patches[i, j] * (normal / contact.area.sum())
        k = self.gyration

        def wrench(xi: np.ndarray) -> np.ndarray:
            fx, fy, torque = contact.wrench(np.array([xi[0], xi[1], xi[2] / k]), pressure)
            return np.array([fx, fy, torque / k])

        return wrench

    def slip(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the scaled slip twist of the table against the part."""
        table = self.table(t)
        return np.array([table[2] - y[3], table[3] - y[4], -self.gyration * y[5]])

    def slope(self, t: float, y: np.ndarray) -> np.ndarray:
        """Return the rate of the state of a sliding part."""
        contact = self.contact(y)
        slip = self.slip(t, y)
        if contact is None or self.friction == 0.0 or not slip.any():
            return np.array([y[3], y[4], y[5], *self.incline, 0.0])
        ax, ay, aw = self.grip(contact, t, self.friction)(slip)
        return np.array([y[3], y[4], y[5], ax + self.incline[0], ay + self.incline[1], aw / self.gyration])

    def needed(self, t: float) -> np.ndarray:
        """Return the wrench of friction per unit mass that moves the part with the table."""
        size = self.radius * self.w**2
        x, y = self.incline
        return np.array([-size * math.cos(self.w * t) - x, -size * math.sin(self.w * t) - y, 0.0])

    def carried(self, y: np.ndarray, t0: float, t: float) -> np.ndarray:
        """Return the state at ``t`` of a part stuck since ``t0``."""
        there, here = self.table(t), self.table(t0)
        return np.array([y[0] + there[0] - here[0], y[1] + there[1] - here[1], y[2], there[2], there[3], 0.0])

    def load(self, y: np.ndarray, t: float, start: np.ndarray | None = None) -> tuple[float, np.ndarray]:
        """Return the load of static friction for motion with the table, and the twist of breakaway."""
        needed = self.needed(t)
        contact = self.contact(y)
        if not needed.any():
            return 0.0, np.array([1.0, 0.0, 0.0])
        if contact is None or self.static == 0.0:
            return math.inf, needed / np.linalg.norm(needed)
        return load(self.grip(contact, t, self.static), needed, start)

    def holds(self, y: np.ndarray, t: float) -> bool:
        """Return whether static friction can carry the part with the table."""
        return self.load(y, t)[0] <= 1.0 + ROUNDING

    def breakaway(self, y: np.ndarray, t: float) -> np.ndarray:
        """Return the scaled slip acceleration of a part that moves with the table and is no longer held."""
        contact = self.contact(y)
        needed = self.needed(t)
        if contact is None or self.friction == 0.0:
            return needed
        grip = self.grip(contact, t, self.friction)
        return escape(grip, needed, load(grip, needed)[1])

    # -- sticking ------------------------------------------------------------------------------------------------------

    def stick(self, y: np.ndarray, t0: float, fresh: float) -> tuple[float, np.ndarray, str]:
        """Move a part with the table until it breaks away, falls or the period ends; no breakaway before ``fresh``."""
        if self.radius == 0.0 and not self.incline.any():
            return self.period, self.carried(y, t0, self.period), "end"
        last: list[np.ndarray | None] = [None]

        def excess(t: float) -> float:
            at = self.carried(y, t0, t)
            value, last[0] = self.load(at, t, last[0])
            return min(value, 1e6) - 1.0 - ROUNDING

        def support(t: float) -> float:
            return self.cutter.support(*self.carried(y, t0, t)[:3])

        spacing = self.period / SAMPLES
        times = [t0, *(k * spacing for k in range(math.floor(t0 / spacing) + 1, SAMPLES)), self.period]
        times = [t for k, t in enumerate(times) if k == 0 or t > times[k - 1]]
        values = [excess(times[0])]
        if values[0] > 0.0 and t0 >= fresh:
            return t0, self.carried(y, t0, t0), "release"
        for k in range(1, len(times)):
            before, t = times[k - 1], times[k]
            values.append(excess(t))
            ends = math.inf
            if values[k] > 0.0:
                low = values[k - 1]
                ends = _root(excess, before, t) if low <= 0.0 else before
            elif (
                k >= 2
                and values[k - 1] > max(values[k - 2], values[k])
                and 2.0 * values[k - 1] > min(values[k - 2], values[k])
            ):
                # A peak between samples may exceed the limit.
                top: Any = minimize_scalar(lambda s: -excess(s), bounds=(times[k - 2], t), method="bounded")
                if -top.fun > 0.0:
                    ends = _root(excess, times[k - 2], float(top.x))
            if support(t) < 0.0:
                falls = _root(support, before, t) if support(before) >= 0.0 else before
                if falls <= ends:
                    return falls, self.carried(y, t0, falls), "fall"
            if ends < math.inf:
                return ends, self.carried(y, t0, ends), "release"
        return self.period, self.carried(y, t0, self.period), "end"

    def break_away(self, t0: float, y: np.ndarray) -> tuple[float, np.ndarray] | None:
        """Return time and state when slip is twice the threshold; None where the part sticks again before that."""

        def acceleration(t: float) -> np.ndarray:
            return self.breakaway(self.carried(y, t0, t), t)

        at_once = acceleration(t0)
        wait = 1e-9 * self.period
        while wait < 0.05 * self.period:
            later = acceleration(t0 + wait)
            slip = 0.5 * wait * (at_once + later)
            if np.linalg.norm(slip) >= 2.0 * self.threshold:
                after = self.carried(y, t0, t0 + wait)
                # The lag of the part in this time is less than threshold times wait.
                after[3:] -= slip / np.array([1.0, 1.0, self.gyration])
                return t0 + wait, after
            wait *= 1.5
        return None

    # -- sliding -------------------------------------------------------------------------------------------------------

    def slide(self, y: np.ndarray, t0: float) -> tuple[float, np.ndarray, str]:
        def caught(t: float, y: np.ndarray) -> float:
            return float(np.linalg.norm(self.slip(t, y))) - self.threshold

        def falls(t: float, y: np.ndarray) -> float:
            return self.cutter.support(y[0], y[1], y[2])

        def grown(t: float, y: np.ndarray) -> float:
            return float(np.linalg.norm(self.slip(t, y))) - _STIFF_UNTIL * self.scale

        caught.terminal = falls.terminal = grown.terminal = True  # type: ignore[attr-defined]
        caught.direction, grown.direction = -1.0, 1.0  # type: ignore[attr-defined]
        events = [caught, falls]
        stiff = grown(t0, y) < -0.5 * _STIFF_UNTIL * self.scale
        solution = solve_ivp(
            self.slope, (t0, self.period), y, "Radau" if stiff else "DOP853", events=events + [grown] * stiff,
            rtol=self.tolerance, atol=self.absolute, max_step=self.longest,
        )  # fmt: skip
        if solution.status < 0:
            raise RuntimeError(f"the reference failed at {self.now + t0:.9g} s: {solution.message}")
        t, y = float(solution.t[-1]), solution.y[:, -1]
        if solution.status == 0:
            return t, y, "end"
        if solution.t_events[1].size:
            return t, y, "fall"
        return t, y, "caught" if solution.t_events[0].size else "grown"

    # -- the whole motion ----------------------------------------------------------------------------------------------

    def go(self, pose: np.ndarray, velocity: np.ndarray, periods: int) -> Trajectory:
        y = np.concatenate([pose, velocity]).astype(float)
        stuck = self.slips_little(0.0, y) and self.holds(y, 0.0)
        if stuck:
            self.switches.append((0.0, 1.0))
        states, sticking = [y.copy()], [stuck]
        fallen = self.cutter.support(*pose) < 0.0
        if fallen:
            self.fall_time = 0.0
        for period in range(periods):
            self.now = period * self.period
            if not fallen:
                y, stuck, fallen = self.pass_period(y, stuck)
            if fallen:
                y, stuck = np.concatenate([y[:3], np.zeros(3)]), False
            states.append(y.copy())
            sticking.append(stuck)
        path = np.array(states)
        return Trajectory(
            pose=path[:, :3],
            velocity=path[:, 3:],
            sticking=np.array(sticking),
            fallen=fallen,
            fall_time=self.fall_time,
            switches=np.array(self.switches).reshape(-1, 2),
            error=np.zeros((periods + 1, 3)),
        )

    def pass_period(self, y: np.ndarray, stuck: bool) -> tuple[np.ndarray, bool, bool]:
        t, fresh = 0.0, 0.0
        for _ in range(_RESTARTS):
            if stuck:
                t, y, why = self.stick(y, t, fresh)
            elif self.slips_little(t, y):
                why = "release"  # the direction of slip must be computed first
            else:
                t, y, why = self.slide(y, t)
            if why == "end":
                return y, stuck, False
            if why == "fall":
                self.fall_time = self.now + t
                return y, False, True
            if why == "caught" and self.holds(y, t):
                stuck = True
                self.switches.append((self.now + t, 1.0))
            elif why in ("caught", "release"):
                started = self.break_away(t, y)
                if started is None:
                    # The limit surface was only touched: the part sticks again before it has moved.
                    stuck, fresh = True, t + 0.05 * self.period
                    continue
                if stuck:
                    self.switches.append((self.now + t, 0.0))
                stuck = False
                t, y = started
        raise RuntimeError(f"sticking and sliding alternate without end at {self.now + t:.9g} s")

    def slips_little(self, t: float, y: np.ndarray) -> bool:
        """Return whether slip is below the threshold."""
        return float(np.linalg.norm(self.slip(t, y))) <= self.threshold


def _root(function: Callable[[float], float], low: float, high: float) -> float:
    root: Any = brentq(function, low, high, xtol=1e-15, rtol=np.float64(1e-14))
    return float(root)
