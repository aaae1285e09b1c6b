"""The table of trained agents: a line for each, with what its trainings reached on fresh episodes."""

from __future__ import annotations

from collections.abc import Sequence

from agents.evaluation.table import markdown
from studies.manual.figures_file import NOTHING, RESULTS, rows

HEADS = ("agent", "success", "time to goal", "time / bound", "collisions", "good a minute", "steps", "minutes")


def trained() -> str:
    """Markdown from ``results/agents.csv``."""
    return markdown(HEADS, lines_of())


def lines_of(task: str | None = None) -> list[list[str]]:
    """A line for each agent, of one task or of all; where figures of the trainings differ, those of all seeds in order."""
    agents: dict[str, list[dict[str, str]]] = {}
    for row in rows(RESULTS / "agents.csv"):
        if task in (None, row["agent"].partition("/")[0]) and "/ladder" not in row["agent"]:
            agents.setdefault(row["agent"], []).append(row)
    return [_line(name, found) for name, found in agents.items()]


def _line(name: str, found: Sequence[dict[str, str]]) -> list[str]:
    counted = f" of {found[0]['episodes']}"
    succeed = _each(found, "success", 100.0, 1, " %")
    return [
        f"{name}{'' if len(found) > 1 else ' (one training)'}",
        NOTHING if found[0]["good_per_minute_mean"] else succeed + counted,
        _each(found, "time_to_goal_median_s", 1.0, 2, " s"),
        _each(found, "time_over_bound_median", 1.0, 3, ""),
        _each(found, "collisions_mean", 1.0, 2, ""),
        _each(found, "good_per_minute_mean", 1.0, 0, ""),
        f"{int(found[0]['steps']):,}".replace(",", "\u202f"),  # a narrow space that does not break
        _each(found, "minutes", 1.0, 1, ""),
    ]


def _each(found: Sequence[dict[str, str]], column: str, factor: float, digits: int, unit: str) -> str:
    """The value of each training, or one if all agree; a dash if it applies to none."""
    texts = [f"{factor * float(row[column]):.{digits}f}" if row[column] else NOTHING for row in found]
    if all(text == NOTHING for text in texts):
        return NOTHING
    return (texts[0] if len(set(texts)) == 1 else ", ".join(texts)) + unit
