"""A trained policy: a small network in NumPy, loaded from safetensors and JSON."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from agents.control.measured import check_state
from agents.learned.goal_policy import NETWORK as GOAL
from agents.learned.goal_policy import GoalPolicy, goal_policy
from agents.learned.storage import as_float32, load_set
from agents.task_info import TaskInfo
from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.envs.layout import Layout

KIND = "vibgym-policy"
MOST_LOG_STD = 88.0
"""The exponential of 89 is infinite in float32."""


def _relu(x: np.ndarray) -> np.ndarray:
    return np.maximum(x, 0.0, dtype=np.float32)


ACTIVATIONS: dict[str, Callable[[np.ndarray], np.ndarray]] = {"tanh": np.tanh, "relu": _relu}


class TrainedPolicy:
    """A network trained by PPO; acts by its mean, unless it is asked to explore.

    Hidden layers, then a linear one; float32 throughout.

    Args:
        layers: (weight (out, in), bias (out,)) of each layer.
        layout: of the observations.
        log_std: (size,) logarithm of the exploration's standard deviation.
        action: the environment's ``action=``.
        activation: of the hidden layers, ``"tanh"`` or ``"relu"``.
        seed: of the exploration.
    """

    observation = "state"

    def __init__(
        self,
        layers: list[tuple[np.ndarray, np.ndarray]],
        layout: Layout,
        log_std: np.ndarray,
        action: str,
        activation: str = "tanh",
        seed: int = 0,
    ) -> None:
        self.activation = ACTIVATIONS[activation]
        self.layers = [(weight.T.copy(), bias) for weight, bias in layers]
        self.layout, self.action = layout, action
        self.std = np.exp(log_std)
        self.generator = np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions in [-1, 1] for one observation or a batch; no memory."""
        x = check_state(observation, self.layout).astype(np.float32)
        for weight, bias in self.layers[:-1]:
            x = self.activation(x @ weight + bias)
        weight, bias = self.layers[-1]
        x = x @ weight + bias
        if not deterministic:
            x = x + self.std * self.generator.standard_normal(x.shape, dtype=np.float32)
        return np.clip(x, -1.0, 1.0), state


def load_trained(path: Path, info: TaskInfo) -> TrainedPolicy | GoalPolicy:
    """Load a policy file and check that it fits.

    Raises:
        ValueError: not a policy file, corrupted, not finite in float32, or made for another task, observation or size of
            action.
    """
    tensors, record = load_set(path, KIND)
    name = str(path)
    if record.get("network") == GOAL:
        return goal_policy(name, tensors, record, info)
    if record.get("task") != info.name:
        raise checks.refuse(f"{name}: task", record.get("task"), f"{info.name!r}")
    tensors = as_float32(name, tensors)
    kind = checks.choice(f"{name}: action", record.get("action"), tuple(ACTIONS))
    activation = checks.choice(f"{name}: activation", record.get("activation"), tuple(ACTIVATIONS))
    size = ACTIONS[kind](info.surface, info.parts).size
    layers: list[tuple[np.ndarray, np.ndarray]] = []
    width = info.layout.size
    while f"layer{len(layers)}.weight" in tensors:
        k = len(layers)
        weight, bias = tensors[f"layer{k}.weight"], tensors.get(f"layer{k}.bias")
        if weight.ndim != 2 or weight.shape[1] != width or bias is None or bias.shape != weight.shape[:1]:
            raise checks.refuse(
                f"{name}: layer{k}", f"weight of shape {weight.shape}", f"shape (n, {width}) and a bias"
            )
        layers.append((weight, bias))
        width = weight.shape[0]
    log_std = tensors.get("log_std")
    if not layers or width != size or log_std is None or log_std.shape != (size,):
        raise checks.refuse(f"{name}: layers", f"{len(layers)} layers, {width} outputs", f"{size} outputs and log_std")
    if log_std.max() > MOST_LOG_STD:
        raise checks.refuse(f"{name}: log_std", float(log_std.max()), f"numbers <= {MOST_LOG_STD:g}")
    return TrainedPolicy(layers, info.layout, log_std, kind, activation)
