"""Training files: the settings of one run, or of many agents."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym

import vibgym  # noqa: F401 - registers the environments
from agents.training.algorithms import ALGORITHMS
from agents.training.imitation import ImitationSettings
from agents.training.outlines import OutlineSettings
from agents.training.residual_env import ResidualSettings
from agents.training.train_settings import JudgingSettings, ServesSettings, TrainSettings
from vibgym import checks
from vibgym.config import Settings, load_yaml, parse
from vibgym.envs.named import environment_id

SECTIONS: dict[str, type[Settings]] = {
    "imitation": ImitationSettings,
    "residual": ResidualSettings,
    "judging": JudgingSettings,
    "outlines": OutlineSettings,
    "serves": ServesSettings,
}
"""Mappings in a file, beside those of the algorithms, which are checked one by one and may stand in ``defaults`` in part."""

TUNING = "tuning"
"""Key of what is tuned, which no training reads: see :mod:`agents.tuning.tuning_settings`."""


def load_settings(
    path: Path, agent: str | None = None, seed: int | None = None, changes: Mapping[str, Any] | None = None
) -> TrainSettings:
    """Read a training file; the first fault is a one-line ValueError that names file and field.

    A file holds the settings of one run, or of many agents: then its keys are the ids of environments, such as
    ``vibgym/Align-v0``, under each of which the settings of its agents stand by name. What stands under ``defaults`` counts for
    all of them.

    Args:
        path: of the YAML file.
        agent: ``"Align/prototype"``: that of this name under ``vibgym/Align-v0``; only for files of many agents.
        seed: instead of the file's.
        changes: values instead of the file's, by names such as ``"ppo.learning_rate"``.
    """
    data, where = _read(path, agent, seed)
    data.pop(TUNING, None)
    for name, value in (changes or {}).items():
        first, _, rest = name.partition(".")
        data[first] = {**(data.get(first) or {}), rest: value} if rest else value
    return settings_from(data, where)


def settings_from(data: Mapping[str, Any], where: str = "training") -> TrainSettings:
    """The settings of one run; those of its algorithm stand under its name, and those of others are only checked.

    Args:
        data: as files have it.
        where: what to call it in errors.

    Raises:
        ValueError: names the first fault.
    """
    data = dict(data)
    if "own" in data:
        raise checks.refuse(f"{where}: own", data["own"], "nothing: settings of an algorithm stand under its name")
    name = data.get("algorithm", "ppo")
    ALGORITHMS.choose(f"{where}: algorithm", name)
    blocks = {each: data.pop(each, None) for each in ALGORITHMS}
    blocks[name] = {} if blocks[name] is None else blocks[name]
    own = {
        each: parse(ALGORITHMS[each].hyperparameters, block, f"{where}: {each}")
        for each, block in blocks.items()
        if block is not None
    }[name]
    for each, model in SECTIONS.items():
        if isinstance(data.get(each), Mapping):
            data[each] = parse(model, data[each], f"{where}: {each}")
    settings = parse(TrainSettings, {**data, "own": own}, where)
    environment_id(settings.task, f"{where}.task")
    return settings


def load_tuning(path: Path, agent: str | None = None) -> tuple[Any, str]:
    """What a training file says of tuning, None if nothing, and what to call it."""
    data, where = _read(path, agent, None)
    return data.get(TUNING), f"{where}: {TUNING}"


def _read(path: Path, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """The settings of one run as they stand in a file, and what to call them."""
    data, where = load_yaml(path), str(path)
    if "task" not in data and any("/" in str(key) for key in data):  # ids of environments
        return _of_agent(data, where, agent, seed)
    if agent is not None:
        raise checks.refuse("--agent", agent, f"nothing: {path} holds the settings of one run")
    return (dict(data) if seed is None else {**data, "seed": seed}), where


def agents_in(path: Path) -> tuple[str, ...]:
    """Names of the agents in a file of many."""
    return tuple(_agents(load_yaml(path), str(path)))


def _agents(data: dict[str, Any], where: str) -> dict[str, dict[str, Any]]:
    found = {}
    for key, own in data.items():
        if key == "defaults":
            continue
        spec = gym.registry.get(key) if isinstance(key, str) else None
        if spec is None or not isinstance(own, dict):
            raise checks.refuse(
                where, key, "a mapping with 'task', for one run, or with 'defaults' and ids of environments"
            )
        for name, settings in own.items():
            if not isinstance(settings, dict) or "task" in settings:
                raise checks.refuse(f"{where}: {key}.{name}", settings, "a mapping of settings without 'task'")
            task = spec.name if spec.namespace == "vibgym" else key
            if f"{spec.name}/{name}" in found:
                raise checks.refuse(f"{where}: {key}", name, "a name that no other environment of this name has")
            found[f"{spec.name}/{name}"] = {"task": task, **settings}
    return found


def _of_agent(data: dict[str, Any], where: str, agent: str | None, seed: int | None) -> tuple[dict[str, Any], str]:
    """Settings of one agent of a file, and what to call them."""
    defaults, agents = data.get("defaults", {}), _agents(data, where)
    if not isinstance(defaults, dict):
        raise checks.refuse(f"{where}: defaults", defaults, "a mapping of settings")
    if agent not in agents:
        raise checks.refuse(f"{where}: agent", agent, f"one of {', '.join(agents)}")
    own = agents[agent]
    merged = {**defaults, **own}
    for name in (*SECTIONS, *ALGORITHMS):
        if isinstance(defaults.get(name), dict) and isinstance(own.get(name), dict):
            merged[name] = {**defaults[name], **own[name]}
    if seed is not None:
        merged["seed"] = seed
    merged.setdefault("output", f"runs/agents/{agent.replace('/', '-')}/seed-{merged.get('seed', 0)}")
    return merged, f"{where}: {agent}"
