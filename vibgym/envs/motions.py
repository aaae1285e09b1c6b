"""Actions that command the motion of each part: acceleration, velocity, or a pose to go to.

The environment computes the phasors: the frictional process is inverted (:mod:`vibgym.allocation.frictional`), and the pushes
are allocated to the elements under the parts (:mod:`vibgym.allocation.allocator`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs.actions import ACTIONS, Action
from vibgym.kernels.jit import jit
from vibgym.physics.core.drive import Drive, phasor_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement
from vibgym.simulation.plant import plant_of, reached

REASONS = (
    "served", "gone: absent, fallen, or not driven", "its centre is off the surface", "it may stick at this velocity",
    "left out by the action",
)  # fmt: skip
"""Why elements rest under a part, see :class:`Wrench`."""

SERVED, GONE, BESIDE, STICKS, LEFT_OUT = range(len(REASONS))


class Wrench(Action):
    """(parts, 3): mean acceleration of each part, x, y and angular, allocated to the elements under it.

    1 is the acceleration of a part at rest by all elements at full amplitude: ``mu a_v w^2 / 2`` (2.9 m/s^2 on the prototype
    with mu 0.58), divided by the radius of gyration for the third. Friction drag at the measured velocity is compensated
    (:mod:`vibgym.allocation.frictional`), so zeros keep the velocity. Commands beyond the actuator limits are scaled down.
    Parts that share elements are allocated together (:mod:`vibgym.allocation.allocator`), within dead zone and limit of the
    data sheet.

    Elements rest under a part without an allocation; ``info["commanded"]["unserved"]`` (parts,) gives the reason as an index
    of :data:`REASONS`. A subclass excludes parts by :meth:`left_out`.

    Attributes:
        allocator: :class:`vibgym.allocation.Allocator` of the scene.
        scale: (worlds, parts, 3), or one row for all worlds: accelerations of an action of 1, m/s^2, m/s^2, rad/s^2.

    Raises:
        ValueError: a part that can stick to the surface, where averages over a period do not hold.
    """

    by_part = True

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        self.shape = (len(self.parts), 3)
        self.scale = self.parts.values(self._full_push)

    def _full_push(self, part: Part) -> list[float]:
        """Return accelerations by all elements at full amplitude, m/s^2, m/s^2, rad/s^2."""
        push = 0.5 * reached([part])[0] * part.friction * self.full_scale
        return [push, push, push / math.sqrt(part.gyration)]

    def resolve_limits(self, sheet: DataSheet, worlds: int) -> dict[str, np.ndarray]:
        self.allocator = Allocator(self.surface, self.parts, sheet)
        self._process = FrictionalInverse(self.surface, self.parts, limit=sheet.limit, ahead=0.5 * self.surface.period)
        self._unserved = np.zeros((worlds, len(self.parts)), dtype=np.int64)
        self._given = np.zeros((worlds, *self.shape))
        values = np.zeros((worlds, 2 * self.surface.rows * self.surface.columns), dtype=np.float32)
        self._phasors = phasor_drive(values, self.surface.columns, self.full_scale)
        return {"unserved": self._unserved}

    def left_out(self, measurement: Measurement) -> np.ndarray:
        """Return the parts (worlds, parts) bool that are excluded from the allocation; by default none."""
        return np.zeros_like(measurement.gone)

    def acceleration(self, values: np.ndarray, velocity: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the wanted mean accelerations (worlds, parts, 3) in the step, m/s^2 and rad/s^2.

        Args:
            values: (worlds, parts, 3) of the action.
            velocity: (worlds, parts, 3) at the start of the step, m/s and rad/s.
            pose: (worlds, parts, 3) measured, m, m, rad.
        """
        return values * self.scale

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the action, not clipped, whose wanted accelerations these are: the inverse of :meth:`acceleration`."""
        return acceleration / self.scale

    def live(self) -> dict[str, np.ndarray]:
        return {"given": self._given, "unserved": self._unserved}

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        # A mean velocity is half a period old.
        velocity = measurement.mean_velocity + 0.5 * self.surface.period * self._given
        wanted = self.acceleration(values.reshape(-1, *self.shape), velocity, measurement.pose)
        push, acceleration, holds = self._process.push(velocity, wanted)
        pose = measurement.pose
        x, y = pose[..., 0], pose[..., 1]
        outside = (x < 0.0) | (y < 0.0) | (x > self.surface.width) | (y > self.surface.depth)
        reasons = [measurement.gone, outside, ~holds, self.left_out(measurement)]
        self._unserved[...] = np.select(reasons, [GONE, BESIDE, STICKS, LEFT_OUT], SERVED)
        served = self._unserved == SERVED
        self._given[...] = np.where(served[..., None], acceleration, 0.0)
        self.allocator.actions(pose, served, np.where(served[..., None], push, 0.0), out=self._phasors.values)
        return self._phasors


TOP_SHARE = 5.0 / 6.0
"""Speed of an action of 1 over the table's: 0.35 m/s on the prototype, where parts reach 0.30 m/s."""


