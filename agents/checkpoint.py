"""Checkpoints: one nested dictionary of arrays, tensors, numbers and texts in one file of torch; reading runs no code."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from vibgym import checks
from vibgym.files import write_atomically

FILE = "checkpoint.pt"
VERSION = 6


class Diverged(RuntimeError):
    """A weight or a loss is not finite; nothing has been written."""


def save(directory: Path, state: Mapping[str, Any]) -> None:
    """Write a checkpoint into ``directory``; the old one stays until the new one is complete.

    Args:
        directory: of the run.
        state: nested mappings, lists and tuples of arrays, tensors, numbers, strings and None; tuples become lists.
    """
    file = io.BytesIO()
    torch.save({"version": VERSION, "state": _mapped(state, _as_torch)}, file)
    write_atomically(directory / FILE, file.getvalue())


def load(directory: Path) -> dict[str, Any] | None:
    """Return what :func:`save` wrote, with tensors in place of arrays (see :func:`arrays`), or None without a checkpoint.

    Raises:
        ValueError: the file is damaged, or of another version.
    """
    path = directory / FILE
    if not path.exists():
        return None
    try:
        with zipfile.ZipFile(path) as file:
            damaged = file.testzip()  # torch does not check the sums
        content = {} if damaged else torch.load(path, weights_only=True)
        if content.get("version") == VERSION:
            return content["state"]
        fault = f"{damaged} is damaged" if damaged else f"version {content.get('version')}, not {VERSION}"
    except Exception as error:  # damaged pickles raise anything
        fault = " ".join(str(error).split())[:200]
    raise checks.conflict(f"{path}: not a checkpoint ({fault}); remove it or choose another output")


def restore(directory: Path, set_state: Callable[[dict[str, Any]], None]) -> bool:
    """Continue from the checkpoint in ``directory``; return False if there is none.

    Raises:
        ValueError: it is damaged, or ``set_state`` rejects it: it belongs to other networks, worlds or data.
    """
    state = load(directory)
    if state is None:
        return False
    try:
        set_state(state)
    except (ValueError, KeyError, TypeError, RuntimeError) as error:  # RuntimeError: other shapes of networks
        text = " ".join(str(error).split())[:200]
        raise checks.conflict(f"{directory / FILE}: of another run ({text}); choose another output") from None
    return True


def arrays(tree: Any) -> Any:
    """Return a part of a checkpoint with NumPy's arrays in place of tensors."""
    return _mapped(tree, lambda leaf: leaf.numpy() if isinstance(leaf, torch.Tensor) else leaf)


def check_finite(tree: Any, name: str = "") -> None:
    """Raise :class:`Diverged` if a tensor or an array of a nested mapping has values that are not finite."""
    if isinstance(tree, Mapping):
        for key, value in tree.items():
            check_finite(value, f"{name}.{key}" if name else str(key))
    elif isinstance(tree, torch.Tensor | np.ndarray) and not torch.isfinite(torch.as_tensor(tree)).all():
        raise Diverged(f"NaN or infinity in {name}")


def _mapped(tree: Any, function: Callable[[Any], Any]) -> Any:
    if isinstance(tree, Mapping):
        return {key: _mapped(value, function) for key, value in tree.items()}
    return [_mapped(entry, function) for entry in tree] if isinstance(tree, list | tuple) else function(tree)


def _as_torch(leaf: Any) -> Any:
    if isinstance(leaf, np.ndarray):
        return torch.from_numpy(np.array(leaf, order="C"))
    return leaf.item() if isinstance(leaf, np.generic) else leaf
