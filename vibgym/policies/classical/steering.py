"""From targets of parts to actions: the base class of all classical controllers, and the simplest of them.

:class:`Steering` runs a control law and finds the pushes for its accelerations; an output (:mod:`.outputs`) turns pushes into
the environment's action. :class:`LocalFieldPolicy` steers every part straight to its target.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field, model_validator

from vibgym import checks
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs.features import SPIN
from vibgym.envs.motions import MOTIONS
from vibgym.policies.classical.law import Law, laws, lead_of
from vibgym.policies.classical.measured import Measured, Preview, from_goals, recall, wrap
from vibgym.policies.classical.outputs import OUTPUTS, DisturbanceObserver
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import BaseSettings, Length, with_unit

LawChoice = str | Mapping[str, Any]
"""Name of a law, or a mapping with ``kind`` and the law's settings."""


TURN_ROOM = 0.010  # m, distance to the nearest other part below which a part turns more slowly
SPIN_LIMIT = (1.0 - 1e-6) * SPIN  # rad/s, range of observations; faster spins are predicted


class SteeringMemory(NamedTuple):
    """Memory of :class:`Steering`."""

    # (batch, parts, 3) m/s^2 and rad/s^2, that the parts got in the last step, without the disturbance
    acceleration: np.ndarray
    law: Any  # the law's own
    spin: np.ndarray  # (batch, parts) rad/s, predicted for the end of that step
    output: Any  # the output's own
    observer: Any  # a Disturbance, or () without an observer
    own: Any = ()  # the policy's own


