"""A policy that SAC trained on the flat state: a small network in NumPy."""

from __future__ import annotations

from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.policies.classical.measured import check_state
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.storage import as_float32

NETWORK = "state"
"""What policy files call this form of network."""

LEAST_LOG_STD, MOST_LOG_STD = -20.0, 2.0
"""Limits of Stable-Baselines3's actor."""

Layer = tuple[np.ndarray, np.ndarray]
"""Weight (out, in) and bias (out,)."""


class StatePolicy:
    """An actor of SAC; acts by the hyperbolic tangent of its mean, unless it is asked to explore.

    Hidden layers with rectifiers, then two linear ones side by side, for mean and logarithm of the standard deviation of the
    noise before the tangent; float32 throughout.

    Args:
        tensors: weights and biases of ``layer0``, ``layer1`` and so on, then of ``mean`` and ``log_std``.
        info: of the task that it serves.
        action: the environment's ``action=``.
        seed: of the exploration.
        name: of the file that the tensors are from, for errors.

    Raises:
        ValueError: tensors that are missing, or made for another size of observation or action.
    """

    observation = "state"

    def __init__(
        self, tensors: dict[str, np.ndarray], info: TaskInfo, action: str, seed: int = 0, name: str = "policy"
    ) -> None:
        self.layout, self.action, self.generator = info.layout, action, np.random.default_rng(seed)
        self.hidden: list[Layer] = []
        width = info.layout.size
        while f"layer{len(self.hidden)}.weight" in tensors:
            self.hidden.append(_layer(name, tensors, f"layer{len(self.hidden)}", width))
            width = len(self.hidden[-1][1])
        if not self.hidden:
            raise checks.refuse(f"{name}: tensors", sorted(tensors), "layer0.weight, layer0.bias and so on")
        size = ACTIONS[action](info.surface, info.parts).size
        self.mean, self.log_std = (_layer(name, tensors, last, width, size) for last in ("mean", "log_std"))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Actions in [-1, 1] for one observation or a batch; no memory."""
        x = check_state(observation, self.layout).astype(np.float32)
        for weight, bias in self.hidden:
            x = np.maximum(x @ weight.T + bias, 0.0, dtype=np.float32)
        before = x @ self.mean[0].T + self.mean[1]
        if not deterministic:
            spread = np.exp(np.clip(x @ self.log_std[0].T + self.log_std[1], LEAST_LOG_STD, MOST_LOG_STD))
            before = before + spread * self.generator.standard_normal(before.shape, dtype=np.float32)
        return np.tanh(before), state


def columns_of(info: TaskInfo) -> list[list[Any]]:
    """Names and widths of what the state of a task tells, as policy files have them."""
    return [[row.name, row.width] for row in info.layout.rows]


def state_policy(name: str, tensors: dict[str, np.ndarray], record: dict[str, Any], info: TaskInfo) -> StatePolicy:
    """The policy of a file whose ``network`` is ``"state"``, once it is clear that it fits.

    Args:
        name: of the file.
        tensors, record: what it holds.
        info: of the task that it shall serve.

    Raises:
        ValueError: not finite in float32, or made for another action or other columns of the state.
    """
    action = checks.choice(f"{name}: action", record.get("action"), tuple(ACTIONS))
    if record.get("columns") != columns_of(info):
        raise checks.refuse(f"{name}: columns", record.get("columns"), f"{columns_of(info)!r}, as this task has them")
    return StatePolicy(as_float32(name, tensors), info, action, name=name)


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
