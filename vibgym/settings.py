"""Settings: what can be set, stated once as a pydantic model: names, types, units, ranges and defaults.

Every registered class has a ``Settings``, and :meth:`vibgym.registry.Registry.make` constructs it with one::

    class Clearance(Cost):
        class Settings(BaseSettings):
            below: Length = Field(default=0.005, gt=0.0)
            \"\"\"Distance below which a part is too near.\"\"\"

Values are SI and radians. A key may carry a unit instead: ``below_mm: 5`` is ``below: 0.005``, for fields of :data:`Length`,
:data:`Angle` and :data:`Mass` and what is derived from them. Sequences are tuples; lists and arrays are converted. Nothing else
is: ``"5"`` is no number, and ``True`` is none either.
"""

from __future__ import annotations

import ast
import functools
import inspect
import itertools
import math
import numbers
import textwrap
import types
from collections.abc import Mapping, Sequence
from enum import Enum
from pathlib import Path
from typing import Annotated, Any, Literal, NamedTuple, TypeVar, Union, get_args, get_origin

import numpy as np
from annotated_types import Ge, Gt, Le, Lt, MaxLen, MinLen
from pydantic import BaseModel, ConfigDict, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import core_schema

from vibgym import checks


class Unit(NamedTuple):
    """Unit of a field, part of its annotation."""

    symbol: str


Length = Annotated[float, Unit("m")]
Angle = Annotated[float, Unit("rad")]
Mass = Annotated[float, Unit("kg")]
Speed = Annotated[float, Unit("m/s")]
Acceleration = Annotated[float, Unit("m/s^2")]

SUFFIXES = {"m": ("mm", 1e-3), "rad": ("deg", math.pi / 180.0), "kg": ("g", 1e-3)}
"""Unit -> the one that a key may carry, and its factor to SI; ``speed_mm`` is in mm/s."""


class AsGiven:
    """Part of the annotation of a value that is neither converted nor validated, since what gets it does so."""

    @staticmethod
    def __get_pydantic_core_schema__(source: Any, handler: Any) -> core_schema.CoreSchema:
        return core_schema.any_schema()


Value = TypeVar("Value")

Given = Annotated[Value, AsGiven]


