"""The study: hand-made schedules, searches, evaluation on new starts, and the page with the results."""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

import vibgym
from agents import parallel
from agents.evaluation.table import markdown
from agents.provenance import processor
from studies.sensorless.handmade import FAMILIES, PLACING, as_drawn, tuned
from studies.sensorless.play import COARSE, FINE, draw_trials, errors_of, play
from studies.sensorless.schedule import Schedule, SchedulePolicy, save_schedule
from studies.sensorless.search import SearchResult, costs, search, validation_trials
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.files import write_atomically
from vibgym.policies.rollout import Outcomes, run, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.parts import shipped_part

INTRODUCTION = Path(__file__).with_name("introduction.md")

AFTER = 1.25
"""Duration of the evaluation over the longest duration of a learned schedule."""

FRESH = 7_100_000
"""First seed of the evaluation's episodes, not used by other studies."""

NOMINAL = (1.0, 1.0)
"""Range of the factor on friction."""

HEADS = (
    "schedule", "nominal: 5 mm, 5 deg", "nominal: 2 mm, 3 deg", "varied: 5 mm, 5 deg", "varied: 2 mm, 3 deg",
    "distance: median, 95 %", "heading error: median, 95 %", "Align: success", "median time",
)  # fmt: skip


def study(settings: SensorlessSettings, config: str, output: Path) -> str:
    """Search and evaluate, write the best schedule of each part and hardware to ``output``, and return the page.

    Raises:
        ValueError: settings that the simulator does not take.
        WriteError: a file cannot be written.
    """
    began, (x, y, heading) = time.perf_counter(), settings.goal
    items = [(part, hardware, settings, output) for part in settings.parts for hardware in settings.hardware]
    sections = parallel.run(section, items, workers=settings.processes)
    minutes = (time.perf_counter() - began) / 60.0
    introduction = INTRODUCTION.read_text(encoding="utf-8").format(
        goal=f"x = {1e3 * x:g} mm, y = {1e3 * y:g} mm, heading {math.degrees(heading):g} deg",
        friction=f"multiplied by {settings.friction[0]:g} to {settings.friction[1]:g}",
        after=AFTER * settings.seconds,
        config=config,
        host=f"Host: {processor()}, {settings.processes} processes of {settings.threads} threads; "
        f"{minutes:.1f} minutes in total. vibgym {vibgym.__version__}, NumPy {np.__version__}.",
        **{name: getattr(settings, name) for name in ("segments", "starts", "model", "seconds", "evaluated")},
    )
    return "\n".join([introduction, *sections])


def section(name: str, hardware: str, settings: SensorlessSettings, output: Path) -> str:
    """Search and evaluate for a part and hardware model, write schedule and section, and return the section of the page."""
    part, surface = shipped_part(name), Surface()
    by_hand = hand_made(part, surface, settings, hardware)
    validation = validation_trials(part, surface, settings, hardware)
    values = costs(list(by_hand.values()), validation, part, surface, settings, hardware)
    best = list(by_hand)[int(values.argmin())]
    searched = {
        f"learned, seed {seed}": search(part, surface, settings, hardware, by_hand[best], seed, quiet=True)
        for seed in settings.seeds
    }
    stored = min(searched, key=lambda key: searched[key].validation)
    training = _training(searched[stored], name, hardware, settings)
    save_schedule(output / f"{name}-{hardware}.json", searched[stored].schedule, surface, training)
    seconds = AFTER * settings.seconds
    # Hand-made schedules continue with their last field until the end of the evaluation.
    schedules = {key: _extended(schedule, seconds) for key, schedule in by_hand.items()}
    schedules |= {key: result.schedule for key, result in searched.items()}
    times = [t for t in np.arange(1.5, 10.0, 0.5).tolist() if t < seconds + 0.5 * surface.period]
    lines, curves = [], []
    for key, schedule in schedules.items():
        varied = evaluate(schedule, part, surface, settings, hardware, settings.friction, seconds)
        nominal, success = ["", ""], ["", ""]
        if key == best or key in searched:
            nominal = evaluate(schedule, part, surface, settings, hardware, NOMINAL, seconds).shares()
            outcomes = episodes(schedule, name, hardware, settings.friction, settings.evaluated)
            median = np.median(outcomes.time_to_goal[outcomes.success]) if outcomes.success.any() else math.nan
            success = [percent(outcomes.success.mean()), "" if math.isnan(median) else f"{median:.2f} s"]
        title = f"**{key}** (stored)" if key == stored else key
        lines.append([title, *nominal, *varied.shares(), *varied.errors(), *success])
        curves.append([key, *(percent(varied.fine[round(t / surface.period)]) for t in times)])
    text = "\n\n".join([
        f"## {name.replace('_', ' ').capitalize()}, {hardware} hardware",
        markdown(HEADS, lines),
        "Share of parts within 2 mm and 3 deg over time, with varied friction:",
        markdown(("schedule", *(f"{t:g} s" for t in times)), curves),
        _searches(searched, best, float(values.min())) + "\n",
    ])  # fmt: skip
    write_atomically(output / f"{name}-{hardware}.md", text)
    return text


