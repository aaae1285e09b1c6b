"""Transitions of a Minari data set, as the rows that networks read."""

from __future__ import annotations

import hashlib
import json
from pathlib import Path
from typing import Any, NamedTuple

import minari
import numpy as np
import torch
from minari.storage.datasets_root_dir import get_dataset_path

import vibgym
from agents.recording.record import SCENE, kept_in, scene_of
from agents.recording.storage import FILE
from agents.training_settings import OfflineSettings
from vibgym import checks
from vibgym.envs.actions import actions_by_part
from vibgym.policies.trained.coding import Coding

AT_ONCE = 1000
"""Episodes that are read side by side."""


class Transitions(NamedTuple):
    """Steps of all episodes, one after the other: what is seen after step k is at ``at[k] + 1``."""

    rows: torch.Tensor  # (observations, parts, columns) float32
    mask: torch.Tensor  # (observations, parts) float32
    at: torch.Tensor  # (steps,) int64, of the observation that a step begins with
    action: torch.Tensor  # (steps, parts, numbers) float32, as the network says it
    reward: torch.Tensor  # (steps,) float32, of all parts together
    ended: torch.Tensor  # (steps,) float32, 1 where the episode ended by itself, not by its limit
    facts: dict[str, Any]  # name, episodes, steps and digest of the data set


def read(settings: OfflineSettings, env: Any, action: str, coding: Coding) -> Transitions:
    """All steps of a data set.

    Args:
        settings: which data set.
        env: a batch of the environment that a policy is to be learned for.
        action: what the policy speaks.
        coding: of the network.

    Raises:
        ValueError: there is no such data set, or it is not of this environment, scene or version, or damaged.
    """
    checks.choice("environment.action", action, actions_by_part())
    with kept_in(settings.directory):
        place = Path(get_dataset_path(settings.dataset))
        if not place.is_dir():
            allowed = f"a data set in {get_dataset_path()}, as 'python -m agents record' makes them"
            raise checks.refuse("offline.dataset", settings.dataset, allowed)
        try:
            data = minari.load_dataset(settings.dataset)
            check(settings.dataset, data, env, action)
            digest = hashlib.sha256((data.storage.data_path / FILE).read_bytes()).hexdigest()
            found = [_group(data, some, coding) for some in _groups(data.total_episodes)]
        except checks.Refused:
            raise
        except (OSError, ValueError, KeyError, AssertionError, TypeError, AttributeError) as error:
            raise checks.refuse("offline.dataset", str(place), f"a data set that is whole ({error})") from None
    observations = np.cumsum([0, *(len(each["rows"]) for each in found)])
    for each, first in zip(found, observations[:-1], strict=True):
        each["at"] += first
    whole = {name: torch.from_numpy(np.concatenate([each[name] for each in found])) for name in found[0]}
    facts = {
        "dataset": settings.dataset,
        "episodes": int(data.total_episodes),
        "steps": int(data.total_steps),
        "sha256": digest,
    }
    return Transitions(**whole, facts=facts)


def check(name: str, data: Any, env: Any, action: str) -> None:
    """Refuse a data set of something else.

    Raises:
        ValueError: it is of another environment, scene, action, observation or version.
    """
    kept = json.loads(data.storage.metadata.get(SCENE, "{}"))
    if not kept:
        raise checks.refuse("offline.dataset", name, "a data set that 'python -m agents record' has made")
    wanted = {**scene_of(env), "action": action, "observation": "parts", "vibgym": vibgym.__version__}
    for key, value in wanted.items():
        if kept.get(key) != value:
            raise checks.refuse("offline.dataset", f"{name} (its {key}: {kept.get(key)})", f"a data set with {value}")


def _groups(episodes: int) -> list[range]:
    return [range(first, min(first + AT_ONCE, episodes)) for first in range(0, episodes, AT_ONCE)]


def _group(data: Any, numbers: range, coding: Coding) -> dict[str, np.ndarray]:
    """Some episodes, read step by step side by side, as networks that remember need it."""
    episodes = list(data.iterate_episodes(numbers))
    lengths = np.array([len(each.rewards) for each in episodes])
    steps = int(lengths.max())

    def padded(rows: list[np.ndarray]) -> np.ndarray:
        whole = np.zeros((steps + 1, len(rows), *rows[0].shape[1:]), dtype=np.float32)
        for k, each in enumerate(rows):
            whole[: len(each), k] = each
        return whole

    parts = len(coding.parts)
    done = padded([each.actions for each in episodes]).reshape(steps + 1, len(episodes), parts, -1)
    seen_parts, seen_mask = (padded([each.observations[name] for each in episodes]) for name in ("parts", "mask"))
    rows, mask, actions = [], [], []
    seen: Any = None
    start = np.zeros(len(episodes), dtype=bool)
    for step in range(steps + 1):
        seen = coding.see({"parts": seen_parts[step], "mask": seen_mask[step]}, seen, start)
        rows.append(seen.rows)
        mask.append(seen.mask)
        actions.append(coding.to_rows(seen, done[step]))
        if coding.remembers:
            seen.command[...] = done[step]
    there = np.arange(steps + 1) <= lengths[:, None]  # (episodes, observations)
    acted = np.arange(steps + 1) < lengths[:, None]
    order = (np.cumsum(there.reshape(-1)) - 1).reshape(there.shape)
    reward, ended = (
        np.concatenate([np.asarray(each) for each in some]).astype(np.float32)
        for some in ([e.rewards for e in episodes], [e.terminations for e in episodes])
    )
    return {
        "rows": np.stack(rows, axis=1)[there],
        "mask": np.stack(mask, axis=1)[there].astype(np.float32),
        "at": order[acted],
        "action": np.stack(actions, axis=1)[acted].astype(np.float32),
        "reward": reward,
        "ended": ended,
    }
