"""Checks of arguments: one clear error that names the argument, the bad value and what is allowed."""

from __future__ import annotations

import contextlib
import dataclasses
import inspect
import math
import numbers
import os
from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np

MOST_PERIODS = 1_000_000_000
"""That one call may ask for: hours of computing, and a number that compiled code can hold."""

MOST_LABEL = 80
"""Characters of a name that reports and pictures show."""


class Refused(ValueError):
    """Bad input, said in one line. Any other ValueError is a fault of the program."""


@contextlib.contextmanager
def within(place: object, joint: str = ": ", kind: type[ValueError] = ValueError) -> Iterator[None]:
    """What shows inside to be wrong with values is bad input of a file or a setting, whose name comes first.

    Around work that may fail for other reasons ``kind`` is :class:`Refused`.
    """
    try:
        yield
    except kind as error:
        raise Refused(f"{place}{joint}{error}") from None


def refuse(name: str, value: object, allowed: str) -> Refused:
    """The error for argument ``name``, in one line of characters that show; long values and names are shortened."""
    message = f"{_shortened(name, 500)}: got {_shortened(shown(value), 120)}; allowed: {_shortened(allowed, 2000)}"
    return Refused(plain_text(" ".join(message.splitlines())))


def plain_text(text: str) -> str:
    """``text`` with escapes for what does not show, or cannot be written as UTF-8 (lone surrogates)."""
    if text.isprintable():
        return text
    return "".join(each if each.isprintable() else each.encode("unicode_escape").decode("ascii") for each in text)


def _shortened(text: str, most: int) -> str:
    if len(text) <= most:
        return text
    tail = 0 if most <= 120 else most // 2  # of a path the end says more
    return text[: most - 3 - tail] + "..." + (text[-tail:] if tail else "")


def shown(value: object) -> str:
    """``repr``, whatever the object."""
    try:
        return repr(value)
    except Exception:  # Python refuses to write out numbers of thousands of digits, and objects may do anything
        if isinstance(value, int):
            return f"a whole number of about {math.ceil(value.bit_length() * math.log10(2.0))} digits"
        return f"an object of type {type(value).__name__}, which cannot be shown"


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
    try:
        result = float(value)
    except OverflowError:  # a whole number or fraction beyond all floats
        raise refuse(name, value, allowed) from None
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


def listed(value: Any) -> bool:
    """Whether a value is a list, a tuple or the like, or an array with an axis; texts are none."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes | range)


def interval(name: str, value: Any, least: float, most: float) -> tuple[float, float]:
    """Two numbers [low, high] with ``least <= low <= high <= most``."""
    if not (listed(value) and len(value) == 2):
        raise refuse(name, value, f"[low, high] with {least:g} <= low <= high <= {most:g}")
    low = number(f"{name}[0]", value[0], least=least, most=most)
    return low, number(f"{name}[1]", value[1], least=low, most=most)


def fitting(name: str, value: int, bytes_each: float) -> int:
    """A number of things that this machine's memory can hold, if each takes ``bytes_each``."""
    most = max(int(memory() / max(bytes_each, 1.0)), 1)
    if value > most:
        allowed = f"a whole number <= {most}: each takes about {bytes_each:.0f} bytes, of {memory() / 2**30:.3g} GiB of memory"
        raise refuse(name, value, allowed)
    return value


def memory() -> int:
    """Bytes of this machine's memory; where the system does not say (Windows), 16 GiB are taken for it."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PAGE_SIZE" in names and "SC_PHYS_PAGES" in names:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return 2**34


def label(name: str, value: Any, most: int = MOST_LABEL) -> str:
    """A text that pictures, tables and pages can show: printable, not empty, and in one line."""
    if not isinstance(value, str) or not value.strip() or not value.isprintable() or len(value) > most:
        raise refuse(name, value, f"a non-empty text of at most {most} printable characters")
    return value


def instance(name: str, value: Any, cls: type) -> Any:
    """An object of a class of this package."""
    if not isinstance(value, cls):
        raise refuse(name, value, f"a vibgym.{cls.__name__}")
    return value


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
        given = np.asarray(value)
        if given.dtype.kind not in "biuf":
            raise TypeError
        changed = None
        if given.dtype == dtype or np.dtype(dtype).kind == "f":
            result = given.astype(dtype, copy=False)
        else:
            with np.errstate(invalid="ignore"):  # told below
                result = given.astype(dtype)
            changed = result != given
        if result.shape != shape:
            if result.ndim > len(shape):
                raise ValueError
            result = np.broadcast_to(result, shape)
    except (TypeError, ValueError, OverflowError, RecursionError):
        got = getattr(value, "shape", None)
        raise refuse(
            name,
            value if got is None else f"array of shape {got} and type {value.dtype}",
            f"real numbers that broadcast to {shape}",
        ) from None
    if changed is not None and changed.any():
        raise refuse(name, _first(given, changed), "True or False" if result.dtype.kind == "b" else "whole numbers")
    # min and max in one pass each, over the data that is really there (a spread array repeats itself)
    low, high = (result.min(), result.max()) if result.size else (0.0, 0.0)
    if not (math.isfinite(low) and math.isfinite(high)):
        raise refuse(name, _first(result, ~np.isfinite(result)), "finite numbers")
    if low < least or high > most:
        bad = _first(result, (result < least) | (result > most))
        raise refuse(name, bad, f"numbers in [{least:.10g}, {most:.10g}]")
    return result


def shaped(
    name: str, value: Any, shapes: tuple[tuple[int, ...], ...], what: str, meaning: str = "", kinds: str = "fiu"
) -> np.ndarray:
    """An array of real numbers of one of ``shapes``, as it is given.

    Args:
        what: of these shapes is allowed, and ``meaning``: what follows these, for errors.
        kinds: of its numbers, NumPy's letters.
    """
    try:
        values = np.asarray(value)
    except (TypeError, ValueError):  # rows of different lengths
        values = None
    if values is None or values.shape not in shapes or values.dtype.kind not in kinds:
        got = value if values is None else f"array of shape {values.shape} and type {values.dtype}"
        raise refuse(name, got, f"{what} of shape {' or '.join(map(str, shapes))}{meaning}")
    return values


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


def made(
    argument: str, make: Any, given: tuple[Any, ...], settings: Mapping[str, Any], more: tuple[str, ...] = ()
) -> Any:
    """``make(*given, **settings)``, where settings that are not among its keyword arguments are refused by name.

    Args:
        make: a class, or a function.
        more: names that are allowed besides.
    """
    known = tuple(dict.fromkeys((*keywords(make), *more)))
    for name in settings:
        if name not in known:
            raise refuse(argument, f"the setting {name!r}", ", ".join(known) or "no settings")
    return make(*given, **settings)


def keywords(make: Any) -> dict[str, Any]:
    """Keyword arguments of a class or function with their defaults, with those of bases to which it hands on the others.

    A class that has many of them keeps them in a record of their own: ``SETTINGS``, a dataclass.
    """
    names: dict[str, Any] = {}
    for each in getattr(make, "__mro__", (make,)):
        if isinstance(each, type) and "__init__" not in vars(each):
            continue
        parameters = inspect.signature(each).parameters.values()
        own = [one for one in parameters if one.kind is one.KEYWORD_ONLY]
        for one in (*own, *(dataclasses.fields(each.SETTINGS) if "SETTINGS" in vars(each) else ())):
            names.setdefault(one.name, one.default)
        if not any(one.kind is one.VAR_KEYWORD for one in parameters):
            break
    return names
