"""What the worlds of a task hold, for those who draw and describe them."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym.envs.core import Core
from vibgym.rendering import Zone
from vibgym.scene import Part
from vibgym.tasks import ManyTask

NUMBER_WORDS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


@dataclass(frozen=True)
class Scene:
    """Parts, zones and walls of a task."""

    parts: tuple[Part, ...]
    kinds: tuple[int, ...]  # of each part
    zones: tuple[Zone, ...]  # of the kinds, in their order; empty for tasks without
    walls: tuple[str, ...]
    crowd: bool  # whether the task is one for several parts

    def inventory(self) -> str:
        """The parts in words."""
        alike: dict[Any, list[Part]] = {}
        for part in self.parts:
            alike.setdefault((part.name, part.friction, part.outline.tobytes()), []).append(part)
        texts = [f"{_word(len(parts))} {_described(parts[0], len(parts))}" for parts in alike.values()]
        return texts[0] if len(texts) == 1 else f"{', '.join(texts[:-1])} and {texts[-1]}"


def _word(count: int) -> str:
    return NUMBER_WORDS[count] if count < len(NUMBER_WORDS) else str(count)


def _described(part: Part, count: int) -> str:
    length, width = 1e3 * np.ptp(np.array(part.outline), axis=0)
    name = part.name.replace("_", " ") + ("s" if count > 1 else "")
    return f"{name} ({length:.3g} × {width:.3g} mm, friction {part.friction:g})"


def scene_of(core: Core) -> Scene:
    """The scene of a core's task."""
    task = core.task
    if not isinstance(task, ManyTask):
        return Scene(core.parts, (0,), (), core.simulator.walls, False)
    zones: tuple[Zone, ...] = ()
    if task.zones is not None:
        zones = tuple(
            Zone((zone[0], zone[1]), (zone[2], zone[3]), kind, name.replace("_", " "))
            for kind, (name, zone) in enumerate(zip(task.names, task.zones.tolist(), strict=True))
        )
    return Scene(core.parts, tuple(task.kind.tolist()), zones, core.simulator.walls, True)
