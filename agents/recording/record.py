"""Episodes of a policy as a Minari data set: ``python -m agents record CONFIG``."""

from __future__ import annotations

import argparse
import copy
import itertools
import json
import os
import re
import tempfile
import time
from contextlib import closing
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
from minari.storage.datasets_root_dir import get_dataset_path
from pydantic import Field, field_validator, model_validator
from tqdm import tqdm

import vibgym
from agents import command_line, locks
from agents.command_line import Command
from agents.recording.episodes import SCENE, play, write
from agents.recording.replay import WORLDS, replayed
from agents.training_settings import Arguments, Plain
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.datasets import create, kept_in
from vibgym.envs.vector import batch_of, environment_id
from vibgym.files import WriteError, reason
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout, worlds_of
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.trained import described
from vibgym.seeds import RANGES, check_seeds
from vibgym.settings import BaseSettings, read

REFERENCE = 20
"""Episodes of the lower reference score."""

NAME = re.compile(r"(?!.?/[^/]*$)([\w-]+/)*[\w-]+-v\d+")
"""Names of data sets; Minari's namespaces have two characters at least."""


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
    def _with_version(cls, dataset: str) -> str:
        if not NAME.fullmatch(dataset):
            raise checks.conflict(f"requires a name such as 'vibgym/align/pose-v0', with a version, got {dataset!r}")
        return dataset

    @field_validator("environment")
    @classmethod
    def _free(cls, environment: dict[str, Any]) -> dict[str, Any]:
        for name in {"observation", "num_envs", "autoreset_mode"} & environment.keys():
            raise checks.conflict(f"{name} cannot be set for recordings")
        return environment

    @model_validator(mode="after")
    def _registered(self) -> RecordSettings:
        environment_id(self.task)
        check_seeds("first_seed", self.first_seed, self.episodes, "recordings")
        return self

    @property
    def label(self) -> str:
        """Kind of the policy."""
        return str(self.policy.get("kind") if isinstance(self.policy, dict) else self.policy)


