"""SAC with hindsight on goal observations: its worlds, model and policies, as :mod:`agents.training.on_policy` for PPO."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.training.checkpoint import refuse_infinite
from agents.training.hindsight import HindsightBuffer, buffer_bytes
from agents.training.noise import Wandering
from agents.training.on_policy import check_native
from agents.training.sac import LeanSAC
from agents.training.settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.goal_features import GoalFeatures
from vibgym.policies.trained.goal_policy import NETWORK, GoalPolicy
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import KIND as POLICY_KIND
from vibgym.policies.trained.trained import VERSION as POLICY_VERSION
from vibgym.policies.trained.trained import described
from vibgym.tasks import PoseTask

TITLE, PHASE = "SAC with hindsight (on Stable-Baselines3)", "sac"
"""What policies' files and learning curves call it."""

ADVICE = "sac.learning_rate or sac.tau"
"""What to lower where a training diverges."""

MOST_BUFFER = 2e9
"""Bytes of the replay buffer."""


class GoalExtractor(BaseFeaturesExtractor):
    """:class:`GoalFeatures` of a batch of tensors.

    Args:
        observation_space: of goal observations.
        features: which ones.
    """

    def __init__(self, observation_space: spaces.Dict, features: GoalFeatures) -> None:
        super().__init__(observation_space, features.size)
        self.period, self.goals = features.period, features.goals
        # What is no part of the state, so that a checkpoint does not carry it.
        self.register_buffer("kept", torch.from_numpy(features.kept), persistent=False)
        self.register_buffer("goal", torch.from_numpy(features.goal), persistent=False)
        self.register_buffer("inverse", torch.from_numpy(1.0 / features.scale), persistent=False)

    def forward(self, observations: dict[str, torch.Tensor]) -> torch.Tensor:
        difference = observations["desired_goal"] - observations["achieved_goal"]
        if self.period:
            turn = difference[:, 2]
            difference[:, 2] = turn - self.period * torch.round(turn / self.period)
        far = torch.tanh(difference[:, self.goal] * self.inverse)  # type: ignore[index, operator]
        return torch.cat((observations["observation"][:, self.kept], far), dim=1)  # type: ignore[index]


def make_env(settings: TrainSettings) -> VecEnv:
    """The batch of worlds that a run trains on, with goal observations.

    Raises:
        ValueError: settings that ask for another observation, or that the environment refuses.
    """
    checks.choice("observation", settings.environment.get("observation", "goal"), ("goal",))
    settings.check_alone()
    arguments: dict[str, Any] = {
        "num_envs": settings.worlds, "autoreset_mode": "SameStep", **settings.environment, "observation": "goal"
    }  # fmt: skip
    name = settings.environment_name
    env = gym.make_vec(name, **arguments) if name in gym.registry else VibgymVectorEnv(settings.task, **arguments)
    check_native(settings, env)
    return VecEnv(env)


def make_model(settings: TrainSettings, env: VecEnv) -> LeanSAC:
    """An untrained SAC model.

    Raises:
        ValueError: an environment without goal observations, hindsight with a reward that a wrapper has changed, or a replay
            buffer that is too large to keep.
    """
    sac = settings.sac
    features = GoalFeatures(TaskInfo.of(env.env))
    if not isinstance(env.observation_space, spaces.Dict) or not hasattr(env.env, "compute_reward"):
        raise checks.refuse("observation", settings.environment.get("observation", "state"), "'goal' for SAC")
    if sac.hindsight > 0.0 and not env.keeps_rewards:  # goals of hindsight are paid by compute_reward
        raise checks.refuse("sac.hindsight", sac.hindsight, "0 where a wrapper changes the goal reward")
    assert isinstance(env.action_space, spaces.Box)
    (actions,) = env.action_space.shape
    size = buffer_bytes(sac.buffer_size, env.num_envs, env.observation_space, env.action_space)
    if size > MOST_BUFFER:
        allowed = f"a buffer of at most {MOST_BUFFER:.1e} bytes; this one has {size:.1e}"
        raise checks.refuse("sac.buffer_size", sac.buffer_size, allowed)

    return LeanSAC(
        "MultiInputPolicy",
        env,
        learning_rate=sac.rate,
        buffer_size=sac.buffer_size,
        learning_starts=sac.learning_starts,
        batch_size=sac.batch_size,
        tau=sac.tau,
        gamma=sac.gamma,
        train_freq=sac.train_freq,
        gradient_steps=sac.gradient_steps,
        policy_delay=sac.policy_delay,
        values=_bounds(env, sac.gamma),
        replay_buffer_class=HindsightBuffer,
        replay_buffer_kwargs={"env": env, "hindsight": sac.hindsight, "horizon": sac.horizon, "seed": settings.seed},
        action_noise=Wandering(env.num_envs, actions, sac.noise, sac.noise_steps, settings.seed),
        ent_coef=f"auto_{sac.ent_coef}",
        target_entropy="auto" if sac.target_entropy is None else sac.target_entropy,
        policy_kwargs={
            "net_arch": list(sac.net),
            "features_extractor_class": GoalExtractor,
            "features_extractor_kwargs": {"features": features},
            "optimizer_kwargs": {"fused": True},  # one pass over all weights, a third of the time of a pass over each
        },
        seed=settings.seed,
        device="cpu",
    )


