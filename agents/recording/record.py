"""Episodes of a policy as a Minari data set: ``python -m agents record CONFIG``."""

from __future__ import annotations

import argparse
import copy
import json
import os
import re
import tempfile
import time
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

import gymnasium as gym
import minari
import numpy as np
from minari.storage.datasets_root_dir import get_dataset_path
from pydantic import Field, field_validator
from tqdm import tqdm

import vibgym
from agents import command_line, locks
from agents.command_line import Command
from agents.recording import storage
from agents.recording.play import Episode, Recorder
from agents.recording.replay import Replayer
from agents.recording.storage import SCENE, kept_in
from agents.training_settings import Arguments, Plain
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.envs.vector import environment_id
from vibgym.files import WriteError, reason
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.trained import described
from vibgym.seeds import RANGES, check_seeds
from vibgym.settings import BaseSettings, read

REFERENCE = 20
"""Episodes of the lower reference score."""

NAME = re.compile(r"([\w-]+/)*[\w-]+-v\d+")


class RecordSettings(BaseSettings):
    """Episodes of one policy on one environment."""

    dataset: str
    """Minari's name, such as "vibgym/align/pose-v0"."""

    task: str
    """See :func:`vibgym.envs.vector.batch_of`."""

    policy: Plain
    """As evaluations take it."""

    environment: Arguments = {}
    """Arguments of the environment."""

    observation: str = "state"
    """That is recorded; the policy has its own."""

    episodes: int = Field(default=1000, ge=1, le=10_000_000)
    """Number of episodes."""

    first_seed: int = RANGES["recordings"].start
    """Episode k begins with this seed + k."""

    worlds: int = Field(default=250, ge=1, le=100_000)
    """Simulated together; no result depends on it."""

    noise: float = Field(default=0.0, ge=0, le=2)
    """Standard deviation, added to the actions that are executed and recorded."""

    directory: str | None = None
    """Of the data sets; None: that of Minari."""

    @field_validator("dataset")
    @classmethod
    def _named(cls, dataset: str) -> str:
        if not NAME.fullmatch(dataset):
            raise checks.conflict(f"requires a name such as 'vibgym/align/pose-v0', with a version, got {dataset!r}")
        return dataset


def load_settings(path: Path) -> RecordSettings:
    """Return the settings of a YAML file; the first fault is a one-line ValueError that names file and field."""
    settings = read(RecordSettings, load_yaml(path), str(path))
    environment_id(settings.task, f"{path}.task")
    return settings


def record(settings: RecordSettings, quiet: bool = False) -> tuple[Path, int, float]:
    """Record episodes as a data set that Minari loads: all of it, or nothing.

    It has, per step, observations, executed actions, rewards and ends; per episode, as metadata
    (``MinariDataset.storage.get_episode_metadata``), seed, success and randomized values. Every episode is replayed bit for bit
    before it is stored (:mod:`agents.recording.replay`). Reference scores, for Minari's normalized scores, are the mean returns
    of random actions and of the recorded episodes.

    Returns:
        The data set's directory, its steps, and the seconds that it took.

    Raises:
        ValueError: invalid settings, or a data set of this name exists; it is unchanged. An episode that does not replay.
        WriteError: no space is left, for instance; nothing is left behind.
    """
    check_seeds("first_seed", settings.first_seed, settings.episodes, "recordings")
    began = time.perf_counter()
    with kept_in(settings.directory):
        place = Path(get_dataset_path(settings.dataset))
    root = place.parents[settings.dataset.count("/")]
    root.mkdir(parents=True, exist_ok=True)
    with locks.one_run(root, "dataset", f".{settings.dataset.replace('/', '-')}.lock"):
        if place.exists():
            raise checks.refuse("dataset", settings.dataset, f"a name that is not taken in {place.parent}; remove it")
        recorder = Recorder(settings)
        try:
            with tempfile.TemporaryDirectory(prefix=".recording-", dir=root) as folder, kept_in(folder):
                steps = _write(recorder, quiet)
                place.parent.mkdir(parents=True, exist_ok=True)
                os.rename(Path(folder) / settings.dataset, place)
                for file in list(Path(folder).rglob("namespace_metadata.json")):
                    target = root / file.relative_to(folder)
                    if not target.exists():
                        os.rename(file, target)
        except OSError as error:
            raise WriteError(f"{place}: not recorded ({reason(error)})") from error
        finally:
            recorder.env.close()
    return place, steps, time.perf_counter() - began


