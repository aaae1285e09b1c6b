"""Fuzzers: hypothesis tests with few examples in ``make test``, more in ``make test-all`` and many in ``make fuzz``.

::

    @fuzz(examples=30, seconds_share=1.0)
    @given(scenes())
    def test_scenes_keep_their_energy(scene):
        count("scenes")
        ...

``make test`` runs ``examples`` of them, always the same; ``make test-all`` sets ``VIBGYM_FUZZ_FACTOR`` and runs that many
times more. ``make fuzz SECONDS=600`` gives every fuzzer its share of that time, in rounds with fresh seeds; a failure ends
its round, not the fuzzer. A table at the end shows the counts.
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
"""Time of all fuzzers together; 0: a fixed number of examples."""

FACTOR = int(os.environ.get("VIBGYM_FUZZ_FACTOR") or 1)
"""Multiplies the examples of the tests."""

ROUND = 10
"""Examples of a round, in multiples of a test's: enough to get past the simplest examples."""

MAX_FAILURES = 10
"""Different failures after which a fuzzer stops."""

shares = 0.0
"""Sum of ``seconds_share`` over all collected fuzzers; conftest.py sets it."""

_counts: Counter[str] = Counter()


class _Over(KeyboardInterrupt):
    """End of the campaign's time. As an interruption, it makes hypothesis stop without replaying the test."""


def count(what: str, number: int = 1) -> None:
    """Add to a count of the running fuzzer, shown in its line of the table."""
    _counts[what] += int(number)


def counted() -> dict[str, int]:
    """Return and clear the counts of the fuzzer that has just run."""
    result = dict(_counts)
    _counts.clear()
    return result


@pytest.fixture(autouse=True)
def numpy_warns_of_nothing() -> Iterator[None]:
    """Silence overflow warnings, which extreme values may cause, in the modules that import this."""
    with warnings.catch_warnings(), np.errstate(all="ignore"):
        warnings.simplefilter("ignore")
        yield


def places(data: Any, above: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Yield the paths to all items of nested mappings and lists."""
    for key in data if isinstance(data, dict) else range(len(data)) if isinstance(data, list) else ():
        yield (*above, key)
        yield from places(data[key], (*above, key))


def fuzz(*, examples: int, seconds_share: float = 1.0, seconds: float | None = None) -> Callable[[Any], Any]:
    """Turn a hypothesis test into a fuzzer; goes above ``@given``.

    Args:
        examples: number in ``make test``; they should take a few seconds at most.
        seconds_share: share of the time of ``make fuzz``, relative to other fuzzers.
        seconds: time of this fuzzer instead of its share.
    """
    large = bool(SECONDS if seconds is None else seconds)

    def decorate(test: Any) -> Any:
        count_examples(test)
        test = settings(
            max_examples=examples * (ROUND if large else FACTOR),
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
    """Make a hypothesis test count its examples and stop at the end of its campaign."""
    inner = test.hypothesis.inner_test

    @functools.wraps(inner)
    def counting(*arguments: Any, **values: Any) -> None:
        if time.monotonic() > getattr(test, "ends", float("inf")) and not getattr(test, "failed", False):
            raise _Over  # a failure is still shrunk, for which it must be reproducible
        count("examples")
        try:
            inner(*arguments, **values)
        except (Exception, pytest.fail.Exception):
            test.failed = True
            raise

    test.hypothesis.inner_test = counting


def _campaign(test: Any, seconds: float, arguments: Any, fixtures: Any) -> None:
    test.ends = time.monotonic() + seconds
    by_place: dict[str, BaseException] = {}
    while time.monotonic() < test.ends and len(by_place) < MAX_FAILURES:
        start = random.SystemRandom().getrandbits(64)
        test.failed = False
        count("rounds")
        try:
            seed(start)(test)(*arguments, **fixtures)
        except _Over:
            break
        except (Exception, pytest.fail.Exception) as failure:
            count("failures")
            for error in failure.exceptions if isinstance(failure, BaseExceptionGroup) else (failure,):
                error.add_note(f"In the round of seed {start}")
                by_place.setdefault(_place(error), error)
    if by_place:
        failures = [
            error if isinstance(error, Exception) else AssertionError(str(error)) for error in by_place.values()
        ]
        raise ExceptionGroup(f"{len(failures)} different failures", failures)


def _place(failure: BaseException) -> str:
    """Return type and location of a failure, which identify it."""
    trace, last = failure.__traceback__, None
    while trace is not None:
        last, trace = trace, trace.tb_next
    where = "" if last is None else f"{last.tb_frame.f_code.co_filename}:{last.tb_lineno}"
    return f"{type(failure).__name__} {where}"
