"""Fuzzers: hypothesis tests that run small among the tests and large by ``make fuzz``.

::

    @fuzz(examples=30, seconds_share=1.0)
    @given(scenes())
    def test_scenes_keep_their_energy(scene):
        count("scenes")
        ...

``make test`` runs ``examples`` of them, always the same. ``make fuzz SECONDS=600`` gives every fuzzer its share of that
time, in rounds with fresh seeds; a failure ends its round, not the fuzzer. What was counted stands in a table at the end.
"""

from __future__ import annotations

import functools
import os
import random
import time
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, seed, settings

SECONDS = float(os.environ.get("VIBGYM_FUZZ_SECONDS") or 0.0)
"""For all fuzzers together; 0: the few examples of the tests."""

ROUND = 10
"""A round has so many times the examples of a test: large enough to leave the simplest examples behind."""

MOST_FAILURES = 10
"""A fuzzer that has found so many different ones has found enough."""

shares = 0.0
"""Sum of ``seconds_share`` over all collected fuzzers; conftest.py sets it."""

_counts: Counter[str] = Counter()


class _Over(KeyboardInterrupt):
    """The time of the campaign; as an interruption, for which hypothesis stops without looking for flaws in the test."""


def count(what: str, number: int = 1) -> None:
    """Add to one of the running fuzzer's counts, which its line of the table shows."""
    _counts[what] += int(number)


def counted() -> dict[str, int]:
    """What the fuzzer that has just run has counted; counting begins anew."""
    result = dict(_counts)
    _counts.clear()
    return result


@pytest.fixture(autouse=True)
def numpy_warns_of_nothing() -> Iterator[None]:
    """Numbers at the edge of what floats hold are allowed and may overflow; for the modules that import this."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def places(data: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Paths to everything in mappings and lists."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*above, key)
        yield from places(data[key], (*above, key))


def fuzz(*, examples: int, seconds_share: float = 1.0, seconds: float | None = None) -> Callable[[Any], Any]:
    """Make a fuzzer of a hypothesis test; stands above ``@given``.

    Args:
        examples: in ``make test``; they should take a few seconds at most.
        seconds_share: of the time of ``make fuzz``, relative to other fuzzers.
        seconds: for this fuzzer alone, instead of its share.
    """
    large = bool(SECONDS if seconds is None else seconds)

    def decorate(test: Any) -> Any:
        count_examples(test)
        test = settings(
            max_examples=examples * ROUND if large else examples,
            derandomize=not large,
            database=None,
            deadline=None,
            suppress_health_check=list(HealthCheck),
        )(test)

        @functools.wraps(test)
        def small(*arguments: Any, **fixtures: Any) -> None:
            test(*arguments, **fixtures)

        @functools.wraps(test)
        def rounds(*arguments: Any, **fixtures: Any) -> None:
            share = seconds_share / (shares or seconds_share)
            _campaign(test, SECONDS * share if seconds is None else seconds, arguments, fixtures)

        run = rounds if large else small
        run.seconds_share = seconds_share  # type: ignore[attr-defined]
        return run

    return decorate


def count_examples(test: Any) -> None:
    """Let a hypothesis test count its examples, and stop when its campaign's time is over."""
    inner = test.hypothesis.inner_test

    @functools.wraps(inner)
    def counting(*arguments: Any, **values: Any) -> None:
        if time.monotonic() > getattr(test, "ends", float("inf")) and not getattr(test, "failed", False):
            raise _Over  # but a failure is still shrunk, and must then repeat itself
        count("examples")
        try:
            inner(*arguments, **values)
        except (Exception, pytest.fail.Exception):
            test.failed = True
            raise

    test.hypothesis.inner_test = counting


def _campaign(test: Any, seconds: float, arguments: Any, fixtures: Any) -> None:
    test.ends = time.monotonic() + seconds
    found: dict[str, BaseException] = {}
    while time.monotonic() < test.ends and len(found) < MOST_FAILURES:
        start = random.SystemRandom().getrandbits(64)
        test.failed = False
        count("rounds")
        try:
            seed(start)(test)(*arguments, **fixtures)
        except _Over:
            break
        except (Exception, pytest.fail.Exception) as failure:
            count("failures")
            for each in failure.exceptions if isinstance(failure, BaseExceptionGroup) else (failure,):
                each.add_note(f"In the round of seed {start}")
                found.setdefault(_place(each), each)
    if found:
        failures = [each if isinstance(each, Exception) else AssertionError(str(each)) for each in found.values()]
        raise ExceptionGroup(f"{len(failures)} different failures", failures)


def _place(failure: BaseException) -> str:
    """Where and as what a failure shows: the same again is no news."""
    trace, last = failure.__traceback__, None
    while trace is not None:
        last, trace = trace, trace.tb_next
    where = "" if last is None else f"{last.tb_frame.f_code.co_filename}:{last.tb_lineno}"
    return f"{type(failure).__name__} {where}"
