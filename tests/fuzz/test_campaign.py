"""Fuzzers run few reproducible examples as tests, and rounds with fresh seeds in a campaign."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.campaign import FACTOR, count, counted, fuzz


def test_a_fuzzer_runs_the_same_few_examples_each_time():
    seen = []

    @fuzz(examples=7, seconds=0.0)
    @given(st.integers())
    def fuzzer(number):
        count("evens", number % 2 == 0)
        seen.append(number)

    counted()
    fuzzer()
    first, counts = list(seen), counted()
    assert counts == {"examples": 7 * FACTOR, "evens": sum(number % 2 == 0 for number in seen)}
    seen.clear()
    fuzzer()
    assert seen == first


def test_a_failure_ends_its_round_and_not_the_campaign():
    @fuzz(examples=5, seconds=2.0)
    @given(st.integers())
    def fuzzer(number):
        assert number < 100

    counted()
    with pytest.raises(ExceptionGroup, match="1 different") as error:
        fuzzer()
    (failure,) = error.value.exceptions
    assert isinstance(failure, AssertionError)
    assert any("number=100" in note for note in failure.__notes__)
    counts = counted()
    assert 1 <= counts["failures"] <= counts["rounds"]
