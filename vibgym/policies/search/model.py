"""A simulation of a task that goes on from what has been measured: for policies that try plans before they act."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym.envs.core import Core
from vibgym.envs.options import Options
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import Start


class Model:
    """Worlds with the task and the scene of an environment, on ideal hardware: what a policy may know of it.

    Measurements of a machine whose commands act late are those of the moment when they act, so that no latency is simulated.

    Args:
        info: task and scene.
        worlds: that are simulated side by side.
        action: that plans speak.

    Raises:
        ValueError: a task whose goals move, which is not simulated.
    """

    def __init__(self, info: TaskInfo, worlds: int, action: str) -> None:
        if info.goal_moves:
            raise info.unsupported("mpc", "a task with fixed goals")
        self.core = Core(Options(**info.scene, action=action), worlds)
        rest = np.stack([np.append(info.surface.idle_velocity(part.friction), 0.0) for part in info.parts])
        self.rest = np.stack([rest, np.zeros_like(rest)])
        """(2, parts, 3) :meth:`drift` of parts at rest."""
        self._info, self._all = info, np.arange(worlds)
        self._key = np.zeros((worlds, 2), dtype=np.int64)  # of arrivals: the same for all plans
        asked, driven = np.array(info.asked, dtype=bool), np.array(info.driven, dtype=bool)
        # Who has a share in what each part earns: itself if it is driven; of the others' all that are.
        self._credit = np.where(driven[:, None], np.diag(driven | ~asked), 0.0) + np.outer(driven, asked & ~driven)

    @property
    def observation(self) -> Any:
        """State observations (worlds, size) after the last step."""
        return self.core.observations

    def begin(self, seen: Measured, drift: np.ndarray) -> None:
        """Go on from a measured state, that of each world.

        Args:
            seen: of as many worlds.
            drift: (worlds, 2, parts, 3), what :meth:`drift` was after the step before.
        """
        present = seen.present
        goal = np.zeros_like(seen.pose)
        if self._info.has_goal:
            goal = seen.pose + np.concatenate([seen.way, seen.turn[..., None]], axis=-1)
        pose = np.where(present[..., None], seen.pose, -1.0)  # beside the surface
        coming = present | self._info.flows  # parts that are not there may arrive
        start = Start(pose, coming, np.where(present[..., None], goal, 0.0), key=self._key)
        velocity = np.where(present[..., None], seen.rate + drift[:, 0], 0.0)
        self.core.put(self._all, start, velocity, np.where(present[..., None], seen.rate, 0.0))
        if self._info.flows:
            self.core.scoring.own_state()["flow_idle"][...] = self.rest[0]
        remembered = self.core.action.live()
        if "given" in remembered:
            remembered["given"][...] = drift[:, 1]
        self._over = np.zeros(len(present), dtype=bool)

    def drift(self) -> np.ndarray:
        """What measurements do not tell, (worlds, 2, parts, 3): by how much parts are faster now than in the mean over the last
        period (m/s, rad/s), and the acceleration that an action counts on having given them (m/s^2, rad/s^2)."""
        state, given = self.core.simulator.state, self.core.action.live().get("given")
        faster = state.velocity - state.mean_velocity
        return np.stack([faster, np.zeros_like(faster) if given is None else given], axis=1)

    def step(self, action: np.ndarray) -> np.ndarray:
        """What every part earns in a step under the actions (worlds, size): (worlds, parts), with its share in the others'.

        Nothing after an episode's end.
        """
        self.core.step(np.ascontiguousarray(action, dtype=np.float32))
        episode = self.core.episode
        earned = np.where(self._over[:, None], 0.0, episode.part_reward) @ self._credit.T
        self._over |= episode.ended
        return earned


def rows_of(memory: Any, chosen: np.ndarray) -> Any:
    """Some worlds (index array) of what a policy remembers: arrays (batch, ...), and tuples of them."""
    if isinstance(memory, np.ndarray):
        return memory[chosen]
    if isinstance(memory, tuple):
        rows = [rows_of(each, chosen) for each in memory]
        return type(memory)(*rows) if hasattr(memory, "_fields") else tuple(rows)
    return memory


def measured_rows(seen: Measured, chosen: np.ndarray) -> Measured:
    """The same of measurements."""
    rows: dict[str, Any] = dict(vars(seen))
    for name, value in rows.items():
        if isinstance(value, np.ndarray) and len(value) == len(seen.centre):
            rows[name] = value[chosen]
    return Measured(**rows)
