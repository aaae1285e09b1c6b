"""What the policies that come along reach in an environment, from the published results."""

from __future__ import annotations

from agents.evaluation.tables import markdown
from studies.manual import open_tasks
from studies.manual.figures_file import table
from studies.manual.published import BOUND, ERRORS, ONE, SEVERAL, TIME, TOGETHER, report
from studies.manual.trained import HEADS, lines_of

PATHS = ("path_error_median_m", "heading_error_median_rad")


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
    table = open_tasks.of(name)
    head = f"One of the [open tasks](../open-tasks.md) (`python -m agents score`, {open_tasks.found()}):"
    return [f"{head}\n\n{table}"] if table else []


def _trained(name: str) -> list[str]:
    """Of ``results/agents.csv``."""
    lines = lines_of(name)
    head = "Agents that were [trained](../trained.md) for it, each training on fresh episodes:"
    return [f"{head}\n\n{markdown(HEADS, lines)}"] if lines else []
