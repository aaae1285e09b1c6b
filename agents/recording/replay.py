"""Replay of recorded episodes: from their seeds, with their actions, every observation and reward must be the same bit for bit.

``python -m agents record`` replays each episode before it is stored, ``python -m agents replay NAME`` those of a data set.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import minari
import numpy as np
from tqdm import tqdm

import vibgym
from agents.command_line import Command
from agents.recording.episodes import SCENE, Episode, play, read
from vibgym import checks
from vibgym.datasets import kept_in
from vibgym.policies.rollout import worlds_of

WORLDS = 64
"""Episodes that are replayed at the same time."""


class RecordedActions:
    """Policy that repeats the actions of an episode in each world, and zeros afterwards."""

    def __init__(self, actions: list[np.ndarray]) -> None:
        padded = np.zeros((len(actions), max(map(len, actions)) + 1, actions[0].shape[1]), dtype=np.float32)
        for world, own in enumerate(actions):
            padded[world, : len(own)] = own
        self._actions = itertools.chain(np.moveaxis(padded, 1, 0), itertools.repeat(padded[:, -1]))

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return the actions of the next step."""
        return next(self._actions), state


def replayed(episodes: Iterable[Episode], env: Any) -> Iterator[Episode]:
    """Yield episodes, each after it has been replayed in a batch of :data:`WORLDS` worlds.

    Raises:
        ValueError: names the seed, and the first step and quantity that differ.
    """
    remaining = iter(episodes)
    while group := list(itertools.islice(remaining, WORLDS)):
        worlds = group + [group[-1]] * (WORLDS - len(group))
        policy = RecordedActions([world.actions for world in worlds])
        for episode, now in zip(group, play(policy, env, [world.seed for world in worlds]), strict=False):
            _compare(episode, now)
        yield from group


def _compare(episode: Episode, now: Episode) -> None:
    """Raise for the first quantity and step of an episode that differ from its replay."""
    for name in ("observations", "rewards", "terminated", "truncated", "success"):
        then, again = getattr(episode, name), getattr(now, name)
        for one, other in [(then[key], again[key]) for key in then] if isinstance(then, dict) else [(then, again)]:
            if not np.array_equal(one, other):
                steps = itertools.zip_longest(np.atleast_1d(one), np.atleast_1d(other))
                first = next(k for k, values in enumerate(steps) if not np.array_equal(*values))
                raise checks.conflict(f"the episode of seed {episode.seed} does not replay: {name}[{first}] differs")


class Recorded(NamedTuple):
    """Open data set of ``python -m agents record``."""

    found: minari.MinariDataset
    settings: dict[str, Any]  # of the recording
    scene: dict[str, Any]  # see agents.recording.record.scene_of
    env: Any  # for its replay

    def episodes(self, quiet: bool) -> Iterator[Episode]:
        """Yield the episodes, each after it has been replayed, in order, with a progress bar unless quiet."""
        episodes = replayed(read(self.found), self.env)
        return iter(tqdm(episodes, total=int(self.found.total_episodes), unit="episode", disable=quiet))


@contextmanager
def opened(name: str, directory: Path | None = None) -> Iterator[Recorded]:
    """Open a data set for its replay within a block.

    Args:
        name: Minari's.
        directory: of the data sets; None: Minari's.

    Raises:
        ValueError: no such data set, or one that ``python -m agents record`` of this version has not written.
    """
    with kept_in(None if directory is None else str(directory)):
        try:
            dataset = minari.load_dataset(name)
        except (FileNotFoundError, ValueError) as error:
            raise checks.refuse("dataset", name, f"the name of a local data set ({error})") from None
        about = dataset.storage.metadata
        if SCENE not in about or "settings" not in about:
            raise checks.conflict(f"{name} was not recorded by python -m agents record")
        settings, scene = json.loads(about["settings"]), json.loads(about[SCENE])
        if scene["vibgym"] != vibgym.__version__:
            raise checks.refuse(f"{name}: version", scene["vibgym"], f"this version of vibgym, {vibgym.__version__}")
        arguments = {**settings["environment"], "action": scene["action"], "observation": scene["observation"]}
        with closing(worlds_of(settings["task"], WORLDS, **arguments)) as env:
            yield Recorded(dataset, settings, scene, env)


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="NAME", help="of a data set, such as vibgym/align/pose-v0")


def command(arguments: argparse.Namespace) -> None:
    """Replay a data set."""
    with opened(arguments.dataset, arguments.output) as data:
        count = sum(1 for _ in data.episodes(arguments.quiet))
    print(f"{arguments.dataset}: {count} episodes replay bit for bit")


COMMANDS = {"replay": Command(_arguments, command, "directory of data sets, instead of Minari's")}