class Steering:
    """Base of the policies that steer parts by a law; a policy defines :meth:`act`.

    Args:
        info: task, scene and step time.
        settings: of the policy and its law; None: the defaults.

    Attributes:
        ahead: s, half the difference of step and period.
        slack: m, largest position error of corners of parts that have arrived.
        top: m/s, speed of a part on elements at full amplitude.

    Raises:
        ValueError: a bad setting of the law, or parts that can stick to the surface, where averages over a period do not hold.
    """

    class Settings(BaseSettings):
        """Settings of a policy and its law.

        Those of the law stand beside the policy's, ``{"law": "pose", "approach": 20}``, or with its name,
        ``{"law": {"kind": "pose", "approach": 20}}``.
        """

        law: LawChoice = "local"
        """Name of the law, or a mapping with its ``kind`` and settings."""

        learn: bool = True
        """Whether to estimate gains and phases of elements, where they have a hard dead zone and parts have goal poses, and
        ``action`` is ``"phasor"``."""

        action: Literal["phasor", "wrench", "velocity", "target"] = "phasor"
        """The environment's ``action=``."""

        observer: Literal["none", "disturbance"] | None = None
        """``"disturbance"`` estimates the acceleration of each part that elements and nominal friction do not explain, and
        rejects it. None: that for one part that can tilt, on elements without a hard dead zone; else ``"none"``, since
        elsewhere it was measured not to help."""

        @model_validator(mode="before")
        @classmethod
        def _with_law(cls, values: Any) -> Any:
            """Move the settings that are not the policy's to the law's."""
            if not isinstance(values, Mapping):
                return values
            own = {name: value for name, value in values.items() if name in cls.model_fields or name in with_unit(cls)}
            rest = {name: value for name, value in values.items() if name not in own}
            if not rest:
                return values
            known = laws()
            kind, settings = known.split("law", own.get("law", cls.model_fields["law"].default))
            law = known[kind].Settings
            for name in rest:
                if name in settings:
                    raise checks.conflict(f"{name!r} is given twice, beside the law and with it")
                if name not in law.model_fields and name not in with_unit(law):
                    names = *cls.model_fields, *law.model_fields
                    raise checks.unknown("setting", name, names, of=f"the policy and its law {kind!r}")
            return {**own, "law": {"kind": kind, **settings, **rest}}

    observation = "state"
    settings: Settings

    @staticmethod
    def supports(action: str) -> bool:
        """Return whether there is an output for the environment's ``action=``."""
        return action in OUTPUTS

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        self.info = info
        self.settings = own = type(self).Settings() if settings is None else settings
        self.law: Law = laws().make("law", own.law, info)
        self.slack, self.top = self.law.slack, info.plant.top_speed
        self.process = FrictionalInverse(
            info.surface, info.parts, limit=info.hardware.limit, ahead=0.5 * info.surface.period
        )
        self.ahead = 0.5 * (info.step_time - info.surface.period)  # s
        # s, of a step's first acceleration, which fades as the velocity comes near what the push can hold.
        self.gaining = 0.5 * info.surface.period * np.exp(-2.0 * self.ahead * info.plant.drag)
        # s, of the same, by the end of the step.
        self.gained = info.surface.period + 2.0 * self.ahead * np.exp(-self.ahead * info.plant.drag)
        self.action: str = own.action
        self.output = OUTPUTS[own.action](info, self.process, own.learn)
        self.learner = self.output.learner
        usual = "none" if info.flat or info.hard_dead_zone or len(info.parts) > 1 else "disturbance"
        observes = (own.observer or usual) == "disturbance"
        self.observer = DisturbanceObserver(info, self.gaining, self.gained) if observes else None
        self.symmetry = np.array([part.symmetry for part in info.parts])
        self.preview = Preview(info) if info.goal_moves else None

    @functools.cached_property
    def lead(self) -> float:
        """s, a target ``lead * v`` ahead of a part makes it move at the velocity ``v``; see :func:`.law.lead_of`."""
        return lead_of(self.law, self.info, 0.5 * self.top)

    def initial(self, batch: int) -> SteeringMemory:
        """Return the memory at the start of an episode."""
        shape = batch, len(self.info.parts)
        observer = () if self.observer is None else self.observer.begin(batch)
        return SteeringMemory(
            np.zeros((*shape, 3)), self.law.initial(batch), np.zeros(shape), self.output.begin(batch), observer
        )

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, SteeringMemory]:
        """Return actions from measured poses and mean velocities, and the memory; see :class:`.task_info.Policy`."""
        measured = Measured.of(observation, self.info)
        memory, new = recall(state, episode_start, self.initial(1), len(measured.centre), measured.arrived)
        return self.act(self.expected(measured, memory), memory, new)

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """Return the action and the new memory.

        Args:
            measured: of :meth:`expected`.
            memory: a copy, which may be overwritten.
            new: (batch,) bool, worlds whose episode has just begun.
        """
        raise NotImplementedError

    def expected(self, measured: Measured, memory: SteeringMemory) -> Measured:
        """Predict positions for the middle of the step's excess over a period, and velocities for the start of the step.

        A mean velocity over a period is half a period old: a part that brakes is slower by now. Its acceleration is known, or
        estimated: the observer's estimate in ``memory`` is updated in place.

        Args:
            measured: a decoded observation.
            memory: of :meth:`initial` or :meth:`steer`.
        """
        if self.preview is not None:
            measured = self.preview(measured)
        known = np.abs(measured.spin) < SPIN_LIMIT
        if self.observer is not None:
            self.observer.update(measured, known, memory.acceleration, memory.observer)
        gained = self.gaining[:, None] * (memory.acceleration + _unknown(memory))
        spin = np.where(known, measured.spin + gained[..., 2], memory.spin)
        measured = replace(measured, velocity=measured.velocity + gained[..., :2], spin=spin)
        if self.ahead == 0.0 and self.learner is None:
            return measured
        moved, rotated = self.ahead * measured.velocity, self.ahead * measured.spin
        if self.learner is not None:  # later measurements will show the gain errors of elements
            unseen, doubt = self.learner.learn(measured, memory.output)
            measured = replace(measured, doubt=doubt)
            moved, rotated = moved + unseen[..., :2], rotated + unseen[..., 2]
        goal = self.ahead * measured.goal_velocity
        return replace(
            measured,
            centre=measured.centre + moved,
            heading=measured.heading + rotated,
            displacement=measured.displacement + goal[..., :2] - moved if self.info.has_goal else measured.displacement,
            heading_error=measured.heading_error + goal[..., 2] - rotated
            if self.info.has_heading
            else measured.heading_error,
        )

    def steer(
        self, measured: Measured, displacement: np.ndarray, memory: SteeringMemory, free: np.ndarray | None = None
    ) -> tuple[np.ndarray, SteeringMemory]:
        """Return the action that moves parts by ``displacement`` (batch, parts, 2) m and turns them to their goal headings.

        Args:
            free: (batch, parts) bool, parts that turn at full speed however near others are; None: no part.
        """
        room = np.clip(measured.gap / TURN_ROOM, 0.0, 1.0)
        if free is not None:
            room = np.where(free, 1.0, room)
        seen = measured if self.preview is None else from_goals(measured)
        wanted, law = self.law.wanted(seen, displacement, room * self._heading_error(measured), memory.law)
        unknown = _unknown(memory)
        wanted = wanted + measured.goal_acceleration - unknown
        moves, velocity = ~np.isnan(wanted[..., :1]), measured.rate
        push, allowed, holds = self.process.push(velocity, np.where(moves, wanted, 0.0))
        moves &= holds[..., None]  # where averages do not hold, the effect of a push is unknown
        push = np.where(moves, push, 0.0)
        seen_then = velocity - self.gaining[:, None] * (memory.acceleration + unknown)
        action, effect, output = self.output.give(measured, seen_then, push, memory.output)
        acceleration, _ = self.process.acceleration(velocity, effect)
        spin = measured.spin + self.gained * (acceleration + unknown)[..., 2]
        # Pass the acceleration within limits, without the allocation's residual, which laws would take for saturation.
        limited = np.where(moves, allowed, acceleration) + unknown - measured.goal_acceleration
        observer = memory.observer and memory.observer._replace(start=velocity, valid=holds)
        memory = SteeringMemory(acceleration, self.law.applied(seen, limited, law), spin, output, observer, memory.own)
        return (action[0] if measured.single else action), memory

    def acted(self, memory: SteeringMemory, proposed: np.ndarray, done: np.ndarray) -> SteeringMemory:
        """Return the memory after a step whose action was changed: given accelerations are those applied.

        The law's own state, such as the error integral of a PID, is unchanged.

        Args:
            memory: that :meth:`predict` returned.
            proposed: (batch, n) the action that it returned.
            done: (batch, n) the action that the environment got.

        Raises:
            ValueError: the policy has another action.
        """
        checks.choice("action", self.action, tuple(MOTIONS))
        shape = memory.acceleration.shape
        changed = (proposed.reshape(shape) != done.reshape(shape)).any(axis=-1, keepdims=True)
        if not changed.any():
            return memory
        effect = np.where(changed, self.output.counted(done, memory.output), memory.output.given)
        acceleration = np.where(changed, effect, memory.acceleration)
        spin = memory.spin + self.gained * (acceleration - memory.acceleration)[..., 2]
        return memory._replace(acceleration=acceleration, spin=spin, output=memory.output._replace(given=effect))

    def _heading_error(self, measured: Measured) -> np.ndarray:
        """Return heading errors (batch, parts) rad.

        Where headings do not count, several parts turn straight (heading 0, modulo their symmetry), to take up little of the
        table's width.
        """
        if self.info.has_heading:
            return measured.heading_error
        if len(self.info.parts) == 1:
            return np.zeros_like(measured.heading)
        return -wrap(measured.heading, self.symmetry)


