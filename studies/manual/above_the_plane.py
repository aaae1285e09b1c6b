"""Tables of policies above the plane, from ``results/tilting``: what ``configs/evaluations/tilting.yaml`` found."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping

from agents.evaluation.table import markdown
from studies.manual.figures_file import RESULTS, Published, with_time

STRUCK = {
    "planar": "planar",
    "tilting": "tilting",
    "planar, kicked": "kicked",
    "struck": "struck",
    "struck, patches": "struck, patches",
}
FOILS = {
    "ramps of 3 mm, restitution 0.2": "tilting",
    "ramps of 1 mm": "steep ramps",
    "of 10 mm": "wide ramps",
    "restitution 0": "dead contact",
    "0.5": "bouncing",
}
PROTOTYPE = {
    "prototype hardware": "prototype",
    "the same, tilting": "prototype tilting",
    "and estimator fitted": "prototype tilting, fitted",
}
"""Heads of columns, and what the evaluation calls these machines."""


@functools.cache
def found() -> Published:
    """What was kept of it."""
    return Published(RESULTS / "tilting")


def compared(task: str, columns: Mapping[str, str]) -> str:
    """Success and median time of all policies that were tried on more than one of some machines."""
    tried = {head: found().of(task, machine) for head, machine in columns.items()}
    tried = {head: rows for head, rows in tried.items() if rows}
    policies = dict.fromkeys(policy for rows in tried.values() for policy in rows)
    lines = [[policy, *(with_time(rows.get(policy)) for rows in tried.values())] for policy in policies]
    return markdown((task, *tried), [line for line in lines if sum(cell != "–" for cell in line) > 2])


TABLES: dict[str, Callable[[], str]] = {
    "struck-align": lambda: compared("Align", STRUCK),
    "struck-sort": lambda: compared("Sort", STRUCK),
    "foils": lambda: compared("Align", FOILS),
    "tilting-prototype-align": lambda: compared("Align", PROTOTYPE),
    "tilting-prototype-sort": lambda: compared("Sort", PROTOTYPE),
}
"""By the name of the file in ``docs/generated``."""
