"""Actions that command the motion of each part: acceleration, velocity, or a pose to go to.

One kernel computes the phasors, world by world: values are decoded to wanted accelerations, the frictional process is inverted
(:mod:`vibgym.allocation.frictional`), and the pushes are allocated to the elements under the parts
(:mod:`vibgym.allocation.projections`).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.allocation.frictional import FrictionalInverse, InverseParameters, invert_ahead
from vibgym.allocation.projections import Problem, Scratch, allocate_world, new_scratch
from vibgym.envs.actions import ACTIONS, Action
from vibgym.kernels.jit import exact, jit
from vibgym.kernels.reference import Layout, Pinned
from vibgym.physics.averaged import averages
from vibgym.physics.core.drive import Drive, phasor_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing import Measurement
from vibgym.simulation import threads as workers
from vibgym.simulation.plant import plant_of, reached

REASONS = (
    "served", "gone: absent, fallen, or not driven", "its centre is off the surface", "it may stick at this velocity",
    "left out by the action",
)  # fmt: skip
"""Why elements rest under a part, see :class:`Wrench`."""

SERVED, GONE, BESIDE, STICKS, LEFT_OUT = range(len(REASONS))

WRENCH, VELOCITY, TARGET, CUSTOM = range(4)
"""Forms of an action: that of a class below, or accelerations that a subclass computes in Python."""

TOP_SHARE = 5.0 / 6.0
"""Speed of an action of 1 over the table's: 0.35 m/s on the prototype, where parts reach 0.30 m/s."""

REACH, TURN_REACH = 0.12, 0.5 * math.pi
"""Displacement (m) and turn (rad) of an action of 1 of :class:`Target`."""

BRAKING, TURN_BRAKING = 0.8, 0.5
"""Share of the push near rest that is used for braking. Elements under a part turn it with less than they move it."""

APPROACH = 0.8
"""Largest share of the way left that a part covers in a step; more would overshoot."""

ITERATIONS = 4
"""Iterations of the speed at the end of a step; each halves its error."""

PART_COST, DEAD_ZONE_COST = 0.9, 4.0
"""us of :func:`command_worlds` for a part, and for a part on elements with a hard dead zone."""

TINY = 1e-300  # replaces a length of zero in divisions


