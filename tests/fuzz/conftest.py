"""Divides the time of a campaign among the fuzzers and prints their counts."""

from __future__ import annotations

import importlib.util
from collections import Counter
from typing import Any

import pytest

from tests.fuzz import campaign

collect_ignore = [] if importlib.util.find_spec("joblib") else ["test_configurations.py"]  # it needs the extra report


@pytest.hookimpl(trylast=True)
def pytest_collection_modifyitems(items: list[Any]) -> None:
    """Runs last, after tests have been deselected."""
    campaign.shares = sum(getattr(getattr(item, "obj", None), "seconds_share", 0.0) for item in items)


@pytest.hookimpl(wrapper=True)
def pytest_runtest_call(item: Any) -> Any:
    """Attach the counts to the test's report, which also reaches the main process of xdist."""
    campaign.counted()
    try:
        return (yield)
    finally:
        if hasattr(item.obj, "seconds_share"):
            item.user_properties.append(("fuzz", campaign.counted()))


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Print one line for each fuzzer of a campaign."""
    if not campaign.SECONDS:
        return
    counters: dict[str, Counter[str]] = {}
    for outcome in ("passed", "failed"):
        for report in terminalreporter.stats.get(outcome, []):
            for name, counts in report.user_properties:
                if name == "fuzz":
                    counters.setdefault(report.nodeid, Counter()).update(counts)
    terminalreporter.section(f"fuzzers, {campaign.SECONDS:g} s")
    for node, counts in sorted(counters.items()):
        shown = {"examples": 0, **counts, "failures": counts["failures"]}
        text = ", ".join(f"{number:,} {what}".replace(",", " ") for what, number in shown.items())
        terminalreporter.write_line(f"{node.removeprefix('tests/fuzz/')}: {text}")
