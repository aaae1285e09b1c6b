"""The study: hand-made schedules, searches, evaluation on new starts, page."""

from __future__ import annotations

import contextlib
import time
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import vibgym
from agents.provenance import processor
from studies.sensorless.handmade import FAMILIES, PLACING, as_drawn, tuned
from studies.sensorless.page import AFTER, Case, Entry, Evaluation, section, text
from studies.sensorless.play import COARSE, FINE, draw_trials, errors_of, play
from studies.sensorless.schedule import Schedule, SchedulePolicy, save_schedule
from studies.sensorless.search import SearchResult, costs, search, validation_trials
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.files import write_atomically
from vibgym.policies.rollout import run, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.parts import shipped_part

FRESH = 7_100_000
"""First seed of the evaluation's episodes, not used by other studies."""

NOMINAL = (1.0, 1.0)


def study(settings: SensorlessSettings, config: str, output: Path, quiet: bool = False) -> str:
    """Search and evaluate, write the best schedule of each part and hardware to ``output``, and return the page.

    Raises:
        ValueError: settings that the simulator does not take.
        WriteError: a file cannot be written.
    """
    surface, began = Surface(), time.perf_counter()
    combinations = [(part, hardware) for part in settings.parts for hardware in settings.hardware]
    task = partial(_case, surface=surface, settings=settings, output=output)
    with contextlib.ExitStack() as held:
        run_all = map
        if settings.processes > 1:
            pool = ProcessPoolExecutor(settings.processes, mp_context=get_context("spawn"))
            run_all = held.enter_context(pool).map
        cases = list(tqdm(run_all(task, *zip(*combinations)), total=len(combinations), unit="case", disable=quiet))
    minutes = (time.perf_counter() - began) / 60.0
    host = (
        f"Host: {processor()}, {settings.processes} processes of {settings.threads} threads; "
        f"{minutes:.1f} minutes in total. vibgym {vibgym.__version__}, NumPy {np.__version__}."
    )
    return text(cases, settings, surface, config, host)


def _case(name: str, hardware: str, surface: Surface, settings: SensorlessSettings, output: Path) -> Case:
    part = shipped_part(name)
    tuning = draw_trials(part, surface, hardware, settings.friction, settings.starts, (3, 0))
    by_hand: dict[str, Schedule] = {}
    for family in FAMILIES:
        by_hand[f"{family}, as drawn"] = as_drawn(family, part, settings)
        if family in PLACING:
            by_hand[f"{family}, tuned"] = tuned(family, part, surface, settings, hardware, tuning)
    validation = validation_trials(part, surface, settings, hardware)
    values = costs(list(by_hand.values()), validation, part, surface, settings, hardware)
    best = list(by_hand)[int(values.argmin())]
    found = {
        f"learned, seed {seed}": search(part, surface, settings, hardware, by_hand[best], seed, quiet=True)
        for seed in settings.seeds
    }
    stored = min(found, key=lambda each: found[each].validation)
    training = _training(found[stored], name, hardware, settings)
    save_schedule(output / f"{name}-{hardware}.json", found[stored].schedule, surface, training)
    schedules = {**by_hand, **{each: one.schedule for each, one in found.items()}}
    # Hand-made schedules continue with their last field until the end of the evaluation.
    seconds = AFTER * settings.seconds
    extended = {key: _extended(each, seconds) if key in by_hand else each for key, each in schedules.items()}
    varied = evaluate(list(extended.values()), part, surface, settings, hardware, settings.friction, seconds)
    chosen = [best, *found]
    at_nominal = evaluate([extended[key] for key in chosen], part, surface, settings, hardware, NOMINAL, seconds)
    nominal = dict(zip(chosen, at_nominal, strict=True))
    entries = []
    for key, evaluation in zip(schedules, varied, strict=True):
        success, median = None, float("nan")
        if key in chosen:
            ends, median = episodes(extended[key], name, hardware, settings.friction, settings.evaluated)
            success = float(ends.mean())
        entries.append(Entry(key, schedules[key], nominal.get(key), evaluation, success, median))
    case = Case(name, hardware, entries, stored, _searches(found, best, float(values.min())))
    write_atomically(output / f"{name}-{hardware}.md", section(case, surface))
    return case


def _extended(schedule: Schedule, seconds: float) -> Schedule:
    """Return the schedule with its last field extended until ``seconds``."""
    lasts = schedule.seconds.copy()
    lasts[-1] = max(seconds - float(lasts[:-1].sum()), 0.0)
    return replace(schedule, seconds=lasts)


def _training(found: SearchResult, part: str, hardware: str, settings: SensorlessSettings) -> dict[str, Any]:
    return {
        "algorithm": "CMA-ES (cma)", "part": part, "hardware": hardware, "seed": found.seed, "seconds": round(found.seconds, 1),
        "evaluations": found.evaluations, "settings": settings.model_dump(mode="json"), "vibgym": vibgym.__version__,
    }  # fmt: skip


def _searches(found: dict[str, SearchResult], best: str, begun: float) -> str:
    """Return a sentence about durations and costs of the searches."""
    each = "; ".join(
        f"seed {one.seed} {one.seconds:.0f} s, cost {one.validation:.2f}, {one.schedule.total:.2f} s long"
        for one in found.values()
    )
    evaluations = next(iter(found.values())).evaluations
    return f'Searches ({evaluations} schedules each, from "{best}", cost {begun:.2f}): {each}.'


def evaluate(
    schedules: list[Schedule],
    part: Part,
    surface: Surface,
    settings: SensorlessSettings,
    hardware: str,
    friction: tuple[float, float],
    seconds: float,
) -> list[Evaluation]:
    """Evaluate schedules on the same new starts with the planar model, every period for ``seconds``."""
    trials = draw_trials(part, surface, hardware, friction, settings.evaluated, (1, 0))
    found = []
    for schedule in schedules:
        poses = play([schedule], trials, part, surface, hardware, seconds, threads=settings.threads)[:, 0]
        errors = errors_of(poses, schedule.goal, part.symmetry)
        ends = (errors.distance[-1], errors.heading[-1])
        distance, heading = (np.quantile(each, [0.5, 0.95]) for each in ends)
        found.append(Evaluation(errors.within(FINE).mean(1), errors.within(COARSE).mean(1), distance, heading))
    return found


def episodes(
    schedule: Schedule, part: str, hardware: str, friction: tuple[float, float], worlds: int, first: int = FRESH
) -> tuple[np.ndarray, float]:
    """Return success (worlds,) bool in episodes of Align, and the median time to success, s (nan without success).

    Starts are those of the environment with seeds from ``first`` on; the goal is that of the schedule.
    """
    arguments: dict[str, Any] = {"parts": [part], "actuators": hardware, "randomize": {"friction": list(friction)}}
    env = worlds_of("Align", worlds, action=SchedulePolicy.action, observation=SchedulePolicy.observation, **arguments)
    policy = SchedulePolicy(TaskInfo.of(env), schedule)
    found = run(policy, env, range(first, first + worlds), "Align", options={"goal": schedule.goal})
    env.close()
    return found.success, float(np.median(found.time_to_goal[found.success])) if found.success.any() else float("nan")
