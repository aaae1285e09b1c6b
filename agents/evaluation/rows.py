"""Rows of statistics of an evaluation: policies, paired differences, studies, load, ladders."""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import pandas as pd
from tqdm import tqdm

from agents.evaluation.run import Results
from agents.evaluation.settings import Study
from agents.evaluation.statistics import Estimate, interval_of
from agents.evaluation.table import (
    LOAD,
    RATES,
    REPORT,
    Place,
    by_run,
    difference,
    ends,
    mean,
    places,
    summary,
    table,
    values,
)

Row = Mapping[str, Any]


def rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of results.csv: every policy on every task and hardware, followed by its training runs."""
    groups, order = {policy.name: policy.group for policy in results.settings.policies}, results.settings.names

    def columns(episodes: pd.DataFrame) -> dict[str, Any]:
        group = groups[values(episodes, "policy")[0]]
        return {"group": group, "training_seed": None, **summary(episodes, *results.settings.intervals)}

    by = ("task", "hardware", "policy")
    records = table(results.main, by, columns).to_dict("records")
    several = results.main.loc[results.main["training_seed"] >= 0]
    runs = table(several, (*by, "training_seed"), lambda some: columns(some) | {"training_seed": _seed(some)})
    records += runs.to_dict("records")
    there = list(dict.fromkeys((row["task"], row["hardware"]) for row in records))
    return sorted(records, key=lambda row: (there.index((row["task"], row["hardware"])), order.index(row["policy"])))


def _seed(episodes: pd.DataFrame) -> int:
    """Return the training seed of the episodes of one run."""
    return int(values(episodes, "training_seed")[0])


def best_rows(results: Results, all_rows: Sequence[Row]) -> dict[tuple[str, str], Row]:
    """Return the best policy by task and hardware: most successes, then the lowest time over its bound, then the lowest time;
    where parts come and go, the most good parts a minute."""

    def rank(row: Row) -> tuple[float, ...]:
        if results.tasks[row["task"]].continuous_feed:
            return (-row["good_per_minute_mean"],)
        times = (row[name] for name in ("time_over_bound_median", "time_to_goal_median_s"))
        return -row["successes"], *(time if math.isfinite(time) else math.inf for time in times)

    return _first(all_rows, rank)


def best_classical(all_rows: Sequence[Row]) -> dict[tuple[str, str], Row]:
    """Return the best classical policy by task and hardware: most successes, then the lowest interquartile mean of times.

    It is chosen on the episodes on which others are compared with it, so chance may favour it slightly.
    """
    some = [row for row in all_rows if row["group"] == "classical"]
    return _first(some, lambda row: (-row["successes"], row["time_iqm_s"]))


def _first(all_rows: Sequence[Row], rank: Callable[[Row], tuple[float, ...]]) -> dict[tuple[str, str], Row]:
    """Return the policy of the lowest rank by task and hardware."""
    best: dict[tuple[str, str], Row] = {}
    for row in all_rows:
        place = row["task"], row["hardware"]
        if row["training_seed"] is None and (place not in best or rank(row) < rank(best[place])):
            best[place] = row
    return best


def differences(results: Results, all_rows: Sequence[Row], quiet: bool = True) -> list[dict[str, Any]]:
    """Return paired differences seed by seed: of every two policies on the same task and hardware; in a comparison, of learned
    and hybrid policies to the best classical one."""
    known, compares = places(results.main), results.settings.where == "comparison"
    pairs = [pair for pair in itertools.combinations(known, 2) if pair[0][:3] == pair[1][:3]]
    if compares:
        best = best_classical(all_rows)
        others = [row for row in all_rows if row["group"] != "classical" and row["training_seed"] is None]
        names = ((row, best[place]) for row in others if (place := (row["task"], row["hardware"])) in best)
        pairs = [
            tuple(Place(REPORT, row["task"], row["hardware"], entry["policy"]) for entry in (row, other))
            for row, other in names
        ]  # type: ignore[misc]
    gaps = []
    for one, other in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet):
        first, second = known[one], known[other]
        labels = {"task": one.task, "hardware": one.hardware, "first": one.policy, "second": other.policy}
        counts = {"episodes": len(first) // (runs := len(by_run(first, "seed"))), "runs": runs}
        gaps.append(labels | counts | difference(first, second, *results.settings.intervals, middle=compares))
    return gaps


def against_best(results: Results, gaps: Sequence[Row], best: Mapping[tuple[str, str], Row]) -> list[Row]:
    """Return the differences of the best policy on every task and hardware to each other one."""
    chosen: list[Row] = []
    for gap in gaps:
        name = best[gap["task"], gap["hardware"]]["policy"]
        if results.tasks[gap["task"]].continuous_feed or name not in (gap["first"], gap["second"]):
            continue  # success does not apply, or two others
        if name == gap["second"]:
            flipped = {key: value.negative() for key, value in gap.items() if isinstance(value, Estimate)}
            gap = {**gap, "first": name, "second": gap["first"], **flipped}
        chosen.append(gap)
    return chosen


def study_rows(results: Results, place: str, study: Study) -> list[dict[str, Any]]:
    """Return the cells of a study, case after case; ``refusal``: why a policy cannot act in a case.

    Args:
        results: of the evaluation.
        place: of the study in the settings.
        study: its settings.
    """
    label = results.settings.label(place)
    cells, known = [], places(results.episodes, label)
    for case in study.cases:
        for column in study.policies:
            cell = Place(label, study.task, case, column.name)
            figures = {"runs": 0, "episodes": 0}
            if cell in known:
                figures = summary(known[cell], *results.settings.intervals)
            cells.append({"case": case, "policy": column.name, "refusal": results.refused.get(cell, ""), **figures})
    return pd.DataFrame(cells, dtype=object).to_dict("records")  # nan where a policy cannot act


def load_rows(results: Results) -> list[dict[str, Any]]:
    """Return the rows of the study of throughput: means a minute by policy and number of parts."""
    return [
        {
            "policy": place.policy,
            "parts": int(place.hardware),
            "episodes": len(some),
            "bound": float(values(some, "rate_bound_per_minute")[0]),
            **{event: mean(some, name) for name, event in RATES.items()},
            **ends("good", interval_of(by_run(some, "good_per_minute"), *results.settings.intervals)),
            "transit_s": mean(some, "transit_s"),
            "on_table": mean(some, "on_table"),
        }
        for place, some in places(results.episodes, LOAD).items()
    ]


def ladders(results: Results, all_rows: Sequence[Row]) -> list[dict[str, Any]]:
    """Return the ladders: of every policy its action, training budget and rows of statistics."""
    actions = {case.place: case.policy.action for case in results.cases if case.policy is not None}
    result = []
    for ladder in results.settings.ladders:
        hardware, steps = results.settings.ladder_hardware(ladder), []
        for name in ladder.policies:
            place = Place(REPORT, ladder.task, hardware, name)
            first, *others = (row for row in all_rows if (row["task"], row["hardware"], row["policy"]) == place[1:])
            curves = results.curves[ladder.task, name].values()
            budget = {key: [curve[key].iloc[-1].item() for curve in curves] for key in ("steps", "seconds")}
            steps.append({"policy": name, "action": actions[place], **budget, "row": first, "runs": others})
        result.append({"name": ladder.name, "task": ladder.task, "hardware": hardware, "steps": steps})
    return result
