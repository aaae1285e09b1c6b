"""Replay of recorded episodes: from their seeds, with their actions, every observation and reward must be the same bit for bit.

``python -m agents record`` replays each episode before it is stored, ``python -m agents replay NAME`` those of a data set.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import vibgym
from agents.command_line import Command
from agents.recording.play import Episode
from vibgym import checks
from vibgym.envs.vector import batch_of


class Replayer:
    """Replays episodes in one world.

    Args:
        task, arguments: of the environment, see :func:`vibgym.envs.vector.batch_of`.
    """

    def __init__(self, task: str, arguments: Mapping[str, Any]) -> None:
        self.env: Any = batch_of(task, num_envs=1, autoreset_mode="Disabled", **arguments)

    def check(self, episode: Episode) -> None:
        """Replay an episode.

        Raises:
            ValueError: names the first step and quantity that differ.
        """
        seen, _ = self.env.reset(seed=[episode.seed])
        self._same(episode, 0, "observation", seen, episode.observations)
        last = len(episode.rewards) - 1
        for step, action in enumerate(episode.actions):
            seen, reward, terminated, truncated, info = self.env.step(action[None])
            self._same(episode, step + 1, "observation", seen, episode.observations)
            ends = (bool(terminated[0]), bool(truncated[0]))
            expected = (episode.terminated, episode.truncated) if step == last else (False, False)
            success = bool(info["is_success"][0]) if step == last else episode.success
            if reward[0] != episode.rewards[step] or ends != expected or success != episode.success:
                raise self._differs(episode, step + 1, "reward or end")

    def _same(self, episode: Episode, step: int, name: str, seen: Any, recorded: Any) -> None:
        pairs = [(seen[key], recorded[key]) for key in recorded] if isinstance(recorded, dict) else [(seen, recorded)]
        if not all(np.array_equal(now[0], then[step]) for now, then in pairs):
            raise self._differs(episode, step, name)

    @staticmethod
    def _differs(episode: Episode, step: int, name: str) -> checks.Refused:
        return checks.conflict(f"the episode of seed {episode.seed} does not replay: {name} of step {step} differs")

    def checked(self, episodes: Iterable[Episode]) -> Iterator[Episode]:
        """Yield episodes, each after it has been replayed."""
        for episode in episodes:
            self.check(episode)
            yield episode

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def replay(name: str, directory: Path | None = None, quiet: bool = False) -> int:
    """Replay all episodes of a data set; return their number.

    Args:
        name: Minari's.
        directory: of the data sets; None: Minari's.

    Raises:
        ValueError: no such data set, one that ``python -m agents record`` of this version has not written, or an episode that
            differs.
    """
    import minari

    from agents.recording.record import SCENE, kept_in

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
        for episode in tqdm(found.iterate_episodes(), total=found.total_episodes, unit="episode", disable=quiet):
            own = next(iter(found.storage.get_episode_metadata([episode.id])))
            replayer.check(
                Episode(
                    int(own["seed"]), episode.observations, np.asarray(episode.actions), np.asarray(episode.rewards),
                    bool(episode.terminations[-1]), bool(episode.truncations[-1]), bool(own["success"]), {},
                )
            )  # fmt: skip
        replayer.close()
    return int(found.total_episodes)


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="NAME", help="of a data set, such as vibgym/align/pose-v0")


def command(arguments: argparse.Namespace) -> None:
    """Replay a data set."""
    count = replay(arguments.dataset, arguments.output, arguments.quiet)
    print(f"{arguments.dataset}: {count} episodes replay bit for bit")


COMMANDS = {"replay": Command(_arguments, command, "directory of data sets, instead of Minari's")}
