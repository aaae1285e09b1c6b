"""A policy that SAC trained on goal observations: a small network in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.goal_features import GoalFeatures
from vibgym.policies.trained.storage import as_float32

NETWORK = "goal"
"""What policy files call this form of network."""

LEAST_LOG_STD, MOST_LOG_STD = -20.0, 2.0
"""Limits of Stable-Baselines3's actor."""

Layer = tuple[np.ndarray, np.ndarray]
"""Weight (out, in) and bias (out,)."""


class GoalPolicy:
    """An actor of SAC; acts by the hyperbolic tangent of its mean, unless it is asked to explore.

    Hidden layers with rectifiers, then two linear ones side by side, for mean and logarithm of the standard deviation of the
    noise before the tangent; float32 throughout.

    Args:
        hidden: layers, of which the first takes :class:`GoalFeatures`.
        mean, log_std: the last ones.
        features: of the observations.
        action: the environment's ``action=``.
        seed: of the exploration.
    """

    observation = "goal"

    def __init__(
        self, hidden: list[Layer], mean: Layer, log_std: Layer, features: GoalFeatures, action: str, seed: int = 0
    ) -> None:
        self.hidden = [(weight.T.copy(), bias) for weight, bias in hidden]
        self.mean, self.log_std = ((weight.T.copy(), bias) for weight, bias in (mean, log_std))
        self.features, self.action = features, action
        self.generator = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions in [-1, 1] for one observation or a batch; no memory."""
        x = self.features.of(observation)
        for weight, bias in self.hidden:
            x = np.maximum(x @ weight + bias, 0.0, dtype=np.float32)
        before = x @ self.mean[0] + self.mean[1]
        if not deterministic:
            spread = np.exp(np.clip(x @ self.log_std[0] + self.log_std[1], LEAST_LOG_STD, MOST_LOG_STD))
            before = before + spread * self.generator.standard_normal(before.shape, dtype=np.float32)
        return np.tanh(before), state


def goal_policy(name: str, tensors: dict[str, np.ndarray], record: dict[str, Any], info: TaskInfo) -> GoalPolicy:
    """The policy of a file whose ``network`` is ``"goal"``, once it is clear that it fits.

    Args:
        name: of the file.
        tensors, record: what it holds.
        info: of the task that it shall serve.

    Raises:
        ValueError: not finite in float32, or made for another action or size of observation.
    """
    tensors = as_float32(name, tensors)
    action = checks.choice(f"{name}: action", record.get("action"), tuple(ACTIONS))
    features = GoalFeatures(info)
    if record.get("features") != features.described:
        got = f"{record.get('features')!r}"
        raise checks.refuse(f"{name}: features", got, f"{features.described!r}, as this task has them")
    hidden: list[Layer] = []
    width = features.size
    while f"layer{len(hidden)}.weight" in tensors:
        hidden.append(_layer(name, tensors, f"layer{len(hidden)}", width))
        width = len(hidden[-1][1])
    if not hidden:
        raise checks.refuse(f"{name}: tensors", sorted(tensors), "layer0.weight, layer0.bias and so on")
    size = ACTIONS[action](info.surface, info.parts).size
    mean, log_std = (_layer(name, tensors, last, width, size) for last in ("mean", "log_std"))
    return GoalPolicy(hidden, mean, log_std, features, action)


def _layer(name: str, tensors: dict[str, np.ndarray], layer: str, width: int, size: int | None = None) -> Layer:
    """Weight and bias of a layer with ``width`` inputs and, where it is given, ``size`` outputs."""
    weight, bias = tensors.get(f"{layer}.weight"), tensors.get(f"{layer}.bias")
    outputs = "n" if size is None else size
    if (
        weight is None or bias is None or weight.ndim != 2 or weight.shape[1] != width or bias.shape != weight.shape[:1]
        or (size is not None and len(bias) != size)
    ):  # fmt: skip
        got = "no weight" if weight is None else f"weight of shape {weight.shape}"
        raise checks.refuse(f"{name}: {layer}", got, f"shape ({outputs}, {width}) and a bias")
    return weight, bias
