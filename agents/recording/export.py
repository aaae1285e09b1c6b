"""Data sets in LeRobot's format, version 3: ``python -m agents export NAME``.

LeRobot's own writer stores the episodes, in its virtual environment (``make learners``), so indices and statistics are those
that its policies expect.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
import warnings
from pathlib import Path
from typing import Any

import numpy as np

from agents.command_line import Command
from agents.recording.episodes import SCENE, Episode
from agents.recording.replay import opened
from vibgym import checks
from vibgym.adapters.lerobot import KEYS, KINDS, names_of, observation_from, text_of
from vibgym.files import WriteError, reason

ORIGIN = "meta/vibgym.json"
"""File with the origin of an exported data set: its name in Minari, settings, scene, reference scores, and seeds."""

ENDS = {"next.reward": "float64", "next.success": "bool", "next.done": "bool"}
"""Features of the step that follows a frame, with the types of the recording."""


def export(name: str, output: Path, directory: Path | None = None, quiet: bool = False) -> tuple[int, int]:
    """Replay a data set and write it in LeRobot's format: all of it, or nothing.

    A frame has the observation before a step (:func:`vibgym.adapters.lerobot.observation_from`), the executed action, and the
    step's reward, success and end; the observation after the last step is not part of the format. Timestamps are multiples of
    the step. Values are those of the recording, unrounded.

    Args:
        name: Minari's.
        output: new directory.
        directory: of Minari's data sets; None: Minari's.
        quiet: no progress bar.

    Returns:
        Numbers of episodes and frames.

    Raises:
        ValueError: see :func:`agents.recording.replay.opened`; an episode that does not replay, an observation that LeRobot's
            format has no place for, a step that is not a whole fraction of a second, a directory that exists, or no LeRobot.
        WriteError: no space is left, for instance; nothing is left behind.
    """
    if output.exists():
        raise checks.refuse("output", str(output), "a directory that does not exist; remove it")
    dataset_class = _lerobot()
    with opened(name, directory) as data:
        kind = checks.choice(f"{name}: observation", data.scene["observation"], KINDS)
        rate = 1.0 / data.env.step_time
        if abs(rate - round(rate)) > 1e-9 * rate:
            raise checks.conflict(f"LeRobot requires a whole number of steps per second; {name} has {rate:.4g}")
        features = _features(data.env, kind)
        try:
            output.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(prefix=".exporting-", dir=output.parent) as folder:
                root = Path(folder) / "dataset"
                made = dataset_class.create(name, round(rate), features, root, use_videos=False, video_backend="pyav")
                seeds, text = list[int](), text_of(type(data.env.task))
                for episode in data.episodes(quiet):
                    with warnings.catch_warnings():
                        warnings.filterwarnings("ignore", "Converting input from bool", RuntimeWarning)  # statistics
                        made.save_episode(made.create_episode_buffer() | _buffer(episode, kind, text, made.fps))
                    seeds.append(episode.seed)
                made.finalize()
                about = data.found.storage.metadata
                origin = {"dataset": name, "settings": data.settings, SCENE: data.scene, "seeds": seeds}
                origin |= {key: float(about[key]) for key in ("ref_min_score", "ref_max_score")}
                (root / ORIGIN).write_text(json.dumps(origin, indent=2) + "\n", encoding="utf-8")
                os.rename(root, output)
        except OSError as error:
            raise WriteError(f"{output}: not exported ({reason(error)})") from error
    return len(seeds), int(data.found.total_steps)


def _lerobot() -> Any:
    """Return LeRobot's class of data sets, silent about its progress."""
    try:
        import datasets  # pyright: ignore[reportMissingImports]
        from lerobot.datasets.lerobot_dataset import LeRobotDataset  # pyright: ignore[reportMissingImports]
    except ModuleNotFoundError as error:
        how = "make learners, then .venv-lerobot/bin/python -m agents export NAME"
        raise checks.conflict(f"export requires LeRobot ({error.name} is not installed): {how}") from None
    datasets.disable_progress_bars()
    return LeRobotDataset


def _features(env: Any, kind: str) -> dict[str, dict[str, Any]]:
    """Return the type, shape and names of the values of each feature."""
    named = {KEYS[key]: names for key, names in names_of(env, kind).items()}
    named["action"] = ["action_" + "_".join(map(str, index)) for index in np.ndindex(env.action_shape)]
    features = {key: {"dtype": "float32", "shape": (len(names),), "names": names} for key, names in named.items()}
    return features | {key: {"dtype": dtype, "shape": (1,), "names": None} for key, dtype in ENDS.items()}


def _buffer(episode: Episode, kind: str, text: str, rate: int) -> dict[str, Any]:
    """Return the features of an episode: (steps, width) each, and (steps,) for those of one value."""
    # Not by add_frame, whose features of one value LeRobot does not save with NumPy 2.4.
    steps, seen = len(episode.rewards), observation_from(kind, episode.observations)
    done = np.arange(steps) == steps - 1
    return {
        **{KEYS[key]: values[:steps] for key, values in seen.items()},
        "action": episode.actions,
        "next.reward": episode.rewards,
        "next.success": done & episode.success,
        "next.done": done,
        "size": steps,
        "task": [text] * steps,
        "frame_index": np.arange(steps),
        "timestamp": np.arange(steps) / rate,
    }


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("dataset", metavar="NAME", help="of a data set, such as vibgym/align/pose-v0")
    parser.add_argument("--datasets", type=Path, metavar="DIR", help="directory of data sets, instead of Minari's")


def command(arguments: argparse.Namespace) -> None:
    """Export a data set."""
    name = arguments.dataset
    output = arguments.output or Path("runs/lerobot") / name
    episodes, frames = export(name, output, arguments.datasets, arguments.quiet)
    print(f"{output}: {episodes} episodes, {frames} frames, replayed bit for bit")


COMMANDS = {"export": Command(_arguments, command, "new directory, instead of runs/lerobot/NAME")}
