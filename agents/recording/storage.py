"""The file of a Minari data set, in Minari's layout.

Minari writes every array in resizable chunks, which takes longer than the simulation of an episode of some tens of steps. Here
arrays are contiguous; Minari reads both.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

import h5py
import numpy as np

from agents.recording.play import Episode

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable with the directory of Minari's data sets."""

SCENE = "vibgym_scene"
"""Key of the scene in the metadata of a data set."""

FILE = "main_data.hdf5"


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
        for episode in episodes:
            length, seen = len(episode.rewards), episode.observations
            ends = np.zeros((2, length), dtype=bool)
            ends[:, -1] = episode.terminated, episode.truncated
            group = file.create_group(f"episode_{count}")
            group.attrs.update({"id": count, "seed": episode.seed, "total_steps": length, "success": episode.success})
            group.attrs.update({f"drawn_{name}": value for name, value in episode.drawn.items()})
            named = {f"observations/{name}": each for name, each in seen.items()} if isinstance(seen, dict) else {}
            arrays = named or {"observations": seen}
            arrays |= {"actions": episode.actions, "rewards": episode.rewards}
            for name, each in (arrays | dict(zip(("terminations", "truncations"), ends, strict=True))).items():
                group.create_dataset(name, data=each)
            count, steps = count + 1, steps + length
    return count, steps


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
