"""Success of policies on tasks, hardware models and shapes: ``python -m studies.benchmarks.policies TABLE ...``.

``policies.yaml`` defines the tables. Seeds are those from 300000, which are not used for tuning, unless the table has others.
The exit code is 1 if an episode of the tables ``bound`` and ``bound-feed`` is faster than its time bound.
"""

from __future__ import annotations

import itertools
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils.seeding import np_random

from agents.evaluation.statistics import (
    Estimate,
    Interval,
    bootstrap,
    episode_scores,
    exact,
    mean_difference,
    quartiles,
    success_difference,
    success_interval,
)
from agents.evaluation.table import number, quantity
from studies.common import HARDWARE, LEVEL, RESAMPLES, outcome, parser
from studies.kept import show
from vibgym.config import load_yaml
from vibgym.envs.drawn import drawn_shapes
from vibgym.policies import rollout
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.seeds import RANGES

FILE = Path(__file__).with_name("policies.yaml")
WORLDS = 500
"""Episodes of a batch."""

LIMIT = 0.2
"""N s, limit of the cost of an episode in the table ``constrained``."""

Settings = dict[str, Any]
"""Policy, task, share of the episodes, and arguments of the environment."""


def joined(settings: Settings, more: Mapping[str, Any]) -> Settings:
    """Return settings with those of an option: mappings (and policies) are joined, other values replaced."""
    result = dict(settings)
    for name, value in more.items():
        if name == "hardware":
            result |= HARDWARE[value]
            continue
        if name == "policy" and isinstance(value, str):
            value = {"kind": value}
        before = result.get(name)
        result[name] = {**before, **value} if isinstance(before, dict) and isinstance(value, dict) else value
    return result


