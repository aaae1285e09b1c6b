"""Settings in files and on command lines, and as JSON values."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import reason
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

MAX_BYTES = 1_000_000
"""Largest settings file."""

MAX_VALUES = 110_000
"""Most values of a settings file, keys included: all seeds of the longest evaluation fit."""


def json_values(value: Any) -> Any:
    """Return settings as JSON values.

    NumPy numbers become numbers, arrays and tuples lists, enumerations their values, and :class:`vibgym.Part` and
    :class:`vibgym.Surface` mappings, from which :func:`vibgym.scene.parts.part_from` and
    :func:`vibgym.scene.surface.surface_from` make equal ones.
    """
    if isinstance(value, Part):
        return value.to_dict()
    if isinstance(value, Surface):
        return asdict(value)
    if isinstance(value, np.ndarray | np.generic):
        return value.tolist()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: json_values(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [json_values(entry) for entry in value]
    return value


def load_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML 1.2 mapping. Duplicate keys, several documents and tags for Python objects are errors.

    Raises:
        ValueError: the file cannot be read, is larger than 1 MB, is not valid YAML (names file and line), is not a mapping, or
            holds more than :data:`MAX_VALUES` values once every alias is expanded.
    """
    from ruamel.yaml import YAML  # importing it takes as long as the rest of this module
    from ruamel.yaml.error import MarkedYAMLError

    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(MAX_BYTES + 1)  # the file may be a device without an end
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise checks.refuse("config", str(path), f"a readable file ({reason(error)})") from None
    if len(content) > MAX_BYTES:
        raise checks.refuse(str(path), f"more than {MAX_BYTES} bytes", f"a file of at most {MAX_BYTES} bytes")
    try:
        data = YAML(typ="safe", pure=True).load(content.decode("utf-8"))
    except MarkedYAMLError as error:
        mark = error.problem_mark or error.context_mark
        where = path if mark is None else f"{path}, line {mark.line + 1}"
        raise checks.refuse(str(where), error.problem, "valid YAML") from None
    except Exception as error:  # constructors of dates and numbers, UTF-8, and the recursion limit
        raise checks.refuse(str(path), str(error), "valid YAML") from None
    if not isinstance(data, dict):
        raise checks.refuse(str(path), type(data).__name__, "a mapping of settings")
    _check_size(path, data)
    return data


def _check_size(path: Path, data: dict[str, Any]) -> None:
    """Limit the values with every alias expanded: nested aliases grow exponentially, and an alias of itself never ends."""
    count, pending = 0, [data]
    while pending:
        value: Any = pending.pop()
        inner = [*value, *value.values()] if isinstance(value, dict) else value if isinstance(value, list) else []
        count += len(inner)
        if count > MAX_VALUES:
            raise checks.refuse(str(path), f"more than {MAX_VALUES} values", f"a file of at most {MAX_VALUES} values")
        pending.extend(inner)


def from_text(argument: str, text: str) -> Any:
    """Return the value of an argument of a command: a mapping from JSON or a YAML file, or the name or path itself."""
    if Path(text).suffix.lower() in (".yaml", ".yml"):
        return load_yaml(text)
    if not text.lstrip().startswith("{"):
        return text
    try:
        return json.loads(text)
    except ValueError as error:
        raise checks.refuse(argument, text, f"JSON ({error})") from None
