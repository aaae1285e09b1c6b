"""Checks of arguments: one clear error that names the argument, the bad value and what is allowed."""

from __future__ import annotations

import inspect
import math
import numbers
from collections.abc import Mapping
from typing import Any

import numpy as np


def refuse(name: str, value: object, allowed: str) -> ValueError:
    """The error for argument ``name``, in one line; long values are shortened."""
    text = repr(value)
    message = f"{name}: got {text if len(text) <= 120 else text[:117] + '...'}; allowed: {allowed}"
    return ValueError(" ".join(message.splitlines()))


def number(
    name: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> float:
    """A finite real number in ``(above, most]`` and ``[least, most]``."""
    bounds = []
    if above > -math.inf:
        bounds.append(f"> {above:g}")
    if least > -math.inf:
        bounds.append(f">= {least:g}")
    if most < math.inf:
        bounds.append(f"<= {most:.10g}")
    allowed = "a finite number" + (" " + " and ".join(bounds) if bounds else "")
    if isinstance(value, bool) or not isinstance(value, numbers.Real):
        raise refuse(name, value, allowed)
    result = float(value)
    if not math.isfinite(result) or not (result > above and result >= least and result <= most):
        raise refuse(name, value, allowed)
    return result


def count(name: str, value: Any, *, least: int = 1, most: int | None = None) -> int:
    """A whole number in ``[least, most]``."""
    allowed = f"a whole number >= {least}" + ("" if most is None else f" and <= {most}")
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise refuse(name, value, allowed)
    whole = int(value)
    if whole < least or (most is not None and whole > most):
        raise refuse(name, value, allowed)
    return whole


def flag(name: str, value: Any) -> bool:
    """True or False."""
    if not isinstance(value, bool | np.bool_):
        raise refuse(name, value, "True or False")
    return bool(value)


def choice(name: str, value: Any, allowed: tuple[Any, ...]) -> Any:
    """One of ``allowed``."""
    if not isinstance(value, str) or value not in allowed:
        raise refuse(name, value, ", ".join(repr(each) for each in allowed))
    return value


def array(
    name: str,
    value: Any,
    shape: tuple[int, ...],
    *,
    dtype: Any = np.float64,
    least: float = -math.inf,
    most: float = math.inf,
) -> np.ndarray:
    """A finite array broadcast to ``shape`` (a read-only view where it had to be spread)."""
    try:
        result = np.asarray(value)
        if result.dtype.kind not in "biuf":
            raise TypeError
        result = result.astype(dtype, copy=False)
        if result.shape != shape:
            if result.ndim > len(shape):
                raise ValueError
            result = np.broadcast_to(result, shape)
    except (TypeError, ValueError):
        got = getattr(value, "shape", None)
        raise refuse(
            name,
            value if got is None else f"array of shape {got} and type {value.dtype}",
            f"real numbers that broadcast to {shape}",
        ) from None
    # min and max in one pass each, over the data that is really there (a spread array repeats itself)
    low, high = (result.min(), result.max()) if result.size else (0.0, 0.0)
    if not (math.isfinite(low) and math.isfinite(high)):
        raise refuse(name, _first(result, ~np.isfinite(result)), "finite numbers")
    if low < least or high > most:
        bad = _first(result, (result < least) | (result > most))
        raise refuse(name, bad, f"numbers in [{least:.10g}, {most:.10g}]")
    return result


def _first(values: np.ndarray, bad: np.ndarray) -> str:
    index = tuple(int(k) for k in np.argwhere(bad)[0])
    return f"{float(values[index])!r} at {list(index)}"


def named(argument: str, value: Any, kinds: tuple[str, ...]) -> tuple[str, dict[str, Any]]:
    """Kind and settings from a name, or from a mapping with ``kind`` and settings."""
    if isinstance(value, Mapping):
        if "kind" not in value:
            raise refuse(argument, dict(value), f"a mapping with 'kind', one of {', '.join(map(repr, kinds))}")
        settings = dict(value)
        return choice(f"{argument}['kind']", settings.pop("kind"), kinds), settings
    return choice(argument, value, kinds), {}


def made(argument: str, cls: Any, given: tuple[Any, ...], settings: Mapping[str, Any]) -> Any:
    """``cls(*given, **settings)``, where settings that it does not have are refused by name."""
    known = keywords(cls)
    for name in settings:
        if name not in known:
            raise refuse(argument, f"the setting {name!r}", ", ".join(known) or "no settings")
    return cls(*given, **settings)


def keywords(cls: Any) -> tuple[str, ...]:
    """Names of a class's keyword arguments, with those of its bases where it hands on what it does not know."""
    names: dict[str, None] = {}
    for each in cls.__mro__:
        if "__init__" in vars(each):
            parameters = inspect.signature(each).parameters.values()
            names |= {one.name: None for one in parameters if one.kind is one.KEYWORD_ONLY}
            if not any(one.kind is one.VAR_KEYWORD for one in parameters):
                break
    return tuple(names)
