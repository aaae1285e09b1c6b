"""From episodes to a data set on disk."""

from __future__ import annotations

import copy
import json
import os
import tempfile
import time
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import gymnasium as gym
import minari
from minari.storage.datasets_root_dir import get_dataset_path
from tqdm import tqdm

import vibgym
from agents import locks
from agents.recording import storage
from agents.recording.play import Recorder
from agents.recording.record_settings import RecordSettings
from vibgym import checks
from vibgym.envs.vector import environment_id
from vibgym.files import WriteError, reason
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.trained import described

ROOT = "MINARI_DATASETS_PATH"
"""Environment variable that says where Minari keeps its data sets."""

SCENE = "vibgym_scene"
"""Key of what a data set says of its scene."""


def record(settings: RecordSettings, quiet: bool = False) -> tuple[Path, int, float]:
    """Play, and write a data set that Minari loads: whole, or not at all.

    Per step it has observations, actions as they were done, rewards and ends; per episode its seed, whether it succeeded, and
    what was drawn for it (hardware, friction, mass): as metadata, see ``MinariDataset.storage.get_episode_metadata``.

    Returns:
        The data set's directory, its steps, and the seconds that it took.

    Raises:
        ValueError: settings that do not fit, or a data set of this name, which stays.
        WriteError: no space is left, or the like; nothing is left behind.
    """
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
    """Play, and write a data set to where Minari keeps them now; returns its steps."""
    settings, env = recorder.settings, recorder.env
    name = environment_id(settings.task)
    spec = copy.deepcopy(gym.registry.get(name))
    if spec is not None:  # of a task alone there is none
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
    episodes = tqdm(recorder.episodes(), total=settings.episodes, unit="episode", disable=quiet)
    count, steps = storage.write(made.storage.data_path, episodes)
    how = {"action": recorder.policy.action, "observation": settings.observation, "vibgym": vibgym.__version__}
    facts = {"total_episodes": count, "total_steps": steps, "dataset_size": made.storage.get_size()}
    scene = json.dumps({**scene_of(env.unwrapped), **how})
    made.storage.update_metadata({**facts, "settings": settings.model_dump_json(), SCENE: scene})
    return steps


def scene_of(env: Any) -> dict[str, Any]:
    """What a data set's numbers are of: task, table, parts and columns; as plain values."""
    return {
        "task": TaskInfo.of(env).name,
        "surface": described(env.surface),
        "parts": len(env.parts),
        "columns": [[row.name, row.width] for row in env.parts_layout],
    }


@contextmanager
def kept_in(directory: str | None) -> Iterator[None]:
    """Minari keeps its data sets there, for a while; None: where it does."""
    before = os.environ.get(ROOT)
    if directory is not None:
        os.environ[ROOT] = str(directory)
    try:
        yield
    finally:
        if before is None:
            os.environ.pop(ROOT, None)
        else:
            os.environ[ROOT] = before


def _named(policy: Any) -> str:
    kind = policy.get("kind") if isinstance(policy, dict) else policy
    return str(kind)
