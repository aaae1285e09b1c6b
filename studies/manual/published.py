"""Tables of published results for the pages: :data:`TABLES` has functions without arguments that return Markdown."""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

from agents.evaluation.table import markdown
from studies.manual import open_tasks
from studies.manual.figures_file import NOTHING, RESULTS, ROOT, Published, Row, rows, table, with_time
from studies.rivals.figures import CONTENDERS, EPISODES, FIGURES, PUSH

TIME, BOUND = "time_to_goal_median_s", "time_over_bound_median"
ERRORS = ("position_error_median_m", "heading_error_median_rad")
PATH_ERRORS = ("path_error_median_m", "heading_error_median_rad")
SEVERAL_PARTS = (TIME, "throughput_median_parts_per_s", "collisions_mean", "path_efficiency_median")
ONE, SEVERAL = ("Transport", "Align", "Rotate"), ("Sort", "Singulate")
PROTOTYPE, RIGID = "prototype", "rigid, disturbed"


# Results of make report.


@functools.cache
def report() -> Published:
    """Return the results of ``make report``."""
    return Published(RESULTS / "report")


def provenance() -> str:
    """Return a sentence with the date, commit, processor and versions of ``make report``."""
    about = report().about
    machine, versions = about["host"], about["versions"]
    return (
        f"Evaluated on {report().day} at commit {about['commit'][:7]}, {machine['cores']} cores ({machine['processor']}), "
        f"Python {versions['python']}, numba {versions['numba']}."
    )


def on(*tables: tuple[Sequence[str], str, Sequence[str]]) -> str:
    """Return tables of all policies in ``make report``, each of tasks, a hardware model and figures."""
    return "\n\n".join(table(report(), *arguments) for arguments in tables)


def follow() -> str:
    """Return the results of Follow on ideal and prototype hardware."""
    return "\n\n".join(
        f"On {hardware} hardware:\n\n{on((('Follow',), hardware, PATH_ERRORS))}" for hardware in ("ideal", PROTOTYPE)
    )


EFFECT_NAMES = {
    "dead zone": "dead zone: no motion below 0.1 mm",
    "latency": "latency of one period",
    "noise": "noise of 0.1 mm and 0.2 deg",
    "spread": "elements differ by 5 % and 5 deg",
    "faults": "5 % of the elements dead",
}
"""Descriptions of effects; their settings are in ``configs/evaluations/report.yaml``."""


def effects() -> str:
    """Return success and time of every policy with every hardware effect."""
    places = [place for place in report().places if place.study == "effects"]
    policies = list(dict.fromkeys(place.policy for place in places))
    lines = []
    for name in dict.fromkeys(place.hardware for place in places):
        results = report().of("Align", name, "effects")
        lines.append([EFFECT_NAMES.get(name, name), *(with_time(results.get(policy)) for policy in policies)])
    return markdown(("Align: effect", *policies), lines)


def overview() -> str:
    """Return the README's table: fields, the best controller and learned policies on each task."""
    columns = {
        "fields (*local_field*, *planner*)": ("ideal", ("local_field", "planner")),
        "controller *pose*": ("ideal", ("pose",)),
        "learned": ("ideal", ("learned",)),
        "*pose*, prototype": (PROTOTYPE, ("pose",)),
        "learned on the prototype": (PROTOTYPE, ("learned there",)),
    }
    lines = []
    for task in (*ONE, *SEVERAL):
        cells = []
        for hardware, policies in columns.values():
            results = report().of(task, hardware)
            cells.append(with_time(next((results[name] for name in policies if name in results), None)))
        lines.append([task, *cells])
    return markdown(("task", *columns), lines)


# Results of configs/evaluations/tilting.yaml: heading of a column -> hardware model.

DISTURBED = {
    "planar": "planar",
    "tilting": "tilting",
    "planar, impulses": "impulses",
    "tilting, disturbed": "disturbed",
    "tilting, disturbed, patches": "disturbed, patches",
}
FOILS = {
    "ramps of 3 mm, restitution 0.2": "tilting",
    "ramps of 1 mm": "steep ramps",
    "ramps of 10 mm": "wide ramps",
    "restitution 0": "dead contact",
    "restitution 0.5": "bouncing",
}
TILTING_PROTOTYPE = {
    "prototype, planar": "prototype",
    "prototype, tilting": "prototype tilting",
    "prototype, tilting, estimator fitted": "prototype tilting, fitted",
}


@functools.cache
def tilting() -> Published:
    """Return the results of ``configs/evaluations/tilting.yaml``."""
    return Published(RESULTS / "tilting")


def compared(task: str, columns: Mapping[str, str]) -> str:
    """Return success and median time of all policies that were evaluated on at least two of the hardware models."""
    results = {head: tilting().of(task, hardware) for head, hardware in columns.items()}
    results = {head: policies for head, policies in results.items() if policies}
    names = dict.fromkeys(name for policies in results.values() for name in policies)
    lines = [[name, *(with_time(policies.get(name)) for policies in results.values())] for name in names]
    return markdown((task, *results), [line for line in lines if sum(cell != NOTHING for cell in line) > 2])


# Results of training: results/agents.csv.

AGENT_HEADS = (
    "agent", "success", "time to goal", "time / bound", "collisions", "good parts per minute", "steps", "minutes"
)  # fmt: skip


