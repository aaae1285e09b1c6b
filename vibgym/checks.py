"""Validation of arguments: one clear error, in one of four forms (range, conflict, missing, unknown).

Every error is a :class:`Refused`, a ``ValueError`` of one line; command lines turn it into exit code 2.
"""

from __future__ import annotations

import contextlib
import difflib
import inspect
import math
import numbers
import os
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

import numpy as np

MAX_PERIODS = 1_000_000_000
"""Most periods of one call: hours of computing, within the integers of compiled code."""

MAX_LABEL = 80
"""Most characters of a name shown in reports and images."""


class Refused(ValueError):
    """Invalid input, described in one line. Any other ``ValueError`` is a fault of the program.

    Attributes:
        faults, lines: of a drawing, its faults and (n, 2) mm each what could be read; else empty.
    """

    faults: tuple[Any, ...] = ()
    lines: tuple[np.ndarray, ...] = ()


@contextlib.contextmanager
def within(place: object, joint: str = ": ", kind: type[ValueError] = ValueError) -> Iterator[None]:
    """Prefix errors raised inside with the name of the file or setting that holds the values.

    Use ``kind=Refused`` around work that may fail for other reasons.
    """
    try:
        yield
    except kind as error:
        named = Refused(f"{place}{joint}{error}")
        vars(named).update(vars(error))
        raise named from None


def refuse(name: str, value: object, allowed: str) -> Refused:
    """Return the error for an argument outside its range: ``friction must be in (0, 2], got 3.1``.

    Args:
        name: of the argument.
        value: that was given.
        allowed: noun phrase that follows "must be".
    """
    return _error(f"{_shortened(name, 500)} must be {_shortened(allowed, 2000)}, got {_shortened(shown(value), 120)}")


def conflict(message: str) -> Refused:
    """Return the error for settings that exclude or require one another: ``--ray requires --seeds``."""
    return _error(_shortened(message, 2000))


def missing(name: str, reason: str = "") -> Refused:
    """Return the error for a missing field: ``missing field 'radius' (required for shape 'disc')``."""
    place, name = _split(name)
    return _error(f"{place}missing field {name!r}" + (f" ({reason})" if reason else ""))


def unknown(what: str, value: object, known: Iterable[object], of: str = "") -> Refused:
    """Return the error for a name that is not registered: ``unknown action 'fields'; did you mean 'field'? (element, ...)``.

    ``of``: what should have it: "FILE: SECTION" becomes ``FILE: unknown key 'gama' of SECTION``.
    """
    place, of = _split(of)
    names = [str(name) for name in known]
    close = difflib.get_close_matches(str(value), names, n=1) if isinstance(value, str) else []
    hint = f"; did you mean {close[0]!r}?" if close else ""
    owner = f" of {_shortened(of, 500)}" if of else ""
    listed = _shortened(", ".join(names) or "there are none", 2000)
    return _error(f"{place}unknown {_shortened(what, 500)} {_shortened(shown(value), 120)}{owner}{hint} ({listed})")


def _split(name: str) -> tuple[str, str]:
    """Split "policy.json: network" into the prefix, with its colon, and the name."""
    place, joint, name = name.rpartition(": ")
    return place + joint, name


def _error(message: str) -> Refused:
    return Refused(plain_text(" ".join(message.splitlines())))


def plain_text(text: str) -> str:
    """Return ``text`` with escapes for characters that are not printable or not UTF-8 (lone surrogates)."""
    if text.isprintable():
        return text
    return "".join(char if char.isprintable() else char.encode("unicode_escape").decode("ascii") for char in text)


def _shortened(text: str, most: int) -> str:
    if len(text) <= most:
        return text
    tail = 0 if most <= 120 else most // 2  # the end of a path is more specific
    return text[: most - 3 - tail] + "..." + (text[-tail:] if tail else "")


def shown(value: object) -> str:
    """Return ``repr(value)``, or a description where ``repr`` fails."""
    try:
        return repr(value)
    except Exception:  # Python limits the digits of printed integers, and a custom __repr__ may raise
        if isinstance(value, int):
            return f"a whole number of about {math.ceil(value.bit_length() * math.log10(2.0))} digits"
        return f"an object of type {type(value).__name__}, which cannot be shown"


