"""Hard cases: their registry, scenes and the motion of the planar model, and comparison with the independent reference."""

from __future__ import annotations

import functools
import math
import threading
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from studies.accuracy.reference import Trajectory, integrate
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.simulator import Simulator

LONGEST = 900.0
"""s; guard against hangs only. The slowest case takes 7 s with compiled kernels."""

FINE: dict[str, Any] = {"steps": 100, "substeps": 2, "pieces": 4}
"""Knobs at which second order leaves 1/400 of the default's error in time, and 1/16 of it in space."""

DEFAULT_BOUND = 2.5e-4
"""m; a tenth of the table's amplitude, a fifth of a pixel of the prototype's camera."""

FINE_BOUND = 1e-6
"""m; the default's bound scaled by second order from 5 to 100 steps, with a margin."""


class Outcome(NamedTuple):
    """Result of a case."""

    measured: float  # in ``unit``
    bound: float  # the case passes if measured <= bound, unless ``note`` states another relation
    unit: str
    passed: bool  # whether the case passes
    note: str = ""  # conditions and further numbers


class HardCase(NamedTuple):
    """A named check; ``question`` states in one sentence what could go wrong."""

    name: str
    question: str
    run: Callable[[], Outcome]


CASES: list[HardCase] = []
"""All cases, in the order of their definition."""


def case(name: str, question: str, *arguments: tuple) -> Callable[[Callable[..., Outcome]], Callable[..., Outcome]]:
    """Return a decorator that registers a check, once for each tuple of ``arguments``, with which ``name`` is formatted."""

    def register(check: Callable[..., Outcome]) -> Callable[..., Outcome]:
        for values in arguments or [()]:
            CASES.append(HardCase(name.format(*values), question, functools.partial(check, *values)))
        return check

    return register


def at_most(measured: float, bound: float, unit: str, note: str = "") -> Outcome:
    """Return an outcome that passes if ``measured <= bound``; NaN never passes."""
    measured = float(measured)
    return Outcome(measured, bound, unit, bool(measured <= bound), note)


def run_case(case: HardCase, longest: float = LONGEST) -> Outcome:
    """Run a case; an exception or a hang is a failed outcome whose note names it.

    Args:
        case: to run.
        longest: s after which the case counts as hung; its thread is a daemon.
    """
    outcomes: list[Outcome] = []

    def work() -> None:
        try:
            outcomes.append(case.run())
        except Exception as error:
            outcomes.append(Outcome(math.nan, math.nan, "", False, f"{type(error).__name__}: {error}"))

    thread = threading.Thread(target=work, name=case.name, daemon=True)
    thread.start()
    thread.join(longest)
    return outcomes[0] if outcomes else Outcome(math.inf, longest, "s", False, f"did not end within {longest:g} s")


class Scene(NamedTuple):
    """A part on a surface with initial ``pose`` (3,) and ``velocity`` (3,), under a held drive."""

    surface: Surface
    part: Part
    pose: Any
    velocity: Any
    amplitude: Any
    phase: Any
    periods: int


class Path(NamedTuple):
    """State at the boundaries of the periods: pose and velocity (periods + 1, 3), flags (periods + 1,)."""

    pose: np.ndarray
    velocity: np.ndarray
    sticking: np.ndarray
    fallen: np.ndarray


def sound(sim: Simulator) -> None:
    """Check that a simulator's state is finite, as ``max`` over errors would skip a NaN.

    Raises:
        ArithmeticError: a number is not finite, or a world diverged.
    """
    finite = all(np.isfinite(array).all() for array in (sim.pose, sim.velocity, sim.mean_velocity))
    if sim.diverged.any() or not finite:
        raise ArithmeticError(f"diverged or not finite at {sim.time:g} s")


def follow(scene: Scene, **knobs: Any) -> Path:
    """Return the planar model's motion, period by period.

    Raises:
        ArithmeticError: a number is not finite, or the world diverged.
    """
    sim = Simulator(scene.surface, scene.part, **knobs)
    sim.reset(scene.pose, scene.velocity)
    states = [(sim.pose[0, 0], sim.velocity[0, 0], False, False)]
    for _ in range(scene.periods):
        sim.advance(scene.amplitude, scene.phase)
        states.append((sim.pose[0, 0], sim.velocity[0, 0], bool(sim.sticking[0, 0]), bool(sim.fallen[0, 0])))
        sound(sim)
    return Path(*(np.array(series) for series in zip(*states, strict=True)))


def exactly(scene: Scene) -> Trajectory:
    """Return the motion by the independent reference."""
    return integrate(*scene, tolerance=1e-8, estimate=False)


def gap(part: Part, one: np.ndarray, other: np.ndarray) -> float:
    """Return the largest distance (m) between the same point of a part at poses (..., 3): shift, and turn times radius."""
    apart = np.asarray(one) - np.asarray(other)
    return float((np.hypot(apart[..., 0], apart[..., 1]) + part.radius * np.abs(apart[..., 2])).max())


def against_reference(
    name: str, question: str, make: Callable[[], Scene], pieces: int = FINE["pieces"]
) -> tuple[HardCase, HardCase]:
    """Return two cases on one scene: with default knobs, and with fine ones and ``pieces``."""

    @functools.cache
    def both() -> tuple[Scene, Trajectory]:
        scene = make()
        return scene, exactly(scene)

    def run(knobs: dict[str, Any], bound: float) -> Outcome:
        scene, exact = both()
        path = follow(scene, **knobs)
        way = np.hypot(*np.diff(exact.pose[:, :2], axis=0).T).sum()
        turn = np.abs(exact.pose[-1, 2] - exact.pose[0, 2])
        if path.fallen[-1] != exact.fallen or path.sticking[-1] != exact.sticking[-1]:
            raise ArithmeticError(
                f"sticking, fallen {path.sticking[-1]}, {path.fallen[-1]}; reference {exact.sticking[-1]}, "
                f"{exact.fallen}",
            )
        note = f"farthest point; way {1e3 * way:.3g} mm, turn {turn:.3g} rad"
        return at_most(gap(scene.part, path.pose, exact.pose), bound, "m", note)

    return (
        HardCase(name, question, lambda: run({}, DEFAULT_BOUND)),
        HardCase(f"{name}, fine steps", question, lambda: run({**FINE, "pieces": pieces}, FINE_BOUND)),
    )


def block(friction: float = 0.6, static: float | None = None, **properties: Any) -> Part:
    """Return a block of 50 x 35 mm."""
    return Part.rectangle(0.05, 0.035, friction=friction, static_friction=static, **properties)


def one_element(size: float = 2.0, **properties: Any) -> Surface:
    """Return a surface of a single large element: the same pressure at any position."""
    return Surface(rows=1, columns=1, element_size=size, **properties)


def threshold(friction: float, frequency: float = 25.0, gravity: float = 9.81) -> float:
    """Return the horizontal amplitude (m) at which ``a_h w^2 = friction g``."""
    return friction * gravity / (2.0 * math.pi * frequency) ** 2


def table_velocity(surface: Surface) -> list[float]:
    """Return the table's velocity at the start of a period."""
    return [0.0, surface.table_speed, 0.0]


def random_drive(surface: Surface, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return amplitude and phase (rows, columns), uniform over their ranges."""
    rng = np.random.default_rng(seed)
    shape = (surface.rows, surface.columns)
    return rng.uniform(0.0, surface.lift_off_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
