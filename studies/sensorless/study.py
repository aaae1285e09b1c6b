"""The whole study: hand-made schedules, searches, evaluation from fresh starts, page."""

from __future__ import annotations

import contextlib
import time
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from multiprocessing import get_context
from pathlib import Path
from typing import Any

import numpy as np
from tqdm import tqdm

import vibgym
from agents.provenance import processor
from studies.sensorless.handmade import FAMILIES, PLACING, plain, tuned
from studies.sensorless.page import AFTER, Case, Entry, Judgement, section, text
from studies.sensorless.play import COARSE, FINE, draw_trials, errors_of, play
from studies.sensorless.search import Found, costs, search, validation_trials
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.files import write_atomically
from vibgym.policies.rollout import run, worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.schedule import Schedule, SchedulePolicy, save_schedule
from vibgym.scene.parts import shipped_part

FRESH = 7_100_000
"""First seed of the evaluation's episodes; no other study uses them."""

NOMINAL = (1.0, 1.0)


def study(settings: SensorlessSettings, config: str, output: Path, quiet: bool = False) -> str:
    """Search and evaluate, write the best schedule of each part and hardware to ``output``, and return the page.

    Raises:
        ValueError: settings that the simulator does not take.
        WriteError: a file cannot be written.
    """
    surface, began = Surface(), time.perf_counter()
    given = [(part, hardware) for part in settings.parts for hardware in settings.hardware]
    task = partial(_case, surface=surface, settings=settings, output=output)
    with contextlib.ExitStack() as held:
        several = map
        if settings.processes > 1:
            pool = ProcessPoolExecutor(settings.processes, mp_context=get_context("spawn"))
            several = held.enter_context(pool).map
        cases = list(tqdm(several(task, *zip(*given)), total=len(given), unit="case", disable=quiet))
    lasted = (time.perf_counter() - began) / 60.0
    machine = (
        f"Machine: {processor()}, {settings.processes} processes of {settings.threads} threads; "
        f"{lasted:.1f} minutes for everything. vibgym {vibgym.__version__}, NumPy {np.__version__}."
    )
    return text(cases, settings, surface, config, machine)


def _case(name: str, hardware: str, surface: Surface, settings: SensorlessSettings, output: Path) -> Case:
    part = shipped_part(name)
    tuning = draw_trials(part, surface, hardware, settings.friction_range, settings.starts, (3, 0))
    by_hand: dict[str, Schedule] = {}
    for family in FAMILIES:
        by_hand[f"{family}, as drawn"] = plain(family, part, settings)
        if family in PLACING:
            by_hand[f"{family}, tuned"] = tuned(family, part, surface, settings, hardware, tuning)
    validation = validation_trials(part, surface, settings, hardware)
    values = costs(list(by_hand.values()), validation, part, surface, settings, hardware)
    best = list(by_hand)[int(values.argmin())]
    found = {
        f"learned, seed {seed}": search(part, surface, settings, hardware, by_hand[best], seed, quiet=True)
        for seed in settings.seeds
    }
    shipped = min(found, key=lambda each: found[each].validation)
    training = _training(found[shipped], name, hardware, settings)
    save_schedule(output / f"{name}-{hardware}.json", found[shipped].schedule, surface, training)
    schedules = {**by_hand, **{each: one.schedule for each, one in found.items()}}
    # By hand the last field goes on; what the searches found has ended by then.
    seconds = AFTER * settings.seconds
    lasting = {key: _lasting(each, seconds) if key in by_hand else each for key, each in schedules.items()}
    varied = judge(list(lasting.values()), part, surface, settings, hardware, settings.friction_range, seconds)
    chosen = [best, *found]
    plainly = judge([lasting[key] for key in chosen], part, surface, settings, hardware, NOMINAL, seconds)
    nominal = dict(zip(chosen, plainly, strict=True))
    entries = []
    for key, judged in zip(schedules, varied, strict=True):
        success, median = None, float("nan")
        if key in chosen:
            ends, median = episodes(lasting[key], name, hardware, settings.friction_range, settings.judged)
            success = float(ends.mean())
        entries.append(Entry(key, schedules[key], nominal.get(key), judged, success, median))
    case = Case(name, hardware, entries, shipped, _searches(found, best, float(values.min())))
    write_atomically(output / f"{name}-{hardware}.md", section(case, surface))
    return case


def _lasting(schedule: Schedule, seconds: float) -> Schedule:
    """Return the schedule with a last field that acts until ``seconds``."""
    lasts = schedule.seconds.copy()
    lasts[-1] = max(seconds - float(lasts[:-1].sum()), 0.0)
    return Schedule(schedule.fields, lasts, schedule.goal, schedule.friction)


def _training(found: Found, part: str, hardware: str, settings: SensorlessSettings) -> dict[str, Any]:
    return {
        "algorithm": "CMA-ES (cma)", "part": part, "hardware": hardware, "seed": found.seed, "seconds": round(found.seconds, 1),
        "evaluations": found.evaluations, "settings": settings.model_dump(mode="json"), "vibgym": vibgym.__version__,
    }  # fmt: skip


def _searches(found: dict[str, Found], best: str, begun: float) -> str:
    """Return a sentence on the searches."""
    each = "; ".join(
        f"seed {one.seed} {one.seconds:.0f} s, cost {one.validation:.2f}, {one.schedule.total:.2f} s long"
        for one in found.values()
    )
    evaluations = next(iter(found.values())).evaluations
    return f'Searches ({evaluations} schedules each, from "{best}", cost {begun:.2f}): {each}.'


def judge(
    schedules: list[Schedule],
    part: Part,
    surface: Surface,
    settings: SensorlessSettings,
    hardware: str,
    friction: tuple[float, float],
    seconds: float,
) -> list[Judgement]:
    """Evaluate all schedules from the same fresh starts, on the planar model, period by period, for ``seconds``."""
    trials = draw_trials(part, surface, hardware, friction, settings.judged, (1, 0))
    found = []
    for schedule in schedules:
        poses = play([schedule], trials, part, surface, hardware, seconds, threads=settings.threads)[:, 0]
        errors = errors_of(poses, schedule.goal, part.symmetry)
        ends = (errors.distance[-1], errors.turn[-1])
        distance, turn = (np.quantile(each, [0.5, 0.95]) for each in ends)
        found.append(Judgement(errors.within(FINE).mean(1), errors.within(COARSE).mean(1), distance, turn))
    return found


def episodes(
    schedule: Schedule, part: str, hardware: str, friction: tuple[float, float], worlds: int, first: int = FRESH
) -> tuple[np.ndarray, float]:
    """Return success (worlds,) bool in episodes of Align, and the median time of the successes, s (nan: none).

    Starts are the environment's, from seeds ``first`` on; the goal is the schedule's.
    """
    arguments: dict[str, Any] = {"parts": [part], "actuators": hardware, "randomize": {"friction": list(friction)}}
    env = worlds_of("Align", worlds, action=SchedulePolicy.action, observation=SchedulePolicy.observation, **arguments)
    policy = SchedulePolicy(TaskInfo.of(env), schedule)
    found = run(policy, env, range(first, first + worlds), "Align", options={"goal": schedule.goal})
    env.close()
    return found.success, float(np.median(found.time_to_goal[found.success])) if found.success.any() else float("nan")