def number(
    name: str, value: Any, *, above: float = -math.inf, least: float = -math.inf, most: float = math.inf
) -> float:
    """Return a finite real number in ``(above, most]`` and ``[least, most]`` as float."""
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
    """Return an integer in ``[least, most]``."""
    allowed = f"a whole number >= {least}" + ("" if most is None else f" and <= {most}")
    if isinstance(value, bool) or not isinstance(value, numbers.Integral):
        raise refuse(name, value, allowed)
    whole = int(value)
    if whole < least or (most is not None and whole > most):
        raise refuse(name, value, allowed)
    return whole


def listed(value: Any) -> bool:
    """Return whether a value is a sequence or an array with at least one axis; strings are neither."""
    if isinstance(value, np.ndarray):
        return value.ndim > 0
    return isinstance(value, Sequence) and not isinstance(value, str | bytes | range)


def interval(name: str, value: Any, least: float, most: float) -> tuple[float, float]:
    """Return two numbers [low, high] with ``least <= low <= high <= most``."""
    if not (listed(value) and len(value) == 2):
        raise refuse(name, value, f"[low, high] with {least:g} <= low <= high <= {most:g}")
    low = number(f"{name}[0]", value[0], least=least, most=most)
    return low, number(f"{name}[1]", value[1], least=low, most=most)


def fitting(name: str, value: int, bytes_each: float) -> int:
    """Return a count of items of ``bytes_each`` bytes that fit into the memory of this host."""
    most = max(int(memory() / max(bytes_each, 1.0)), 1)
    if value > most:
        allowed = f"a whole number <= {most}: each takes about {bytes_each:.0f} bytes, of {memory() / 2**30:.3g} GiB of memory"
        raise refuse(name, value, allowed)
    return value


def memory() -> int:
    """Return the bytes of memory of this host; 16 GiB where the system does not report it (Windows)."""
    names = getattr(os, "sysconf_names", {})
    if "SC_PAGE_SIZE" in names and "SC_PHYS_PAGES" in names:
        return os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")
    return 2**34


def label(name: str, value: Any, most: int = MAX_LABEL) -> str:
    """Return a non-empty printable string of one line."""
    if not isinstance(value, str) or not value.strip() or not value.isprintable() or len(value) > most:
        raise refuse(name, value, f"a non-empty string of at most {most} printable characters")
    return value


def instance(name: str, value: Any, cls: type) -> Any:
    """Return ``value`` if it is an instance of a class of this package."""
    if not isinstance(value, cls):
        raise refuse(name, value, f"a vibgym.{cls.__name__}")
    return value


def flag(name: str, value: Any) -> bool:
    """Return a bool."""
    if not isinstance(value, bool | np.bool_):
        raise refuse(name, value, "True or False")
    return bool(value)


def choice(name: str, value: Any, allowed: Collection[Any]) -> Any:
    """Return ``value`` if it is one of the names ``allowed``."""
    if not isinstance(value, str):
        raise refuse(name, value, "one of " + ", ".join(repr(option) for option in allowed))
    if value not in allowed:
        raise unknown(name, value, allowed)
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
    """Return a finite array broadcast to ``shape`` (a read-only view if it was broadcast)."""
    try:
        values = np.asarray(value)
        if values.dtype.kind not in "biuf":
            raise TypeError
        changed = None
        if values.dtype == dtype or np.dtype(dtype).kind == "f":
            result = values.astype(dtype, copy=False)
        else:
            with np.errstate(invalid="ignore"):  # reported below
                result = values.astype(dtype)
            changed = result != values
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
        raise refuse(name, _first(values, changed), "True or False" if result.dtype.kind == "b" else "whole numbers")
    # One pass each for min and max
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
    """Return an array of real numbers of one of ``shapes``, without conversion.

    Args:
        what, meaning: kind of array, and text after the shapes, for errors.
        kinds: allowed NumPy kinds.
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


def misfit(make: Any, *arguments: Any, **settings: Any) -> str | None:
    """Return why a class or function does not take these arguments, or None if it does."""
    try:
        inspect.signature(make).bind(*arguments, **settings)
    except TypeError as error:
        return str(error)
    return None
