"""Comparisons of a figure: text of the differences."""

import pytest

from studies.thesis.figure import of_number, of_range


def test_the_difference_of_a_number_is_absolute_and_relative():
    line = of_number("speed", 0.30, 0.33, "m/s", 2)
    assert (line.thesis, line.ours, line.difference) == ("0.30 m/s", "0.33 m/s", "+0.03 m/s (+10.0 %)")
    assert of_number("bias", 0.0, -0.5, "px", 1).difference == "-0.5 px"


@pytest.mark.parametrize("low, high, ours, thesis, difference", [
    (0.70, 0.72, 0.71, "0.70 to 0.72", "within"),
    (0.70, 0.72, 0.69, "0.70 to 0.72", "0.01 below"),
    (None, 5.0, 5.25, "at most 5.00", "0.25 above"),
    (0.7, None, 0.9, "at least 0.70", "within"),
])  # fmt: skip
def test_the_difference_to_a_range_is_the_distance_to_its_nearest_bound(low, high, ours, thesis, difference):
    line = of_range("lambda", low, high, ours, digits=2)
    assert (line.thesis, line.difference) == (thesis, difference)
