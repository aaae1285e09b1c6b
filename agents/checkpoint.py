"""Checkpoints: networks, optimizers and nested state as named arrays and JSON; reading them runs no code."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from agents.failures import Diverged
from vibgym import checks
from vibgym.policies.trained.storage import as_float32, load_set, save_set

KIND = "vibgym-checkpoint"
VERSION = 5
FILE = "checkpoint.json"
ADAM = ("step", "exp_avg", "exp_avg_sq")
STATE = "state.json"
"""Tensor with the state as JSON in UTF-8, so that the file's SHA-256 covers it."""

ARRAY = "$array"
"""Key of a mapping that represents the array of this name."""

Modules = Mapping[str, torch.nn.Module]
Optimizers = Mapping[str, torch.optim.Optimizer]


def check_finite(tensors: Mapping[str, np.ndarray]) -> None:
    """Raise :class:`Diverged` if a value is not finite."""
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise Diverged(f"NaN or infinity in {name}")


def tensors_of(modules: Modules, optimizers: Optimizers) -> dict[str, np.ndarray]:
    """Return weights and states of Adam as arrays by name."""
    return _weights(modules) | {
        f"adam.{which}.{index}.{name}": state[name].detach().cpu().numpy()
        for which, optimizer in optimizers.items()
        for index, state in optimizer.state_dict()["state"].items()
        for name in ADAM
    }


def _weights(modules: Modules) -> dict[str, np.ndarray]:
    return {
        f"{which}.{name}": value.detach().cpu().numpy()
        for which, module in modules.items()
        for name, value in module.state_dict().items()
    }


def save(directory: Path, modules: Modules, optimizers: Optimizers, state: Any) -> None:
    """Write a checkpoint into ``directory``; the old one stays until the new one is complete.

    Args:
        directory: of the run.
        modules, optimizers: by name; optimizers are Adam.
        state: nested mappings, lists and tuples of arrays, numbers, strings and None.

    Raises:
        Diverged: a weight is not finite.
    """
    tensors = tensors_of(modules, optimizers)
    check_finite(tensors)
    arrays, plain = flatten(state, "state")
    text = np.frombuffer(json.dumps(plain).encode(), dtype=np.uint8)
    save_set(directory / FILE, KIND, {**tensors, **arrays, STATE: text}, {"steps": state["steps"]}, VERSION)


def load(directory: Path, modules: Modules, optimizers: Optimizers, set_state: Callable[[Any], None]) -> bool:
    """Restore what :func:`save` wrote; return False if there is no checkpoint.

    Args:
        directory, modules, optimizers: as in :func:`save`.
        set_state: receives the state.

    Raises:
        ValueError: the checkpoint is damaged, not finite, or of other networks or worlds; modules are unchanged.
    """
    path = directory / FILE
    if not path.exists():
        return False
    tensors, _ = load_set(path, KIND, VERSION)
    learned = as_float32(str(path), {name: value for name, value in tensors.items() if not name.startswith("state")})
    shapes = {name: value.shape for name, value in _weights(modules).items()}
    for which, optimizer in optimizers.items():
        for index, parameter in enumerate(p for group in optimizer.param_groups for p in group["params"]):
            prefix = f"adam.{which}.{index}"
            if f"{prefix}.step" in learned:  # Adam has a state for parameters with a gradient
                shapes |= {f"{prefix}.{name}": tuple(parameter.shape) for name in ADAM} | {f"{prefix}.step": ()}
    if STATE not in tensors or any(name not in learned or learned[name].shape != shapes[name] for name in shapes):
        raise checks.conflict(f"{path}: tensors of another network; remove the checkpoint or choose another output")
    try:
        set_state(unflatten(json.loads(tensors[STATE].tobytes()), tensors))
    except (ValueError, KeyError, TypeError) as error:  # written by another version
        raise checks.conflict(f"{path}: state of other worlds ({error})") from None
    for which, module in modules.items():
        module.load_state_dict({name: torch.from_numpy(learned[f"{which}.{name}"]) for name in module.state_dict()})
    for which, optimizer in optimizers.items():
        state: dict[int, dict[str, torch.Tensor]] = {}
        for name, value in learned.items():
            kind, _, rest = name.partition(f".{which}.")
            if kind == "adam":
                index, _, key = rest.partition(".")
                state.setdefault(int(index), {})[key] = torch.from_numpy(value)
        optimizer.load_state_dict({**optimizer.state_dict(), "state": state})
    return True


def flatten(tree: Any, name: str) -> tuple[dict[str, np.ndarray], Any]:
    """Return the arrays of nested mappings, lists and tuples by name, and the remaining plain values for JSON.

    Tuples, including named ones, become lists (see :func:`restore_tuples`); NumPy scalars become Python's.

    Args:
        tree: of arrays, numbers, strings and None.
        name: prefix of the arrays' names.

    Raises:
        TypeError: another type is among them.
    """
    if isinstance(tree, np.ndarray):
        if tree.dtype.kind not in "biuf":
            raise TypeError(f"{name}: an array of {tree.dtype}")
        return {name: tree}, {ARRAY: name}
    if isinstance(tree, np.generic):
        return {}, tree.item()
    if tree is None or isinstance(tree, bool | int | float | str):
        return {}, tree
    if isinstance(tree, Mapping):
        pairs: Any = tree.items()
    elif isinstance(tree, list | tuple):
        pairs = enumerate(tree)
    else:
        raise TypeError(f"{name}: {type(tree).__name__}")
    arrays: dict[str, np.ndarray] = {}
    plain = {}
    for key, value in pairs:
        found, plain[key] = flatten(value, f"{name}.{key}")
        arrays.update(found)
    return arrays, plain if isinstance(tree, Mapping) else list(plain.values())


def unflatten(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """Return the nested values again.

    Raises:
        KeyError: an array is missing.
    """
    if isinstance(plain, dict):
        return arrays[plain[ARRAY]] if set(plain) == {ARRAY} else {k: unflatten(v, arrays) for k, v in plain.items()}
    return [unflatten(each, arrays) for each in plain] if isinstance(plain, list) else plain


def restore_tuples(pattern: Any, tree: Any) -> Any:
    """Return ``tree`` with tuples, including named ones, where ``pattern`` has them and ``tree`` has lists.

    Raises:
        ValueError: they differ in form.
    """
    if isinstance(pattern, tuple):
        if not isinstance(tree, list) or len(tree) != len(pattern):
            raise ValueError(f"expected a list of {len(pattern)}, got {type(tree).__name__}")
        values = [restore_tuples(*each) for each in zip(pattern, tree, strict=True)]
        return type(pattern)(*values) if hasattr(pattern, "_fields") else tuple(values)
    if isinstance(pattern, np.ndarray) and (not isinstance(tree, np.ndarray) or tree.shape != pattern.shape):
        raise ValueError(f"expected an array of shape {pattern.shape}, got {type(tree).__name__}")
    return tree
