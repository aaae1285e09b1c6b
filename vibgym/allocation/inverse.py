"""Which motion of the elements under a part gives the acceleration that I want? The averaged model turned round.

To first order the mean acceleration is affine in the phasors of the elements under the part: two equations and unknowns on one
element, the phasors of least norm on several. To second order it is quadratic, and Newton's method starts from there.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym._numba.reference import Pinned
from vibgym.physics.averaged.along_way import Inversion, new_room
from vibgym.physics.averaged.contact import AveragedScheme, new_workspace
from vibgym.physics.averaged.correction import correct_worlds, invert_worlds
from vibgym.physics.averaged.inverse import new_kept
from vibgym.physics.averaged.map import instant_states, mean_accelerations, mean_states
from vibgym.physics.core.drive import DRIVE, Drive, polar_drive
from vibgym.physics.core.records import STATE, new_state
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers
from vibgym.simulation.averages_tables import averages
from vibgym.simulation.models import MODELS
from vibgym.simulation.protocol import Setup
from vibgym.simulation.schemes import check_sliding

LARGEST = 1e9
"""Of poses, velocities and accelerations: squares of larger numbers lose what is looked for."""

MOST_CORRECTIONS = 5

POINTS: Mapping[str, tuple[list[float], list[float]]] = {
    "instant": ([0.0], [1.0]),
    "period": ([0.5 - 0.5 / math.sqrt(3.0), 0.5 + 0.5 / math.sqrt(3.0)], [0.5, 0.5]),
}
"""Where in a period the averaged model is asked, and with what weights: Gauss's rule of two points for the period."""


class Allocation(NamedTuple):
    """Motion of the elements and what it does."""

    amplitude: np.ndarray  # (worlds, rows, columns) m, zero away from the part
    phase: np.ndarray  # (worlds, rows, columns) rad
    achieved: np.ndarray  # (worlds, 3) mean acceleration by the averaged model, m/s^2, m/s^2, rad/s^2
    reachable: np.ndarray  # (worlds,) bool: achieved is what was wanted


def phasors_for(surface: Surface, part: Part, pose: Any, velocity: Any, wrench: Any, *, order: int = 2) -> Allocation:
    """Amplitude and phase of the elements under a part that give it a mean acceleration.

    What cannot be reached is cut down by one rule: the change against elements at rest keeps its direction and is scaled until
    the largest amplitude is at the limit. Directions that the elements under the part do not move at all (torque on
    one element) are given up first; the rest is then the nearest in the sense of least squares, with angular acceleration
    times the radius of gyration. ``achieved`` says what is left.

    This is the acceleration at the given state. Within a period it changes as the part moves and gathers speed, by 7 to 20 %
    of what was wanted: those who command period by period take :class:`Inverse`, which also is the faster one.

    Args:
        surface, part: a pair that always slides (:meth:`vibgym.Surface.slides_permanently`).
        pose: broadcastable to (worlds, 3): x, y (m), heading (rad), without the wobble within a period.
        velocity: likewise, m/s and rad/s: the mean velocity, not that of one instant (:func:`mean_state`).
        wrench: likewise, wanted mean acceleration, m/s^2 and rad/s^2 (force and torque over mass and inertia).
        order: of the averaged model, 1 or 2.

    Raises:
        ValueError: a bad argument, a part without support, or a pair that can stick.
    """
    return Inverse(surface, part, order=order, over="instant").phasors(pose, velocity, wrench)


