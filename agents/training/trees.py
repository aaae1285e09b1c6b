"""Nested values as named arrays and JSON, so that reading them back runs no code."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

ARRAY = "$array"
"""Key of a mapping that stands for an array of this name."""


def taken_apart(tree: Any, name: str) -> tuple[dict[str, np.ndarray], Any]:
    """The arrays of nested mappings, lists and tuples, by name, and what remains: plain values for JSON.

    Tuples, named ones too, come back as lists, see :func:`as_was`; NumPy's numbers as Python's.

    Args:
        tree: of arrays, numbers, strings and None.
        name: with which the arrays' names begin.

    Raises:
        TypeError: something else is among them.
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
        found, plain[key] = taken_apart(value, f"{name}.{key}")
        arrays.update(found)
    return arrays, plain if isinstance(tree, Mapping) else list(plain.values())


def put_together(plain: Any, arrays: Mapping[str, np.ndarray]) -> Any:
    """The nested values again.

    Raises:
        KeyError: an array is missing.
    """
    if isinstance(plain, dict):
        return arrays[plain[ARRAY]] if set(plain) == {ARRAY} else {k: put_together(v, arrays) for k, v in plain.items()}
    return [put_together(each, arrays) for each in plain] if isinstance(plain, list) else plain


def as_was(pattern: Any, tree: Any) -> Any:
    """``tree`` with the tuples, named ones too, that ``pattern`` has where ``tree`` has lists.

    Raises:
        ValueError: they differ in form.
    """
    if isinstance(pattern, tuple):
        if not isinstance(tree, list) or len(tree) != len(pattern):
            raise ValueError(f"got {type(tree).__name__}; allowed: a list of {len(pattern)}")
        values = [as_was(*each) for each in zip(pattern, tree, strict=True)]
        return type(pattern)(*values) if hasattr(pattern, "_fields") else tuple(values)
    if isinstance(pattern, np.ndarray) and (not isinstance(tree, np.ndarray) or tree.shape != pattern.shape):
        raise ValueError(f"got {type(tree).__name__}; allowed: an array of shape {pattern.shape}")
    return tree
