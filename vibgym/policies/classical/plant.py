"""What laws know of the parts as plants: how hard they can be pushed, and how friction brakes them."""

from __future__ import annotations

from vibgym.allocation.allocator import strongest
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.sliding import Sliding, sliding_of


def plant_of(info: TaskInfo) -> Sliding:
    """The local model of a task's parts on its surface, under its hardware."""
    return sliding_of(info.surface, info.parts, strongest(info.surface, info.hardware))
