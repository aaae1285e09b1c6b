"""What a task asks for and of which parts, in words."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from vibgym.policies.task_info import TaskInfo
from vibgym.scene import Part

NUMBER_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def joined(words: Sequence[str]) -> str:
    """ "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def inventory(parts: Sequence[Part]) -> str:
    """The parts of a task."""
    alike: dict[Any, list[Part]] = {}
    for part in parts:
        alike.setdefault((part.name, part.friction, part.outline.tobytes()), []).append(part)
    return joined([_described(each[0], len(each)) for each in alike.values()])


def _described(part: Part, count: int) -> str:
    length, width = 1e3 * np.ptp(np.array(part.outline), axis=0)
    number = NUMBER_WORDS[count] if count < len(NUMBER_WORDS) else str(count)
    name = part.name.replace("_", " ") + ("s" if count > 1 else "")
    return f"{number} {name} ({length:.3g} × {width:.3g} mm, friction {part.friction:g})"


def loads(tasks: Mapping[str, tuple[TaskInfo, int]]) -> list[dict[str, Any]]:
    """Which parts tasks have, by name with their numbers of episodes; tasks with the same ones together."""
    found: dict[tuple[str, int], list[str]] = {}
    for task, (info, episodes) in tasks.items():
        found.setdefault((inventory(info.parts), episodes), []).append(task)
    return [
        {"tasks": joined(names), "inventory": parts, "episodes": episodes} for (parts, episodes), names in found.items()
    ]


def asked(task: TaskInfo) -> str:
    """What counts as success."""
    if task.flows:
        return "parts that leave through the gate of their kind, straight and apart"
    asked = []
    if task.has_goal:
        heading = f" and {math.degrees(task.heading_tolerance):.3g}°" if task.has_heading else ""
        moves = " of a goal that moves along a path, throughout" if task.goal_moves else ""
        asked.append(f"within {1e3 * task.position_tolerance:g} mm{heading}{moves}")
    if task.zones is not None:
        asked.append("all parts in their zones")
    if task.apart is not None:
        asked.append(f"all parts more than {1e3 * task.apart:.1f} mm apart")
    return joined(asked) or "what its documentation says"


def facts(task: TaskInfo, episodes: int) -> dict[str, Any]:
    """What results.json says of a task; None where something does not count."""
    zones = {} if task.zones is None else dict(zip(task.kinds, task.zones.tolist(), strict=True))
    return {
        "name": task.name,
        "summary": task.summary,
        "position_tolerance": task.position_tolerance if task.has_goal else None,
        "heading_tolerance": task.heading_tolerance if task.has_heading else None,
        "step_limit": task.step_limit,
        "episodes": episodes,
        "parts": [part.name for part in task.parts],
        "zones": zones,
        "apart": task.apart,
    }