def _unknown(memory: SteeringMemory) -> np.ndarray | float:
    """Return the accelerations (batch, parts, 3) by disturbances, m/s^2 and rad/s^2; 0 without an observer."""
    return memory.observer.acceleration if memory.observer else 0.0


class LocalFieldPolicy(Steering):
    """Policy that steers every part straight to its target, without regard to obstacles.

    The target is the goal position; or the nearest point of the part's zone, a margin inside; or, where parts only have to keep
    a distance, it lies straight away from the other parts that are too near.

    Raises:
        ValueError: a task without goals, zones or distances, or a bad setting of the law.
    """

    class Settings(Steering.Settings):
        """Settings of the policy and its law."""

        margin: Length = Field(default=0.03, ge=0.0)
        """Distance of targets from borders of zones and table."""

    settings: Settings

    def __init__(self, info: TaskInfo, settings: Settings | None = None) -> None:
        super().__init__(info, settings)
        info.check_places("local_field")

    def act(self, measured: Measured, memory: SteeringMemory, new: np.ndarray) -> tuple[np.ndarray, SteeringMemory]:
        """See :meth:`Steering.act`."""
        return self.steer(measured, self.targets(measured) - measured.centre, memory)

    def targets(self, measured: Measured) -> np.ndarray:
        """Return the targets of the parts, (batch, parts, 2) m."""
        info, centre = self.info, measured.centre
        if info.has_goal:
            return centre + measured.displacement
        if info.zones is not None:
            zone = info.zones[list(info.kind)]
            inset = np.minimum(self.settings.margin, 0.5 * (zone[:, 2:] - zone[:, :2]))
            return np.clip(centre, zone[:, :2] + inset, zone[:, 2:] - inset)
        assert info.apart is not None
        between = centre[:, :, None] - centre[:, None]
        distance = np.sqrt((between**2).sum(axis=-1))
        radius = np.array([part.radius for part in info.parts])
        enough = radius[:, None] + radius + (info.apart + 2.0 * self.slack)
        lack = np.maximum(enough - distance, 0.0) * measured.present[:, None] * ~np.eye(len(radius), dtype=bool)
        away = (lack / np.maximum(distance, 1e-9))[..., None] * between
        size = np.array([info.surface.width, info.surface.depth])
        edge = min(self.settings.margin, 0.5 * size.min())
        return np.clip(centre + away.sum(axis=2), edge, size - edge)
