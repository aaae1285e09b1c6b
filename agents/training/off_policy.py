"""SAC with hindsight on goal observations: model, checkpoint and policy of a training run."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from gymnasium import spaces
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from agents.learned.goal_features import GoalFeatures
from agents.learned.goal_policy import NETWORK, GoalPolicy
from agents.learned.storage import as_float32, load_set, save_set
from agents.learned.trained import KIND as POLICY_KIND
from agents.learned.trained import VERSION as POLICY_VERSION
from agents.learned.trained import described
from agents.task_info import TaskInfo
from agents.training.adapter import StableBaselinesAdapter
from agents.training.checkpoint import ADAM, FILE, FREE, KIND, Diverged
from agents.training.hindsight import HindsightBuffer, buffer_bytes
from agents.training.noise import Wandering
from agents.training.sac import LeanSAC
from agents.training.settings import MOST_STEPS, TrainSettings
from vibgym import checks

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


def make_model(settings: TrainSettings, env: StableBaselinesAdapter) -> LeanSAC:
    """An untrained SAC model.

    Raises:
        ValueError: an environment without goal observations, or a replay buffer that is too large to keep.
    """
    sac = settings.sac
    features = GoalFeatures(TaskInfo.of(env.env))
    if not isinstance(env.observation_space, spaces.Dict) or not hasattr(env.env, "compute_reward"):
        raise checks.refuse("observation", settings.environment.get("observation", "state"), "'goal' for SAC")
    assert isinstance(env.action_space, spaces.Box)
    (actions,) = env.action_space.shape
    size = buffer_bytes(sac.buffer_size, env.num_envs, env.observation_space, env.action_space)
    if size > MOST_BUFFER:
        allowed = f"a buffer of at most {MOST_BUFFER:.1e} bytes; this one has {size:.1e}"
        raise checks.refuse("sac.buffer_size", sac.buffer_size, allowed)

    def learning_rate(remaining: float) -> float:
        return sac.final_learning_rate + remaining * (sac.learning_rate - sac.final_learning_rate)

    return LeanSAC(
        "MultiInputPolicy",
        env,
        learning_rate=learning_rate,
        buffer_size=sac.buffer_size,
        learning_starts=sac.learning_starts,
        batch_size=sac.batch_size,
        tau=sac.tau,
        gamma=sac.gamma,
        train_freq=sac.train_freq,
        gradient_steps=sac.gradient_steps,
        policy_delay=sac.policy_delay,
        values=(-1.0 / (1.0 - sac.gamma), 0.0),
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


def acting(model: LeanSAC, settings: TrainSettings) -> GoalPolicy:
    """The model's actor as it stands, in NumPy."""
    tensors = _actor(model)
    pairs = {name: (tensors[f"{name}.weight"], tensors[f"{name}.bias"]) for name in _layers(model)}
    mean, log_std = pairs.pop("mean"), pairs.pop("log_std")
    features = GoalFeatures(TaskInfo.of(_env(model).env))
    return GoalPolicy(list(pairs.values()), mean, log_std, features, settings.environment.get("action", "element"))


def save_policy(path: Path, model: LeanSAC, settings: TrainSettings, training: dict[str, Any]) -> None:
    """Write the actor for :func:`agents.learned.trained.load_trained`.

    Raises:
        Diverged: a weight is not finite; an older policy stays.
    """
    tensors = _actor(model)
    _refuse_infinite(tensors)
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


def save(directory: Path, model: LeanSAC, settings: TrainSettings, seconds: float) -> None:
    """Write weights, optimizers, counters and the replay buffer.

    Raises:
        Diverged: one of them is not finite; the last checkpoint stays.
    """
    check_finite(model)
    buffer = _buffer(model)
    stored = {f"buffer.{name}": value for name, value in buffer.get_state().items()}
    record = {
        "settings": settings.model_dump(mode="json"),
        "steps": model.num_timesteps,
        "updates": model._n_updates,
        "seconds": seconds,
        "position": buffer.pos,
        "full": buffer.full,
    }
    save_set(directory / FILE, KIND, _weights(model) | _adam(model) | stored, record)


