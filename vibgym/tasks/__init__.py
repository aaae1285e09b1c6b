"""What is asked of the parts: start and goal, reward terms, success. One file a task."""

from vibgym.tasks.align import Align
from vibgym.tasks.base import Task
from vibgym.tasks.many import ManyTask
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.rotate import Rotate
from vibgym.tasks.singulate import Singulate
from vibgym.tasks.sort import Sort
from vibgym.tasks.transport import Transport

POSE_TASKS: dict[str, type[PoseTask]] = {"Transport": Transport, "Align": Align, "Rotate": Rotate}
MANY_TASKS: dict[str, type[ManyTask]] = {"Sort": Sort, "Singulate": Singulate}
TASKS: dict[str, type[Task]] = {**POSE_TASKS, **MANY_TASKS}

__all__ = [
    "MANY_TASKS",
    "POSE_TASKS",
    "TASKS",
    "Align",
    "ManyTask",
    "PoseTask",
    "Rotate",
    "Singulate",
    "Sort",
    "Task",
    "Transport",
]
