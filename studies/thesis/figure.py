"""What a repeated figure of the thesis consists of, and how its numbers stand beside ours."""

from __future__ import annotations

from dataclasses import dataclass

from vibgym import checks


@dataclass(frozen=True)
class Comparison:
    """A number or statement of the thesis beside ours: a line of the figure's first table.

    Attributes:
        what: is compared, with its conditions.
        thesis: its number with unit, or its statement; "not given" or "lost" where the text has none.
        ours: the same from this repository.
        difference: in words or with a unit; never empty, also where both agree.
    """

    what: str
    thesis: str
    ours: str
    difference: str

    def __post_init__(self) -> None:
        for name in ("what", "thesis", "ours", "difference"):
            _said(f"comparison.{name}", getattr(self, name))


@dataclass(frozen=True)
class Picture:
    """A PNG file and its caption, which says what is drawn and with which settings."""

    png: bytes
    caption: str

    def __post_init__(self) -> None:
        _said("picture.caption", self.caption)


@dataclass(frozen=True)
class Table:
    """Further numbers: a caption, columns, and rows of as many cells."""

    caption: str
    columns: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]

    def __post_init__(self) -> None:
        _said("table.caption", self.caption)
        for row in self.rows:
            if len(row) != len(self.columns):
                raise checks.refuse("table.rows", row, f"{len(self.columns)} cells, one for each column")


@dataclass(frozen=True)
class Figure:
    """A figure or table of the thesis, repeated.

    Attributes:
        title: begins with the number in the thesis.
        shows: what the thesis shows and says.
        comparisons: the thesis beside ours, at least one.
        differs: how far we differ and, where known, why; whole sentences, for this is what the page's summary says.
        assumed: what the thesis's text has lost or does not say, each with what stands in its place here.
        pictures, tables: of ours.

    Raises:
        ValueError: something is missing.
    """

    title: str
    shows: str
    comparisons: tuple[Comparison, ...]
    differs: str
    assumed: tuple[str, ...]
    pictures: tuple[Picture, ...]
    tables: tuple[Table, ...] = ()

    def __post_init__(self) -> None:
        for name in ("title", "shows", "differs"):
            _said(f"figure.{name}", getattr(self, name))
        if not self.comparisons:
            raise checks.refuse("figure.comparisons", self.comparisons, "at least one line, thesis beside ours")
        for each in self.assumed:
            _said("figure.assumed", each)


def of_number(what: str, thesis: float, ours: float, unit: str = "", digits: int = 3) -> Comparison:
    """A number of the thesis beside ours, with the difference in its unit and relative to the thesis's.

    Args:
        what: is compared.
        thesis, ours: in ``unit``.
        unit: behind the numbers.
        digits: behind the decimal point.
    """
    off = ours - thesis
    share = f" ({100.0 * off / thesis:+.1f} %)" if thesis else ""
    return Comparison(
        what, _number(thesis, unit, digits), _number(ours, unit, digits), f"{off:+.{digits}f}{_unit(unit)}{share}"
    )


def of_range(
    what: str, low: float | None, high: float | None, ours: float, unit: str = "", digits: int = 3
) -> Comparison:
    """The same for a range that the thesis gives: at least ``low``, at most ``high``, or both (None: no such bound)."""
    sides = (low, high)
    if low is None and high is None:
        raise checks.refuse("low", sides, "a bound below or above")
    if low is None or high is None:
        bound = high if low is None else low
        assert bound is not None
        thesis = f"{'at most' if low is None else 'at least'} {_number(bound, unit, digits)}"
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


def _said(name: str, text: object) -> None:
    if not isinstance(text, str) or not text.strip():
        raise checks.refuse(name, text, "a text")
