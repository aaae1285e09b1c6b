"""SAC on the flat state: its worlds, model and policies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces

from agents.training.algorithm import Algorithm
from agents.training.checkpoint import refuse_infinite
from agents.training.sac import learner
from agents.training.sac.hyperparameters import SACSettings
from agents.training.sac.replay import Replay, buffer_bytes
from agents.training.train_settings import TrainSettings
from agents.training.worlds import make_worlds
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.state_policy import NETWORK, StatePolicy, columns_of
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import KIND, VERSION, described

MOST_BUFFER = 2e9
"""Bytes of the replay buffer."""


class SAC(Algorithm):
    """Off-policy: every step is learned from many times. See :class:`agents.training.sac.learner.SAC`."""

    hyperparameters = SACSettings
    title, phase = "SAC (on Stable-Baselines3)", "sac"
    advice = "sac.learning_rate or sac.tau"
    log_interval = 500

    def __init__(self, settings: TrainSettings) -> None:
        self.settings = settings

    def make_env(self) -> VecEnv:
        checks.choice("observation", self.settings.environment.get("observation", "state"), ("state",))
        self.settings.check_alone()
        return make_worlds(self.settings, "state")

    def make_model(self, env: VecEnv) -> learner.SAC:
        own, space, actions = self.settings.own, env.observation_space, env.action_space
        assert isinstance(own, SACSettings) and isinstance(space, spaces.Box) and isinstance(actions, spaces.Box)
        size = buffer_bytes(own.buffer_size, env.num_envs, space, actions)
        if size > MOST_BUFFER:
            allowed = f"a buffer of at most {MOST_BUFFER:.1e} bytes; this one has {size:.1e}"
            raise checks.refuse("sac.buffer_size", own.buffer_size, allowed)
        return learner.SAC(
            "MlpPolicy",
            env,
            learning_rate=own.rate,
            buffer_size=own.buffer_size,
            learning_starts=own.learning_starts,
            batch_size=own.batch_size,
            tau=own.tau,
            gamma=own.gamma,
            train_freq=own.train_freq,
            gradient_steps=own.gradient_steps,
            replay_buffer_class=Replay,
            replay_buffer_kwargs={"seed": self.settings.seed},
            ent_coef=f"auto_{own.ent_coef}",
            target_entropy="auto" if own.target_entropy is None else own.target_entropy,
            # One pass over all weights takes a third of the time of a pass over each.
            policy_kwargs={"net_arch": list(own.net), "optimizer_kwargs": {"fused": True}},
            seed=self.settings.seed,
            device="cpu",
        )

    def acting(self, model: learner.SAC) -> StatePolicy:
        return StatePolicy(self.actor(model), _info(model), self.settings.action)

    def actor(self, model: learner.SAC) -> dict[str, np.ndarray]:
        tensors = {}
        for name, layer in _layers(model).items():
            for kind, value in layer.state_dict().items():
                tensors[f"{name}.{kind}"] = value.detach().cpu().numpy().copy()
        return tensors

    def take_actor(self, model: learner.SAC, tensors: Mapping[str, np.ndarray]) -> None:
        for name, layer in _layers(model).items():
            layer.load_state_dict({k: torch.from_numpy(tensors[f"{name}.{k}"].copy()) for k in ("weight", "bias")})

    def save_policy(self, path: Path, model: learner.SAC, training: dict[str, Any]) -> None:
        tensors, info = self.actor(model), _info(model)
        refuse_infinite(tensors)
        record = {
            "network": NETWORK,
            "tasks": [info.name],
            "surface": described(info.surface),
            "parts": len(info.parts),
            "action": self.settings.action,
            "columns": columns_of(info),
            "training": training,
        }
        save_set(path, KIND, tensors, record, VERSION)


def _layers(model: learner.SAC) -> dict[str, torch.nn.Linear]:
    """The actor's layers by the names that policy files have for them."""
    hidden = [each for each in model.actor.latent_pi if isinstance(each, torch.nn.Linear)]
    named = {f"layer{k}": layer for k, layer in enumerate(hidden)}
    last = {"mean": model.actor.mu, "log_std": model.actor.log_std}
    assert all(isinstance(layer, torch.nn.Linear) for layer in last.values())
    return named | last  # type: ignore[operator]


def _info(model: learner.SAC) -> TaskInfo:
    env = model.get_env()
    assert isinstance(env, VecEnv)
    return TaskInfo.of(env.env)