class Velocity(Wrench):
    """(parts, 3): mean velocity of each part at the end of the step, x, y and spin, allocated to the elements under it.

    A value ``a`` commands ``sign(a) a^2`` times :attr:`top`: 5/6 of the table's speed (0.35 m/s on the prototype, above the
    speed that parts reach), divided by the radius of gyration for the third. The square makes small velocities finer; 0 stops
    a part. The acceleration is that of :class:`Wrench` which changes the measured velocity to the commanded one within the
    step, as far as actuator limits permit.

    Attributes:
        top: (worlds, parts, 3), or one row for all worlds: velocities of an action of 1, m/s, m/s, rad/s.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part]) -> None:
        super().__init__(surface, parts)
        speed = TOP_SHARE * surface.table_speed
        self.top = self.parts.values(lambda part: [speed, speed, speed / math.sqrt(part.gyration)])

    def acceleration(self, values: np.ndarray, velocity: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.acceleration`."""
        return (values * np.abs(values) * self.top - velocity) / self.step_time

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.values`."""
        share = (velocity + self.step_time * acceleration) / self.top
        return np.sign(share) * np.sqrt(np.abs(share))


REACH, TURN_REACH = 0.12, 0.5 * math.pi
"""Displacement (m) and turn (rad) of an action of 1 of :class:`Target`."""

BRAKING, TURN_BRAKING = 0.8, 0.5
"""Share of the push near rest that is used for braking. Elements under a part turn it with less than they move it."""

APPROACH = 0.8
"""Largest share of the way left that a part covers in a step; more would overshoot."""

ITERATIONS = 4
"""Iterations of the speed at the end of a step; each halves its error."""


class Target(Velocity):
    """(parts, 3): pose of each part relative to the measured one, x, y and heading, reached along a braking curve.

    A value ``a`` commands ``sign(a) a^2`` times 0.12 m, or 90 degrees. A part gets the acceleration that puts it on the curve
    from which it can just stop at the target, at most at the speed of :class:`Velocity`; 0 stops it.

    A target beyond a border of the surface is moved inside, to :attr:`margin` from it. This is no error, since policies that
    explore command such targets near a border; ``info["commanded"]["moved"]`` (parts, 2) has the displacement, m, zeros for
    targets inside.

    Attributes:
        reach: (3,) displacements and turn of an action of 1, m, m, rad.
        margin: m, least distance of a target from the borders: twice the table's horizontal amplitude.
    """

    reach = np.array([REACH, REACH, TURN_REACH])

    def resolve_limits(self, sheet: DataSheet, worlds: int) -> dict[str, np.ndarray]:
        # The border moves with the table, so that a centre of mass on it would be without support now and then.
        self.margin = 2.0 * self.surface.horizontal_amplitude
        strength = strongest(self.surface, sheet)

        def braking(part: Part) -> list[float]:
            plant = plant_of(self.surface, [part], strength)
            return [BRAKING * plant.push[0], BRAKING * plant.push[0], TURN_BRAKING * plant.turn_push[0]]

        self._braking = self.parts.values(braking)
        self._moved = np.zeros((worlds, len(self.parts), 2))
        return {**super().resolve_limits(sheet, worlds), "moved": self._moved}

    def live(self) -> dict[str, np.ndarray]:
        return {**super().live(), "moved": self._moved}

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        _, moved = self._inside(values.reshape(-1, *self.shape), measurement.pose)
        self._moved[...] = np.where(measurement.gone[..., None], 0.0, moved)
        return super().command(values, measurement)

    def acceleration(self, values: np.ndarray, velocity: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.acceleration`."""
        offset, _ = self._inside(values, pose)
        displacement, direction = _polar(offset)
        return (self._speed(displacement, _towards(velocity, direction)) * direction - velocity) / self.step_time

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.values`."""
        speed, direction = _polar(velocity + self.step_time * acceleration)
        now = _towards(velocity, direction)
        left = np.maximum(speed**2 / (2.0 * self._braking), speed * self.step_time / APPROACH)
        displacement = np.maximum(left + 0.5 * self.step_time * (now + speed), 0.0)
        offset = displacement * direction / self.reach
        return np.sign(offset) * np.sqrt(np.abs(offset))

    def _inside(self, values: np.ndarray, pose: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return displacements and turns (worlds, parts, 3) to the targets, and how far (..., 2) m they are moved inside."""
        offset = values * np.abs(values) * self.reach
        wanted = pose[..., :2] + offset[..., :2]
        inside = np.clip(wanted, self.margin, np.array([self.surface.width, self.surface.depth]) - self.margin)
        offset[..., :2] = inside - pose[..., :2]
        return offset, inside - wanted

    def _speed(self, displacement: np.ndarray, now: np.ndarray) -> np.ndarray:
        """Return speeds (worlds, parts, 3) towards the targets at the end of the step: ``v = curve(x - T (now + v) / 2)``."""
        speed = np.empty_like(displacement)
        brake(displacement, now, self._braking, self.top, self.step_time, speed)
        return speed


@jit
def brake(displacement, now, braking, top, step, speed):
    """Compute ``speed``, see :meth:`Target._speed`."""
    for w in range(displacement.shape[0]):
        row = min(w, top.shape[0] - 1)
        for p in range(displacement.shape[1]):
            for k in range(3):
                v = now[w, p, k]
                for iteration in range(ITERATIONS):
                    left = max(displacement[w, p, k] - 0.5 * step * (now[w, p, k] + v), 0.0)
                    allowed = min(math.sqrt(2.0 * braking[row, p, k] * left), APPROACH / step * left)
                    v = allowed if iteration == 0 else 0.5 * (v + allowed)
                speed[w, p, k] = min(v, top[row, p, k])


def _polar(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return length and direction (..., 3) of vectors (x, y), twice the same length, and of headings."""
    length = np.abs(vector)
    length[..., :2] = np.hypot(vector[..., 0], vector[..., 1])[..., None]
    return length, vector / np.maximum(length, 1e-300)


def _towards(velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the components (..., 3) of velocities in these directions, as :func:`_polar` has them."""
    along = velocity * direction
    along[..., :2] = along[..., :2].sum(axis=-1, keepdims=True)
    return along


MOTIONS: dict[str, type[Wrench]] = {"wrench": Wrench, "velocity": Velocity, "target": Target}
"""The actions of this module by name."""

for _name, _action in MOTIONS.items():
    ACTIONS.register(_name, _action)