def restore(directory: Path, model: LeanSAC, settings: TrainSettings) -> float:
    """Take ``model`` to the last checkpoint in ``directory``, if there is one; its episodes begin anew.

    Returns:
        Seconds trained before.

    Raises:
        ValueError: the checkpoint is damaged or not finite, or belongs to other settings; ``model`` is unchanged.
    """
    path = directory / FILE
    if not path.exists():
        return 0.0
    tensors, record = load_set(path, KIND)
    mine, theirs = settings.model_dump(mode="json"), record.get("settings")
    names = [key for key in mine if not isinstance(theirs, dict) or theirs.get(key) != mine[key]]
    if set(names) - FREE:
        allowed = "a checkpoint of the same settings; remove it or choose another output"
        raise checks.refuse(str(path), f"other {', '.join(names)}", allowed)
    steps = checks.count(f"{path}: steps", record.get("steps"), least=0, most=MOST_STEPS)
    updates = checks.count(f"{path}: updates", record.get("updates"), least=0, most=MOST_STEPS)
    seconds = checks.number(f"{path}: seconds", record.get("seconds"), least=0.0)
    buffer = _buffer(model)
    full = checks.flag(f"{path}: full", record.get("full"))
    position = checks.count(f"{path}: position", record.get("position"), least=0, most=buffer.buffer_size - 1)
    stored = {name[7:]: tensors.pop(name) for name in list(tensors) if name.startswith("buffer.")}
    buffer.check_state(f"{path}: buffer", stored, position, full)
    tensors = as_float32(str(path), tensors)
    shapes = {name: value.shape for name, value in _weights(model).items()}
    states: dict[str, dict[str, Any]] = {}
    for which, optimizer in _optimizers(model).items():
        states[which] = {**optimizer.state_dict(), "state": {}}
        for index, parameter in enumerate(p for group in optimizer.param_groups for p in group["params"]):
            prefix = f"adam.{which}.{index}"
            if f"{prefix}.step" in tensors:
                shapes |= {f"{prefix}.step": (1,), **{f"{prefix}.{n}": tuple(parameter.shape) for n in ADAM[1:]}}
                states[which]["state"][index] = {
                    n: torch.from_numpy(tensors[f"{prefix}.{n}"]) for n in ADAM if f"{prefix}.{n}" in tensors
                }
                states[which]["state"][index]["step"].squeeze_()  # numbers come back as arrays of one
    if any(name not in tensors or tensors[name].shape != shape for name, shape in shapes.items()):
        raise checks.refuse(str(path), "tensors of another network", "a checkpoint of the same settings")
    weights = {name[7:]: torch.from_numpy(value) for name, value in tensors.items() if name.startswith("policy.")}
    model.policy.load_state_dict({name: weights[name] for name in model.policy.state_dict()})
    assert model.log_ent_coef is not None
    with torch.no_grad():
        model.log_ent_coef.copy_(torch.from_numpy(tensors["log_ent_coef"]))
    for which, optimizer in _optimizers(model).items():
        optimizer.load_state_dict(states[which])
    buffer.set_state(stored, position, full)
    model.num_timesteps, model._n_updates = steps, updates
    return seconds


def check_finite(model: LeanSAC) -> None:
    """Raise :class:`Diverged` where a weight, or what an optimizer remembers of it, is not finite."""
    _refuse_infinite(_weights(model) | _adam(model))


def _refuse_infinite(tensors: dict[str, np.ndarray]) -> None:
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise Diverged(f"NaN or infinity in {name}")


def _weights(model: LeanSAC) -> dict[str, np.ndarray]:
    assert model.log_ent_coef is not None
    tensors = {f"policy.{name}": _numpy(value) for name, value in model.policy.state_dict().items()}
    return tensors | {"log_ent_coef": _numpy(model.log_ent_coef)}


def _optimizers(model: LeanSAC) -> dict[str, torch.optim.Optimizer]:
    assert model.ent_coef_optimizer is not None
    return {
        "actor": model.actor.optimizer, "critic": model.critic.optimizer, "ent_coef": model.ent_coef_optimizer
    }  # fmt: skip


def _adam(model: LeanSAC) -> dict[str, np.ndarray]:
    found = {}
    for which, optimizer in _optimizers(model).items():
        for index, state in optimizer.state_dict()["state"].items():
            found |= {f"adam.{which}.{index}.{name}": _numpy(state[name]) for name in ADAM}
    return found


def _layers(model: LeanSAC) -> dict[str, torch.nn.Linear]:
    hidden = [each for each in model.actor.latent_pi if isinstance(each, torch.nn.Linear)]
    named = {f"layer{k}": layer for k, layer in enumerate(hidden)}
    last = {"mean": model.actor.mu, "log_std": model.actor.log_std}
    assert all(isinstance(layer, torch.nn.Linear) for layer in last.values())
    return named | last  # type: ignore[operator]


def _actor(model: LeanSAC) -> dict[str, np.ndarray]:
    tensors = {}
    for name, layer in _layers(model).items():
        tensors |= {f"{name}.weight": _numpy(layer.weight), f"{name}.bias": _numpy(layer.bias)}
    return tensors


def _buffer(model: LeanSAC) -> HindsightBuffer:
    assert isinstance(model.replay_buffer, HindsightBuffer)
    return model.replay_buffer


def _env(model: LeanSAC) -> StableBaselinesAdapter:
    env = model.get_env()
    assert isinstance(env, StableBaselinesAdapter)
    return env


def _numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy().copy()
