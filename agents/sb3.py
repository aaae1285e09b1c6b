"""Stable-Baselines3's algorithms, unmodified, by name: ``algorithm: sb3.SAC``, ``sb3.PPO``, ``sb3.TD3`` and so on.

Keyword arguments of the algorithm's class are under ``sb3`` in a training file. Any action works, and any observation that is
a box or a dictionary of boxes, including user-registered ones. A continued run loads weights, optimizers and replay buffer, and
starts new episodes: it is not identical to an uninterrupted run.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import stable_baselines3
import torch
from pydantic import ConfigDict
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.off_policy_algorithm import OffPolicyAlgorithm

from agents.checkpoint import check_finite
from agents.training_envs import make_worlds
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.config import json_values
from vibgym.files import write_atomically
from vibgym.seeds import training_seed
from vibgym.settings import BaseSettings

CHECKPOINT, REPLAY = "checkpoint.zip", "replay.pkl"

NAMES = tuple(
    name
    for name, cls in vars(stable_baselines3).items()
    if isinstance(cls, type) and issubclass(cls, BaseAlgorithm) and name not in ("DQN", "HER")  # discrete actions
)
"""Values of NAME in ``sb3.NAME``."""


class SB3:
    """One algorithm of Stable-Baselines3, made unmodified.

    Args:
        settings: of the run; ``algorithm`` is ``sb3.NAME``.
    """

    class Settings(BaseSettings):
        """Keyword arguments of the algorithm's class, as its documentation lists them."""

        model_config = ConfigDict(extra="allow")

        policy: str | None = None
        """None: MlpPolicy, or MultiInputPolicy for dictionaries."""

    phase = "sb3"

    def __init__(self, settings: TrainSettings) -> None:
        settings.check_alone()
        self.settings, self.action = settings, settings.action
        self.observation = settings.environment.get("observation", "state")
        name = settings.algorithm.removeprefix("sb3.")
        self.title, self._class = f"{name} of Stable-Baselines3", getattr(stable_baselines3, name)
        with checks.within("environment"):
            self.env = make_worlds(settings, self.observation)
        arguments = json_values(settings.own.model_dump())  # lists, not tuples
        buffer = arguments.get("replay_buffer_class")
        if isinstance(buffer, str):  # such as HerReplayBuffer
            arguments["replay_buffer_class"] = getattr(stable_baselines3, buffer, buffer)
        named = isinstance(self.env.observation_space, gym.spaces.Dict)
        policy = arguments.pop("policy") or ("MultiInputPolicy" if named else "MlpPolicy")
        try:
            self.model: BaseAlgorithm = self._class(policy, self.env, seed=settings.seed, device="cpu", **arguments)
        except (TypeError, ValueError, AssertionError) as error:
            self.env.close()
            raise checks.conflict(f"sb3: {error}") from None
        self._seed_worlds()

    def _seed_worlds(self) -> None:
        """Replace the seed that Stable-Baselines3 gave to the worlds, that of its networks."""
        self.env.seed(training_seed(self.settings.seed, f"{self.steps} steps"))

    @property
    def steps(self) -> int:
        """Steps of all worlds so far."""
        return self.model.num_timesteps

    def learn(self, until: int, report: Callable[[dict[str, float]], None]) -> None:
        """Train until ``until`` steps; ``report`` is called between rollouts."""

        class Between(BaseCallback):
            def _on_step(self) -> bool:
                return True

            def _on_rollout_start(self) -> None:
                report({k: float(v) for k, v in self.logger.name_to_value.items() if isinstance(v, int | float)})

        self.model.learn(until - self.steps, Between(), log_interval=None, reset_num_timesteps=False)  # type: ignore[arg-type]
        self.check_finite()
        report({})

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions, see :meth:`vibgym.policies.task_info.Policy.predict`."""
        return self.model.predict(observation, state, episode_start, deterministic)

    def check_finite(self) -> None:
        """Raise :class:`agents.checkpoint.Diverged` if a weight is not finite."""
        check_finite(dict(self.model.policy.state_dict()))

    def save(self, directory: Path) -> None:
        """Write the model and, off-policy, its replay buffer."""
        self.check_finite()
        if isinstance(self.model, OffPolicyAlgorithm):
            write_atomically(directory / REPLAY, _bytes(self.model.save_replay_buffer))
        write_atomically(directory / CHECKPOINT, _bytes(self.model.save))

    def load(self, directory: Path) -> bool:
        """Continue from what :meth:`save` wrote; return False if there is nothing."""
        path = directory / CHECKPOINT
        if not path.exists():
            return False
        try:
            model = self._class.load(path, self.env, device="cpu")
            if isinstance(model, OffPolicyAlgorithm):
                model.load_replay_buffer(directory / REPLAY)
        except Exception as error:  # damaged pickles raise anything
            hint = "remove it or choose another output"
            raise checks.conflict(f"{path}: not a checkpoint of these settings ({error}); {hint}") from None
        self.model = model
        self._seed_worlds()
        return True

    def actor(self) -> dict[str, np.ndarray]:
        """Return the weights of the whole policy."""
        return {name: tensor.detach().numpy().copy() for name, tensor in self.model.policy.state_dict().items()}

    def set_actor(self, tensors: dict[str, np.ndarray]) -> None:
        """Replace the weights of the policy."""
        self.model.policy.load_state_dict({name: torch.from_numpy(tensor.copy()) for name, tensor in tensors.items()})

    def save_policy(self, path: Path, training: dict[str, Any]) -> Path:
        """Write the policy as Stable-Baselines3's ``.zip`` beside ``path``; return its path."""
        self.check_finite()
        path = path.with_suffix(".zip")
        write_atomically(path, _bytes(self.model.save))
        return path

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def _bytes(save: Callable[[io.BytesIO], None]) -> bytes:
    file = io.BytesIO()
    save(file)
    return file.getvalue()
