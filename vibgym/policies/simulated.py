"""Simulation of a task from measured states, for policies that plan with it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from vibgym.envs.core import Core
from vibgym.envs.options import Options
from vibgym.policies.classical.measured import Measured, mapped
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import Start

MODEL_WORLDS = 256  # maximum number of simulated worlds


class Model:
    """Simulated worlds with the task and the scene of an environment, on ideal hardware.

    With latency, measurements are predictions for the instant when commands act, so no latency is simulated.

    Args:
        info: task and scene, with goals that stay.
        worlds: number of worlds.
        action, observation: as of environments.

    Attributes:
        core: the worlds.
        over: (worlds,) bool, whose episodes have ended.
    """

    def __init__(self, info: TaskInfo, worlds: int, action: str, observation: str = "state") -> None:
        self.core = Core(Options(**info.scene, action=action, observation=observation), worlds)
        self.over = np.zeros(worlds, dtype=bool)
        rest = np.stack([np.append(info.surface.idle_velocity(part.friction), 0.0) for part in info.parts])
        self.rest = np.stack([rest, np.zeros_like(rest)])
        """(2, parts, 3) :meth:`drift` of parts at rest."""
        self._info, self._all = info, np.arange(worlds)
        self._key = np.zeros((worlds, 2), dtype=np.int64)  # of arrivals: the same for all plans
        scored, driven = np.array(info.scored, dtype=bool), np.array(info.driven, dtype=bool)
        # A driven part gets its own reward; those of the other parts go to all driven parts.
        self._credit = np.where(driven[:, None], np.diag(driven | ~scored), 0.0) + np.outer(driven, scored & ~driven)

    def begin(self, seen: Measured, drift: np.ndarray) -> None:
        """Start from a measured state per world.

        Args:
            seen: of as many worlds.
            drift: (worlds, 2, parts, 3), :meth:`drift` after the step before.
        """
        present = seen.present
        goal = np.zeros_like(seen.pose)
        if self._info.has_goal:
            goal = seen.pose + np.concatenate([seen.displacement, seen.heading_error[..., None]], axis=-1)
        pose = np.where(present[..., None], seen.pose, -1.0)  # off the surface
        coming = present | self._info.continuous_feed  # absent parts may arrive
        start = Start(pose, coming, np.where(present[..., None], goal, 0.0), key=self._key)
        velocity = np.where(present[..., None], seen.rate + drift[:, 0], 0.0)
        self.core.put(self._all, start, velocity, np.where(present[..., None], seen.rate, 0.0))
        if self._info.continuous_feed:
            self.core.scoring.custom_state()["flow_idle"][...] = self.rest[0]
        remembered = self.core.action.live()
        if "given" in remembered:
            remembered["given"][...] = drift[:, 1]
        self.over = np.zeros(len(present), dtype=bool)

    def drift(self) -> np.ndarray:
        """Return the unmeasured state (worlds, 2, parts, 3).

        It is the velocity minus its mean over the last period (m/s, rad/s), and the acceleration that an action assumes to have
        given the parts (m/s^2, rad/s^2).
        """
        state, assumed = self.core.simulator.state, self.core.action.live().get("given")
        faster = state.velocity - state.mean_velocity
        return np.stack([faster, np.zeros_like(faster) if assumed is None else assumed], axis=1)

    def step(self, action: np.ndarray) -> np.ndarray:
        """Return the rewards (worlds, parts) of a step with actions (worlds, size); 0 after an episode's end."""
        self.core.pipeline.run(np.ascontiguousarray(action, dtype=np.float32))
        episode = self.core.episode
        earned = np.where(self.over[:, None], 0.0, episode.part_reward) @ self._credit.T
        self.over |= episode.ended
        return earned


class Models(dict[int, Model]):
    """Simulations by their number of worlds, each made when it is first asked for.

    Args:
        info: task and scene.
        kind: of the policy that simulates, for errors.
        action, observation: as of environments.

    Raises:
        ValueError: a task with moving goals.
    """

    def __init__(self, info: TaskInfo, kind: str, action: str, observation: str = "state") -> None:
        if info.goal_moves:
            raise info.unsupported(kind, "a task with fixed goals")
        super().__init__()
        self._made_with = info, action, observation

    def __missing__(self, worlds: int) -> Model:
        info, action, observation = self._made_with
        self[worlds] = model = Model(info, worlds, action, observation)
        return model


def rows_of(memory: Any, chosen: np.ndarray) -> Any:
    """Return the rows of some worlds (index array) of a policy's memory: arrays (batch or 0, ...), and tuples of them."""
    return mapped(lambda array: array[chosen] if len(array) else array, memory)


def measured_rows(seen: Measured, chosen: np.ndarray) -> Measured:
    """Return the rows of some worlds (index array) of measurements; fields that broadcast are unchanged."""
    arrays = {name: value for name, value in vars(seen).items() if isinstance(value, np.ndarray)}
    return replace(seen, **{name: array[chosen] for name, array in arrays.items() if len(array) == len(seen.centre)})