class Inverse:
    """:func:`phasors_for` for one pair, prepared for those who ask again and again.

    Args:
        surface, part: a pair that always slides.
        order: of the averaged model, 1 or 2.
        over: what ``wrench`` is the mean of. ``"instant"``: the acceleration at the given state. ``"period"``: the mean over
            the period that begins there, along the way that the part then takes: the mean velocity changes by ``wrench``
            times the period's length.
        corrections: how many times the planar model plays the period and what it misses is asked for on top; needs
            ``over="period"``. The averaged model leaves out what is of third order in ``mu g / (a_h w^2)``. In the median a
            correction takes four fifths of the error away at a friction of 0.9, and more at smaller ones. It costs a
            simulated period, a little more, and another inverse where elements are at their limit or hardly move the part.
        threads: None uses all processors of this process; results do not depend on it.

    Raises:
        ValueError: a bad argument, or a pair that can stick.
    """

    def __init__(
        self,
        surface: Surface,
        part: Part,
        *,
        order: int = 2,
        over: str = "period",
        corrections: int = 0,
        threads: int | None = None,
    ) -> None:
        _check_pair(surface, part)
        order = checks.count("order", order, most=2)
        checks.choice("over", over, tuple(POINTS))
        corrections = checks.count("corrections", corrections, least=0, most=MOST_CORRECTIONS)
        if corrections and over != "period":
            allowed = "0 with over='instant': the planar model plays whole periods"
            raise checks.refuse("corrections", corrections, allowed)
        self.surface, self.part = surface, part
        self._threads = workers.available_threads() if threads is None else checks.count("threads", threads, most=4096)
        self._tasks = workers.Pool(partial(_inversion, surface, part, order, over, corrections > 0))
        self._elements = self._tasks.lend(lambda task: len(task.room.elements))
        self._corrections = corrections
        self._planar = Periods(surface, part, self._threads) if corrections else None

    def phasors(self, pose: Any, velocity: Any, wrench: Any) -> Allocation:
        """Amplitude and phase of the elements under the part, and what they do.

        With corrections, ``achieved`` is what the averaged model says, less what it was found to say too much, and
        ``reachable`` is False where anything had to be cut down on the way.

        Args:
            pose, velocity, wrench: as for :func:`phasors_for`, at the start of the period.

        Raises:
            ValueError: a bad argument, or a part without support.
        """
        pose, velocity, wrench = _aligned(pose=pose, velocity=velocity, wrench=wrench)
        worlds, full = len(pose), (len(pose), self.surface.rows, self.surface.columns)
        amplitude, phase = np.zeros((worlds, full[1] * full[2])), np.zeros((worlds, full[1] * full[2]))
        achieved, reachable = np.empty((worlds, 3)), np.empty(worlds, dtype=bool)
        kept, offset = new_kept(worlds, self._elements), np.zeros((worlds, 3))
        found = kept, amplitude, phase, achieved, reachable
        self._share(invert_worlds, worlds, pose, velocity, wrench, offset, *found)
        _check_support(pose, np.isnan(achieved[:, 0]))
        result = Allocation(amplitude.reshape(full), phase.reshape(full), achieved, reachable)
        for _ in range(self._corrections):
            assert self._planar is not None
            missing = achieved - self._planar.mean_acceleration(pose, velocity, result.amplitude, result.phase)
            # A part that falls within the period has no mean acceleration: then the averaged model has the last word.
            missing[np.isnan(missing).any(axis=1)] = 0.0
            offset += missing
            self._share(correct_worlds, worlds, pose, velocity, wrench, offset, missing, *found)
        return result

    def _share(self, kernel: Callable[..., None], worlds: int, *arrays: Any) -> None:
        """Let threads share the worlds."""

        def work(start: int, stop: int) -> None:
            self._tasks.lend(lambda task: kernel(start, stop, task, *arrays))

        workers.share(work, worlds, self._threads)


def _inversion(surface: Surface, part: Part, order: int, over: str, kept: bool) -> Inversion:
    """What one thread needs."""
    table, body = surface.table(), part.body()
    points, weights = (np.array(each) for each in POINTS[over])
    room = new_room(table, body, len(points))
    scheme = AveragedScheme(order, 1, 1, averages())
    return Inversion(table, body, scheme, points * table.period, weights, surface.full_scale, kept, room)