def hand_made(part: Part, surface: Surface, settings: SensorlessSettings, hardware: str) -> dict[str, Schedule]:
    """Return hand-made schedules by name."""
    tuning, schedules = draw_trials(part, surface, hardware, settings.friction, settings.starts, (3, 0)), {}
    for family in FAMILIES:
        schedules[f"{family}, as drawn"] = as_drawn(family, part, settings)
        if family in PLACING:
            schedules[f"{family}, tuned"] = tuned(family, part, surface, settings, hardware, tuning)
    return schedules


def _extended(schedule: Schedule, seconds: float) -> Schedule:
    """Return the schedule with its last field extended until ``seconds``."""
    lasts = schedule.seconds.copy()
    lasts[-1] = max(seconds - float(lasts[:-1].sum()), 0.0)
    return replace(schedule, seconds=lasts)


def _training(best: SearchResult, part: str, hardware: str, settings: SensorlessSettings) -> dict[str, Any]:
    return {
        "algorithm": "CMA-ES (cma)", "part": part, "hardware": hardware, "seed": best.seed, "seconds": round(best.seconds, 1),
        "evaluations": best.evaluations, "settings": settings.model_dump(mode="json"), "vibgym": vibgym.__version__,
    }  # fmt: skip


def _searches(searched: Mapping[str, SearchResult], best: str, begun: float) -> str:
    """Return a sentence about durations and costs of the searches."""
    results = "; ".join(
        f"seed {one.seed} {one.seconds:.0f} s, cost {one.validation:.2f}, {one.schedule.total:.2f} s long"
        for one in searched.values()
    )
    evaluations = next(iter(searched.values())).evaluations
    return f'Searches ({evaluations} schedules each, from "{best}", cost {begun:.2f}): {results}.'


class Evaluation(NamedTuple):
    """Evaluation of one schedule on one hardware model."""

    fine: np.ndarray  # (periods + 1,) share of parts within 2 mm and 3 deg (Align)
    coarse: np.ndarray  # the same within 5 mm and 5 deg
    distance: np.ndarray  # (2,) median and 95th percentile at the end, m
    heading: np.ndarray  # (2,) likewise, rad

    def shares(self) -> list[str]:
        """Return the shares within both tolerances at the end as text."""
        return [percent(self.coarse[-1]), percent(self.fine[-1])]

    def errors(self) -> list[str]:
        """Return the errors at the end as text."""
        (near, far), (little, much) = 1e3 * self.distance, np.degrees(self.heading)
        return [f"{near:.2f} mm, {far:.2f} mm", f"{little:.2f} deg, {much:.2f} deg"]


def evaluate(
    schedule: Schedule,
    part: Part,
    surface: Surface,
    settings: SensorlessSettings,
    hardware: str,
    friction: tuple[float, float],
    seconds: float,
) -> Evaluation:
    """Evaluate a schedule on new starts, the same for all, with the planar model, every period for ``seconds``."""
    trials = draw_trials(part, surface, hardware, friction, settings.evaluated, (1, 0))
    poses = play([schedule], trials, part, surface, hardware, seconds, threads=settings.threads)[:, 0]
    errors = errors_of(poses, schedule.goal, part.symmetry)
    distance, heading = (np.quantile(values[-1], [0.5, 0.95]) for values in (errors.distance, errors.heading))
    return Evaluation(errors.within(FINE).mean(1), errors.within(COARSE).mean(1), distance, heading)


def episodes(schedule: Schedule, part: str, hardware: str, friction: tuple[float, float], worlds: int) -> Outcomes:
    """Return the outcomes of episodes of Align, with the environment's starts and the goal of the schedule."""
    arguments: dict[str, Any] = {"parts": [part], "actuators": hardware, "randomize": {"friction": list(friction)}}
    env = worlds_of("Align", worlds, action=SchedulePolicy.action, observation=SchedulePolicy.observation, **arguments)
    policy = SchedulePolicy(TaskInfo.of(env), schedule)
    runs = run(policy, env, range(FRESH, FRESH + worlds), "Align", options={"goal": schedule.goal})
    env.close()
    return runs


def percent(share: float) -> str:
    """Return a share in percent."""
    return f"{100.0 * share:.1f} %"
