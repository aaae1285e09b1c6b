"""Model-predictive path integral control: plans are sampled, simulated, and weighted by the reward of each part.

See Williams et al., "Information theoretic MPC for model-based reinforcement learning", ICRA 2017. A plan is a sequence of
actions, samples are the plan plus noise, and the new plan is their mean, weighted by the exponential of their rewards. In
addition rewards and weights are computed part by part, so that sixteen parts need no more samples than one. The best sample so
far is executed. With a base policy, samples are changes of the base's actions.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.envs.actions import ACTIONS, actions_by_part
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.registry import make_policy
from vibgym.policies.simulated import MODEL_WORLDS, Models, measured_rows, rows_of
from vibgym.policies.task_info import TaskInfo
from vibgym.settings import BaseSettings

WIDTHS = (1.0, 0.3, 0.1)  # factors of the noise of successive samples: wide far from the goal, narrow at the goal
KNOTS = 12  # steps between the random values of a plan, which is interpolated linearly
COLDNESS = 10.0  # exponent of the weights from the mean to the best sample


class MpcPlan(NamedTuple):
    """Memory of :class:`MPCPolicy`."""

    change: np.ndarray  # (batch, horizon, size) of the base's actions, or of zeros
    drift: np.ndarray  # (batch, 2, parts, 3), see Model.drift
    age: np.ndarray  # (batch,) int64, steps of the episode


class MPCPolicy:
    """Simulates plans from the measured state and executes the one with the highest reward.

    It uses public properties of task and scene, observations, and the task's rewards. Plans of one world depend on ``seed`` and
    its observations only.

    Args:
        info: task and scene.
        settings: of the planning. The base has the observation ``"state"`` and the same action.

    Raises:
        ValueError: an action without a share for every part, a task with moving goals, or a base with another action.
    """

    class Settings(BaseSettings):
        """Settings of the planning."""

        samples: int = Field(default=32, ge=4, le=100_000)
        """Plans per iteration."""

        horizon: int = Field(default=12, ge=1, le=10_000)
        """Steps of a plan."""

        iterations: int = Field(default=2, ge=1, le=1000)
        """Number of sampling rounds, each around the result of the one before."""

        noise: float = Field(default=0.5, gt=0.0, le=10.0)
        """Standard deviation of the samples, of actions in [-1, 1]."""

        base: Any = None
        """None, or a policy whose actions plans begin with, as ``vibgym.make_policy`` takes it."""

        action: str | None = None
        """Any with a share for every part. None: ``"field"``, under which parts brake by themselves at zero; with a base
        ``"wrench"``, which most of them have."""

        seed: int = Field(default=0, ge=0)
        """Of the samples."""

    observation = "state"

    @staticmethod
    def supports(action: str) -> bool:
        """Return whether plans can have the environment's ``action=``."""
        return ACTIONS[action].by_part

    def __init__(self, info: TaskInfo, settings: Settings) -> None:
        base, action = settings.base, settings.action
        if base is not None:
            action = action or "wrench"
            base = make_policy(base, info, settings.seed, action)
        self.action = checks.choice("action", action or "field", actions_by_part())
        self.info, self.base, self.settings = info, base, settings
        self.samples, self.horizon = settings.samples, settings.horizon
        self.together = max(1, MODEL_WORLDS // self.samples)  # worlds planned at a time
        self._models = Models(info, "mpc", self.action)
        self.rest, self.size, self.parts = self._models[1].rest, self._models[1].core.action.size, len(info.parts)
        if base is not None:
            checks.choice("base.action", base.action, (self.action,))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions from measured poses and mean velocities; the state is a :class:`MpcPlan` and the base's memory."""
        measured = Measured.of(observation, self.info)
        batch = len(measured.centre)
        first = MpcPlan(np.zeros((1, self.horizon, self.size)), self.rest[None], np.zeros(1, dtype=np.int64))
        own, based = (None, None) if state is None else state
        plan, _ = recall(own, episode_start, first, batch)
        reference = np.zeros((batch, self.size)), None
        if self.base is not None:
            reference = self.base.predict(np.atleast_2d(observation), based, episode_start, deterministic)
        action, after = np.empty((batch, self.size), dtype=np.float32), plan._replace(age=plan.age + 1)
        for low in range(0, batch, self.together):
            some = np.arange(low, min(low + self.together, batch))
            seen, drift = measured_rows(measured, some), plan.drift[some]
            usual = self._usual(seen, drift, reference[0][some], rows_of(reference[1], some))
            best, after.drift[some] = self._searched(seen, drift, usual, plan.change[some], plan.age[some])
            action[some] = np.clip(usual[:, 0] + best[:, 0], -1.0, 1.0)
            after.change[some, :-1], after.change[some, -1] = best[:, 1:], 0.0
        return (action[0] if measured.single else action), (after, reference[1])

    def _usual(self, seen: Measured, drift: np.ndarray, action: np.ndarray, memory: Any) -> np.ndarray:
        """Return the base's actions over the horizon (worlds, horizon, size); zeros without a base."""
        worlds = len(action)
        result = np.zeros((worlds, self.horizon, self.size))
        if self.base is None:
            return result
        model, going_on = self._models[worlds], np.zeros(worlds, dtype=bool)
        model.begin(seen, drift)
        for step in range(self.horizon):
            result[:, step] = action
            if step + 1 < self.horizon:
                model.step(action)
                action, memory = self.base.predict(model.core.pipeline.observations, memory, going_on)
        return result

    def _searched(
        self, seen: Measured, drift: np.ndarray, usual: np.ndarray, change: np.ndarray, age: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the best changes (worlds, horizon, size) of the base's actions, and the drift after their first step."""
        worlds, everyone = len(usual), np.arange(len(usual))
        repeated = np.repeat(everyone, self.samples)
        seen, begun = measured_rows(seen, repeated), drift[repeated]
        best, most = change, np.full(worlds, -np.inf)
        for iteration in range(self.settings.iterations):
            tried = change[:, None] + self._noise(age, iteration)
            tried[:, 0], tried[:, 1], tried[:, 2] = 0.0, change, best
            tried = np.clip(usual[:, None] + tried, -1.0, 1.0) - usual[:, None]
            actions = (usual[:, None] + tried).reshape(-1, self.horizon, self.size)
            earned, then = (
                result.reshape(worlds, self.samples, *result.shape[1:]) for result in self._tried(seen, begun, actions)
            )
            whole = earned.sum(axis=2)
            first = whole.argmax(axis=1)
            better = whole[everyone, first] > most
            most = np.where(better, whole[everyone, first], most)
            best = np.where(better[:, None, None], tried[everyone, first], best)
            drift = np.where(better[:, None, None, None], then[everyone, first], drift)
            weight = _weights(earned)
            changes = tried.reshape(*tried.shape[:3], self.parts, -1)
            change = np.einsum("wsp,wstpn->wtpn", weight, changes).reshape(change.shape)
        return best, drift

    def _tried(self, seen: Measured, drift: np.ndarray, actions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the rewards (worlds, parts) of plans (worlds, horizon, size), and the drift after the first step."""
        model = self._models[len(actions)]
        model.begin(seen, drift)
        earned = model.step(actions[:, 0])
        after = model.drift()
        for step in range(1, self.horizon):
            earned += model.step(actions[:, step])
        return earned, after

    def _noise(self, age: np.ndarray, iteration: int) -> np.ndarray:
        """Return noise (worlds, samples, horizon, size): normal values at knots, linear between, in several widths."""
        knots = -(-self.horizon // KNOTS) + 1
        at = np.arange(self.horizon) / KNOTS
        low, part = at.astype(int), (at % 1.0)[:, None]
        width = self.settings.noise * np.resize(WIDTHS, self.samples)[:, None, None]
        result = np.empty((len(age), self.samples, self.horizon, self.size))
        for world, steps in enumerate(age.tolist()):
            generator = np.random.default_rng([self.settings.seed, steps, iteration])
            drawn = generator.standard_normal((self.samples, knots, self.size))
            result[world] = width * ((1.0 - part) * drawn[:, low] + part * drawn[:, low + 1])
        return result


def _weights(earned: np.ndarray) -> np.ndarray:
    """Return weights of the samples (worlds, samples, parts) from their rewards, part by part."""
    best, mean = earned.max(axis=1, keepdims=True), earned.mean(axis=1, keepdims=True)
    weight = np.exp(COLDNESS * (earned - best) / np.maximum(best - mean, 1e-9))
    return weight / weight.sum(axis=1, keepdims=True)
