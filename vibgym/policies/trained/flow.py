"""Policies that sample a sequence of actions by flow matching, and execute its beginning.

The distribution of actions can have several modes, such as the sides from which a part can be pushed; the mean of two of them
is often no good action. A network gives the rate at which a sample of noise becomes a sequence of actions (Lipman et al., "Flow
matching for generative modeling", ICLR 2023; Liu, Gong and Liu, "Flow straight and fast", ICLR 2023). Sequences and their
execution are those of diffusion policies (Chi et al., "Diffusion policy", RSS 2023).
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.policies.classical.measured import recall
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.networks import ENCODERS, Tensors, linear

MAX_HORIZON = 64
TIMES = 8
"""Sines and cosines of the time of the flow."""

EPSILON = np.float32(1e-5)
"""Of torch's layer normalization."""


class FlowPlan(NamedTuple):
    """Memory of a policy."""

    inputs: Any  # of the last step
    actions: np.ndarray  # (worlds, rows, horizon, values) network outputs
    age: np.ndarray  # (worlds,) int64, actions of it that have been executed
    count: np.ndarray  # (worlds,) int64, plans since the start of the episode


def times(t: np.ndarray) -> np.ndarray:
    """Return the network's input (..., 1 + 2 * TIMES) for times (..., 1), 0 (noise) to 1 (actions)."""
    phase = (np.float32(np.pi) * np.arange(1, TIMES + 1, dtype=np.float32)) * t
    return np.concatenate([t, np.sin(phase), np.cos(phase)], axis=-1)


def rate(tensors: Tensors, code: np.ndarray, sample: np.ndarray, t: float) -> np.ndarray:
    """Apply :class:`agents.flow.FlowActor` after its encoder: the rate of change of a sample (..., horizon * values)."""
    instant = np.full((*code.shape[:-1], 1), t, dtype=np.float32)
    x = linear(tensors, "first", np.concatenate([code, sample, times(instant)], axis=-1))
    block = 0
    while f"blocks.{block}.0.weight" in tensors:
        mean = x.mean(axis=-1, keepdims=True)
        centred = x - mean
        deviation = np.sqrt((centred * centred).mean(axis=-1, keepdims=True) + EPSILON)
        y = centred / deviation * tensors[f"blocks.{block}.0.weight"] + tensors[f"blocks.{block}.0.bias"]
        x = x + linear(tensors, f"blocks.{block}.3", _silu(linear(tensors, f"blocks.{block}.1", y)))
        block += 1
    return linear(tensors, "last", _silu(x))


def _silu(x: np.ndarray) -> np.ndarray:
    return x / (1.0 + np.exp(-x))


class FlowPolicy:
    """A network that samples sequences of actions.

    With ``deterministic`` the noise depends only on the number of plans since the start of the episode, so that episodes can be
    repeated, alone and in batches.

    Args:
        tensors: of :class:`agents.flow.FlowActor`, float32, under torch's names.
        network: name of its encoder, among :data:`vibgym.policies.trained.networks.ENCODERS`.
        coding: of the environment.
        flow: ``horizon``, actions of a plan; ``executed``, those that are executed before the next one; ``steps`` of Euler's
            method from noise to actions; ``scale`` of actions.

    Raises:
        ValueError: an invalid ``flow``.
    """

    def __init__(self, tensors: Mapping[str, np.ndarray], network: str, coding: Coding, flow: Any) -> None:
        self.tensors, self.coding = tensors, coding
        self.action, self.observation = coding.action, coding.observation
        if not isinstance(flow, dict) or set(flow) != {"horizon", "executed", "steps", "scale"}:
            raise checks.refuse("flow", flow, "a mapping of 'horizon', 'executed', 'steps' and 'scale'")
        self.horizon = checks.count("flow.horizon", flow["horizon"], most=MAX_HORIZON)
        self.executed = checks.count("flow.executed", flow["executed"], most=self.horizon)
        self.euler = checks.count("flow.steps", flow["steps"], most=1000)
        self.scale = np.float32(checks.number("flow.scale", flow["scale"], above=0.0, most=10.0))
        self._encode = ENCODERS[checks.choice("network", network, tuple(ENCODERS))]
        self.generator, self._noises = np.random.default_rng(0), list[np.ndarray]()

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions in [-1, 1] for one observation or a batch; the state is a :class:`FlowPlan`."""
        inputs = self.coding.encode(observation, getattr(state, "inputs", None), episode_start)
        worlds, rows = inputs.rows.shape[:2]
        zeros = np.zeros(1, dtype=np.int64)
        first = FlowPlan(
            (), np.zeros((1, rows, self.horizon, self.coding.shape.action), dtype=np.float32), zeros, zeros
        )
        own = state._replace(inputs=()) if isinstance(state, FlowPlan) else state
        plan, begins = recall(own, episode_start, first, worlds)
        due = begins | (plan.age >= self.executed)
        actions, age = plan.actions, np.where(due, 0, plan.age)
        if due.any():
            noise = self._noise(plan.count[due], rows, deterministic)
            actions[due] = self.plan(inputs.rows[due], noise).reshape(-1, *actions.shape[1:])
        of_parts = actions[np.arange(worlds), :, age]
        done = self.coding.decode(inputs, np.clip(of_parts, -1.0, 1.0).astype(np.float32))
        single = self.coding.single(observation)
        return (done[0] if single else done), FlowPlan(inputs, actions, age + 1, plan.count + due)

    def outputs(self, rows: np.ndarray) -> tuple[np.ndarray, ...]:
        """Return the actions (worlds, rows, values) of a plan from zero noise, one array for each step of the horizon."""
        noise = np.zeros((*rows.shape[:2], self.horizon * self.coding.shape.action), dtype=np.float32)
        return tuple(np.split(self.plan(rows, noise), self.horizon, axis=-1))

    def plan(self, rows: np.ndarray, noise: np.ndarray) -> np.ndarray:
        """Return network outputs (worlds, rows, horizon * values) for rows and standard normal noise of the same shape."""
        code = self._encode(self.tensors, self.coding.shape, rows)
        sample = noise
        for step in range(self.euler):
            sample = sample + rate(self.tensors, code, sample, step / self.euler) / np.float32(self.euler)
        return sample * self.scale

    def _noise(self, count: np.ndarray, rows: int, deterministic: bool) -> np.ndarray:
        """Return standard normal noise (worlds, rows, horizon * values) for the numbers of plans."""
        shape = (rows, self.horizon * self.coding.shape.action)
        if not deterministic:
            return self.generator.standard_normal((len(count), *shape), dtype=np.float32)
        while len(self._noises) <= count.max():
            stream = np.random.default_rng([0, len(self._noises)])
            self._noises.append(stream.standard_normal(shape, dtype=np.float32))
        return np.stack([self._noises[number] for number in count])
