"""Schedules by CMA-ES (library ``cma``; Hansen, "The CMA evolution strategy: a tutorial", 2016)."""

from __future__ import annotations

import math
import time
from dataclasses import dataclass
from typing import Any

import cma
import numpy as np
from tqdm import tqdm

from agents.learned.schedule import LEAST_REACH, MOST_REACH, Schedule
from agents.learned.sensorless.errors import cost, errors_of
from agents.learned.sensorless.play import Trials, draw_trials, play
from agents.learned.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.fields import DEFAULT_REACH

PLACES = (0.05, 0.025)  # m, what 1 in the search's units is along x and y
TURN = 0.5  # rad
MOST_LOG = 5.0  # of reach and duration, from where the search begins
NUMBERS = 8  # of a segment: its field's, and its duration

FIRST = (0.0, 0.0, 0.0, 1.0, 0.5, 0.0, 0.0, 0.0)
"""Where the search begins, for every segment: two squeezes at the goal, the one that aligns twice as strong."""


@dataclass(frozen=True, eq=False)
class Found:
    """What a search found."""

    schedule: Schedule
    seed: int
    validation: float  # cost from starts that the search has not seen
    history: np.ndarray  # (generations,) least cost
    seconds: float  # wall time
    evaluations: int  # schedules that were played


def decoded(numbers: np.ndarray, goal: np.ndarray, seconds: float, friction: float) -> Schedule:
    """The schedule of a point (segments * 8,) of the search; its segments begin as equal shares of ``seconds``.

    Durations that together exceed ``seconds`` are cut short in proportion.
    """
    rows = np.asarray(numbers, dtype=np.float64).reshape(-1, NUMBERS)
    fields = np.empty((len(rows), NUMBERS - 1))
    fields[:, :2] = np.clip(goal[:2] + rows[:, :2] * PLACES, -100.0, 100.0)
    fields[:, 2] = np.clip(goal[2] + TURN * rows[:, 2], -100.0, 100.0)
    fields[:, 3:6] = np.clip(rows[:, 3:6], -100.0, 100.0)
    fields[:, 6] = np.clip(DEFAULT_REACH * _factor(rows[:, 6]), LEAST_REACH, MOST_REACH)
    lasts = seconds / len(rows) * _factor(rows[:, 7])
    return Schedule(fields, lasts * min(seconds / lasts.sum(), 1.0), goal, friction)


def _factor(numbers: np.ndarray) -> np.ndarray:
    return np.exp(np.clip(0.5 * numbers, -MOST_LOG, MOST_LOG))


def costs(schedules: list[Schedule], trials: Trials, part: Part, surface: Surface, settings: Any) -> np.ndarray:
    """Cost (schedules,) of each from these starts, see :func:`agents.learned.sensorless.errors.cost`."""
    poses = play(schedules, trials, part, surface, settings.hardware, settings.seconds, settings.model, settings.threads)
    return cost(errors_of(poses, schedules[0].goal, part.symmetry))


def validation_trials(part: Part, surface: Surface, settings: SensorlessSettings) -> Trials:
    """Starts by which schedules are chosen: neither those of a search nor those of the judgement."""
    return draw_trials(part, surface, settings.hardware, settings.friction_range, 4 * settings.starts, (2, 0))


def search(part: Part, surface: Surface, settings: SensorlessSettings, seed: int, quiet: bool = False) -> Found:
    """Search for a schedule.

    All schedules of a generation face the same starts, machines and friction, every generation fresh ones. What is returned
    is the centre of the last generation's distribution.

    Raises:
        ValueError: settings that the simulator does not take.
    """
    goal, random, began = np.array(settings.goal), np.random.default_rng([seed, 1]), time.perf_counter()

    def schedule_of(numbers: Any) -> Schedule:
        return decoded(numbers, goal, settings.seconds, part.friction)

    first = np.tile(FIRST, settings.segments)
    options = {
        "popsize": settings.population,
        "randn": lambda *shape: random.standard_normal(shape),
        "seed": math.nan,  # the generator above is all the randomness that there is
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(first.tolist(), settings.sigma, options)
    history = []
    for generation in tqdm(range(settings.generations), desc=f"{part.name}, seed {seed}", disable=quiet):
        points = strategy.ask()
        trials = draw_trials(
            part, surface, settings.hardware, settings.friction_range, settings.starts, (0, seed, generation)
        )
        values = costs([schedule_of(point) for point in points], trials, part, surface, settings)
        strategy.tell(points, values.tolist())
        history.append(values.min())
    found = schedule_of(strategy.result.xfavorite)
    validation = costs([found], validation_trials(part, surface, settings), part, surface, settings)
    lasted, played = time.perf_counter() - began, settings.generations * settings.population
    return Found(found, seed, float(validation[0]), np.array(history), lasted, played)
