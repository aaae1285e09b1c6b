"""State of a training run and the policy that comes out of it, as tensors and settings."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO

from agents.learned.coding import Coding
from agents.learned.pictures import PictureCoding
from agents.learned.storage import as_float32, load_set, save_set
from agents.learned.trained import ANY, RESIDUAL, described
from agents.learned.trained import KIND as POLICY_KIND
from agents.learned.trained import VERSION as POLICY_VERSION
from agents.task_info import TaskInfo
from agents.training.parts_policy import trained_tensors
from agents.training.ppo import PartsPPO
from agents.training.settings import MOST_STEPS, TrainSettings
from vibgym import checks

KIND = "vibgym-checkpoint"
FILE = "checkpoint.json"
ADAM = ("step", "exp_avg", "exp_avg_sq")
FREE = {"steps", "checkpoint_steps", "output", "judging", "serves"}
"""Settings that may change between the sittings of a run."""


class Diverged(RuntimeError):
    """A model has numbers that are not finite; nothing has been written."""


class TrainingError(RuntimeError):
    """A training that ended before its time, for no fault of the program's."""


def check_finite(model: PPO) -> None:
    """Raise :class:`Diverged` where a weight, or what the optimizer remembers of it, is not finite."""
    _refuse_infinite(_weights(model) | _optimizer(model))


def _refuse_infinite(tensors: dict[str, np.ndarray]) -> None:
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise Diverged(f"NaN or infinity in {name}")


def _weights(model: PPO) -> dict[str, np.ndarray]:
    return {f"policy.{name}": _numpy(value) for name, value in model.policy.state_dict().items()}


def _optimizer(model: PPO) -> dict[str, np.ndarray]:
    states = model.policy.optimizer.state_dict()["state"].items()
    return {f"adam.{index}.{name}": _numpy(state[name]) for index, state in states for name in ADAM}


def _numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy()


def save(directory: Path, model: PPO, settings: TrainSettings, seconds: float) -> None:
    """Write weights, optimizer state and counters.

    Raises:
        Diverged: one of them is not finite; the last checkpoint stays.
    """
    tensors = _weights(model) | _optimizer(model)
    _refuse_infinite(tensors)
    record = {"settings": settings.model_dump(mode="json"), "steps": model.num_timesteps, "seconds": seconds}
    record["pace"] = model.pace if isinstance(model, PartsPPO) else 1.0
    save_set(directory / FILE, KIND, tensors, record)


def restore(directory: Path, model: PPO, settings: TrainSettings) -> float:
    """Take ``model`` to the last checkpoint in ``directory``, if there is one.

    Returns:
        Seconds trained before.

    Raises:
        ValueError: the checkpoint is damaged or not finite, or belongs to other settings; ``model`` is unchanged.
    """
    path = directory / FILE
    if not path.exists():
        return 0.0
    tensors, record = load_set(path, KIND)
    mine = settings.model_dump(mode="json")
    theirs = record.get("settings")
    names = [key for key in mine if not isinstance(theirs, dict) or theirs.get(key) != mine[key]]
    if set(names) - FREE:
        raise checks.refuse(
            str(path),
            f"other {', '.join(names)}",
            "a checkpoint of the same settings; remove it or choose another output",
        )
    tensors = as_float32(str(path), tensors)
    wanted = {f"policy.{name}": value for name, value in model.policy.state_dict().items()}
    shapes = {name: tuple(value.shape) for name, value in wanted.items()}
    trained = [parameter for group in model.policy.optimizer.param_groups for parameter in group["params"]]
    for index, parameter in enumerate(trained):
        if f"adam.{index}.step" in tensors:
            shapes.update({f"adam.{index}.{name}": tuple(parameter.shape) for name in ADAM[1:]})
    counted = [value for name, value in tensors.items() if name.startswith("adam.") and name.endswith(".step")]
    if any(name not in tensors or tensors[name].shape != shape for name, shape in shapes.items()) or any(
        value.size != 1 for value in counted
    ):
        raise checks.refuse(str(path), "tensors of another network", "a checkpoint of the same settings")
    steps = checks.count(f"{path}: steps", record.get("steps"), least=0, most=MOST_STEPS)
    seconds = checks.number(f"{path}: seconds", record.get("seconds"), least=0.0)
    pace = checks.number(f"{path}: pace", record.get("pace"), above=0.0, most=1.0)
    optimizer = model.policy.optimizer.state_dict()
    indices = [index for group in optimizer["param_groups"] for index in group["params"]]
    optimizer["state"] = {
        index: {name: torch.from_numpy(tensors[f"adam.{index}.{name}"].copy()) for name in ADAM}
        for index in indices
        if f"adam.{index}.step" in tensors
    }
    model.policy.load_state_dict({name[7:]: torch.from_numpy(tensors[name].copy()) for name in wanted})
    model.policy.optimizer.load_state_dict(optimizer)
    model.num_timesteps = steps
    if isinstance(model, PartsPPO):
        model.pace = pace
    return seconds


def save_policy(path: Path, model: PPO, settings: TrainSettings, env: Any, training: dict[str, Any]) -> None:
    """Write the acting part of the model for :func:`agents.learned.trained.load_trained`.

    Raises:
        Diverged: a weight is not finite; an older policy stays.
    """
    tensors = trained_tensors(model.policy.actor)  # type: ignore[arg-type]
    _refuse_infinite(tensors)
    serves, info = settings.serves, TaskInfo.of(env)
    coding: Coding | PictureCoding = model.policy.coding  # type: ignore[assignment]
    record: dict[str, Any] = {
        "tasks": list(dict.fromkeys([info.name, *(serves.tasks or ())])),
        "surface": ANY if serves.surface == ANY else described(info.surface),
        "parts": ANY if serves.parts == ANY else len(info.parts),
        "columns": coding.columns,
        "turned": coding.turned,
        "remembers": coding.remembers,
        "action": coding.action,
        "network": settings.ppo.network,
        "activation": settings.ppo.activation,
        "training": training,
    }
    if settings.residual is not None:
        record[RESIDUAL] = settings.residual.model_dump(mode="json")
    save_set(path, POLICY_KIND, tensors, record, POLICY_VERSION)