def _bounds(env: VecEnv, gamma: float) -> tuple[float, float] | None:
    """Least and largest value of rewards of -1 and 0 for ever, the shipped goal reward; None with any other reward."""
    task = type(env.env.task)
    shipped = task.compute_reward is PoseTask.compute_reward and task.FALL_REWARD == PoseTask.FALL_REWARD
    return (-1.0 / (1.0 - gamma), 0.0) if shipped and env.keeps_rewards else None


def acting(model: LeanSAC, settings: TrainSettings) -> GoalPolicy:
    """The model's actor as it stands, in NumPy."""
    tensors = actor(model)
    pairs = {name: (tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in _layers(model)}
    mean, log_std = pairs.pop("mean"), pairs.pop("log_std")
    features = GoalFeatures(TaskInfo.of(_env(model).env))
    return GoalPolicy(list(pairs.values()), mean, log_std, features, settings.environment.get("action", "element"))


def save_policy(path: Path, model: LeanSAC, settings: TrainSettings, training: dict[str, Any]) -> None:
    """Write the actor for :func:`vibgym.policies.trained.trained.load_trained`.

    Raises:
        Diverged: a weight is not finite; an older policy stays.
    """
    tensors = actor(model)
    refuse_infinite(tensors)
    info = TaskInfo.of(_env(model).env)
    record = {
        "network": NETWORK,
        "tasks": [info.name],
        "surface": described(info.surface),
        "parts": len(info.parts),
        "action": settings.environment.get("action", "element"),
        "features": GoalFeatures(info).described,
        "training": training,
    }
    save_set(path, POLICY_KIND, tensors, record, POLICY_VERSION)


def _layers(model: LeanSAC) -> dict[str, torch.nn.Linear]:
    hidden = [each for each in model.actor.latent_pi if isinstance(each, torch.nn.Linear)]
    named = {f"layer{k}": layer for k, layer in enumerate(hidden)}
    last = {"mean": model.actor.mu, "log_std": model.actor.log_std}
    assert all(isinstance(layer, torch.nn.Linear) for layer in last.values())
    return named | last  # type: ignore[operator]


def actor(model: LeanSAC) -> dict[str, np.ndarray]:
    """The tensors of what acts."""
    tensors = {}
    for name, layer in _layers(model).items():
        tensors |= {f"{name}.weight": _numpy(layer.weight), f"{name}.bias": _numpy(layer.bias)}
    return tensors


def take_actor(model: LeanSAC, tensors: Mapping[str, np.ndarray]) -> None:
    """Act as these tensors do."""
    for name, layer in _layers(model).items():
        kinds = ("weight", "bias")
        layer.load_state_dict({kind: torch.from_numpy(tensors[f"{name}.{kind}"].copy()) for kind in kinds})


def _env(model: LeanSAC) -> VecEnv:
    env = model.get_env()
    assert isinstance(env, VecEnv)
    return env


def _numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().copy()
