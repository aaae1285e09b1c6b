"""Data sets of Minari."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from minari.data_collector import EpisodeBuffer

from agents.recording.play import Episode

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable with the directory of Minari's data sets."""

SCENE = "vibgym_scene"
"""Key of the scene in the metadata of a data set."""

FILE = "main_data.hdf5"
"""File of all episodes."""


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


@contextmanager
def kept_in(directory: str | None) -> Iterator[None]:
    """Set the directory of Minari's data sets within a block; None: unchanged."""
    before = os.environ.get(ROOT)
    if directory is not None:
        os.environ[ROOT] = os.path.abspath(directory)
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(ROOT, None)
        else:
            os.environ[ROOT] = before
