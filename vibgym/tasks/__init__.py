"""What is asked of the parts: start and goal, reward terms, success. One file a task."""

from vibgym.tasks.align import Align
from vibgym.tasks.pose import PoseTask
from vibgym.tasks.rotate import Rotate
from vibgym.tasks.transport import Transport

TASKS: dict[str, type[PoseTask]] = {"Transport": Transport, "Align": Align, "Rotate": Rotate}

__all__ = ["TASKS", "Align", "PoseTask", "Rotate", "Transport"]
