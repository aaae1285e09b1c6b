"""The fuzzers' own machinery: few examples among the tests, rounds with fresh seeds in a campaign."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.fuzz.campaign import count, counted, fuzz


def test_among_the_tests_a_fuzzer_runs_few_examples_and_always_the_same():
    seen = []

    @fuzz(examples=7, seconds=0.0)
    @given(st.integers())
    def fuzzer(number):
        count("evens", number % 2 == 0)
        seen.append(number)

    counted()
    fuzzer()
    first, counts = list(seen), counted()
    assert counts == {"examples": 7, "evens": sum(number % 2 == 0 for number in seen)}
    seen.clear()
    fuzzer()
    assert seen == first


def test_a_campaign_goes_on_in_fresh_rounds_until_its_time_is_over():
    seen = set()

    @fuzz(examples=5, seconds=0.3)
    @given(st.integers())
    def fuzzer(number):
        seen.add(number)

    counted()
    fuzzer()
    counts = counted()
    assert counts["rounds"] > 1 and counts["examples"] >= len(seen) > 50


def test_a_failure_ends_its_round_and_not_the_campaign():
    @fuzz(examples=5, seconds=0.5)
    @given(st.integers())
    def fuzzer(number):
        assert number < 100

    counted()
    with pytest.raises(ExceptionGroup, match="1 different failures") as error:
        fuzzer()
    (failure,) = error.value.exceptions
    assert isinstance(failure, AssertionError)
    assert any("number=100" in note for note in failure.__notes__)
    counts = counted()
    assert 1 < counts["failures"] <= counts["rounds"]
