"""The report's page: one HTML file that needs nothing else."""

from __future__ import annotations

import base64
import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from tqdm import tqdm

from agents.evaluation import animation, cost_figure, crowd_figures, figures
from agents.evaluation.log import TURN_WEIGHT, WATCHED_AMONG, Film
from agents.evaluation.results import Results, Row, TaskFacts
from agents.evaluation.statistics import Comparison
from agents.evaluation.tables import number, plain, quantity
from vibgym.tasks.pose import HOLD_STEPS

MOST_BYTES = 14_000_000
"""Of the page; films share what is left of it."""

FIGURE_BYTES = 250_000
"""Of one plot in base64, generously: kept free when films get their shares."""

DEGREES = 180.0 / math.pi


def page(results: Results, quiet: bool = False) -> str:
    """The whole page as HTML."""
    loader = jinja2.FileSystemLoader(Path(__file__).parent)
    environment = jinja2.Environment(
        loader=loader, autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True, lstrip_blocks=True
    )
    settings = results.settings
    pairs = list(results.rollouts)
    # Base64 needs 4 bytes for 3.
    share = int(0.74 * (MOST_BYTES - FIGURE_BYTES * (len(pairs) + 5)) / len(pairs))
    cards: dict[str, list[dict[str, Any]]] = {task: [] for task in settings.tasks}
    for row in tqdm(results.rows, desc="drawing", unit="pair", disable=quiet):
        cards[row.task].append(_card(results, row, max(share, 100_000)))
    surface = results.surface
    crowds = [task for task in settings.tasks if results.scenes[task].crowd]
    singles = [task for task in settings.tasks if task not in crowds]
    return environment.get_template("report.html.j2").render(
        results=results,
        settings=settings,
        surface=surface,
        loads=_loads(results),
        singles=singles,
        crowds=crowds,
        confidence=f"{100 * settings.confidence:g} %",
        seeds=seeds_text(settings.seed_list()),
        step_time=next(iter(results.rollouts.values())).step_time,
        hold=HOLD_STEPS,
        shown=figures.SHOWN,
        mapped=crowd_figures.MAPPED,
        watched_among=WATCHED_AMONG,
        turn_weight=1e3 * TURN_WEIGHT,
        tasks=[
            {
                "facts": facts,
                "crowd": task in crowds,
                "inventory": results.scenes[task].inventory(),
                "tolerance": _tolerance(facts),
                "cards": cards[task],
                "arrivals": _data((crowd_figures if task in crowds else figures).arrivals(results, task), "png"),
            }
            for task, facts in results.tasks.items()
        ],
        comparisons=[_compared(each) for each in against_best(results)],
        examples=[_example(results, tasks) for tasks in (singles, crowds) if tasks and settings.animations],
        colours={name: figures.policy_colour(results, name) for name in results.policies},
        cost=None if results.cost is None else cost_figure.section(results.cost),
        settings_text=json.dumps(plain(settings.as_written()), indent=2),
    )


def _loads(results: Results) -> list[dict[str, Any]]:
    """Which parts the tasks have, tasks with the same ones together."""
    found: dict[tuple[str, int], list[str]] = {}
    for task, facts in results.tasks.items():
        found.setdefault((results.scenes[task].inventory(), facts.episodes), []).append(task)
    return [
        {"tasks": joined(tasks), "inventory": inventory, "episodes": episodes}
        for (inventory, episodes), tasks in found.items()
    ]