def _write(recorder: Recorder, quiet: bool) -> int:
    """Record episodes in Minari's current directory; return the number of steps."""
    settings, env = recorder.settings, recorder.env
    name = environment_id(settings.task)
    spec = copy.deepcopy(gym.registry.get(name))
    if spec is not None:  # a task by name has none
        spec.kwargs.update(recorder.kwargs)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # about the missing author and permanent link
        made = minari.create_dataset_from_buffers(
            settings.dataset,
            [],
            env=spec,
            action_space=env.single_action_space,
            observation_space=env.single_observation_space,
            algorithm_name=_named(settings.policy),
            description=f"{settings.episodes} episodes of {_named(settings.policy)} on {name}.",
            code_permalink=None,
            requirements=[f"vibgym=={vibgym.__version__}"],
            jpeg_encoding=False,
        )
    replayer, returns = Replayer(settings.task, recorder.kwargs), list[float]()
    episodes = tqdm(replayer.checked(recorder.episodes()), total=settings.episodes, unit="episode", disable=quiet)
    count, steps = storage.write(made.storage.data_path, _noted(episodes, returns))
    replayer.close()
    how = {"action": recorder.policy.action, "observation": settings.observation, "vibgym": vibgym.__version__}
    reference = {"ref_min_score": random_return(recorder), "ref_max_score": float(np.mean(returns))}
    facts = reference | {"total_episodes": count, "total_steps": steps, "dataset_size": made.storage.get_size()}
    scene = json.dumps({**scene_of(env.unwrapped), **how})
    made.storage.update_metadata({**facts, "settings": settings.model_dump_json(), SCENE: scene})
    return steps


def _noted(episodes: Iterable[Episode], returns: list[float]) -> Iterator[Episode]:
    """Yield episodes, and append their returns."""
    for episode in episodes:
        returns.append(float(episode.rewards.sum()))
        yield episode


class RandomActions:
    """Policy with uniformly random values of any action, the lower reference of a data set."""

    observation = "state"

    def __init__(self, action: str, size: int, seed: int) -> None:
        self.action, self.size, self.generator = action, size, np.random.default_rng(seed)

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return an action for every observation."""
        return self.generator.uniform(-1.0, 1.0, (len(observation), self.size)).astype(np.float32), state


def random_return(recorder: Recorder) -> float:
    """Return the mean return of random actions in :data:`REFERENCE` episodes."""
    settings, core = recorder.settings, recorder.env.unwrapped.core
    random = RandomActions(recorder.policy.action, core.action.size, settings.first_seed)
    arguments = {name: value for name, value in recorder.kwargs.items() if name != "observation"}
    seeds = range(settings.first_seed, settings.first_seed + REFERENCE)
    return float(rollout(random, settings.task, seeds=seeds, **arguments).returns.mean())


def scene_of(env: Any) -> dict[str, Any]:
    """Return the scene of a data set as plain values: task, surface, parts and columns."""
    return {
        "task": TaskInfo.of(env).name,
        "surface": described(env.surface),
        "parts": len(env.parts),
        "columns": [[row.name, row.width] for row in env.parts_layout],
    }


def _named(policy: Any) -> str:
    kind = policy.get("kind") if isinstance(policy, dict) else policy
    return str(kind)


def _arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser, "YAML file, see configs/recordings/")


def command(arguments: argparse.Namespace) -> None:
    """Record the episodes that a settings file describes."""
    settings = load_settings(arguments.config)
    if arguments.output is not None:
        settings = settings.model_copy(update={"directory": str(arguments.output)})
    with checks.within(arguments.config, kind=checks.Refused):
        place, steps, seconds = record(settings, arguments.quiet)
    print(f"{place}: {settings.episodes} episodes, {steps} steps in {seconds:.1f} s, {steps / seconds:.0f} steps/s")


COMMANDS = {"record": Command(_arguments, command, "directory of data sets, instead of the file's")}