def agent_lines(task: str | None = None) -> list[list[str]]:
    """Return one line per agent, of one task or of all. Values that differ between training seeds are listed in order."""
    agents: dict[str, list[dict[str, str]]] = {}
    for row in rows(RESULTS / "agents.csv"):
        if task in (None, row["agent"].partition("/")[0]) and "/ladder" not in row["agent"]:
            agents.setdefault(row["agent"], []).append(row)
    return [_agent_line(name, seeds) for name, seeds in agents.items()]


def _agent_line(name: str, seeds: Sequence[Mapping[str, str]]) -> list[str]:
    success = f"{_by_seed(seeds, 'success', 100.0, 1, ' %')} of {seeds[0]['episodes']}"
    return [
        f"{name}{'' if len(seeds) > 1 else ' (one seed)'}",
        NOTHING if seeds[0]["good_per_minute_mean"] else success,
        _by_seed(seeds, "time_to_goal_median_s", 1.0, 2, " s"),
        _by_seed(seeds, "time_over_bound_median", 1.0, 3, ""),
        _by_seed(seeds, "collisions_mean", 1.0, 2, ""),
        _by_seed(seeds, "good_per_minute_mean", 1.0, 0, ""),
        f"{int(seeds[0]['steps']):,}".replace(",", "\u202f"),  # narrow no-break space
        _by_seed(seeds, "minutes", 1.0, 1, ""),
    ]


def _by_seed(seeds: Sequence[Mapping[str, str]], column: str, factor: float, digits: int, unit: str) -> str:
    """Return the value of each seed, one value if all agree, or a dash if there is none."""
    texts = [f"{factor * float(row[column]):.{digits}f}" if row[column] else NOTHING for row in seeds]
    if all(text == NOTHING for text in texts):
        return NOTHING
    return (texts[0] if len(set(texts)) == 1 else ", ".join(texts)) + unit


# Results of python -m studies.rivals.


def _number(row: Row, name: str, digits: int, factor: float = 1.0) -> str:
    return "" if row[name] == "" else f"{factor * float(row[name]):.{digits}f}"


def rivals() -> str:
    """Return success and time of every machine on every task."""
    results = rows(ROOT / FIGURES)
    cells = {(row["machine"], row["task"]): rival_cell(row) for row in results}
    episodes = {row["task"]: row["episodes"] for row in results}
    tasks = [task for task in EPISODES if task in episodes]
    heads = ("machine", *(f"{task} ({episodes[task]})" for task in tasks))
    lines = [(rival.title, *(cells.get((name, task), "") for task in tasks)) for name, rival in CONTENDERS.items()]
    return markdown(heads, lines)


def rival_cell(row: Row) -> str:
    """Return success with its interval, median time, and the time relative to the segmented surface's."""
    rate, low, high = (_number(row, name, 0 if float(row[name]) in (0.0, 1.0) else 1, 100.0)
                       for name in ("success", "success_low", "success_high"))  # fmt: skip
    text = f"{rate} % ({low} to {high})"
    if row["time_ratio"] == "":
        return text
    text += f", {_number(row, 'time_median', 2)} s"
    if row["machine"] == "segmented":
        return text
    text += f", x {_number(row, 'time_ratio', 2)}"
    if row["time_ratio_low"] == "":
        return text
    return f"{text} ({_number(row, 'time_ratio_low', 2)} to {_number(row, 'time_ratio_high', 2)})"


def rivals_push() -> str:
    """Return the share of the full push that every machine can give to several parts."""
    results = rows(ROOT / PUSH)
    counts = list(dict.fromkeys(row["parts"] for row in results))
    cells = {(row["machine"], row["parts"]): f"{_number(row, 'share', 1, 100.0)} %" for row in results}
    names = list(dict.fromkeys(row["machine"] for row in results))
    heads = ("machine", *(f"{count} part{'s' if int(count) > 1 else ''}" for count in counts))
    return markdown(heads, [(CONTENDERS[name].title, *(cells[name, count] for count in counts)) for name in names])


TABLES: dict[str, Callable[[], str]] = {
    "provenance": provenance,
    "overview": overview,
    "one-part": lambda: on((ONE, "ideal", (TIME, BOUND, *ERRORS, "fallen_rate"))),
    "several-parts": lambda: on((SEVERAL, "ideal", SEVERAL_PARTS)),
    "prototype": lambda: on((ONE, PROTOTYPE, (TIME, BOUND, *ERRORS)), (SEVERAL, PROTOTYPE, SEVERAL_PARTS)),
    "rigid": lambda: on((("Align",), RIGID, (TIME, *ERRORS)), (("Sort",), RIGID, SEVERAL_PARTS)),
    "follow": follow,
    "effects": effects,
    "trained": lambda: markdown(AGENT_HEADS, agent_lines()),
    "disturbed-align": lambda: compared("Align", DISTURBED),
    "disturbed-sort": lambda: compared("Sort", DISTURBED),
    "foils": lambda: compared("Align", FOILS),
    "tilting-prototype-align": lambda: compared("Align", TILTING_PROTOTYPE),
    "tilting-prototype-sort": lambda: compared("Sort", TILTING_PROTOTYPE),
    "rivals": rivals,
    "rivals-push": rivals_push,
    **open_tasks.TABLES,
}
"""File name in ``docs/generated``, without suffix -> function that returns its Markdown."""
