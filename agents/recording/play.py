"""Episodes of a policy, recorded step by step."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from vibgym.policies.rollout import Episodes


class Episode(NamedTuple):
    """Record of an episode."""

    seed: int
    observations: Any  # (steps + 1, ...), or a dictionary of such
    actions: np.ndarray  # (steps, size), as they were done
    rewards: np.ndarray  # (steps,)
    terminated: bool
    truncated: bool
    success: bool
    drawn: dict[str, np.ndarray]  # randomized values of the episode, see ``info["drawn"]``


def play(policy: Any, env: Any, seeds: Sequence[int]) -> Iterator[Episode]:
    """Yield an episode for every seed, in their order. A world whose episode has ended begins the next one.

    Args:
        policy, env: see :class:`vibgym.policies.rollout.Episodes`.
        seeds: of the episodes' resets.
    """
    before, drawn = None, dict[str, np.ndarray]()
    history: list[tuple[Any, np.ndarray, np.ndarray]] = []  # observation before, action and reward of each step
    waiting, due = dict[int, Episode](), 0

    def began(fresh: np.ndarray, observation: Any, info: dict[str, Any]) -> None:
        nonlocal before
        before = observation
        for name, value in info.get("drawn", {}).items():
            if not name.startswith("_"):
                drawn.setdefault(name, np.array(value))[fresh] = value[fresh]

    for step in Episodes(policy, env, seeds, began):
        history.append((before, step.action, step.reward))
        before = step.observation
        for world in np.flatnonzero(step.ended).tolist():
            observations, actions, rewards = zip(*history[-step.age[world] :], strict=True)
            waiting[int(step.episode[world])] = Episode(
                seeds[step.episode[world]],
                _of_world((*observations, before), world),
                _of_world(actions, world),
                _of_world(rewards, world),
                bool(step.terminated[world]),
                bool(step.truncated[world]),
                bool(step.info["is_success"][world]),
                {name: np.copy(value[world]) for name, value in drawn.items()},
            )
        del history[: -step.age[step.playing].max()]  # no episode needs it
        while due in waiting:
            yield waiting.pop(due)
            due += 1


def _of_world(steps: Sequence[Any], world: int) -> Any:
    """Return the values of a world at all steps: an array (steps, ...), or a dictionary of such."""
    if isinstance(steps[0], dict):
        return {name: np.stack([step[name][world] for step in steps]) for name in steps[0]}
    return np.stack([step[world] for step in steps])