class Periods:
    """What the planar model makes of a period that starts from a mean state."""

    def __init__(self, surface: Surface, part: Part, threads: int, **knobs: Any) -> None:
        self._surface, self._threads = surface, threads
        hulls = hulls_of((part,))
        self._model = MODELS["planar"](Setup(surface, (part,), (), hulls, 1), knobs)
        self._table, self._body = surface.table(), part.body()
        self._scheme = AveragedScheme(1, 1, 1, averages())
        self._workspaces = workers.Pool(partial(new_workspace, self._table, self._body))

    def mean_acceleration(
        self, pose: np.ndarray, velocity: np.ndarray, amplitude: np.ndarray, phase: np.ndarray
    ) -> np.ndarray:
        """Change of the mean velocity over the period's length, (worlds, 3); NaN where the part falls."""
        drive = polar_drive(amplitude, phase, self._surface.angular_frequency)
        return self._workspaces.lend(lambda work: self._played(work, drive, pose, velocity))

    def _played(self, work: Any, drive: Drive, pose: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        table, body, scheme = self._table, self._body, self._scheme
        state = new_state(len(pose), 1)
        instant_states(drive, table, body, scheme, pose, velocity, work, state.pose[:, 0], state.velocity[:, 0])
        pinned, held = Pinned(STATE, state), Pinned(DRIVE, drive)
        workers.share(lambda start, stop: self._model.advance(start, stop, held, pinned, 1), len(pose), self._threads)
        after = np.empty_like(pose), np.empty_like(pose)
        mean_states(drive, table, body, scheme, state.pose[:, 0], state.velocity[:, 0], work, *after)
        lost = state.fallen[:, 0] | state.diverged
        return np.where(lost[:, None], np.nan, (after[1] - velocity) / table.period)


def mean_acceleration(
    surface: Surface, part: Part, pose: Any, velocity: Any, amplitude: Any, phase: Any, *, order: int = 2
) -> np.ndarray:
    """Mean acceleration (worlds, 3) by the averaged model under given elements: :func:`phasors_for` the other way round.

    Args:
        surface, part, pose, velocity, order: as for :func:`phasors_for`.
        amplitude, phase: broadcastable to (worlds, rows, columns), m and rad.

    Raises:
        ValueError: as for :func:`phasors_for`.
    """
    order = checks.count("order", order, most=2)
    pose, velocity, drive = _driven(surface, part, pose, velocity, amplitude, phase)
    result = np.empty((len(pose), 3))
    scheme = AveragedScheme(order, 1, 1, averages())
    table, body = surface.table(), part.body()
    mean_accelerations(drive, table, body, scheme, pose, velocity, new_workspace(table, body), result)
    _check_support(pose, np.isnan(result[:, 0]))
    return result


def mean_state(
    surface: Surface, part: Part, pose: Any, velocity: Any, amplitude: Any, phase: Any
) -> tuple[np.ndarray, np.ndarray]:
    """Mean pose and velocity (worlds, 3) that belong to those at the start of a period, under given elements.

    They differ by the wobble within a period: up to ``mu g / w^2`` and ``mu g / w``, and twice that with strong fields.

    Args:
        surface, part: as for :func:`phasors_for`.
        pose, velocity: broadcastable to (worlds, 3), at the start of a period, as the simulator has them.
        amplitude, phase: broadcastable to (worlds, rows, columns), m and rad.

    Raises:
        ValueError: as for :func:`phasors_for`.
    """
    pose, velocity, drive = _driven(surface, part, pose, velocity, amplitude, phase)
    scheme = AveragedScheme(1, 1, 1, averages())
    result = np.empty_like(pose), np.empty_like(pose)
    table, body = surface.table(), part.body()
    mean_states(drive, table, body, scheme, pose, velocity, new_workspace(table, body), *result)
    _check_support(pose, np.isnan(result[0][:, 0]))
    return result


def _driven(
    surface: Surface, part: Part, pose: Any, velocity: Any, amplitude: Any, phase: Any
) -> tuple[np.ndarray, np.ndarray, Drive]:
    """Checked pose, velocity and drive."""
    _check_pair(surface, part)
    pose, velocity = _aligned(pose=pose, velocity=velocity)
    full = (len(pose), surface.rows, surface.columns)
    assert surface.max_amplitude is not None
    amplitude = checks.array("amplitude", amplitude, full, least=0.0, most=surface.max_amplitude * (1.0 + 1e-12))
    phase = checks.array("phase", phase, full)
    drive = polar_drive(amplitude, phase, surface.angular_frequency)
    return pose, velocity, drive


def _check_pair(surface: Any, part: Any) -> None:
    checks.instance("surface", surface, Surface)
    checks.instance("part", part, Part)
    check_sliding(surface, part.static_friction)


def _check_support(pose: np.ndarray, unsupported: np.ndarray) -> None:
    if unsupported.any():
        raise checks.refuse("pose", pose[unsupported][0].tolist(), "poses whose centre of mass the surface supports")


def _aligned(**given: Any) -> list[np.ndarray]:
    """Arrays (worlds, 3); a number or one row stands for all worlds."""
    rows = {}
    for name, value in given.items():
        try:
            rows[name] = np.atleast_2d(np.asarray(value, dtype=np.float64))
        except (TypeError, ValueError, OverflowError, RecursionError):
            raise checks.refuse(name, value, "real numbers of shape (worlds, 3)") from None
        if rows[name].ndim != 2 or rows[name].shape[1] not in (1, 3):
            raise checks.refuse(name, f"array of shape {rows[name].shape}", "shape (worlds, 3)")
    worlds = max(len(each) for each in rows.values())
    return [
        np.ascontiguousarray(checks.array(name, each, (worlds, 3), least=-LARGEST, most=LARGEST))
        for name, each in rows.items()
    ]
