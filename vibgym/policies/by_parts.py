"""Policies where the parts of worlds differ: one for each combination of parts that a world has."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.policies.simulated import rows_of
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.scene.kinds import Kinds, groups_of

MAX_POLICIES = 256
"""Policies that are kept."""


class ByParts:
    """Acts in every world by the policy that is made for the world's present parts.

    The state of a call is that of each policy, by the parts that it is for, and the worlds that it acts in.

    Args:
        make: returns the policy of a scene.
        info: of the environment.

    Attributes:
        kinds: parts of the worlds in which it acts, live; those of the environment of ``info`` unless set.
        action, observation: of the policies.
    """

    def __init__(self, make: Callable[[TaskInfo], Policy], info: TaskInfo) -> None:
        assert info.worlds is not None
        self._make, self._info, self.kinds = make, info, info.worlds
        self._made: dict[bytes, Policy] = {}
        first = self._policy(self.kinds, self.kinds.kind[0])
        self.action, self.observation = first.action, first.observation

    def _policy(self, kinds: Kinds, own: np.ndarray) -> Policy:
        """Return the policy for parts of these kinds (parts,)."""
        key = own.tobytes()
        if key not in self._made:
            if len(self._made) == MAX_POLICIES:
                self._made.clear()
            self._made[key] = self._make(self._info.with_parts([kinds.every[kind] for kind in own.tolist()]))
        return self._made[key]

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """See :class:`vibgym.policies.task_info.Policy`; the batch is that of all worlds of :attr:`kinds`.

        Raises:
            ValueError: another number of observations than worlds.
        """
        kinds, before = self.kinds, {} if state is None else state
        numbers = observation
        if isinstance(observation, dict):
            numbers = observation.get("mask", next(iter(observation.values())))
        if np.ndim(numbers) in (1, 3):  # a flat observation or an image
            return self._single(observation, before, episode_start, deterministic)
        if len(numbers) != len(kinds.kind):
            raise checks.refuse("observation", f"a batch of {len(numbers)}", f"one of the {len(kinds.kind)} worlds")
        begun = np.zeros(len(numbers), dtype=bool) if episode_start is None else np.asarray(episode_start, dtype=bool)
        action, after = np.empty(0), {}
        for own, worlds in groups_of(kinds.kind):
            memory, new = _memory_of(before.get(own.tobytes()), worlds, begun[worlds])
            by_name = isinstance(observation, dict)
            seen = {k: values[worlds] for k, values in observation.items()} if by_name else numbers[worlds]
            chosen, memory = self._policy(kinds, own).predict(seen, memory, new, deterministic)
            if not len(action):
                action = np.empty((len(numbers), *np.shape(chosen)[1:]), dtype=np.asarray(chosen).dtype)
            action[worlds] = chosen
            after[own.tobytes()] = worlds, memory
        return action, after

    def _single(self, observation: Any, before: Any, episode_start: Any, deterministic: bool) -> tuple[np.ndarray, Any]:
        """Return the action for one observation, of the first world."""
        own = self.kinds.kind[0]
        _, memory = before.get(own.tobytes(), (None, None))
        action, memory = self._policy(self.kinds, own).predict(observation, memory, episode_start, deterministic)
        return action, {own.tobytes(): (None, memory)}


def _memory_of(before: Any, worlds: np.ndarray, begun: np.ndarray) -> tuple[Any, np.ndarray]:
    """Return the state of a policy for ``worlds`` (n,), and where it begins anew, (n,) bool.

    Args:
        before: worlds and state of its last call; None: it has not been called.
        begun: (n,) bool, where an episode has just begun.
    """
    if before is None:
        return None, np.ones(len(worlds), dtype=bool)
    acted, memory = before
    if np.array_equal(acted, worlds):
        return memory, begun
    at = np.searchsorted(acted, worlds)
    at = np.where(at < len(acted), at, 0)
    known = acted[at] == worlds
    return rows_of(memory, at), begun | ~known
