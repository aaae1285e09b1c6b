"""What the sheet says is measured here: a few dozens of episodes of the tasks for one part."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from agents.evaluation import animation
from agents.evaluation.datasheet.limits import Limits, limits_of
from agents.evaluation.datasheet.settings import DatasheetSettings
from agents.evaluation.jobs import Job, told
from agents.evaluation.log import Log, Rollout
from agents.provenance import provenance
from vibgym import checks
from vibgym.envs.viewer import scenery_of
from vibgym.policies.rollout import worlds_of
from vibgym.policies.task_info import TaskInfo

RESTING = 25
"""Periods at the end of an episode over which a part at its goal is watched."""


@dataclass(frozen=True)
class Sheet:
    """All of it. Arrays are (episodes,), nan where an episode says nothing."""

    settings: DatasheetSettings
    info: TaskInfo  # of Align on this surface with this part
    limits: Limits
    speed: np.ndarray  # m/s, way over time from rest to rest
    seconds: np.ndarray  # s, of Transport
    turn_speed: np.ndarray | None  # rad/s, turn over time from rest to rest; None for discs
    position: np.ndarray  # m, mean error at rest
    heading: np.ndarray | None  # rad, likewise
    reached: dict[str, tuple[TaskInfo, int]]  # task -> what it asks for, and episodes that succeeded
    lost: int  # parts that fell off the surface, in all episodes
    picture: bytes  # PNG of the part on its way
    provenance: dict[str, Any]


def measure(settings: DatasheetSettings, quiet: bool = False) -> Sheet:
    """Everything of a sheet.

    Raises:
        ValueError: a surface, part, hardware or policy that does not work; the first fault, in one line.
    """
    environment = settings.environment
    info = told("Align", environment, "datasheet")
    part = info.parts[0]
    with checks.within("datasheet"):
        limits = limits_of(info.surface, part, info.hardware, (info.position_tolerance, info.heading_tolerance))
    turns = part.symmetry != 0
    jobs = {"Transport": environment, "Align": environment, "rest": _resting(environment, info)}
    found = {name: _job(settings, name, each) for name, each in jobs.items()}
    if turns:
        found["Rotate"] = _job(settings, "Rotate", environment)
    played = {name: job.play(Log, name, quiet) for name, job in found.items()}
    moved, rest = played["Transport"], played["rest"]
    way = np.hypot(*np.moveaxis(moved.goals[:, 0, :2] - moved.poses[:, 0, 0, :2], -1, 0))
    return Sheet(
        settings=settings,
        info=info,
        limits=limits,
        speed=way / moved.time_to_goal,
        seconds=moved.time_to_goal,
        turn_speed=_turn_speed(played["Rotate"]) if turns else None,
        position=_at_rest(rest, "position_error"),
        heading=_at_rest(rest, "heading_error") if turns else None,
        reached={name: (found[name].info, int(each.success.sum())) for name, each in played.items() if name != "rest"},
        lost=sum(int(each.fallen.sum()) for each in played.values()),
        picture=_picture(played["Align"], environment),
        provenance=provenance(),
    )


def _resting(environment: dict[str, Any], info: TaskInfo) -> dict[str, Any]:
    """An episode is a success after all of its periods at the goal: so none ends before, and the part is seen at rest."""
    assert info.step_limit is not None  # Align has one
    return {**environment, "task_settings": {"hold": info.step_limit * info.periods_per_step}}


def _job(settings: DatasheetSettings, name: str, environment: dict[str, Any]) -> Job:
    """A task's episodes; "rest" is Align that does not end."""
    task = "Align" if name == "rest" else name
    with checks.within(f"datasheet ({task})"):
        info = told(task, environment, "environment")
        return Job(task, info, settings.seeds, environment, settings.policy, None).made()


def _turn_speed(rollout: Rollout) -> np.ndarray:
    """rad/s; goals of Rotate are not wrapped."""
    return np.abs(rollout.goals[:, 0, 2] - rollout.poses[:, 0, 0, 2]) / rollout.time_to_goal


def _at_rest(rollout: Rollout, name: str) -> np.ndarray:
    """Mean error over the last periods; nan where the part was lost."""
    values = rollout.over_time(name)
    assert values is not None  # Align tells both
    return np.where(rollout.fallen, np.nan, np.abs(values[:, -RESTING:]).mean(axis=1))


def _picture(rollout: Rollout, environment: dict[str, Any]) -> bytes:
    """The part half way to its goal."""
    env = worlds_of("Align", 1, **environment)
    scenery = scenery_of(env.unwrapped)  # type: ignore[arg-type]
    env.close()
    film = rollout.film
    left = np.hypot(*np.moveaxis(film.poses[:, 0, :2] - film.goals[:, 0, :2], -1, 0))
    frame = int((left <= 0.5 * left[0]).argmax())
    return animation.png(animation.picture(film, scenery, frame, animation.painter_for(scenery, 1064)), 64)
