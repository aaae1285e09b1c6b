"""The record of a figure: differences as they are told, and what may not be left out."""

import pytest

from studies.thesis.figure import Comparison, Figure, Picture, Table, of_number, of_range

LINE = Comparison("speed", "0.3 m/s", "0.31 m/s", "3 %")


def test_the_difference_of_a_number_is_ours_less_the_thesis():
    line = of_number("speed", 0.30, 0.33, "m/s", 2)
    assert (line.thesis, line.ours, line.difference) == ("0.30 m/s", "0.33 m/s", "+0.03 m/s (+10.0 %)")
    assert of_number("bias", 0.0, -0.5, "px", 1).difference == "-0.5 px"


@pytest.mark.parametrize("low, high, ours, thesis, difference", [
    (0.70, 0.72, 0.71, "0.70 to 0.72", "within"),
    (0.70, 0.72, 0.69, "0.70 to 0.72", "0.01 below"),
    (None, 5.0, 5.25, "at most 5.00", "0.25 above"),
    (0.7, None, 0.9, "at least 0.70", "within"),
])  # fmt: skip
def test_the_difference_to_a_range_is_the_way_to_its_nearer_end(low, high, ours, thesis, difference):
    line = of_range("lambda", low, high, ours, digits=2)
    assert (line.thesis, line.difference) == (thesis, difference)


def test_nothing_may_be_left_out():
    good = {
        "title": "Fig. 1", "shows": "a", "comparisons": (LINE,), "differs": "b", "assumed": (), "pictures": (),
    }  # fmt: skip
    assert Figure(**good).tables == ()
    for name, bad in {"title": " ", "shows": "", "comparisons": (), "differs": "", "assumed": ("",)}.items():
        with pytest.raises(ValueError, match=f"figure.{name}"):
            Figure(**{**good, name: bad})
    with pytest.raises(ValueError, match="comparison.difference"):
        Comparison("a", "b", "c", "")
    with pytest.raises(ValueError, match="picture.caption"):
        Picture(b"", "")
    with pytest.raises(ValueError, match="table.rows"):
        Table("a", ("b", "c"), (("1", "2"), ("1",)))
    with pytest.raises(ValueError, match="low"):
        of_range("a", None, None, 1.0)
