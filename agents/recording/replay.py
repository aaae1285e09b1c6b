"""Replay of recorded episodes: from their seeds, with their actions, every observation and reward must be the same bit for bit.

``python -m agents record`` replays each episode before it is stored, ``python -m agents replay NAME`` those of a data set.
"""

from __future__ import annotations

import argparse
import itertools
import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from tqdm import tqdm

import vibgym
from agents.command_line import Command
from agents.recording.play import Episode
from agents.recording.storage import SCENE, kept_in
from vibgym import checks
from vibgym.envs.vector import batch_of

WORLDS = 64
"""Episodes that are replayed at the same time."""


class Replayer:
    """Replays episodes, several at a time.

    Args:
        task, arguments: of the environment, see :func:`vibgym.envs.vector.batch_of`.
    """

    def __init__(self, task: str, arguments: Mapping[str, Any]) -> None:
        self.env: Any = batch_of(task, num_envs=WORLDS, autoreset_mode="Disabled", **arguments)

    def check(self, episodes: Sequence[Episode]) -> None:
        """Replay at most :data:`WORLDS` episodes.

        Raises:
            ValueError: names the seed, and the first step and quantity that differ.
        """
        count = len(episodes)
        seeds = [episodes[min(k, count - 1)].seed for k in range(WORLDS)]
        seen, _ = self.env.reset(seed=seeds)
        for k, episode in enumerate(episodes):
            self._observed(episode, 0, seen, k)
        action, playing = np.zeros(self.env.action_space.shape, dtype=np.float32), np.arange(WORLDS) < count
        for step in range(max(len(episode.rewards) for episode in episodes)):
            for k in np.flatnonzero(playing).tolist():
                action[k] = episodes[k].actions[step]
            seen, reward, terminated, truncated, info = self.env.step(action)
            for k in np.flatnonzero(playing).tolist():
                episode, last = episodes[k], step + 1 == len(episodes[k].rewards)
                self._observed(episode, step + 1, seen, k)
                ends = episode.terminated and last, episode.truncated and last
                same = reward[k] == episode.rewards[step] and (bool(terminated[k]), bool(truncated[k])) == ends
                if not same or (last and bool(info["is_success"][k]) != episode.success):
                    raise _differs(episode, step + 1, "reward or end")
                playing[k] = not last
            if (terminated | truncated).any():
                self.env.reset(options={"reset_mask": terminated | truncated})

    @staticmethod
    def _observed(episode: Episode, step: int, seen: Any, k: int) -> None:
        recorded = episode.observations
        pairs = [(seen[key], recorded[key]) for key in recorded] if isinstance(recorded, dict) else [(seen, recorded)]
        if not all(np.array_equal(now[k], then[step]) for now, then in pairs):
            raise _differs(episode, step, "observation")

    def checked(self, episodes: Iterable[Episode]) -> Iterator[Episode]:
        """Yield episodes, each after it has been replayed."""
        remaining = iter(episodes)
        while group := list(itertools.islice(remaining, WORLDS)):
            self.check(group)
            yield from group

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def _differs(episode: Episode, step: int, name: str) -> checks.Refused:
    return checks.conflict(f"the episode of seed {episode.seed} does not replay: {name} of step {step} differs")


class Recorded(NamedTuple):
    """Open data set of ``python -m agents record``."""

    found: Any  # minari.MinariDataset
    settings: dict[str, Any]  # of the recording
    scene: dict[str, Any]  # see agents.recording.record.scene_of
    replayer: Replayer

    def episodes(self) -> Iterator[Episode]:
        """Yield the episodes, each after it has been replayed, in order."""
        episodes = (_stored(self.found, each) for each in self.found.iterate_episodes())
        return self.replayer.checked(episodes)


@contextmanager
def opened(name: str, directory: Path | None = None) -> Iterator[Recorded]:
    """Open a data set for its replay within a block.

    Args:
        name: Minari's.
        directory: of the data sets; None: Minari's.

    Raises:
        ValueError: no such data set, or one that ``python -m agents record`` of this version has not written.
    """
    import minari

    with kept_in(None if directory is None else str(directory)):
        try:
            found = minari.load_dataset(name)
        except (FileNotFoundError, ValueError) as error:
            raise checks.refuse("dataset", name, f"the name of a local data set ({error})") from None
        about = found.storage.metadata
        if SCENE not in about or "settings" not in about:
            raise checks.conflict(f"{name} was not recorded by python -m agents record")
        settings, scene = json.loads(about["settings"]), json.loads(about[SCENE])
        if scene["vibgym"] != vibgym.__version__:
            raise checks.refuse(f"{name}: version", scene["vibgym"], f"this version of vibgym, {vibgym.__version__}")
        arguments = {**settings["environment"], "action": scene["action"], "observation": scene["observation"]}
        replayer = Replayer(settings["task"], arguments)
        try:
            yield Recorded(found, settings, scene, replayer)
        finally:
            replayer.close()


def replay(name: str, directory: Path | None = None, quiet: bool = False) -> int:
    """Replay all episodes of a data set; return their number.

    Args:
        name, directory: see :func:`opened`.
        quiet: no progress bar.

    Raises:
        ValueError: see :func:`opened`; or an episode that differs.
    """
    with opened(name, directory) as data:
        total = int(data.found.total_episodes)
        for _ in tqdm(data.episodes(), total=total, unit="episode", disable=quiet):
            pass
    return total


def _stored(dataset: Any, episode: Any) -> Episode:
    """Return an episode of Minari as it was recorded."""
    own = next(iter(dataset.storage.get_episode_metadata([episode.id])))
    ends = bool(episode.terminations[-1]), bool(episode.truncations[-1]), bool(own["success"])
    actions, rewards = np.asarray(episode.actions), np.asarray(episode.rewards)
    return Episode(int(own["seed"]), episode.observations, actions, rewards, *ends, {})


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="NAME", help="of a data set, such as vibgym/align/pose-v0")


def command(arguments: argparse.Namespace) -> None:
    """Replay a data set."""
    count = replay(arguments.dataset, arguments.output, arguments.quiet)
    print(f"{arguments.dataset}: {count} episodes replay bit for bit")


COMMANDS = {"replay": Command(_arguments, command, "directory of data sets, instead of Minari's")}