class BaseSettings(BaseModel):
    """Base of all settings: no unknown names, no silent conversions, finite numbers, frozen."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False, defer_build=True)

    @model_validator(mode="before")
    @classmethod
    def _in_si(cls, values: Any) -> Any:
        """Return the given values in SI units without suffixes."""
        return in_si(cls, values) if isinstance(values, Mapping) else values


def in_si(model: type[BaseModel], values: Mapping[Any, Any]) -> dict[Any, Any]:
    """Return values by the names of a model's fields, in SI units; other keys as they are.

    Raises:
        ValueError: a setting that is given twice, in two units.
    """
    suffixed, result = with_unit(model), {}
    untouched = {name for name, field in model.model_fields.items() if AsGiven in field.metadata}
    for key, value in values.items():
        name, factor = suffixed.get(key, (key, 1.0))
        if name in result:
            raise checks.conflict(f"{name!r} is given twice, in two units")
        try:
            value = value if name in untouched else plain(value)
        except RecursionError:
            raise _endless(str(key), value) from None
        result[name] = value if factor == 1.0 else _scaled(value, factor)
    return result


Model = TypeVar("Model", bound=BaseModel)


def read(model: type[Model], values: Any, where: str) -> Model:
    """Return settings from a mapping, or those that are given; raise one line that names argument, value and range.

    Args:
        where: the argument that holds them, for errors; empty: they are arguments themselves.
    """
    if isinstance(values, model):
        return values
    if not isinstance(values, Mapping):
        raise checks.refuse(where, values, f"a mapping with keys among {', '.join(model.model_fields)}")
    try:
        return model.model_validate(values)
    except RecursionError:
        raise checks.refuse(
            where or ", ".join(map(str, values)), values, "a mapping that does not contain itself"
        ) from None
    except ValidationError as error:
        raise refusal(error, model, values, where) from None


def refusal(error: ValidationError, model: type[BaseModel], value: Any, where: str) -> checks.Refused:
    """Return the one-line error for values that a model does not take."""
    # An unknown name first: a field may be missing because its name is misspelt.
    faults = sorted(error.errors(include_url=False), key=lambda fault: fault["type"] != "extra_forbidden")
    # One fault for each member of a union: the member that fits best fails deepest.
    same = [fault for fault in faults if fault["loc"][:1] == faults[0]["loc"][:1]]
    fault = max(same, key=lambda candidate: len(candidate["loc"]))
    place, owner, field, factor = where, model, None, 1.0
    for part in fault["loc"]:
        if isinstance(value, Mapping):
            if part in owner.model_fields:
                names = {name: (key, scale) for key, (name, scale) in with_unit(owner).items() if key in value}
                key, factor = names.get(part, (part, 1.0))
                field = owner.model_fields[part]
                owner = _model_of(field.annotation, fault["loc"]) or owner
            elif part in value:
                key, field = part, None
            else:
                continue  # the name of a member of a union
            place, value = f"{place}.{key}" if place else str(key), value.get(key)
        elif isinstance(part, int) and checks.listed(value) and part < len(value) and factor == 1.0:
            place, value, field = f"{place}[{part}]", value[part], None
    kind = fault["type"]
    if kind == "extra_forbidden":
        return checks.unknown("setting", fault["loc"][-1], owner.model_fields, of=place.rpartition(".")[0])
    if kind == "missing" and not checks.listed(value):
        return checks.missing(place)
    if kind == "value_error":
        return checks.conflict(f"{place}: {fault.get('ctx', {}).get('error')}".removeprefix(": "))
    if field is not None:
        return checks.refuse(place, value, allowed(field, factor))
    if kind == "missing":
        return checks.conflict(f"{place} has too few items, got {checks.shown(value)}")
    what, _, values = fault["msg"].partition(" should be ")
    if not values:  # "List should have at least 1 item after validation, not 0"
        return checks.conflict(f"{place}: {what[0].lower()}{what[1:]}, got {checks.shown(value)}")
    return checks.refuse(place, value, values)


def _model_of(kind: Any, location: tuple[Any, ...]) -> type[BaseModel] | None:
    """Return the model in an annotation, of several the one that the location of a fault names."""
    models = [model for model in _nested(kind) if isinstance(model, type) and issubclass(model, BaseModel)]
    return next((model for model in models if model.__name__ in location), models[0] if models else None)


def _nested(kind: Any) -> list[Any]:
    """Return the types in an annotation, without containers."""
    inner = [inner_kind for argument in get_args(kind) for inner_kind in _nested(argument)]
    return inner or [kind]


# -- units -------------------------------------------------------------------------------------------------------------


@functools.cache
def with_unit(model: type[BaseModel]) -> dict[str, tuple[str, float]]:
    """Return the keys with a unit that a model takes: name of the field, and factor to SI."""
    keys = {}
    for name, field in model.model_fields.items():
        symbol, _, _ = (unit_of(field) or "").partition("/")
        if symbol in SUFFIXES:  # others, such as s, have no further unit
            suffix, factor = SUFFIXES[symbol]
            keys[f"{name}_{suffix}"] = name, factor
    return keys


def unit_of(field: FieldInfo) -> str | None:
    """Return the unit of a field, None without one."""
    units = [unit for unit in (*field.metadata, *_metadata(field.annotation)) if isinstance(unit, Unit)]
    return units[0].symbol if units else None


def _metadata(kind: Any) -> list[Any]:
    """Return all metadata in an annotation, of items of containers too."""
    own = list(kind.__metadata__) if get_origin(kind) is Annotated else []
    return own + [note for argument in get_args(kind) if not isinstance(argument, Unit) for note in _metadata(argument)]


def plain(value: Any) -> Any:
    """Return a value with Python's numbers instead of NumPy's, and tuples instead of lists and arrays."""
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if isinstance(value, Enum):
        return value.value
    if isinstance(value, Mapping):
        return {key: plain(entry) for key, entry in value.items()}
    return tuple(map(plain, value)) if type(value) in (list, tuple) else value


def _endless(name: str, value: Any) -> checks.Refused:
    """Return the error for a value that :func:`plain` cannot follow to its end, with the path to it for a few levels."""
    for _ in range(5):
        for key in value if isinstance(value, Mapping) else ():
            try:
                plain(value[key])
            except RecursionError:
                name, value = f"{name}.{key}", value[key]
                break
    return checks.refuse(name, value, "a value that does not contain itself, nor hundreds of levels")


def _scaled(value: Any, factor: float) -> Any:
    """Return numbers times the factor; other values as they are, for the validation to refuse."""
    if isinstance(value, tuple):
        return tuple(_scaled(entry, factor) for entry in value)
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        return value
    try:
        return float(value) * factor
    except OverflowError:
        return math.inf


# -- descriptions ------------------------------------------------------------------------------------------------------

_WORDS = {float: "a finite number", int: "a whole number", bool: "True or False", str: "a string", type(None): "None"}
_WORDS |= {complex: "a complex number", Path: "a path", Any: "any value", dict: "a mapping", Mapping: "a mapping"}
_WORDS |= {Sequence: "a list"}

_SIGNS = {Gt: (">", "gt"), Ge: (">=", "ge"), Lt: ("<", "lt"), Le: ("<=", "le")}


def allowed(field: FieldInfo, factor: float = 1.0) -> str:
    """Return what a field may be, in words: "a finite number > 0 and <= 0.01, in m".

    Args:
        factor: of the unit to SI in which the range is wanted.
    """
    unit = unit_of(field)
    text = _words(field.annotation, field.metadata, factor)
    if unit is None:
        return text
    symbol, _, rest = unit.partition("/")
    return f"{text}, in {SUFFIXES[symbol][0] if factor != 1.0 else symbol}{'/' + rest if rest else ''}"


def _words(kind: Any, metadata: Sequence[Any], factor: float) -> str:
    if get_origin(kind) is Annotated:
        own = [one for field in kind.__metadata__ for one in getattr(field, "metadata", [field])]  # of Field(...)
        return _words(kind.__origin__, (*own, *metadata), factor)
    origin, arguments = get_origin(kind), get_args(kind)
    lengths = [f"at least {bound.min_length}" for bound in metadata if isinstance(bound, MinLen)]
    size = " and ".join(lengths + [f"at most {bound.max_length}" for bound in metadata if isinstance(bound, MaxLen)])
    if origin in (Union, types.UnionType):
        return " or ".join(_words(arg, metadata if arg is not type(None) else (), factor) for arg in arguments)
    if origin is Literal:
        return "one of " + ", ".join(map(repr, arguments))
    if origin is tuple:
        if arguments[-1] is not ...:
            kinds = dict.fromkeys(_words(arg, (), factor) for arg in arguments)
            return f"a list of {len(arguments)}: {', '.join(kinds)}"
        return f"a list of {size + ': ' if size else ''}{_words(arguments[0], (), factor)}"
    if isinstance(kind, type) and issubclass(kind, BaseModel):
        return f"a mapping with keys among {', '.join(kind.model_fields)}"
    bounds = [
        f"{_SIGNS[type(bound)][0]} {getattr(bound, _SIGNS[type(bound)][1]) / factor:.10g}"
        for bound in metadata
        if type(bound) in _SIGNS
    ]
    known = origin or kind
    word = _WORDS.get(known, f"a {getattr(known, '__name__', 'valid value')}")
    if size:
        word += f" of {size} {'characters' if kind is str else 'items'}"
    return f"{word}{' ' if bounds else ''}{' and '.join(bounds)}"


def table(model: type[BaseModel]) -> str:
    """Return the Markdown table of a model's settings for the documentation: name, default, allowed values, meaning."""
    meanings = _meanings(model)
    lines = ["| setting | default | allowed | meaning |", "|---|---|---|---|"]
    for name, field in model.model_fields.items():
        default = "required" if field.is_required() else f"`{field.get_default()!r}`"
        lines.append(f"| `{name}` | {default} | {allowed(field)} | {meanings.get(name, '')} |".replace("||", "|"))
    return "\n".join(lines)


def _meanings(model: type[BaseModel]) -> dict[str, str]:
    """Return the docstrings of a model's fields: the strings below them in the source, of its bases too."""
    meanings: dict[str, str] = {}
    for cls in reversed(model.__mro__):
        if not issubclass(cls, BaseSettings) or cls is BaseSettings:
            continue
        (source,) = ast.parse(textwrap.dedent(inspect.getsource(cls))).body
        body = source.body  # type: ignore[attr-defined]
        for field, text in itertools.pairwise(body):
            if isinstance(field, ast.AnnAssign) and isinstance(text, ast.Expr) and isinstance(text.value, ast.Constant):
                meanings[field.target.id] = " ".join(str(text.value.value).split())  # type: ignore[union-attr]
    return meanings
