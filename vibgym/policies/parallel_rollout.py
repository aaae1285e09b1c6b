"""Parallel rollout: several policies are simulated from the measured state, and the one that does best acts for a while.

See Bertsekas, Tsitsiklis and Wu, "Rollout algorithms for combinatorial optimization", Journal of Heuristics 1997, and, for
several policies, Chang, Givan and Chong, "Parallel rollout for online solution of partially observable Markov decision
processes", Discrete Event Dynamic Systems 2004. In an exact model, changing over to the policy that ends first is never slower
than keeping to one of them, and chance helps: a policy that jams or falls in one of fifty episodes seldom does so where another
one does. Learned agents, controllers, and one controller with several settings can be combined.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.policies.classical.measured import Measured, recall
from vibgym.policies.registry import make_policy
from vibgym.policies.simulated import MODEL_WORLDS, Models, measured_rows, rows_of
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.settings import BaseSettings

READ = {"state": ("state",), "parts": ("parts", "mask"), "parts_and_state": ("parts", "mask", "state")}
"""Observations that the policies may have, and their entries in that of all."""

Seen = Mapping[str, np.ndarray]
"""Entries of :data:`READ`, each (worlds, ...)."""


class RolloutMemory(NamedTuple):
    """Memory of :class:`ParallelRolloutPolicy`, in addition to those of its policies."""

    acting: np.ndarray  # (batch,) int64, index of the policy that acts
    age: np.ndarray  # (batch,) int64, steps of the episode
    drift: np.ndarray  # (batch, 2, parts, 3), see Model.drift


class ParallelRolloutPolicy:
    """Simulates every policy from the measured state at regular intervals; the one that does best acts until the next time.

    Best is the one that succeeds first, or, if none does within the horizon, the one with the highest return. The policy that
    acts stays if none is better. One that takes over begins without a memory, as in its simulation. The simulation is of ideal
    hardware. Worlds are independent of each other.

    Args:
        info: task and scene.
        settings: of the choice. All policies have the same action; the first acts if all do equally well.

    Raises:
        ValueError: another action or observation, or a task with moving goals.
    """

    class Settings(BaseSettings):
        """Policies, and settings of the choice."""

        policies: tuple[Any, ...] = Field(min_length=1)
        """Each as ``vibgym.make_policy`` takes it."""

        action: str | None = None
        """Of policies that support several. None: that of the first policy."""

        every: int = Field(default=15, ge=1, le=10_000)
        """Steps between choices."""

        horizon: int = Field(default=100, ge=1, le=10_000)
        """Simulated steps."""

    @staticmethod
    def supports(action: str) -> bool:
        """Return whether policies may have the environment's ``action=``: any."""
        return True

    def __init__(self, info: TaskInfo, settings: Settings) -> None:
        made: list[Policy] = []
        for policy in settings.policies:
            made.append(make_policy(policy, info, action=settings.action or (made[0].action if made else None)))
        self.policies, self.action = tuple(made), made[0].action
        for index, policy in enumerate(self.policies):
            checks.choice(f"policies[{index}].action", policy.action, (self.action,))
            checks.choice(f"policies[{index}].observation", policy.observation, READ)
        flat = all(policy.observation == "state" for policy in self.policies)
        self.observation = "state" if flat else "parts_and_state"
        self.info, self.settings = info, settings
        self._models = Models(info, "parallel_rollout", self.action, self.observation)
        self._rest = self._models[1].rest

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions; the state is a :class:`RolloutMemory` and the memories of all policies."""
        entries = observation if isinstance(observation, Mapping) else {"state": observation}
        measured = Measured.of(entries["state"], self.info)
        seen = {name: np.asarray(rows)[None] if measured.single else np.asarray(rows) for name, rows in entries.items()}
        batch, (own, memories) = len(measured.centre), (None, (None,) * len(self.policies)) if state is None else state
        zeros = np.zeros(1, dtype=np.int64)
        own, begun = recall(own, episode_start, RolloutMemory(zeros, zeros, self._rest[None]), batch)
        begun = begun.copy()  # also of a policy that takes over
        together, due = max(1, MODEL_WORLDS // len(self.policies)), np.flatnonzero(own.age % self.settings.every == 0)
        for some in np.split(due, range(together, len(due), together)):
            best = self._best(seen, measured, own, memories, begun, some)
            begun[some] |= best != own.acting[some]
            own.acting[some] = best
        model, after = self._models[batch], list(memories)
        action = np.empty((batch, model.core.action.size), dtype=np.float32)
        for index in np.unique(own.acting).tolist():
            answers, after[index] = self._ask(index, seen, memories[index], begun, deterministic)
            action[own.acting == index] = answers[own.acting == index]
        model.begin(measured, own.drift)
        model.step(action)
        return (action[0] if measured.single else action), (
            RolloutMemory(own.acting, own.age + 1, model.drift()),
            tuple(after),
        )

    def _best(
        self,
        seen: Seen,
        measured: Measured,
        own: RolloutMemory,
        memories: tuple[Any, ...],
        begun: np.ndarray,
        some: np.ndarray,
    ) -> np.ndarray:
        """Return the index of the best policy in each of some worlds (index array)."""
        if not len(some):
            return some
        # The number of worlds varies from step to step: repeated up to a power of two, so that few models are made.
        worlds, count = np.resize(some, 1 << (len(some) - 1).bit_length()), len(self.policies)
        rows, acting = np.tile(worlds, count), own.acting[worlds] == np.arange(count)[:, None]
        model = self._models[len(rows)]
        model.begin(measured_rows(measured, rows), own.drift[rows])
        shares = [{name: entry[worlds] for name, entry in seen.items()}] * count
        states, fresh = [rows_of(memory, worlds) for memory in memories], begun[worlds] | ~acting
        earned, end = np.zeros(len(rows)), np.full(len(rows), np.inf)
        for step in range(self.settings.horizon):
            answers = [self._ask(k, shares[k], states[k], fresh[k], True) for k in range(count)]
            states, running = [state for _, state in answers], ~model.over
            earned += model.step(np.concatenate([action for action, _ in answers])).sum(axis=1)
            end[running & model.core.episode.success] = step
            won, over = np.isfinite(end).reshape(count, -1), model.over.reshape(count, -1)
            if (won.any(axis=0) | over.all(axis=0)).all():  # any other success would be later
                break
            shares, fresh = self._split(model.core.pipeline.observations, len(worlds)), np.zeros_like(fresh)
        earned = np.where(np.isfinite(earned), earned, -np.inf)
        order = np.lexsort((~acting, -earned.reshape(count, -1), end.reshape(count, -1)), axis=0)
        return order[0, : len(some)]

    def _split(self, observations: Any, worlds: int) -> list[Seen]:
        """Return the observations of each policy's worlds."""
        entries = observations if isinstance(observations, Mapping) else {"state": observations}
        starts = range(0, worlds * len(self.policies), worlds)
        return [{name: entry[start : start + worlds] for name, entry in entries.items()} for start in starts]

    def _ask(
        self, index: int, seen: Seen, memory: Any, begun: np.ndarray, deterministic: bool
    ) -> tuple[np.ndarray, Any]:
        """Return the actions (worlds, size) and the memory of a policy."""
        policy = self.policies[index]
        names = READ[policy.observation]
        read: Any = seen["state"] if names == ("state",) else {name: seen[name] for name in names}
        return policy.predict(read, memory, begun, deterministic)
