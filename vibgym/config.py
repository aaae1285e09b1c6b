"""Settings from mappings and files: unknown keys refused, units allowed in key names, one clear error.

A key may carry a unit: ``element_size_mm: 26`` is ``element_size: 0.026``. Everything inside is SI and radians.
"""

from __future__ import annotations

import json
import math
import numbers
from collections.abc import Mapping
from dataclasses import asdict
from enum import Enum
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from vibgym import checks
from vibgym.files import reason
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

UNITS = {"_mm": 1e-3, "_deg": math.pi / 180.0, "_g": 1e-3}
"""Suffixes of keys and the factors to SI."""

MOST_BYTES = 1_000_000
"""Largest settings file."""

MOST_VALUES = 110_000
"""Most values of a settings file, keys included: all seeds of the longest evaluation fit."""


class Settings(BaseModel):
    """Base of all settings: no unknown keys, no silent conversions, finite numbers, frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)


Model = TypeVar("Model", bound=BaseModel)


def to_si(data: Mapping[str, Any], where: str) -> dict[str, Any]:
    """Return a copy in SI units without unit suffixes; numbers and nested lists of numbers are scaled."""
    result: dict[str, Any] = {}
    for key, value in data.items():
        if not isinstance(key, str):
            raise checks.refuse(where, key, "keys that are strings")
        name = key
        for suffix, factor in UNITS.items():
            if key.endswith(suffix):
                name = key.removesuffix(suffix)
                value = _scaled(value, factor, f"{where}.{key}")
                break
        if name in result:
            raise checks.refuse(f"{where}.{key}", value, f"{name!r} once, not in two units")
        result[name] = value
    return result


def _scaled(value: Any, factor: float, where: str) -> Any:
    if isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim):
        return [_scaled(each, factor, where) for each in value]
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise checks.refuse(where, value, "a number")
    return value * factor if isinstance(value, float) else checks.number(where, value) * factor


def parse(model: type[Model], data: Any, where: str) -> Model:
    """Validate ``data`` as ``model``; raise a one-line ValueError that names the first invalid field."""
    if not isinstance(data, Mapping):
        raise checks.refuse(where, data, f"a mapping with keys among {', '.join(model.model_fields)}")
    try:
        return model.model_validate(_plain(to_si(data, where)))
    except RecursionError:
        raise checks.refuse(where, data, "a mapping that does not contain itself") from None
    except ValidationError as error:
        fault = error.errors()[0]
        field = ".".join([where, *(str(part) or "''" for part in fault["loc"])])
        if fault["type"] == "extra_forbidden":
            raise checks.unknown(
                f"key of {'.'.join([where, *map(str, fault['loc'][:-1])])}", str(fault["loc"][-1]), model.model_fields
            ) from None
        if fault["type"] == "missing":
            raise checks.missing(field) from None
        kind, _, allowed = fault["msg"].partition(" should be ")
        if not allowed:  # "List should have at least 1 item after validation, not 0"
            raise checks.conflict(f"{field}: {kind}, got {checks.shown(fault['input'])}") from None
        raise checks.refuse(field, fault["input"], allowed) from None


def json_values(value: Any) -> Any:
    """Return settings as JSON values.

    NumPy numbers and arrays become numbers and lists, enumerations their values, and :class:`vibgym.Part` and
    :class:`vibgym.Surface` mappings, from which
    :func:`vibgym.scene.parts.part_from` and :func:`vibgym.scene.surface.surface_from` make equal ones.
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
        return {key: json_values(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return type(value)(json_values(each) for each in value) if type(value) in (list, tuple) else value
    return value


def _plain(data: dict[str, Any]) -> dict[str, Any]:
    """Return settings for strict validation: NumPy's numbers as Python's, and pairs in lists as tuples."""
    data = {key: json_values(value) for key, value in data.items()}
    return {key: _paired(value) if isinstance(value, list) else value for key, value in data.items()}


def _paired(value: list[Any]) -> list[Any]:
    nested = [isinstance(each, list) and any(isinstance(one, list) for one in each) for each in value]
    return [
        _paired(each) if deep else tuple(each) if isinstance(each, list) else each
        for each, deep in zip(value, nested, strict=True)
    ]


def load_yaml(path: str | Path) -> dict[str, Any]:
    """Read a YAML 1.2 mapping. Duplicate keys, several documents and tags for Python objects are errors.

    Raises:
        ValueError: the file cannot be read, is larger than 1 MB, is not valid YAML (names file and line), is not a mapping, or
            holds more than :data:`MOST_VALUES` values once every alias is expanded.
    """
    from ruamel.yaml import YAML  # importing it takes as long as the rest of this module
    from ruamel.yaml.error import MarkedYAMLError

    path = Path(path)
    try:
        with path.open("rb") as file:
            content = file.read(MOST_BYTES + 1)  # the file may be a device without an end
    except (OSError, ValueError) as error:  # ValueError: a null character in the path
        raise checks.refuse("config", str(path), f"a readable file ({reason(error)})") from None
    if len(content) > MOST_BYTES:
        raise checks.refuse(str(path), f"more than {MOST_BYTES} bytes", f"a file of at most {MOST_BYTES} bytes")
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
        if count > MOST_VALUES:
            raise checks.refuse(str(path), f"more than {MOST_VALUES} values", f"a file of at most {MOST_VALUES} values")
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
