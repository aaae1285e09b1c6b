"""Tables of published results for the pages: each is a function without arguments that returns Markdown."""

from __future__ import annotations

import functools
from collections.abc import Callable

from agents.evaluation.table import markdown
from studies.manual import above_the_plane, open_tasks, rivals
from studies.manual.figures_file import RESULTS, Published, table, with_time
from studies.manual.trained import trained

TIME, BOUND = "time_to_goal_median_s", "time_over_bound_median"
ERRORS = ("position_error_median_m", "heading_error_median_rad")
ONE, SEVERAL = ("Transport", "Align", "Rotate"), ("Sort", "Singulate")
ALL = (*ONE, *SEVERAL)
PROTOTYPE, RIGID = "prototype", "rigid, struck"
TOGETHER = (TIME, "throughput_median_parts_per_s", "collisions_mean", "path_efficiency_median")


@functools.cache
def report() -> Published:
    """What ``make report`` found."""
    return Published(RESULTS / "report")


def provenance() -> str:
    """When and on what they were found."""
    about = report().about
    machine, versions = about["machine"], about["versions"]
    return (
        f"Found on {report().day} at commit {about['commit'][:7]}, {machine['cores']} cores ({machine['processor']}), "
        f"Python {versions['python']}, numba {versions['numba']}."
    )


def one_part() -> str:
    """Transport, Align and Rotate on the ideal machine."""
    return table(report(), ONE, "ideal", (TIME, BOUND, *ERRORS, "fallen_rate"))


def several_parts() -> str:
    """Sort and Singulate on the ideal machine."""
    return table(report(), SEVERAL, "ideal", TOGETHER)


def prototype() -> str:
    """The same tasks on the prototype's machine: one part, then several."""
    one = table(report(), ONE, PROTOTYPE, (TIME, BOUND, *ERRORS))
    return f"{one}\n\n{table(report(), SEVERAL, PROTOTYPE, TOGETHER)}"


def rigid() -> str:
    """On rigid parts that are struck."""
    one = table(report(), ("Align",), RIGID, (TIME, *ERRORS))
    return f"{one}\n\n{table(report(), ('Sort',), RIGID, TOGETHER)}"


def follow() -> str:
    """Paths, on both machines."""
    names = ("path_error_median_m", "heading_error_median_rad")
    tables = [(hardware, table(report(), ("Follow",), hardware, names)) for hardware in ("ideal", PROTOTYPE)]
    return "\n\n".join(f"On the {hardware} machine:\n\n{text}" for hardware, text in tables)


def effects() -> str:
    """What breaks a policy: success and time of every policy under every effect."""
    places = [place for place in report().places if place.study == "effects"]
    cases = list(dict.fromkeys(place.hardware for place in places))
    policies = list(dict.fromkeys(place.policy for place in places))
    found = {case: report().of("Align", case, "effects") for case in cases}
    lines = [
        [CASE_NAMES.get(case, case), *(with_time(found[case].get(policy)) for policy in policies)] for case in cases
    ]
    return markdown(("Align: effect", *policies), lines)


CASE_NAMES = {
    "dead zone": "dead zone: nothing below 0.1 mm",
    "latency": "latency of one period",
    "noise": "noise of 0.1 mm and 0.2 deg",
    "spread": "elements differ by 5 % and 5 deg",
    "faults": "5 % of the elements dead",
}
"""Cases of the study of effects in words; their settings are in ``configs/evaluations/report.yaml``."""


def overview() -> str:
    """The README's: of each task what comes of doing nothing clever, of the best laws, and of what was learned."""
    columns = (("ideal", ("local_field", "planner")), ("ideal", ("pose",)), ("ideal", ("learned",)))
    columns = (*columns, (PROTOTYPE, ("pose",)), (PROTOTYPE, ("learned there",)))
    heads = (
        "task",
        "fields (*local_field*, *planner*)",
        "law *pose*",
        "learned",
        "*pose* on the prototype",
        "learned there",
    )
    lines = []
    for task in ALL:
        cells = []
        for hardware, policies in columns:
            found = report().of(task, hardware)
            cells.append(with_time(next((found[name] for name in policies if name in found), None)))
        lines.append([task, *cells])
    return markdown(heads, lines)


TABLES: dict[str, Callable[[], str]] = {
    "provenance": provenance,
    "overview": overview,
    "one-part": one_part,
    "several-parts": several_parts,
    "prototype": prototype,
    "rigid": rigid,
    "follow": follow,
    "effects": effects,
    "trained": trained,
    **above_the_plane.TABLES,
    **open_tasks.TABLES,
    **rivals.TABLES,
}
"""By the name of the file in ``docs/generated``."""
