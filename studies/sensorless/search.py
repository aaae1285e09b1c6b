"""Search for schedules by CMA-ES (library ``cma``; Hansen, "The CMA evolution strategy: a tutorial", 2016)."""

from __future__ import annotations

import math
import time
from typing import Any, NamedTuple

import cma
import numpy as np
from tqdm import tqdm

from studies.sensorless.play import Trials, cost, draw_trials, errors_of, play
from studies.sensorless.schedule import MAX, MIN_REACH, Schedule
from studies.sensorless.settings import SensorlessSettings
from vibgym import Part, Surface
from vibgym.fields import DEFAULT_REACH

CENTRE_UNITS = (0.05, 0.025)  # m along x and y per unit of the search
ANGLE_UNIT = 0.5  # rad
MAX_LOG = 5.0  # largest change of the logarithms of reach and duration
VALIDATION = 8  # starts of the validation over those of a schedule in the search
NUMBERS = 8  # parameters of a segment: those of its field, and its duration


class SearchResult(NamedTuple):
    """Result of a search."""

    schedule: Schedule
    seed: int
    validation: float  # cost on separate starts
    history: np.ndarray  # (generations,) lowest cost
    seconds: float  # wall time
    evaluations: int  # number of simulated schedules


REST = 0.5
"""s, simulated after the end of a schedule: parts turn by about a degree while they come to rest."""


def decoded(numbers: np.ndarray, goal: np.ndarray, seconds: float, friction: float, step: float) -> Schedule:
    """Return the schedule of a point (segments * 8,) of the search; at 0 all segments have the same duration.

    If the durations exceed ``seconds`` in total, they are scaled down. Every end is a multiple of ``step`` (s).
    """
    rows = np.asarray(numbers, dtype=np.float64).reshape(-1, NUMBERS)
    fields = np.empty((len(rows), NUMBERS - 1))
    fields[:, :2] = np.clip(goal[:2] + rows[:, :2] * CENTRE_UNITS, -100.0, 100.0)
    fields[:, 2] = np.clip(goal[2] + ANGLE_UNIT * rows[:, 2], -100.0, 100.0)
    fields[:, 3:6] = np.clip(rows[:, 3:6], -100.0, 100.0)
    fields[:, 6] = np.clip(DEFAULT_REACH * _factor(rows[:, 6]), MIN_REACH, MAX)
    lasts = seconds / len(rows) * _factor(rows[:, 7])
    ends = np.round(np.cumsum(lasts) * min(seconds / lasts.sum(), 1.0) / step)
    return Schedule(fields, step * np.diff(ends, prepend=0.0), goal, friction)


def encoded(schedule: Schedule, segments: int, seconds: float) -> np.ndarray:
    """Return the point (segments * 8,) of ``schedule``; the longest segments are halved until there are ``segments``."""
    fields, lasts = list(schedule.fields), list(schedule.seconds)
    while len(lasts) < segments:
        k = int(np.argmax(lasts))
        lasts[k] /= 2.0
        fields.insert(k, fields[k])
        lasts.insert(k, lasts[k])
    rows = np.empty((segments, NUMBERS))
    values = np.array(fields)
    rows[:, :2] = (values[:, :2] - schedule.goal[:2]) / CENTRE_UNITS
    rows[:, 2] = (values[:, 2] - schedule.goal[2]) / ANGLE_UNIT
    rows[:, 3:6] = values[:, 3:6]
    rows[:, 6] = 2.0 * np.log(values[:, 6] / DEFAULT_REACH)
    rows[:, 7] = 2.0 * np.log(np.array(lasts) / (seconds / segments))
    return rows.ravel()


def _factor(numbers: np.ndarray) -> np.ndarray:
    return np.exp(np.clip(0.5 * numbers, -MAX_LOG, MAX_LOG))


def costs(
    schedules: list[Schedule], trials: Trials, part: Part, surface: Surface, settings: SensorlessSettings, hardware: str
) -> np.ndarray:
    """Return the costs (schedules,), see :func:`studies.sensorless.play.cost`."""
    poses = play(
        schedules, trials, part, surface, hardware, settings.seconds + REST, settings.model, settings.periods,
        settings.threads,
    )  # fmt: skip
    return cost(errors_of(poses, schedules[0].goal, part.symmetry))


def validation_trials(part: Part, surface: Surface, settings: SensorlessSettings, hardware: str) -> Trials:
    """Draw the starts for selecting a schedule, separate from those of search and evaluation."""
    return draw_trials(part, surface, hardware, settings.friction, VALIDATION * settings.starts, (2, 0))


def search(
    part: Part,
    surface: Surface,
    settings: SensorlessSettings,
    hardware: str,
    first: Schedule,
    seed: int,
    quiet: bool = False,
) -> SearchResult:
    """Search for a schedule, starting at ``first``.

    All schedules of a generation have the same trials; every generation has new ones. The result is the mean of the last
    generation's distribution.

    Raises:
        ValueError: settings that the simulator does not take.
    """
    goal, random, began = np.array(settings.goal), np.random.default_rng([seed, 1]), time.perf_counter()

    def schedule_of(numbers: Any) -> Schedule:
        return decoded(numbers, goal, settings.seconds, part.friction, settings.periods * surface.period)

    point = encoded(first, settings.segments, settings.seconds)
    options = {
        "popsize": settings.population,
        "randn": lambda *shape: random.standard_normal(shape),
        "seed": math.nan,  # no seed: all random numbers are those of the generator above
        "verbose": -9,
    }
    strategy = cma.CMAEvolutionStrategy(point.tolist(), settings.sigma, options)
    history = []
    for generation in tqdm(range(settings.generations), desc=f"{part.name}, {hardware}, seed {seed}", disable=quiet):
        points = strategy.ask()
        trials = draw_trials(part, surface, hardware, settings.friction, settings.starts, (0, seed, generation))
        values = costs([schedule_of(point) for point in points], trials, part, surface, settings, hardware)
        strategy.tell(points, values.tolist())
        history.append(values.min())
    best = schedule_of(strategy.result.xfavorite)
    validation = costs([best], validation_trials(part, surface, settings, hardware), part, surface, settings, hardware)
    duration, evaluations = time.perf_counter() - began, settings.generations * settings.population
    return SearchResult(best, seed, float(validation[0]), np.array(history), duration, evaluations)