class Wrench(Action):
    """(parts, 3): mean acceleration of each part, x, y and angular, allocated to the elements under it.

    1 is the acceleration of a part at rest by all elements at full amplitude: ``mu a_v w^2 / 2`` (2.9 m/s^2 on the prototype
    with mu 0.58), divided by the radius of gyration for the third. Friction drag at the measured velocity is compensated
    (:mod:`vibgym.allocation.frictional`), so zeros keep the velocity. Commands beyond the actuator limits are scaled down.
    Parts that share elements are allocated together (:mod:`vibgym.allocation.allocator`), within dead zone and limit of the
    data sheet.

    Elements rest under a part without an allocation; ``info["commanded"]["unserved"]`` (parts,) gives the reason as an index
    of :data:`REASONS`. A subclass may exclude parts by :meth:`left_out`, and override :meth:`acceleration`.

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
        surface, shape, own = self.surface, (worlds, len(self.parts)), type(self)
        self.allocator = Allocator(surface, self.parts, sheet)
        process = FrictionalInverse(surface, self.parts, limit=sheet.limit, ahead=0.5 * surface.period)
        phasors = np.zeros((worlds, 2 * surface.rows * surface.columns), dtype=np.float32)
        self._phasors = phasor_drive(phasors, surface.columns, self.full_scale)
        decoding = self._new_decoding(sheet)
        self._decoding = Pinned(DECODING, decoding)
        # Methods that a subclass overrides are called before the kernel.
        self._custom_acceleration = own.acceleration is not Wrench.acceleration
        self._custom_left_out = own.left_out is not Wrench.left_out
        self._motion = Pinned(MOTION, Motion(
            decoding._replace(form=CUSTOM) if self._custom_acceleration else decoding, process.parameters,
            self.allocator.problem, surface.width, surface.depth, lag=0.5 * surface.period,
            wanted=np.zeros((*shape, 3)), left_out=np.zeros(shape, dtype=bool), given=np.zeros((*shape, 3)),
            unserved=np.zeros(shape, dtype=np.int64), moved=np.zeros((*shape, 2)), phasors=phasors,
        ))  # fmt: skip
        cost = len(self.parts) * (DEAD_ZONE_COST if self.allocator.least > 0.0 else PART_COST)
        self._blocks = workers.Blocks(worlds, workers.available_threads(), cost)
        self._works = [Pinned(WORK, new_work(surface, self.parts)) for _ in self._blocks.edges]
        return {"unserved": self._motion.record.unserved}

    def _new_decoding(self, sheet: DataSheet) -> Decoding:
        """Return the meaning of the values."""
        return Decoding(WRENCH, self.step_time, self.scale)

    def left_out(self, measurement: Measurement) -> np.ndarray:
        """Return the parts (worlds, parts) bool that are excluded from the allocation; by default none."""
        return np.zeros_like(measurement.gone)

    def acceleration(self, values: np.ndarray, velocity: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Return the wanted mean accelerations (worlds, parts, 3) in the step, m/s^2 and rad/s^2.

        Args:
            values: (worlds, parts, 3) of the action, in [-1, 1].
            velocity: (worlds, parts, 3) at the start of the step, m/s and rad/s.
            pose: (worlds, parts, 3) measured, m, m, rad.
        """
        values, wanted = np.ascontiguousarray(values, dtype=np.float32), np.empty(velocity.shape)
        velocity, pose = np.ascontiguousarray(velocity), np.ascontiguousarray(pose)
        decode_batch(self._decoding.address, values, velocity, pose, wanted, np.empty(2))
        return wanted

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """Return the action, not clipped, whose wanted accelerations these are: the inverse of :meth:`acceleration`."""
        return acceleration / self.scale

    def live(self) -> dict[str, np.ndarray]:
        return {"given": self._motion.record.given, "unserved": self._motion.record.unserved}

    def command(self, values: np.ndarray, measurement: Measurement) -> Drive:
        motion, address, edges, works = self._motion.record, self._motion.address, self._blocks.edges, self._works
        pose, mean_velocity, gone = measured = measurement[:3]
        if self._custom_acceleration:
            velocity, shape = mean_velocity + motion.lag * motion.given, (len(gone), *self.shape)
            motion.wanted[...] = self.acceleration(np.clip(values, -1.0, 1.0).reshape(shape), velocity, pose)
        if self._custom_left_out:
            motion.left_out[...] = self.left_out(measurement)
        self._blocks.run(lambda k: command_worlds(*edges[k], works[k].address, address, values, *measured))
        return self._phasors


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

    def _new_decoding(self, sheet: DataSheet) -> Decoding:
        return super()._new_decoding(sheet)._replace(form=VELOCITY, top=self.top)

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.values`."""
        share = (velocity + self.step_time * acceleration) / self.top
        return np.sign(share) * np.sqrt(np.abs(share))


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
        return {**super().resolve_limits(sheet, worlds), "moved": self._motion.record.moved}

    def _new_decoding(self, sheet: DataSheet) -> Decoding:
        surface, strength = self.surface, strongest(self.surface, sheet)
        # The border moves with the table, so that a centre of mass on it would be without support now and then.
        self.margin = 2.0 * surface.horizontal_amplitude

        def braking(part: Part) -> list[float]:
            plant = plant_of(surface, [part], strength)
            return [BRAKING * plant.push[0], BRAKING * plant.push[0], TURN_BRAKING * plant.turn_push[0]]

        self._braking, last = self.parts.values(braking), np.array([surface.width, surface.depth]) - self.margin
        velocity = super()._new_decoding(sheet)
        return velocity._replace(form=TARGET, braking=self._braking, reach=self.reach, first=self.margin, last=last)

    def live(self) -> dict[str, np.ndarray]:
        return {**super().live(), "moved": self._motion.record.moved}

    def values(self, acceleration: np.ndarray, velocity: np.ndarray) -> np.ndarray:
        """See :meth:`Wrench.values`."""
        speed, direction = _polar(velocity + self.step_time * acceleration)
        now = _towards(velocity, direction)
        left = np.maximum(speed**2 / (2.0 * self._braking), speed * self.step_time / APPROACH)
        displacement = np.maximum(left + 0.5 * self.step_time * (now + speed), 0.0)
        offset = displacement * direction / self.reach
        return np.sign(offset) * np.sqrt(np.abs(offset))


def _polar(vector: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return length and direction (..., 3) of vectors (x, y), twice the same length, and of headings."""
    length = np.abs(vector)
    length[..., :2] = np.hypot(vector[..., 0], vector[..., 1])[..., None]
    return length, vector / np.maximum(length, TINY)


def _towards(velocity: np.ndarray, direction: np.ndarray) -> np.ndarray:
    """Return the components (..., 3) of velocities in these directions, as :func:`_polar` has them."""
    along = velocity * direction
    along[..., :2] = along[..., :2].sum(axis=-1, keepdims=True)
    return along


MOTIONS: dict[str, type[Wrench]] = {"wrench": Wrench, "velocity": Velocity, "target": Target}
"""The actions of this module by name."""

for _name, _action in MOTIONS.items():
    ACTIONS.register(_name, _action)


# -- from values to phasors -----------------------------------------------------------------------------------------------


class Decoding(NamedTuple):
    """Meaning of the values of an action. Arrays (rows, parts, 3) have a row per world, or one for all worlds."""

    form: int  # WRENCH, ...
    time: float  # s, of a step
    scale: np.ndarray  # (rows, parts, 3) see Wrench
    top: np.ndarray = np.zeros((0, 0, 3))  # (rows, parts, 3) see Velocity
    braking: np.ndarray = np.zeros((0, 0, 3))  # (rows, parts, 3) of Target, m/s^2, m/s^2, rad/s^2
    reach: np.ndarray = np.zeros(0)  # (3,) see Target
    first: float = 0.0  # m, least x and y of targets
    last: np.ndarray = np.zeros(0)  # (2,) m, largest x and y of targets


class Motion(NamedTuple):
    """An action and its scene; arrays are live."""

    decoding: Decoding
    process: InverseParameters
    problem: Problem
    width: float  # m, of the surface
    depth: float
    lag: float  # s, by which a mean velocity is older than the step
    wanted: np.ndarray  # (worlds, parts, 3) accelerations, m/s^2, m/s^2, rad/s^2
    left_out: np.ndarray  # (worlds, parts) bool
    given: np.ndarray  # (worlds, parts, 3) accelerations that the pushes of the last step give
    unserved: np.ndarray  # (worlds, parts) int64, among REASONS
    moved: np.ndarray  # (worlds, parts, 2) m, by which targets are moved inside the borders
    phasors: np.ndarray  # (worlds, 2 elements) float32


class Work(NamedTuple):
    """Scratch of a block of worlds."""

    averages: averages.Scratch
    allocation: Scratch
    velocity: np.ndarray  # (3,) of a part at the start of the step, m/s, m/s, rad/s
    later: np.ndarray  # (3,) later in the step
    push: np.ndarray  # (parts, 3)
    served: np.ndarray  # (parts,) bool


def new_work(surface: Surface, parts: Sequence[Part]) -> Work:
    """Allocate scratch memory."""
    pushes, served = np.zeros((len(parts), 3)), np.zeros(len(parts), dtype=bool)
    return Work(averages.new_scratch(), new_scratch(surface, parts), np.zeros(3), np.zeros(3), pushes, served)


DECODING: Layout[Decoding] = Layout("DECODING", __name__)
MOTION: Layout[Motion] = Layout("MOTION", __name__)
WORK: Layout[Work] = Layout("WORK", __name__)
decoding_at, motion_at, work_at = DECODING.at, MOTION.at, WORK.at


@exact
def clipped(value):
    """Return a float32 number of at most 1 in magnitude."""
    return min(max(value, np.float32(-1.0)), np.float32(1.0))


@exact
def squared(value):
    """Return ``sign(a) a^2`` of a clipped value ``a``: small motions are finer."""
    return clipped(value) * abs(clipped(value))


@jit
def brake(displacement, now, braking, top, time):
    """Return the speed towards a target at the end of a step: ``v = curve(x - T (now + v) / 2)``."""
    v = now
    for iteration in range(ITERATIONS):
        left = max(displacement - 0.5 * time * (now + v), 0.0)
        allowed = min(math.sqrt(2.0 * braking * left), APPROACH / time * left)
        v = allowed if iteration == 0 else 0.5 * (v + allowed)
    return min(v, top)


@exact
def approach(decoding, row, part, values, velocity, pose, wanted, moved):
    """Compute the acceleration onto the braking curve to a target, and how far the target is moved; see :func:`decode`."""
    braking, top, time = decoding.braking[row, part], decoding.top[row, part], decoding.time
    for k in range(2):
        target = pose[k] + squared(values[k]) * decoding.reach[k]
        inside = min(max(target, decoding.first), decoding.last[k])
        wanted[k], moved[k] = inside - pose[k], inside - target
    way, turn = math.hypot(wanted[0], wanted[1]), squared(values[2]) * decoding.reach[2]
    x, y, side = wanted[0] / max(way, TINY), wanted[1] / max(way, TINY), turn / max(abs(turn), TINY)
    speed = brake(way, velocity[0] * x + velocity[1] * y, braking[0], top[0], time)
    spin = brake(abs(turn), velocity[2] * side, braking[2], top[2], time)
    wanted[0], wanted[1] = (speed * x - velocity[0]) / time, (speed * y - velocity[1]) / time
    wanted[2] = (spin * side - velocity[2]) / time


@exact
def decode(decoding, row, part, values, velocity, pose, wanted, moved):
    """Compute the wanted mean acceleration of a part in the step.

    Args:
        decoding: reference to a :class:`Decoding`.
        row: of its arrays.
        values: (3,) of the part's action.
        velocity: (3,) at the start of the step, m/s, m/s, rad/s.
        pose: (3,) measured, m, m, rad.
        wanted: (3,), overwritten, m/s^2, m/s^2, rad/s^2.
        moved: (2,), overwritten by :class:`Target`, see :class:`Motion`.
    """
    if decoding.form == WRENCH:
        for k in range(3):
            wanted[k] = clipped(values[k]) * decoding.scale[row, part, k]
    elif decoding.form == VELOCITY:
        for k in range(3):
            wanted[k] = (squared(values[k]) * decoding.top[row, part, k] - velocity[k]) / decoding.time
    elif decoding.form == TARGET:
        approach(decoding, row, part, values, velocity, pose, wanted, moved)


@jit
def decode_batch(decoding, values, velocity, pose, wanted, moved):
    """Compute wanted accelerations (batch, parts, 3), see :meth:`Wrench.acceleration`; ``decoding`` is an address."""
    decoding = decoding_at(decoding)
    for i in range(values.shape[0]):
        row = min(i, decoding.scale.shape[0] - 1)
        for p in range(values.shape[1]):
            decode(decoding, row, p, values[i, p], velocity[i, p], pose[i, p], wanted[i, p], moved)


@exact
def command_worlds(start, stop, work, motion, values, pose, mean_velocity, gone):
    """Compute the phasors of worlds ``start`` to ``stop``, the accelerations that they give, and which parts get none.

    Args:
        work, motion: addresses of a pinned :class:`Work` and :class:`Motion`.
        values: (worlds, 3 parts) float32, of the actions.
        pose, mean_velocity, gone: (worlds, parts, ...), measured.
    """
    work, motion = work_at(work), motion_at(motion)
    decoding, process, velocity = motion.decoding, motion.process, work.velocity
    for w in range(start, stop):
        row = min(w, process.kind.shape[0] - 1)
        for p in range(pose.shape[1]):
            at, given, wanted, moved = pose[w, p], motion.given[w, p], motion.wanted[w, p], motion.moved[w, p]
            for k in range(3):
                velocity[k] = mean_velocity[w, p, k] + motion.lag * given[k]
            reason, moved[:] = GONE, 0.0
            if not gone[w, p]:
                decode(decoding, row, p, values[w, 3 * p : 3 * p + 3], velocity, at, wanted, moved)
                kind, push = process.kind[row, p], work.push[p]
                holds = invert_ahead(process, kind, velocity, wanted, work.averages, work.later, push, given)
                if at[0] < 0.0 or at[1] < 0.0 or at[0] > motion.width or at[1] > motion.depth:
                    reason = BESIDE
                elif not holds:
                    reason = STICKS
                else:
                    reason = LEFT_OUT if motion.left_out[w, p] else SERVED
            motion.unserved[w, p], work.served[p] = reason, reason == SERVED
            if reason != SERVED:
                given[:] = 0.0
        allocate_world(motion.problem, w, pose[w], work.served, work.push, work.allocation, motion.phasors[w], True)
