"""What the policies that come along reach in an environment, from the published results."""

from __future__ import annotations

import json

from agents.evaluation.tables import markdown, number, quantity
from studies.manual.figures_file import RESULTS, rows, table
from studies.manual.published import BOUND, ERRORS, ONE, SEVERAL, TIME, TOGETHER, report
from studies.manual.trained import HEADS, lines_of

PATHS = ("path_error_median_m", "heading_error_median_rad")
OPEN_HEADS = ("hardware", "policy", "score", "success", "time to goal", "good a minute", "collisions", "episodes")


def baselines(name: str) -> str:
    """Tables of all that is known of ``vibgym/<name>-v0``, with their dates, or where to get figures."""
    pieces = [*_reported(name), *_scored(name), *_trained(name)]
    if not pieces:
        return (
            f'None are published. `vibgym.policies.rollout("planner", "vibgym/{name}-v0", seeds=range(100))` '
            "plays the planner's, and takes any other policy."
        )
    return "\n\n".join(pieces)


def _reported(name: str) -> list[str]:
    """Of ``results/report``: a table for each machine."""
    found = []
    for hardware in dict.fromkeys(place.hardware for place in report().places if place[:2] == ("report", name)):
        names = (TIME, BOUND, *ERRORS) if name in ONE else TOGETHER if name in SEVERAL else PATHS
        found.append(
            f"On *{hardware}* hardware (`make report`, {report().day}):\n\n{table(report(), [name], hardware, names)}"
        )
    return found


def _scored(name: str) -> list[str]:
    """Of ``results/open``: one table for both machines."""
    scored = [row for row in rows(RESULTS / "open" / "scores.csv") if row["task"] == name and row["served"] == "True"]
    if not scored:
        return []
    about = json.loads((RESULTS / "open" / "results.json").read_text(encoding="utf-8"))
    lines = [
        [
            row["hardware"],
            row["policy"],
            number(float(row["score"]), 3),
            quantity(_value(row, "success_rate"), 100.0, 1, "%"),
            quantity(_value(row, "time_to_goal_median_s"), 1.0, 2, "s"),
            number(_value(row, "good_per_minute"), 1),
            number(_value(row, "collisions_mean"), 2),
            row["episodes"],
        ]
        for row in scored
    ]
    day = about["time"][:10]
    return [
        f"One of the [open tasks](../open-tasks.md) (`python -m agents score`, {day}):\n\n{markdown(OPEN_HEADS, lines)}"
    ]


def _value(row: dict[str, str], column: str) -> float:
    return float(row[column]) if row[column] else float("nan")


def _trained(name: str) -> list[str]:
    """Of ``results/agents.csv``."""
    lines = lines_of(name)
    head = "Agents that were [trained](../trained.md) for it, each training on fresh episodes:"
    return [f"{head}\n\n{markdown(HEADS, lines)}"] if lines else []
