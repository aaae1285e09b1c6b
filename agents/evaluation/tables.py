"""Numbers, colours and tables as all pages write them."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

WORTH_SHOWING = 0.05
"""Axes of times end with the last success of those policies that succeed at least so often."""

GOOD, BAD = (11, 122, 117), (209, 87, 42)
"""Red, green, blue of what always and of what never succeeds."""

STRONGEST = 0.42
"""Opacity there: text on it stays readable on light and on dark pages."""


def quantity(value: float, factor: float, digits: int, unit: str) -> str:
    """A number >= 0 with its unit, in ``digits`` decimals or one from 10 up.

    A dash stands for what does not apply, "< 0.01" for what is small but not zero.
    """
    if _missing(value):
        return "–"
    text, space = number(factor * value, digits), "" if unit in ("°", "") else " "
    if value > 0.0 and float(text) == 0.0:
        text = f"< {10.0**-digits:.{digits}f}"
    return f"{text}{space}{unit}"


def number(value: float, digits: int) -> str:
    """A number >= 0 in ``digits`` decimals, or one at most from 10 up; a dash for what does not apply."""
    return "–" if math.isnan(value) else f"{value:.{digits if value < 9.995 else min(digits, 1)}f}"


def signed(value: float, digits: int) -> str:
    """With a typographic minus, and no sign on zero."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def span(low: float, high: float, digits: int) -> str:
    """ "1.20 to 3.40", or a dash where there is no interval."""
    return "–" if low != low else f"{quantity(low, 1.0, digits, '')} to {quantity(high, 1.0, digits, '')}"


def thousands(rate: float) -> str:
    """Steps per second in thousands or millions, or a dash if nothing was measured."""
    return quantity(rate, 1e-6, 1, "M") if rate >= 999_500 else quantity(rate, 1e-3, 0, "k")


def seeds_text(seeds: list[int]) -> str:
    """ "3 to 7" for consecutive seeds, or all of them."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def colour(share: float) -> str:
    """Of a success rate: strong where all succeed and where none does, hardly any colour at one half."""
    way = 2.0 * share - 1.0
    red, green, blue = GOOD if way > 0.0 else BAD
    return f"rgba({red}, {green}, {blue}, {STRONGEST * abs(way):.3f})"


def plain(value: Any) -> Any:
    """JSON values: numbers that are not finite become None, objects their description."""
    if isinstance(value, SimpleNamespace):
        value = vars(value)
    if _missing(value):
        return None
    if isinstance(value, Mapping):
        return {str(key): plain(each) for key, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain(each) for each in value]
    return value if isinstance(value, str | int | float | bool | None) else repr(value)


def _missing(value: Any) -> bool:
    return isinstance(value, float) and not math.isfinite(value)


def markdown(heads: Sequence[str], lines: Iterable[Sequence[str]]) -> str:
    """A table in Markdown."""
    return "\n".join([_line(heads), _line("-" * len(each) for each in heads), *map(_line, lines)])


def _line(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cells) + " |"
