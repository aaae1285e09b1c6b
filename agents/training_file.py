"""Training files: the settings of one run, or of many agents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments
from agents import sb3
from agents.algorithms import ALGORITHMS
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.envs.vector import environment_id
from vibgym.seeds import check_seeds
from vibgym.settings import read

SECTIONS = ("imitation", "residual", "selection", "serves")
"""Sections of a file in addition to those of the algorithms; ``defaults`` may contain a part of a section."""

TUNING = "tuning"
"""Key of the search space, which training ignores: see :mod:`agents.tune`."""


def load_settings(
    path: Path, agent: str | None = None, seed: int | None = None, changes: Mapping[str, Any] | None = None
) -> TrainSettings:
    """Read a training file.

    A file has the settings of one run, or of many agents: then its keys are ids of environments, such as
    ``vibgym/Align-v0``, with the settings of agents by name. ``defaults`` apply to all of them.

    Args:
        path: of the YAML file.
        agent: such as ``"Align/prototype"``, ``prototype`` under ``vibgym/Align-v0``; only for files of many agents.
        seed: instead of the file's.
        changes: values instead of the file's, by names such as ``"ppo.learning_rate"``.

    Raises:
        ValueError: names file and field of the first fault.
    """
    data, where = _read(path, agent, seed)
    data.pop(TUNING, None)
    for name, value in (changes or {}).items():
        first, _, rest = name.partition(".")
        data[first] = {**(data.get(first) or {}), rest: value} if rest else value
    return settings_from(data, where)


def settings_from(data: Mapping[str, Any], where: str = "training") -> TrainSettings:
    """Return the settings of one run. Settings of other algorithms are only validated.

    Args:
        data: contents of a training file.
        where: prefix of errors.
    """
    data = dict(data)
    if "own" in data:
        raise checks.conflict(f"{where}: settings of an algorithm are under its name, not under 'own'")
    name, _, variant = str(data.get("algorithm", "ppo")).partition(".")
    ALGORITHMS.choose(f"{where}: algorithm", name)
    if name == "sb3":
        checks.choice(f"{where}: algorithm sb3.NAME: NAME", variant, sb3.NAMES)
    elif variant:
        with checks.within(where):
            raise checks.unknown("algorithm", data["algorithm"], ALGORITHMS)
    blocks = {key: data.pop(key, None) for key in ALGORITHMS}
    own = {
        key: read(ALGORITHMS[key].Settings, {} if block is None else block, f"{where}: {key}")
        for key, block in blocks.items()
        if block is not None or key == name
    }
    settings = read(TrainSettings, {**data, "own": own[name]}, where)
    environment_id(settings.task, f"{where}.task")
    if (selection := settings.selection) is not None:
        check_seeds(f"{where}: selection.first_seed", selection.first_seed, selection.episodes, "selection")
    return settings


def load_tuning(path: Path, agent: str | None = None) -> tuple[Any, str]:
    """Return the ``tuning`` section of a training file (None without one), and its name for errors."""
    data, where = _read(path, agent, None)
    return data.get(TUNING), f"{where}: {TUNING}"


def _read(path: Path, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """Return the settings of one run in a file, and their name for errors."""
    data, where = load_yaml(path), str(path)
    if "task" not in data and any("/" in str(key) for key in data):  # ids of environments
        return _of_agent(data, where, agent, seed)
    if agent is not None:
        raise checks.conflict(f"--agent: {path} has the settings of one run")
    return (dict(data) if seed is None else {**data, "seed": seed}), where


def agents_in(path: Path) -> tuple[str, ...]:
    """Return the names of the agents in a file of many."""
    return tuple(_agents(load_yaml(path), str(path)))


def _agents(data: dict[str, Any], where: str) -> dict[str, dict[str, Any]]:
    """Return the settings of all agents by name, such as ``Align/prototype``, without the defaults."""
    agents: dict[str, dict[str, Any]] = {}
    for key, variants in data.items():
        if key == "defaults":
            continue
        spec = gym.registry.get(key) if isinstance(key, str) else None
        if spec is None or not isinstance(variants, dict):
            allowed = "a mapping with 'task', for one run, or with 'defaults' and ids of environments"
            raise checks.refuse(where, key, allowed)
        for name, settings in variants.items():
            if not isinstance(settings, dict) or "task" in settings:
                raise checks.refuse(f"{where}: {key}.{name}", settings, "a mapping of settings without 'task'")
            if f"{spec.name}/{name}" in agents:
                raise checks.refuse(f"{where}: {key}", name, "a name that is unique among environments of this name")
            agents[f"{spec.name}/{name}"] = {"task": spec.name if spec.namespace == "vibgym" else key, **settings}
    return agents


def _of_agent(data: dict[str, Any], where: str, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """Return the settings of one agent, and their name for errors."""
    defaults, agents = data.get("defaults", {}), _agents(data, where)
    if not isinstance(defaults, dict):
        raise checks.refuse(f"{where}: defaults", defaults, "a mapping of settings")
    if agent not in agents:
        with checks.within(where):
            raise checks.unknown("agent", agent, agents)
    own = agents[agent]
    merged = {**defaults, **own}
    for name in (*SECTIONS, *ALGORITHMS):
        if isinstance(defaults.get(name), dict) and isinstance(own.get(name), dict):
            merged[name] = {**defaults[name], **own[name]}
    if seed is not None:
        merged["seed"] = seed
    merged.setdefault("output", f"runs/agents/{agent.replace('/', '-')}/seed-{merged.get('seed', 0)}")
    return merged, f"{where}: {agent}"