def joined(words: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _data(content: bytes, kind: str) -> str:
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def seeds_text(seeds: list[int]) -> str:
    """ "3 to 7" for consecutive seeds, or all of them."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def _tolerance(facts: TaskFacts) -> str:
    """What counts as there."""
    if facts.position_tolerance is None:
        if facts.apart is not None:
            return f"all parts more than {1e3 * facts.apart:.1f} mm apart"
        return "all parts in their zones"
    text = f"{1e3 * facts.position_tolerance:g} mm"
    if facts.heading_tolerance is not None:
        text += f" and {DEGREES * facts.heading_tolerance:.3g}°"
    return text


def _card(results: Results, row: Row, share: int) -> dict[str, Any]:
    """What the table's row and the card of one policy on one task show."""
    film, crowd = results.rollouts[row.task, row.policy].film, results.scenes[row.task].crowd
    plot = (crowd_figures if crowd else figures).trajectories(results, row.task, row.policy)
    card: dict[str, Any] = {
        "row": row,
        "success": f"{100 * row.success_rate:.1f}",
        "interval": f"{100 * row.success_low:.1f} to {100 * row.success_high:.1f}",
        "time": quantity(row.time_to_goal_median_s, 1.0, 2, "s"),
        "times": _range(row.time_to_goal_q25_s, row.time_to_goal_q75_s, 1.0),
        "position": quantity(row.position_error_median_m, 1e3, 2, "mm"),
        "positions": _range(row.position_error_q25_m, row.position_error_q75_m, 1e3),
        "heading": quantity(row.heading_error_median_rad, DEGREES, 2, "°"),
        "headings": _range(row.heading_error_q25_rad, row.heading_error_q75_rad, DEGREES),
        "efficiency": quantity(row.path_efficiency_median, 100.0, 0, "%"),
        "rate": thousands(row.steps_per_second),
        "rates": f"policy {thousands(row.policy_steps_per_second)}, "
        f"environment {thousands(row.environment_steps_per_second)}",
        "seed": film.seed,
        "outcome": _outcome(film, crowd),
        "throughput": quantity(row.throughput_median_parts_per_s, 1.0, 2, "parts/s"),
        "throughputs": _range(row.throughput_q25_parts_per_s, row.throughput_q75_parts_per_s, 1.0),
        "collisions": number(row.collisions_mean, 1),
        "clearance": _millimetres(row.clearance_median_m),
        "done": number(row.parts_done_mean, 2),
        "plot": _data(plot, "png"),
        "film": None,
    }
    if results.settings.animations:
        frames, interval = animation.frames_of(results, row.task, row.policy)
        card["film"] = _data(animation.webp(frames, interval, share), "webp")
        card["still"] = _data(animation.png(frames[-1]), "png")
        card["size"] = (frames[0].shape[1], frames[0].shape[0])
    return card


def _outcome(film: Film, crowd: bool) -> str:
    if not crowd:
        return f"the part {'reaches' if film.success else 'does not reach'} the goal"
    parts, done = int(np.isfinite(film.poses[0, :, 0]).sum()), int(film.done[-1])
    return f"all {parts} parts are done" if film.success else f"{done} of {parts} parts are done at the end"


def _millimetres(value: float) -> str:
    """With its sign: negative is an overlap."""
    return "–" if not math.isfinite(value) else f"{_signed(1e3 * value, 2).removeprefix('+')} mm"


def thousands(rate: float) -> str:
    """Steps per second in thousands or millions, or a dash if nothing was measured."""
    return quantity(rate, 1e-6, 1, "M") if rate >= 999_500 else quantity(rate, 1e-3, 0, "k")


def _range(low: float, high: float, factor: float) -> str:
    """ "1.20 – 3.40", or nothing where there is nothing to show."""
    text = number(factor * high, 2)
    return f"{number(factor * low, 2)} – {text}" if math.isfinite(high) and float(text) > 0.0 else ""


def _signed(value: float, digits: int) -> str:
    """With a typographic minus, and no sign on zero."""
    text = f"{value:+.{digits}f}"
    return text[1:] if float(text) == 0.0 else text.replace("-", "−")


def best_policy(results: Results, task: str) -> str:
    """The policy with the most successes on a task; of equal ones the fastest to the goal."""
    rows = [row for row in results.rows if row.task == task]
    return min(rows, key=lambda row: (-row.successes, np.nan_to_num(row.time_to_goal_median_s, nan=np.inf))).policy


def against_best(results: Results) -> list[Comparison]:
    """Comparisons of every task's best policy with each other one, the best one first."""
    found = []
    for each in results.comparisons:
        best = best_policy(results, each.task)
        if best == each.first:
            found.append(each)
        elif best == each.second:
            found.append(each.turned())
    return found


def _compared(each: Comparison) -> dict[str, Any]:
    low, high = 100 * each.success_interval.low, 100 * each.success_interval.high
    time = each.time_interval
    return {
        "task": each.task,
        "first": each.first,
        "second": each.second,
        "success": _signed(100 * each.success_difference, 1),
        "success_interval": f"{_signed(low, 1)} to {_signed(high, 1)}",
        "success_clear": low > 0.0 or high < 0.0,
        "both": each.both,
        "time": f"{_signed(each.time_difference, 2)} s" if each.both else "–",
        "time_interval": "" if time is None else f"{_signed(time.low, 2)} to {_signed(time.high, 2)}",
        "time_clear": time is not None and (time.low > 0.0 or time.high < 0.0),
    }


def _example(results: Results, tasks: Sequence[str]) -> str:
    """A large picture for the reading aid: of the policies that ever work, the film with the most varied field."""
    best = {(task, best_policy(results, task)) for task in tasks}
    frames: dict[tuple[str, str], int] = {}
    variety: dict[tuple[str, str], tuple[bool, float]] = {}
    for row in results.rows:
        pair = (row.task, row.policy)
        if row.task in tasks and (row.success_rate >= figures.WORTH_SHOWING or pair in best):
            film, radius = results.rollouts[pair].film, results.scenes[row.task].parts[0].radius
            # Half way there: the lines behind the parts show, and the goals are still free, if the task moves them at all.
            way = (film.poses - film.poses[0])[..., :2]
            travelled = np.nansum(np.hypot(way[..., 0], way[..., 1]), axis=1)
            frames[pair] = frame = int((travelled >= 0.5 * travelled.max()).argmax())
            moved = bool(travelled[frame] > radius)
            variety[pair] = (moved, float(film.phasors[frame].var(axis=(0, 1)).sum()))
    task, policy = max(variety, key=lambda pair: variety[pair])
    painter = animation.painter_for(results, task, 1064)
    return _data(animation.png(animation.picture(results, task, policy, frames[task, policy], painter)), "png")
