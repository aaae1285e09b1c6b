"""Good and faulty parts a minute against the number of parts that come and go, as a data sheet draws it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from matplotlib.axes import Axes

from agents.evaluation import figures
from agents.evaluation.jobs import Job, Known
from agents.evaluation.quantities import RATES
from agents.evaluation.records import Row, ends
from agents.evaluation.resampling import interval_of
from agents.evaluation.settings import EvaluationSettings
from vibgym import checks
from vibgym.policies.measures import Measured

COLOURS = {"good": "#0b7a75", "tilted": "#b8860b", "close": "#2f6fde", "wrong": "#8a4fbf", "lost": "#d1572a"}


class Loaded(NamedTuple):
    """What is run and judged in one piece."""

    study: str  # "load", which no case of another study is called together with two more words
    parts: str
    policy: str


@dataclass(frozen=True)
class Load:
    """The study's table: rows for every policy, and of each for every number of parts, ascending."""

    task: str
    episodes: int
    policies: tuple[str, ...]
    rows: tuple[Row, ...]

    def of(self, policy: str) -> list[Row]:
        """One curve."""
        return [row for row in self.rows if row.policy == policy]

    def as_values(self) -> dict[str, Any]:
        """For JSON."""
        return {"task": self.task, "episodes": self.episodes, "results": [vars(row) for row in self.rows]}


def load_jobs(settings: EvaluationSettings) -> Iterator[tuple[Loaded, Job]]:
    """Every policy of the study with every number of parts, the kinds of the task in turn; none without a study.

    Raises:
        ValueError: a task whose parts stay, more parts than fit, or an unfitting policy.
    """
    asked, known = settings.under_load, Known()
    if asked is None:
        return
    plain, field = known.info(asked.task, settings.environment, "evaluation.under_load"), "evaluation.under_load"
    if not plain.flows:
        raise checks.refuse(f"{field}.task", asked.task, "tasks whose parts come and go")
    kinds = [plain.parts[plain.kind.index(kind)].to_dict() for kind in range(len(plain.kinds))]
    contents = settings.named_policies()
    for name in asked.policies:
        for count in sorted(asked.parts):
            environment = {**settings.environment, "parts": [kinds[k % len(kinds)] for k in range(count)]}
            info = known.info(asked.task, environment, f"{field}.parts.{count}")
            seeds = settings.seed_list(asked.task, asked.episodes)
            with checks.within(f"{field}.policies ({name}, {count} parts)"):
                yield (
                    Loaded("load", str(count), name),
                    Job(asked.task, info, seeds, environment, contents[name], None).made(),
                )


def loaded_row(key: Loaded, found: Measured, level: float, resamples: int) -> Row:
    """Statistics of one policy with some number of parts: means a minute."""
    good = found.fact("good_per_minute")
    interval = interval_of(good[None], level, resamples)
    return Row(
        policy=key.policy,
        parts=int(key.parts),
        episodes=len(found.seeds),
        bound=float(found.rate_bound[0]),
        **{event: float(found.fact(name).mean()) for name, event in RATES.items()},
        **ends("good", interval),
        transit_s=float(found.fact("transit").mean()),
        on_table=float(found.fact("on_table").mean()),
    )


def draw(load: Load) -> bytes:
    """A plot for every policy side by side: parts a minute by what became of them, and the bound."""
    figure = figures.new_figure(2.9 * max(len(load.policies), 2), 3.0)
    all_axes = figure.subplots(1, len(load.policies), sharey=True, squeeze=False)[0]
    for axes, name in zip(all_axes, load.policies, strict=True):
        _curves(axes, load.of(name))
        figures.style(axes, xlabel="parts in play", title=name)
    all_axes[0].set_ylabel("parts a minute")
    figures.name_lines(figure, all_axes[0].get_lines())
    return figures.png(figure)


def _curves(axes: Axes, rows: list[Row]) -> None:
    counts = [row.parts for row in rows]
    axes.plot(counts, [row.bound for row in rows], "--", color=figures.MUTED, linewidth=1.0, label="bound")
    for event, colour in COLOURS.items():
        values = np.array([getattr(row, event) for row in rows])
        width = 1.9 if event == "good" else 1.1
        axes.plot(counts, values, "o-", color=colour, linewidth=width, markersize=3.2, label=event)
    low = [row.good if row.good_low != row.good_low else row.good_low for row in rows]
    high = [row.good if row.good_high != row.good_high else row.good_high for row in rows]
    axes.fill_between(counts, low, high, color=COLOURS["good"], alpha=0.18, linewidth=0)
    axes.set_xticks(counts)
    axes.set_ylim(bottom=0.0)