def options(level: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings of the options of a level by name."""
    ((name, values), *others) = level.items()
    if isinstance(values, list) and not others:
        return {str(value): {name: value} for value in values}
    return dict(level)


def rows(table: Mapping[str, Any]) -> Iterator[tuple[list[str], Settings]]:
    """Yield labels and settings of the rows of a table."""
    for block in table["rows"]:
        for choice in itertools.product(*(options(level).items() for level in block)):
            settings = joined({}, table.get("settings", {}))
            for _, more in choice:
                settings = joined(settings, more)
            yield [name for name, _ in choice], settings


def played(settings: Settings, first: int, episodes: int) -> MeasuredOutcomes:
    """Run the episodes of a case."""
    environment = dict(settings)
    policy, task, share = (
        environment.pop(name, default) for name, default in (("policy", ""), ("task", ""), ("share", 1.0))
    )
    seeds = range(first, first + max(1, round(share * episodes)))
    results = [
        rollout(policy, task, seeds=seeds[k : k + WORLDS], keep=Measures, **environment)
        for k in range(0, len(seeds), WORLDS)
    ]
    one = results[0]
    arrays = {
        field.name: np.concatenate([getattr(result, field.name) for result in results])
        for field in fields(one)
        if isinstance(getattr(one, field.name), np.ndarray)
    }
    return MeasuredOutcomes(
        **{"task": task, "seeds": tuple(seeds), "step_time": one.step_time, "timing": one.timing, **arrays}
    )


# -- formats of cells --------------------------------------------------------------------------------------------------


def over_shapes(result: MeasuredOutcomes, settings: Settings) -> str:
    """Format success, median time and score; the interval is for other shapes, whose episodes are correlated."""
    drawn = drawn_shapes(f"vibgym/{settings['task']}-v0", {"split": settings["split"]})
    assert drawn is not None
    shape = drawn.draw(np.array([np_random(seed)[0].random(drawn.draws) for seed in result.seeds]))[:, 0]
    score = episode_scores(result).mean()
    text = outcome(result.success, result.time_to_goal, 1, shape_interval(result.success, shape))
    return text if np.isnan(score) else f"{text}, {score:.3f}"


def shape_interval(success: np.ndarray, shape: np.ndarray) -> Interval:
    """Return the interval of a success rate for other shapes, from episodes (n,) and their shapes."""
    rates = np.array([success[shape == k].mean() for k in np.unique(shape)])
    if np.ptp(rates) == 0.0:
        return exact(int(success.sum()), success.size, LEVEL)
    return bootstrap(rates, LEVEL, RESAMPLES)


def mean_time(result: MeasuredOutcomes, _: Settings) -> str:
    """Format success and mean time to success."""
    time = f"{result.time_to_goal[result.success].mean():.2f} s" if result.success.any() else "–"
    return f"{100.0 * result.success.mean():.1f} %, {time}"


def within_the_limit(result: MeasuredOutcomes, _: Settings) -> str:
    """Format the share of the episodes whose cost is within :data:`LIMIT`."""
    within = result.cost <= LIMIT
    share = exact(int(within.sum()), len(within), LEVEL)
    return f"{100 * within.mean():.1f} % ({100 * share.low:.1f} to {100 * share.high:.1f})"


def steps_above(result: MeasuredOutcomes) -> np.ndarray:
    """Return the steps of successful episodes above their bound."""
    return np.rint((result.time_to_goal - result.bound)[result.success] / result.step_time)


def low_high(values: np.ndarray, digits: int, end: Callable[[np.ndarray], Any]) -> str:
    """Format the median and the smallest or largest value."""
    return f"{np.median(values):.{digits}f}, {end(values):.{digits}f}" if len(values) else "–"


Format = Callable[[MeasuredOutcomes, Settings], str]
FORMATS: dict[str, Format] = {
    "success": lambda result, _: quantity(result.success.mean(), 100.0, 1, "%"),
    "time": lambda result, _: quantity(quartiles(result.time_to_goal).median, 1.0, 2, "s"),
    "over bound": lambda result, _: quantity(quartiles(result.time_over_bound).median, 1.0, 2, ""),
    "collisions": lambda result, _: number(float(result.collisions.mean()), 2),
    "episodes": lambda result, _: str(len(result.success)),
    "median time": lambda result, _: outcome(result.success, result.time_to_goal),
    "mean time": mean_time,
    "interval": lambda result, _: outcome(
        result.success, result.time_to_goal, 1, success_interval(result.success, LEVEL, RESAMPLES)
    ),
    "over shapes": over_shapes,
    # Feed
    "good": lambda result, _: "{:.1f} ({:.1f} to {:.1f})".format(
        *(call(result.reported("good_per_minute")) for call in (np.mean, np.min, np.max))
    ),
    "faulty": lambda result, _: (
        f"{sum(result.reported(f'{kind}_per_minute').mean() for kind in ('tilted', 'close', 'wrong', 'lost')):.1f}"
    ),
    "transit": lambda result, _: f"{result.reported('transit').mean():.2f} s",
    "on the table": lambda result, _: f"{result.reported('on_table').mean():.1f}",
    "of the bound": lambda result, _: quantity(quartiles(result.rate_over_bound).median, 100.0, 0, "%"),
    # costs
    "cost": lambda result, _: "{:.3f} ({:.3f} to {:.3f})".format(*np.quantile(result.cost, (0.5, 0.05, 0.95))),
    "within the limit": within_the_limit,
    "return": lambda result, _: f"{result.returns.mean():.2f}",
    "score": lambda result, _: f"{episode_scores(result).mean():.3f}",
    "at limited cost": lambda result, _: f"{np.where(result.cost <= LIMIT, episode_scores(result), 0.0).mean():.3f}",
    "contacts": lambda result, _: f"{result.collisions.mean():.1f}",
    "change of commands": lambda result, _: f"{result.action_change.mean():.3f}",
    "overshoots": lambda result, _: f"{result.overshoots.mean():.1f}; {result.corrections.mean():.1f}",
    # bounds
    "times over bound": lambda result, _: low_high(result.time_over_bound[result.success], 3, np.min),
    "steps above bound": lambda result, _: low_high(steps_above(result), 0, np.min),
    "beaten": lambda result, _: str(int((steps_above(result) < 0.0).sum())),
    "rates over bound": lambda result, _: low_high(result.rate_over_bound, 3, np.max),
    "rates beaten": lambda result, _: str(int((result.rate_over_bound > 1.0).sum())),
}
"""Functions that format the outcomes of a case."""


# -- tables ------------------------------------------------------------------------------------------------------------


def lines(table: Mapping[str, Any], episodes: int, results: list[list[MeasuredOutcomes]]) -> Iterator[list[str]]:
    """Yield the rows of a table as text; the outcomes are appended to ``results``, a list a row."""
    first = table.get("first_seed", RANGES["held_out"].start)
    for names, settings in rows(table):
        cases = [joined(settings, more) for more in table.get("columns", {"": {}}).values()]
        of_cases = [played(case, first, episodes) for case in cases]
        results.append(of_cases)
        if "columns" in table:
            cells = [FORMATS[table["cell"]](result, case) for result, case in zip(of_cases, cases, strict=True)]
        else:
            cells = [FORMATS[name](of_cases[0], cases[0]) for name in table["cells"].values()]
        if "last" in table:
            cells.append(f"{100.0 * (of_cases[-1].success.mean() - of_cases[-2].success.mean()):+.1f}")
        print(*names, *cells, sep=" | ", flush=True)
        yield [*names, *cells]


QUANTITIES = {
    "success": (100.0, 1, "%"),
    "time to the goal": (1.0, 4, "s"),
    "position error at the end": (1e3, 4, "mm"),
    "heading error at the end": (180.0 / np.pi, 4, "deg"),
}
"""Factor, digits and unit of each paired difference."""


def differences(camera: MeasuredOutcomes, model: MeasuredOutcomes) -> list[Estimate]:
    """Return the means of camera minus statistical model on the same seeds, for each of :data:`QUANTITIES`."""
    gaps = (
        camera.time_to_goal - model.time_to_goal,
        camera.position_error - model.position_error,
        camera.heading_error - model.heading_error,
    )
    success = success_difference(camera.success[None], model.success[None], LEVEL, RESAMPLES)
    return [success, *(mean_difference(gap[None], LEVEL, RESAMPLES) for gap in gaps)]


def camera_differences(results: Sequence[Sequence[MeasuredOutcomes]], keep: bool) -> None:
    """Show the largest differences of cameras from their statistical models, which are the columns to their right."""
    pairs = [differences(row[k], row[k + 1]) for row in results for k in range(1, len(row), 2)]
    table = []
    for (name, (factor, digits, unit)), estimates in zip(QUANTITIES.items(), zip(*pairs, strict=True), strict=True):
        known = [estimate for estimate in estimates if np.isfinite(estimate.value)]
        clear = [estimate for estimate in known if estimate.clear]
        largest = (
            f"{max(abs(factor * estimate.value) for estimate in some):.{digits}f} {unit}" if some else "–"
            for some in (known, clear)
        )
        table.append([name, str(len(known)), next(largest), str(len(clear)), next(largest)])
    heads = ("camera minus its statistics", "compared", "largest mean difference", "significant", "largest of these")
    show("camera-policies-differences", heads, table, keep)


def main(argv: Sequence[str] | None = None) -> int:
    """Evaluate and print; return the exit code."""
    tables = load_yaml(FILE)
    arguments = parser(__doc__)
    arguments.add_argument("tables", nargs="+", metavar="TABLE", choices=list(tables), help=", ".join(tables))
    arguments.add_argument("--episodes", type=int, help="of a case, instead of the table's number")
    asked, beaten = arguments.parse_args(argv), False
    for name in asked.tables:
        table, results = tables[name], []
        heads = [
            *table["heads"],
            *table.get("columns", table.get("cells")),
            *([table["last"]] if "last" in table else []),
        ]
        body = list(lines(table, asked.episodes or table["episodes"], results))
        show(name, heads, body, asked.keep and not name.startswith(("bound", "element")))
        if name == "camera-policies":
            camera_differences(results, asked.keep)
        beaten |= name.startswith("bound") and any(line[-1] != "0" for line in body)
    return int(beaten)


if __name__ == "__main__":
    sys.exit(main())
