"""Episodes of a policy: played step by step, and kept as data sets of Minari."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
from minari.data_collector import EpisodeBuffer

from vibgym.policies.rollout import Episodes

SCENE = "vibgym_scene"
"""Key of the scene in the metadata of a data set."""

FILE = "main_data.hdf5"
"""File of all episodes."""


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


def write(dataset: Any, episodes: Iterable[Episode]) -> float:
    """Add episodes to an empty data set of Minari; return the mean of their returns.

    Raises:
        OSError: no space is left, for instance.
    """
    returns, metadata = list[float](), list[dict[str, Any]]()

    def buffers() -> Iterator[EpisodeBuffer]:
        for episode in episodes:
            returns.append(float(episode.rewards.sum()))
            drawn = {f"drawn_{name}": value for name, value in episode.drawn.items()}
            metadata.append({"success": episode.success, **drawn})
            ends = np.zeros((2, len(episode.rewards)), dtype=bool)
            ends[:, -1] = episode.terminated, episode.truncated
            data: Any = episode.observations, episode.actions, episode.rewards, *ends
            yield EpisodeBuffer(None, episode.seed, None, *data)

    dataset.storage.update_episodes(buffers())
    dataset.storage.update_episode_metadata(metadata)
    return float(np.mean(returns))


def read(dataset: Any) -> Iterator[Episode]:
    """Yield the episodes of a data set as they were recorded, without randomized values."""
    for episode in dataset.iterate_episodes():
        (own,) = dataset.storage.get_episode_metadata([episode.id])
        ends = bool(episode.terminations[-1]), bool(episode.truncations[-1]), bool(own["success"])
        yield Episode(int(own["seed"]), episode.observations, episode.actions, episode.rewards, *ends, {})
