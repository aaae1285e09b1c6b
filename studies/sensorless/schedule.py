"""Sensorless schedules: sequences of fields of the whole surface that bring one part from any start pose to a goal.

Programmable force fields can bring a part of unknown pose to a known one without a sensor (Boehringer, Donald, MacDonald,
"Programmable force fields for distributed manipulation", 1999; Kavraki 1997 for one elliptic field): each field of a sequence
leaves fewer poses possible, up to the part's symmetry. The thesis (sections 4.2, 7.2.2) tried one squeeze field. Here every
field is two squeezes at right angles and a swirl about one centre; :mod:`.search` finds the values.

The policy depends on time only. The goal is part of the schedule: ``reset(options={"goal": schedule.goal})``.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.config import json_values, load_yaml
from vibgym.fields import squeeze, tangential
from vibgym.files import write_atomically
from vibgym.policies.classical.measured import check_state, recall
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.surface import Surface

COLUMNS = ("x", "y", "angle", "towards", "along", "swirl", "reach")
"""Of a field: centre (m); direction of the first squeeze line (rad from +x); strength of the push towards it, and of the push
along it towards the centre; strength of the swirl about the centre, counter-clockwise (1: full amplitude); distance at
which all three are at full strength (m)."""

MIN_REACH, MAX = 1e-4, 1e3
"""m, least reach; largest magnitude of any value of a field and of a goal."""


@dataclass(frozen=True, eq=False)
class Schedule:
    """Fields in time; after the last one all elements rest.

    Args:
        fields: (segments, 7), see :data:`COLUMNS`.
        seconds: (segments,) duration of each field, s.
        goal: (3,) final pose of the part, m, m, rad.
        friction: of the part, which determines the direction of a push (:func:`vibgym.fields.lead_angle`).

    Raises:
        ValueError: a wrong shape, or values out of range.
    """

    fields: np.ndarray
    seconds: np.ndarray
    goal: np.ndarray
    friction: float

    def __post_init__(self) -> None:
        segments = np.size(self.seconds)
        if np.shape(self.seconds) != (segments,) or not segments:
            raise checks.refuse("seconds", self.seconds, "one number for each segment")
        if np.shape(self.fields) != (segments, len(COLUMNS)):
            raise checks.refuse("fields", f"shape {np.shape(self.fields)}", f"shape {(segments, len(COLUMNS))}")
        fields = np.array(checks.array("fields", self.fields, (segments, len(COLUMNS)), least=-MAX, most=MAX))
        checks.array("fields: reach", fields[:, 6], (segments,), least=MIN_REACH)
        seconds = np.array(checks.array("seconds", self.seconds, (segments,), least=0.0))
        goal = np.array(checks.array("goal", self.goal, (3,), least=-MAX, most=MAX))
        for name, value in (("fields", fields), ("seconds", seconds), ("goal", goal)):
            value.setflags(write=False)
            object.__setattr__(self, name, value)  # the class is frozen
        object.__setattr__(self, "friction", checks.number("friction", self.friction, least=0.0, most=MAX))

    @property
    def total(self) -> float:
        """Duration of all fields, s."""
        return float(self.seconds.sum())

    def phasors(self, surface: Surface) -> np.ndarray:
        """Return the phasors (segments + 1, rows, columns, 2) of the fields, and of the rest after them."""
        phasors = np.zeros((len(self.seconds) + 1, surface.rows, surface.columns, 2))
        for k, (x, y, angle, towards, along, swirl, reach) in enumerate(self.fields.tolist()):
            field = squeeze(x, y, angle, towards, reach) + squeeze(x, y, angle + math.pi / 2.0, along, reach)
            field = field + tangential(x, y, swirl, reach)
            phasors[k] = field.phasors(surface, friction=self.friction)
        return phasors

    def shares(self, time: np.ndarray, step: float) -> np.ndarray:
        """Return the share (batch, segments + 1) of each segment and of the rest in ``step`` s from ``time`` (batch,) s."""
        ends = np.append(np.cumsum(self.seconds), math.inf)
        begins = np.append(0.0, ends[:-1])
        now = np.asarray(time, dtype=np.float64)[:, None]
        shares = np.clip(np.minimum(ends, now + step) - np.maximum(begins, now), 0.0, None) / step
        return np.round(shares, 9)  # 1 for a whole step at any time


class Clock(NamedTuple):
    """State of the policy."""

    time: np.ndarray  # (batch,) s since the episode's start


class SchedulePolicy:
    """Open-loop policy that plays a schedule as ``"phasor"`` actions; of the observation it uses only the shape.

    A segment that ends within a step shares it with the next one.

    Args:
        info: task, scene and step time.
        schedule: fields in time.

    Raises:
        ValueError: a task for several parts, or without a fixed goal pose.
    """

    action, observation = "phasor", "state"

    def __init__(self, info: TaskInfo, schedule: Schedule) -> None:
        if not info.has_goal or info.goal_moves or len(info.parts) != 1:
            raise info.unsupported("schedule", "a task for one part with a fixed goal pose")
        self.info, self.schedule = info, schedule
        self._phasors = schedule.phasors(info.surface).reshape(len(schedule.seconds) + 1, -1)

    def initial(self, batch: int) -> Clock:
        """Return the state at the start."""
        return Clock(np.zeros(batch))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return phasors of all elements for one observation or a batch; the state is a :class:`Clock`."""
        values = check_state(observation, self.info.layout)
        batch = 1 if values.ndim == 1 else len(values)
        clock, _ = recall(state, episode_start, self.initial(batch), batch)
        shares = self.schedule.shares(clock.time, self.info.step_time)
        # Not a matrix product: a world's sum must not depend on the number of worlds.
        action = np.zeros((batch, self._phasors.shape[1]))
        for k in range(shares.shape[1]):
            action += shares[:, k, None] * self._phasors[k]
        action = action.astype(np.float32)
        return (action[0] if values.ndim == 1 else action), Clock(clock.time + self.info.step_time)


def save_schedule(path: Path, schedule: Schedule, surface: Surface, training: Mapping[str, Any]) -> None:
    """Write a schedule for :func:`load_schedule` as JSON, with a record of how it was found."""
    content = {**asdict(schedule), "surface": surface, "training": dict(training)}
    write_atomically(path, json.dumps(json_values(content), indent=1) + "\n")


def read_schedule(path: Path) -> tuple[Schedule, dict[str, Any]]:
    """Return a schedule and its file's content.

    Raises:
        ValueError: the file is missing, damaged, or contains no schedule.
    """
    content = load_yaml(path)
    with checks.within(path):
        return Schedule(*map(content.get, ("fields", "seconds", "goal", "friction"))), content  # type: ignore[arg-type]


def load_schedule(path: Path, info: TaskInfo) -> SchedulePolicy:
    """Load a schedule and check that it fits.

    Raises:
        ValueError: see :func:`read_schedule`, or another task or surface.
    """
    schedule, content = read_schedule(path)
    if content.get("surface") != asdict(info.surface):
        raise checks.refuse(f"{path}: surface", content.get("surface"), f"a schedule for {asdict(info.surface)}")
    return SchedulePolicy(info, schedule)
