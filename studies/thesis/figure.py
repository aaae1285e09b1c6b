"""Record of a reproduced figure of the thesis: values of the thesis and of vibgym, pictures and tables."""

from __future__ import annotations

from typing import NamedTuple


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
    tables: tuple[Table, ...] = ()


def of_number(what: str, thesis: float, ours: float, unit: str = "", digits: int = 3) -> Comparison:
    """Compare two values: absolute difference in their unit, and relative to the thesis.

    Args:
        what: compared quantity.
        thesis, ours: in ``unit``.
        unit: appended to the values.
        digits: after the decimal point.
    """
    off = ours - thesis
    share = f" ({100.0 * off / thesis:+.1f} %)" if thesis else ""
    difference = f"{off:+.{digits}f}{_unit(unit)}{share}"
    return Comparison(what, _number(thesis, unit, digits), _number(ours, unit, digits), difference)


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
