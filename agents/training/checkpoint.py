"""All that a training run has come to, on disk: a killed one goes on from it as if nothing had happened."""

from __future__ import annotations

import json
from operator import attrgetter
from pathlib import Path
from typing import Any

import numpy as np
import torch

from agents.failures import Diverged
from agents.training.hyperparameters import MOST_STEPS
from agents.training.train_settings import TrainSettings
from agents.training.trees import put_together, taken_apart
from vibgym import checks
from vibgym.policies.trained.storage import as_float32, load_set, save_set

KIND = "vibgym-checkpoint"
VERSION = 2
FILE = "checkpoint.json"
ADAM = ("step", "exp_avg", "exp_avg_sq")
STATE = "state.json"
"""Tensor that holds the plain part of a model's state, as JSON in UTF-8: so the file's SHA-256 covers it too."""

FREE = {"steps", "checkpoint_steps", "output", "judging", "serves"}
"""Settings that may change between the sittings of a run."""


def check_finite(model: Any) -> None:
    """Raise :class:`Diverged` where a weight, or what an optimizer remembers of it, is not finite."""
    refuse_infinite(_weights(model) | _adam(model))


def refuse_infinite(tensors: dict[str, np.ndarray]) -> None:
    """Raise :class:`Diverged` where a number is not finite."""
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise Diverged(f"NaN or infinity in {name}")


def _saved(model: Any) -> tuple[dict[str, torch.nn.Module], dict[str, torch.optim.Optimizer], dict[str, torch.Tensor]]:
    """Networks, optimizers and single tensors of an algorithm of Stable-Baselines3, by their names there."""
    names, tensors = model._get_torch_save_params()
    found = {name: attrgetter(name)(model) for name in names}
    optimizers = {name: each for name, each in found.items() if isinstance(each, torch.optim.Optimizer)}
    modules = {name: each for name, each in found.items() if name not in optimizers}
    return modules, optimizers, {name: attrgetter(name)(model) for name in tensors}


def _weights(model: Any) -> dict[str, np.ndarray]:
    modules, _, tensors = _saved(model)
    found = {f"{which}.{name}": value for which, each in modules.items() for name, value in each.state_dict().items()}
    return {name: _numpy(value) for name, value in (found | tensors).items()}


def _adam(model: Any) -> dict[str, np.ndarray]:
    return {
        f"adam.{which}.{index}.{name}": _numpy(state[name])
        for which, optimizer in _saved(model)[1].items()
        for index, state in optimizer.state_dict()["state"].items()
        for name in ADAM
    }


def _numpy(tensor: torch.Tensor) -> np.ndarray:
    return tensor.detach().cpu().numpy()


def save(directory: Path, model: Any, settings: TrainSettings, seconds: float) -> None:
    """Write weights, optimizers and the state of model and worlds.

    Args:
        directory: of the run.
        model: an algorithm of Stable-Baselines3 that is :class:`agents.training.resumable.Resumable`.
        settings: of the run.
        seconds: trained so far.

    Raises:
        Diverged: a weight is not finite; the last checkpoint stays.
    """
    tensors = _weights(model) | _adam(model)
    refuse_infinite(tensors)
    arrays, plain = taken_apart(model.get_state(), "state")
    text = np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8)
    record = {"settings": settings.model_dump(mode="json"), "steps": model.num_timesteps, "seconds": seconds}
    save_set(directory / FILE, KIND, {**tensors, **arrays, STATE: text}, record, VERSION)


def restore(directory: Path, model: Any, settings: TrainSettings) -> float:
    """Take ``model`` and its worlds to the last checkpoint in ``directory``, if there is one.

    Returns:
        Seconds trained before.

    Raises:
        ValueError: the checkpoint is damaged or not finite, or belongs to other settings; ``model`` is unchanged.
    """
    path = directory / FILE
    if not path.exists():
        return 0.0
    tensors, record = load_set(path, KIND, VERSION)
    mine, theirs = settings.model_dump(mode="json"), record.get("settings")
    names = [key for key in mine if not isinstance(theirs, dict) or theirs.get(key) != mine[key]]
    if set(names) - FREE:
        allowed = "a checkpoint of the same settings; remove it or choose another output"
        raise checks.refuse(str(path), f"other {', '.join(names)}", allowed)
    seconds = checks.number(f"{path}: seconds", record.get("seconds"), least=0.0)
    checks.count(f"{path}: steps", record.get("steps"), least=0, most=MOST_STEPS)
    modules, optimizers, single = _saved(model)
    learned = as_float32(str(path), {name: value for name, value in tensors.items() if not name.startswith("state")})
    shapes = {name: value.shape for name, value in _weights(model).items()}
    memories: dict[str, dict[str, Any]] = {}
    for which, optimizer in optimizers.items():
        memories[which] = {**optimizer.state_dict(), "state": {}}
        for index, parameter in enumerate(p for group in optimizer.param_groups for p in group["params"]):
            prefix = f"adam.{which}.{index}"
            if f"{prefix}.step" in learned:
                shapes |= {f"{prefix}.step": (), **{f"{prefix}.{name}": tuple(parameter.shape) for name in ADAM[1:]}}
                memories[which]["state"][index] = {
                    name: torch.from_numpy(learned[f"{prefix}.{name}"])
                    for name in ADAM
                    if f"{prefix}.{name}" in learned
                }
    if (
        any(name not in learned or learned[name].shape != shape for name, shape in shapes.items())
        or STATE not in tensors
    ):
        raise checks.refuse(str(path), "tensors of another network", "a checkpoint of the same settings")
    try:
        model.set_state(put_together(json.loads(tensors[STATE].tobytes()), tensors))
    except (ValueError, KeyError, TypeError) as error:  # written by another version, whose worlds know other things
        allowed = f"a checkpoint of this version ({error})"
        raise checks.refuse(str(path), "a state of other worlds", allowed) from None
    for which, module in modules.items():
        module.load_state_dict({name: torch.from_numpy(learned[f"{which}.{name}"]) for name in module.state_dict()})
    with torch.no_grad():
        for name, tensor in single.items():
            tensor.copy_(torch.from_numpy(learned[name]))
    for which, optimizer in optimizers.items():
        optimizer.load_state_dict(memories[which])
    return seconds
