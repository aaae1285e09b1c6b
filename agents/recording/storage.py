"""The file of a Minari data set, in Minari's layout.

Minari writes every array in resizable chunks, which takes longer than the simulation of an episode of some tens of steps. Here
every array is one compact object, in a quarter of that time; Minari reads both.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import h5py
import numpy as np
from h5py import h5a, h5d, h5g, h5p, h5s, h5t  # type: ignore[attr-defined]

from agents.recording.play import Episode

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable with the directory of Minari's data sets."""

SCENE = "vibgym_scene"
"""Key of the scene in the metadata of a data set."""

FILE = "main_data.hdf5"
MOST_COMPACT = 60_000
"""Largest array that is stored in its header, bytes; HDF5 allows 64 KiB."""


def write(directory: Path, episodes: Iterable[Episode]) -> tuple[int, int]:
    """Add episodes to an empty data set of Minari; return the numbers of episodes and steps.

    Args:
        directory: of its data.
        episodes: in order.

    Raises:
        OSError: no space is left, for instance.
    """
    count = steps = 0
    with h5py.File(directory / FILE, "r+") as file:
        writer = _Writer()
        for episode in episodes:
            writer.episode(file.id, f"episode_{count}", count, episode)
            count, steps = count + 1, steps + len(episode.rewards)
    return count, steps


class _Writer:
    """Writer of arrays and attributes, with shared HDF5 types."""

    def __init__(self) -> None:
        self.compact, self.large = (h5p.create(h5p.DATASET_CREATE) for _ in range(2))
        self.compact.set_layout(h5d.COMPACT)
        self.scalar = h5s.create(h5s.SCALAR)
        self.types: dict[np.dtype, Any] = {}

    def episode(self, file: Any, name: str, number: int, episode: Episode) -> None:
        group, ends = h5g.create(file, name.encode()), np.zeros((2, len(episode.rewards)), dtype=bool)
        ends[:, -1] = episode.terminated, episode.truncated
        facts = {
            "id": number,
            "seed": episode.seed,
            "total_steps": len(episode.rewards),
            "success": episode.success,
            **{f"drawn_{key}": value for key, value in episode.drawn.items()},
        }
        for key, value in facts.items():
            self.attribute(group, key, np.asarray(value))
        if isinstance(episode.observations, dict):
            inner = h5g.create(group, b"observations")
            for key, value in episode.observations.items():
                self.array(inner, key, value)
        else:
            self.array(group, "observations", episode.observations)
        self.array(group, "actions", episode.actions)
        self.array(group, "rewards", episode.rewards)
        self.array(group, "terminations", ends[0])
        self.array(group, "truncations", ends[1])

    def array(self, group: Any, name: str, value: np.ndarray) -> None:
        value = np.ascontiguousarray(value)
        how = self.compact if value.nbytes <= MOST_COMPACT else self.large
        kind = self.type(value.dtype)
        h5d.create(group, name.encode(), kind, h5s.create_simple(value.shape), how).write(h5s.ALL, h5s.ALL, value, kind)

    def attribute(self, group: Any, name: str, value: np.ndarray) -> None:
        space = h5s.create_simple(value.shape) if value.shape else self.scalar
        kind = self.type(value.dtype)
        h5a.create(group, name.encode(), kind, space).write(np.ascontiguousarray(value), kind)

    def type(self, dtype: np.dtype) -> Any:
        if dtype not in self.types:
            self.types[dtype] = h5t.py_create(dtype, logical=True)
        return self.types[dtype]


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
