"""Transitions of a Minari data set, as network inputs."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import minari
import numpy as np
import torch
from minari.storage.datasets_root_dir import get_dataset_path

import vibgym
from agents.recording.episodes import FILE, SCENE
from agents.recording.record import scene_of
from vibgym import checks
from vibgym.datasets import kept_in
from vibgym.envs.actions import actions_by_part
from vibgym.policies.trained.coding import Coding

if TYPE_CHECKING:
    from agents.offline import DataLearner

AT_ONCE = 1000
"""Episodes that are converted together."""


class Transitions(NamedTuple):
    """Steps of all episodes in order. The observation after step k has the index ``at[k] + 1``."""

    rows: torch.Tensor  # (observations, parts, columns) float32; of images uint8
    mask: torch.Tensor  # (observations, parts) float32
    at: torch.Tensor  # (steps,) int64, index of the observation before the step
    action: torch.Tensor  # (steps, parts, values) float32, as network outputs
    reward: torch.Tensor  # (steps,) float32, sum of all parts
    ended: torch.Tensor  # (steps,) float32, 1 where the episode was terminated, not truncated
    info: dict[str, Any]  # name, episodes, steps and digest of the data set


def read(settings: DataLearner.Settings, env: Any, action: str, coding: Coding, where: str) -> Transitions:
    """Return all steps of a data set.

    Args:
        settings: name the data set.
        env: batch of the policy's environment.
        action: of the policy.
        coding: of the network.
        where: name of the settings, for errors.

    Raises:
        ValueError: no such data set, one of another environment, scene or version, or a damaged one.
    """
    checks.choice("environment.action", action, actions_by_part())
    with kept_in(settings.directory):
        place = Path(get_dataset_path(settings.dataset))
        if not place.is_dir():
            allowed = f"a data set in {get_dataset_path()}, written by 'python -m agents record'"
            raise checks.refuse(f"{where}.dataset", settings.dataset, allowed)
        try:
            data = minari.load_dataset(settings.dataset)
            check(settings.dataset, data, env, action, coding.observation, where)
            digest = hashlib.sha256((data.storage.data_path / FILE).read_bytes()).hexdigest()
            if settings.episodes is not None and settings.episodes > data.total_episodes:
                allowed = f"at most {data.total_episodes}, which {settings.dataset} has"
                raise checks.refuse(f"{where}.episodes", settings.episodes, allowed)
            count = settings.episodes or int(data.total_episodes)
            groups = (range(count)[first : first + AT_ONCE] for first in range(0, count, AT_ONCE))
            loaded = [_group(data, numbers, coding) for numbers in groups]
        except checks.Refused:
            raise
        except (OSError, ValueError, KeyError, AssertionError, TypeError, AttributeError) as error:
            raise checks.refuse(f"{where}.dataset", str(place), f"a complete data set ({error})") from None
    observations = np.cumsum([0, *(len(group["rows"]) for group in loaded)])
    for group, first in zip(loaded, observations[:-1], strict=True):
        group["at"] += first
    whole = {name: torch.from_numpy(np.concatenate([group[name] for group in loaded])) for name in loaded[0]}
    info = {"dataset": settings.dataset, "episodes": count, "steps": len(whole["reward"]), "sha256": digest}
    return Transitions(**whole, info=info)


def check(name: str, data: Any, env: Any, action: str, observation: str, where: str) -> None:
    """Raise if a data set has another origin, environment, scene, action, observation or version."""
    kept = json.loads(data.storage.metadata.get(SCENE, "{}"))
    if not kept:
        raise checks.refuse(f"{where}.dataset", name, "a data set written by 'python -m agents record'")
    wanted = {**scene_of(env), "action": action, "observation": observation, "vibgym": vibgym.__version__}
    for key, value in wanted.items():
        if kept.get(key) != value:
            raise checks.refuse(f"{where}.dataset", f"{name} (its {key}: {kept.get(key)})", f"a data set with {value}")


def _group(data: Any, numbers: range, coding: Coding) -> dict[str, np.ndarray]:
    """Return the transitions of some episodes, converted step by step since rows may contain previous actions."""
    episodes = list(data.iterate_episodes(numbers))
    lengths = np.array([len(episode.rewards) for episode in episodes])
    steps = int(lengths.max())

    def padded(rows: list[np.ndarray]) -> np.ndarray:
        whole = np.zeros((steps + 1, len(rows), *rows[0].shape[1:]), dtype=rows[0].dtype)
        for k, row in enumerate(rows):
            whole[: len(row), k] = row
        return whole

    parts = len(coding.parts)
    executed = padded([episode.actions for episode in episodes]).reshape(steps + 1, len(episodes), parts, -1)
    observed = [episode.observations for episode in episodes]
    named = isinstance(observed[0], dict)
    seen: Any = {name: padded([own[name] for own in observed]) for name in observed[0]} if named else padded(observed)
    rows, mask, actions = [], [], []
    inputs: Any = None
    start = np.zeros(len(episodes), dtype=bool)
    for step in range(steps + 1):
        now = {name: values[step] for name, values in seen.items()} if named else seen[step]
        inputs = coding.encode(now, inputs, start)
        rows.append(inputs.rows)
        mask.append(inputs.mask)
        actions.append(coding.to_rows(inputs, executed[step]))
        if coding.history:
            inputs.command[..., : coding.shape.action] = executed[step]
    there = np.arange(steps + 1) <= lengths[:, None]  # (episodes, observations)
    acted = np.arange(steps + 1) < lengths[:, None]
    order = (np.cumsum(there.reshape(-1)) - 1).reshape(there.shape)
    return {
        "rows": np.stack(rows, axis=1)[there],
        "mask": np.stack(mask, axis=1)[there].astype(np.float32),
        "at": order[acted],
        "action": np.stack(actions, axis=1)[acted].astype(np.float32),
        "reward": np.concatenate([episode.rewards for episode in episodes]).astype(np.float32),
        "ended": np.concatenate([episode.terminations for episode in episodes]).astype(np.float32),
    }
