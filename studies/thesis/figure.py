"""Record of a reproduced figure of the thesis: its text with values of the thesis and of vibgym, pictures and tables."""

from __future__ import annotations

import functools
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from vibgym.config import load_yaml


class Comparison(NamedTuple):
    """Row of a figure's first table."""

    what: str  # the compared quantity, with its conditions
    thesis: str  # value with unit, or statement; "not given" or "lost" where the text has none
    ours: str  # the same from this repository
    difference: str  # in words or with a unit, also where both agree


class Picture(NamedTuple):
    """PNG file, and a caption with its settings."""

    png: bytes
    caption: str


class Table(NamedTuple):
    """Further values: a caption, columns, and rows with a cell per column."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]


class Figure(NamedTuple):
    """Reproduced figure or table of the thesis."""

    title: str  # begins with the number in the thesis
    shows: str  # content of the figure in the thesis
    comparisons: tuple[Comparison, ...]
    differs: str  # size and, where known, cause of the differences: the page's summary
    assumed: tuple[str, ...]  # assumptions in place of what the thesis's text lacks
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...]


Row = Mapping[str, str]
"""Line of a table: cell by column."""


def figure(name: str, values: Mapping[str, Any], pictures: Sequence[bytes], *tables: Sequence[Row]) -> Figure:
    """Return a figure with its text of ``texts.yaml``, where ``{value:.2f}`` stands for values.

    Args:
        name: of the figure.
        values: numbers and words of the text.
        pictures: PNG files, in the order of their captions.
        *tables: in the order of their captions.
    """
    text = _filled(texts()[name], values)
    return Figure(
        text["title"],
        text["shows"],
        tuple(_comparison(line, values) for line in text["comparisons"]),
        text["differs"],
        tuple(text["assumed"]),
        tuple(Picture(*pair) for pair in zip(pictures, text["pictures"], strict=True)),
        tuple(
            Table(caption, tuple(rows[0]), tuple(tuple(row.values()) for row in rows))
            for caption, rows in zip(text.get("tables", ()), tables, strict=True)
        ),
    )


@functools.cache
def texts() -> dict[str, Any]:
    """Return the text of all figures by name, in the order of the thesis."""
    return load_yaml(Path(__file__).with_name("texts.yaml"))


def _filled(text: Any, values: Mapping[str, Any]) -> Any:
    if isinstance(text, dict):
        return {key: _filled(entry, values) for key, entry in text.items()}
    if isinstance(text, list):
        return [_filled(entry, values) for entry in text]
    return text.format_map(values) if isinstance(text, str) else text


def _comparison(line: list[str] | dict[str, Any], values: Mapping[str, Any]) -> Comparison:
    if isinstance(line, list):
        return Comparison(*line)
    arguments = {**line, "ours": values[line["value"]]}
    del arguments["value"]
    return of_number(**arguments) if "thesis" in arguments else of_range(**arguments)


def of_number(what: str, thesis: float, ours: float, unit: str = "", digits: int = 3) -> Comparison:
    """Compare two values in ``unit``: absolute difference, and relative to the thesis."""
    off = ours - thesis
    share = f" ({100.0 * off / thesis:+.1f} %)" if thesis else ""
    return Comparison(
        what, _number(thesis, unit, digits), _number(ours, unit, digits), f"{off:+.{digits}f}{_unit(unit)}{share}"
    )


def of_range(
    what: str, low: float | None, high: float | None, ours: float, unit: str = "", digits: int = 3
) -> Comparison:
    """Compare a value with a range of the thesis: from ``low``, up to ``high``, or both (None: unbounded)."""
    if low is None:
        assert high is not None
        thesis = f"at most {_number(high, unit, digits)}"
    elif high is None:
        thesis = f"at least {_number(low, unit, digits)}"
    else:
        thesis = f"{low:.{digits}f} to {_number(high, unit, digits)}"
    difference = "within"
    if low is not None and ours < low:
        difference = f"{_number(low - ours, unit, digits)} below"
    if high is not None and ours > high:
        difference = f"{_number(ours - high, unit, digits)} above"
    return Comparison(what, thesis, _number(ours, unit, digits), difference)


def _number(value: float, unit: str, digits: int) -> str:
    return f"{value:.{digits}f}{_unit(unit)}"


def _unit(unit: str) -> str:
    return f" {unit}" if unit else ""


def listed(values: Sequence[float], digits: int, unit: str) -> str:
    """Return all values with their unit."""
    return ", ".join(f"{value:.{digits}f}" for value in values) + _unit(unit)


def span(values: Sequence[float], digits: int = 1) -> str:
    """Return the range of values."""
    return f"{min(values):.{digits}f} to {max(values):.{digits}f}"
