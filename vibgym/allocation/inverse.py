"""Which motion of the elements under a part gives the acceleration that I want? The averaged model turned round.

To first order the mean acceleration is affine in the phasors of the elements under the part: two equations and unknowns on one
element, the phasors of least norm on several. To second order it is quadratic, and Newton's method starts from there.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.averaged.contact import AveragedScheme, new_workspace
from vibgym.physics.averaged.map import acceleration_map, elements_under, mean_accelerations, mean_states
from vibgym.physics.core.drive import Drive, polar_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.averages_tables import averages
from vibgym.simulation.schemes import check_sliding

LARGEST = 1e9
"""Of poses, velocities and accelerations: squares of larger numbers lose what is looked for."""

ITERATIONS = 12
SCALINGS = 20
CLOSE = 1e-12  # error of the solution, over mu g
REACHED = 1e-10
WEAKEST = 1e-12
"""Directions of acceleration that phasors move less than 1e-6 as strongly as the best one (squared) count as out of reach."""


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

    Args:
        surface, part: a pair that always slides (:meth:`vibgym.Surface.slides_permanently`).
        pose: broadcastable to (worlds, 3): x, y (m), heading (rad), without the wobble within a period.
        velocity: likewise, m/s and rad/s: the mean velocity, not that of one instant (:func:`mean_state`).
        wrench: likewise, wanted mean acceleration, m/s^2 and rad/s^2 (force and torque over mass and inertia).
        order: of the averaged model, 1 or 2.

    Raises:
        ValueError: a bad argument, a part without support, or a pair that can stick.
    """
    _check_pair(surface, part)
    order = checks.count("order", order, most=2)
    pose, velocity, wrench = _aligned(pose=pose, velocity=velocity, wrench=wrench)
    worlds = len(pose)
    table, body = surface.table(), part.body()
    scheme = AveragedScheme(order, 1, 1, averages())
    work = new_workspace(table, body)
    elements = np.empty((worlds, surface.rows * surface.columns), dtype=np.int64)
    most = elements_under(table, body, pose, velocity, work, elements)
    _check_support(pose, elements[:, 0] < 0)
    elements = np.ascontiguousarray(elements[:, :most])
    constant, linear = np.zeros((worlds, 3)), np.zeros((worlds, 3, 2 * most))
    shares, coupling = np.zeros((worlds, 6, most)), np.zeros((worlds, 3, 18, 18))
    acceleration_map(table, body, scheme, pose, velocity, elements, work, constant, linear, shares, coupling)

    # Angular acceleration times radius of gyration: one unit for all rows, and kinetic energy for least squares.
    lever = np.array([1.0, 1.0, np.sqrt(body.gyration)])
    solver = _Solver(constant * lever, linear * lever[:, None], shares, coupling * lever[:, None, None])
    size = body.friction * surface.gravity
    limit = surface.full_scale
    idle = solver.value(np.zeros((worlds, 2 * most)))
    change = wrench * lever - idle
    scale = np.ones(worlds)
    phasors = np.zeros((worlds, 2 * most))
    for _ in range(SCALINGS):
        phasors = solver.solve(idle + scale[:, None] * change, CLOSE * size)
        over = _largest(phasors) / limit if limit > 0.0 else np.where(_largest(phasors) > 0.0, np.inf, 0.0)
        if (over <= 1.0 + 1e-6).all():
            break
        scale = scale / np.maximum(over, 1.0)
    phasors = phasors * np.minimum(1.0, limit / np.maximum(_largest(phasors), 1e-300))[:, None]
    achieved = solver.value(phasors)
    reachable = np.abs(achieved - wrench * lever).max(axis=1) <= REACHED * size

    c, s = phasors[:, :most], phasors[:, most:]
    shape = (worlds, surface.rows * surface.columns)
    amplitude, phase = np.zeros(shape), np.zeros(shape)
    world, place = np.nonzero(elements >= 0)
    element = elements[world, place]
    assert surface.max_amplitude is not None
    normal = np.hypot(c, s)[world, place] / surface.angular_frequency**2
    amplitude[world, element] = np.minimum(normal, surface.max_amplitude)
    phase[world, element] = np.arctan2(s, c)[world, place]
    full = (worlds, surface.rows, surface.columns)
    return Allocation(amplitude.reshape(full), phase.reshape(full), achieved / lever, reachable)


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


def _largest(phasors: np.ndarray) -> np.ndarray:
    c, s = np.split(phasors, 2, axis=1)
    return np.hypot(c, s).max(axis=1)


class _Solver:
    """``constant + linear p + m B m`` of every world, and its inverse."""

    def __init__(self, constant: np.ndarray, linear: np.ndarray, shares: np.ndarray, coupling: np.ndarray) -> None:
        self._constant, self._linear, self._shares, self._coupling = constant, linear, shares, coupling

    def _moments(self, phasors: np.ndarray) -> np.ndarray:
        c, s = np.split(phasors, 2, axis=1)
        load = self._shares.sum(axis=2)
        return np.concatenate(
            [load, np.einsum("wij,wj->wi", self._shares, c), np.einsum("wij,wj->wi", self._shares, s)], axis=1
        )

    def value(self, phasors: np.ndarray) -> np.ndarray:
        """Acceleration (worlds, 3)."""
        moments = self._moments(phasors)
        second = np.einsum("wi,waij,wj->wa", moments, self._coupling, moments)
        return self._constant + np.einsum("waj,wj->wa", self._linear, phasors) + second

    def _slope(self, phasors: np.ndarray) -> np.ndarray:
        by_moment = 2.0 * np.einsum("waij,wj->wai", self._coupling, self._moments(phasors))
        by_c = np.einsum("wai,wij->waj", by_moment[:, :, 6:12], self._shares)
        by_s = np.einsum("wai,wij->waj", by_moment[:, :, 12:], self._shares)
        return self._linear + np.concatenate([by_c, by_s], axis=2)

    def solve(self, wanted: np.ndarray, close: float) -> np.ndarray:
        """Phasors by Newton's method from rest; each step is the one of least norm."""
        phasors = np.zeros((len(wanted), self._linear.shape[2]))
        for _ in range(ITERATIONS):
            slope = self._slope(phasors)
            left = wanted - self.value(phasors)
            inverse = np.linalg.pinv(slope @ slope.transpose(0, 2, 1), rcond=WEAKEST, hermitian=True)
            step = np.einsum("waj,wa->wj", slope, np.einsum("wab,wb->wa", inverse, left))
            phasors = phasors + step
            moved = np.einsum("waj,wj->wa", slope, step)
            if np.abs(moved).max(initial=0.0) <= close:
                break
        return phasors
