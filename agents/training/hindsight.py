"""Experience that is replayed as if another goal had been meant (hindsight experience replay)."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.buffers import DictReplayBuffer
from stable_baselines3.common.type_aliases import DictReplayBufferSamples
from stable_baselines3.common.vec_env import VecEnv, VecNormalize

from vibgym.envs import generators


def buffer_bytes(size: int, worlds: int, observation_space: spaces.Dict, action_space: spaces.Box) -> int:
    """Memory of a :class:`HindsightBuffer` of ``size`` transitions."""
    numbers = 2 * sum(spaces.flatdim(space) for space in observation_space.values()) + spaces.flatdim(action_space)
    return max(size // worlds, 1) * worlds * (4 * (numbers + 3) + 8 + 1)


class HindsightBuffer(DictReplayBuffer):
    """Transitions of goal observations; a share of each batch gets a goal that its episode reached later ("future").

    It follows Andrychowicz et al., "Hindsight Experience Replay", 2017 (https://arxiv.org/abs/1707.01495), as
    Stable-Baselines3's ``HerReplayBuffer`` does, and differs from that in four points. A fall stays a fall whatever goal is
    meant: the reward function is told of it, where theirs would pay for the goal on the floor. Goals lie no further ahead than
    a horizon. Episodes count as soon as they have begun, by the goals reached so far. Storing and drawing are array operations
    over all worlds, and the cost of a batch does not grow with the buffer.

    Only the two goals are kept apart; whatever else an observation says of the goal would be that of the goal first meant, so
    a network must not see it: see :class:`vibgym.policies.trained.goal_features.GoalFeatures`.

    Args:
        buffer_size: transitions of all worlds; at least one for each is kept.
        observation_space: with ``achieved_goal`` and ``desired_goal``.
        action_space: a box.
        device: of the batches.
        n_envs: worlds.
        optimize_memory_usage, handle_timeout_termination: as Stable-Baselines3 calls them; the first must be false.
        env: whose ``compute_reward(achieved, desired, {"fallen": bool array})`` rewards a batch, asked through ``env_method``.
        hindsight: share of a batch with replaced goals, 0 to 1.
        horizon: steps that such a goal is reached later at most. Parts that have come to rest stay where they are: goals from
            the rest of a long episode would mostly be where the part is already.
        seed: of what is drawn.
    """

    def __init__(
        self,
        buffer_size: int,
        observation_space: spaces.Dict,
        action_space: spaces.Space,
        device: torch.device | str = "cpu",
        n_envs: int = 1,
        optimize_memory_usage: bool = False,
        handle_timeout_termination: bool = True,
        *,
        env: VecEnv,
        hindsight: float = 0.8,
        horizon: int = 50,
        seed: int = 0,
    ) -> None:
        super().__init__(
            buffer_size, observation_space, action_space, device, n_envs, optimize_memory_usage,
            handle_timeout_termination,
        )  # fmt: skip
        self.env, self.hindsight, self.horizon = env, hindsight, horizon
        self.generator = np.random.default_rng(seed)
        self.fallen = np.zeros((self.buffer_size, n_envs), dtype=bool)
        self.length = np.zeros((self.buffer_size, n_envs), dtype=np.int64)
        """Steps from a transition to the last of its episode; -1 while that goes on."""
        self._begun = np.zeros(n_envs, dtype=np.int64)  # transitions of the present episodes

    def add(  # type: ignore[override]
        self,
        obs: dict[str, np.ndarray],
        next_obs: dict[str, np.ndarray],
        action: np.ndarray,
        reward: np.ndarray,
        done: np.ndarray,
        infos: list[dict[str, Any]],
    ) -> None:
        """Keep one transition of every world; ``infos`` of ended episodes say ``fallen``."""
        row = self.pos
        super().add(obs, next_obs, action, reward, done, infos)
        self.length[row] = -1
        self.fallen[row] = False
        self._begun += 1
        for world in np.flatnonzero(done).tolist():
            self.fallen[row, world] = infos[world]["fallen"]
            self._close(row, world)

    def _close(self, row: int, world: int) -> None:
        """Transition ``row`` is the last of the world's present episode."""
        kept = min(int(self._begun[world]), self.buffer_size)
        back = np.arange(kept)
        self.length[(row - back) % self.buffer_size, world] = back
        self._begun[world] = 0

    def sample(self, batch_size: int, env: VecNormalize | None = None) -> DictReplayBufferSamples:  # type: ignore[override]
        """Uniformly drawn transitions; the first ``hindsight`` share of them with a goal reached later."""
        rows = self.generator.integers(0, self.size(), size=batch_size)
        worlds = self.generator.integers(0, self.n_envs, size=batch_size)
        seen = {key: value[rows, worlds] for key, value in self.observations.items()}
        after = {key: value[rows, worlds] for key, value in self.next_observations.items()}
        reward = self.rewards[rows, worlds]
        changed = round(self.hindsight * batch_size)
        if changed:
            past, where = rows[:changed], worlds[:changed]
            left = self.length[past, where]
            left = np.where(left < 0, (self.pos - 1 - past) % self.buffer_size, left)
            reached = (past + self.generator.integers(0, np.minimum(left, self.horizon) + 1)) % self.buffer_size
            goal = self.next_observations["achieved_goal"][reached, where]
            seen["desired_goal"][:changed] = after["desired_goal"][:changed] = goal
            fallen = {"fallen": self.fallen[past, where]}
            achieved = after["achieved_goal"][:changed]
            reward[:changed] = self.env.env_method("compute_reward", achieved, goal, fallen, indices=[0])[0]
        dones = self.dones[rows, worlds] * (1.0 - self.timeouts[rows, worlds])
        return DictReplayBufferSamples(
            observations={key: torch.from_numpy(value) for key, value in seen.items()},
            actions=torch.from_numpy(self.actions[rows, worlds]),
            next_observations={key: torch.from_numpy(value) for key, value in after.items()},
            dones=torch.from_numpy(dones.astype(np.float32)).reshape(-1, 1),
            rewards=torch.from_numpy(reward).reshape(-1, 1),
        )

    def get_state(self) -> dict[str, Any]:
        """What has been stored, arrays (rows, worlds, ...) in the order of the memory, and what is drawn next."""
        stored = {name: value[: self.size()] for name, value in self._memory().items()}
        return {
            "stored": stored,
            "begun": self._begun.copy(),
            "position": self.pos,
            "full": self.full,
            "generator": generators.state_of(self.generator),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave on a buffer of the same size."""
        self.pos, self.full = state["position"], state["full"]
        for name, value in self._memory().items():
            value[: self.size()] = state["stored"][name]
        self._begun[:] = state["begun"]
        self.generator = generators.generator_from("buffer", state["generator"])

    def _memory(self) -> dict[str, np.ndarray]:
        both = {"observations": self.observations, "next_observations": self.next_observations}
        kept = {f"{name}.{key}": value for name, of in both.items() for key, value in of.items()}
        return kept | {
            name: getattr(self, name) for name in ("actions", "rewards", "dones", "timeouts", "fallen", "length")
        }