class Actor:
    """Policy with its own observation, independent of the recorded one, and with noise on its actions.

    Args:
        policy, env: the policy and its environment.
        settings: of the recording.
    """

    def __init__(self, policy: Policy, env: Any, settings: RecordSettings) -> None:
        self.policy, self.env, self.settings = policy, env, settings
        self._seeds = itertools.count(settings.first_seed)
        self._noise: list[Any] = [None] * env.num_envs

    def predict(
        self, observation: Any, state: Any = None, episode_start: Any = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """See :class:`vibgym.policies.task_info.Policy`."""
        if self.policy.observation != self.settings.observation:
            observation = self.env.unwrapped.observed(self.policy.observation)
        action, state = self.policy.predict(observation, state, episode_start, deterministic)
        if self.settings.noise > 0.0:
            for world in np.flatnonzero(episode_start):  # take the seeds in the order of the worlds
                self._noise[world] = np.random.default_rng([next(self._seeds), 1])
            action = action + self.settings.noise * np.stack(
                [generator.standard_normal(action.shape[1]) for generator in self._noise]
            )
        space = self.env.single_action_space
        return np.clip(action, space.low, space.high).astype(np.float32), state


def load_settings(path: Path) -> RecordSettings:
    """Return the settings of a YAML file; the first fault is a one-line ValueError that names file and field."""
    return read(RecordSettings, load_yaml(path), str(path))


def record(settings: RecordSettings, quiet: bool = False) -> tuple[Path, int, float]:
    """Record episodes as a data set that Minari loads: all of it, or nothing.

    It has, per step, observations, executed actions, rewards and ends; per episode, as metadata
    (``MinariDataset.storage.get_episode_metadata``), seed, success and randomized values. Every episode is replayed bit for bit
    before it is stored (:mod:`agents.recording.replay`). Reference scores, for Minari's normalized scores, are the mean returns
    of random actions and of the recorded episodes.

    Returns:
        The data set's directory, its steps, and the seconds that it took.

    Raises:
        ValueError: an invalid environment, a policy that does not serve it, or a data set of this name exists; it is unchanged.
            An episode that does not replay.
        WriteError: no space is left, for instance; nothing is left behind.
    """
    began = time.perf_counter()
    with kept_in(settings.directory):
        place = Path(get_dataset_path(settings.dataset))
    root = place.parents[settings.dataset.count("/")]
    root.mkdir(parents=True, exist_ok=True)
    with locks.one_run(root, "dataset", f".{settings.dataset.replace('/', '-')}.lock"):
        if place.exists():
            raise checks.refuse("dataset", settings.dataset, f"a name that is not taken in {place.parent}; remove it")
        policy, arguments = _policy(settings)
        try:
            with tempfile.TemporaryDirectory(prefix=".recording-", dir=root) as folder, kept_in(folder):
                steps = _write(settings, policy, arguments, quiet)
                place.parent.mkdir(parents=True, exist_ok=True)
                os.rename(Path(folder) / settings.dataset, place)
                for file in list(Path(folder).rglob("namespace_metadata.json")):
                    target = root / file.relative_to(folder)
                    if not target.exists():
                        os.rename(file, target)
        except OSError as error:
            raise WriteError(f"{place}: not recorded ({reason(error)})") from error
    return place, steps, time.perf_counter() - began


def _policy(settings: RecordSettings) -> tuple[Policy, dict[str, Any]]:
    """Return the policy and the arguments of its environment."""
    environment = dict(settings.environment)
    action = environment.pop("action", None)
    with closing(batch_of(settings.task, num_envs=1, **environment)) as env:
        policy = make_policy(settings.policy, TaskInfo.of(env), settings.first_seed)
    checks.choice("environment.action", action or policy.action, (policy.action,))
    return policy, {**environment, "action": policy.action}


def _write(settings: RecordSettings, policy: Policy, arguments: dict[str, Any], quiet: bool) -> int:
    """Record episodes in Minari's current directory; return the number of steps."""
    name, environment = environment_id(settings.task), {**arguments, "observation": settings.observation}
    spec = copy.deepcopy(gym.registry.get(name))
    if spec is not None:  # a task by name has none
        spec.kwargs.update(environment)
    count = min(settings.worlds, settings.episodes)
    with (
        closing(worlds_of(settings.task, count, **environment)) as env,
        closing(worlds_of(settings.task, WORLDS, **environment)) as other,
    ):
        data = create(
            settings.dataset,
            [],
            env=spec,
            action_space=env.single_action_space,
            observation_space=env.single_observation_space,
            algorithm_name=settings.label,
            description=f"{settings.episodes} episodes of {settings.label} on {name}.",
        )
        seeds = range(settings.first_seed, settings.first_seed + settings.episodes)
        episodes = replayed(play(Actor(policy, env, settings), env, seeds), other)
        highest = write(data, tqdm(episodes, total=settings.episodes, unit="episode", disable=quiet))
        how = {"action": policy.action, "observation": settings.observation, "vibgym": vibgym.__version__}
        scene = json.dumps({**scene_of(env.unwrapped), **how})
        lowest = random_return(settings, env.single_action_space.shape, arguments)
    scores = {"ref_min_score": lowest, "ref_max_score": highest}
    data.storage.update_metadata({**scores, "settings": settings.model_dump_json(), SCENE: scene})
    return data.storage.total_steps


def random_return(settings: RecordSettings, shape: Any, arguments: dict[str, Any]) -> float:
    """Return the mean return of random actions of this shape in :data:`REFERENCE` episodes."""
    generator = np.random.default_rng(settings.first_seed)

    def predict(observation: Any, state: Any, *more: Any, **how: Any) -> tuple[np.ndarray, Any]:
        return generator.uniform(-1.0, 1.0, (len(observation), *shape)).astype(np.float32), state

    policy = SimpleNamespace(predict=predict, action=arguments["action"], observation="state")
    seeds = range(settings.first_seed, settings.first_seed + REFERENCE)
    return float(rollout(policy, settings.task, seeds=seeds, **arguments).returns.mean())


def scene_of(env: Any) -> dict[str, Any]:
    """Return the scene of a data set as plain values: task, surface, parts and columns."""
    return {
        "task": TaskInfo.of(env).name,
        "surface": described(env.surface),
        "parts": len(env.parts),
        "columns": [[row.name, row.width] for row in env.parts_layout],
    }


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
