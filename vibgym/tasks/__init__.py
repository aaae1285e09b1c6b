"""What is asked of the parts: start and goal, reward terms, success. One file a task."""

from vibgym.registry import Registry
from vibgym.tasks.base import Start, Task
from vibgym.tasks.feed import Feed, in_stable_poses
from vibgym.tasks.follow import Follow
from vibgym.tasks.pack import Pack
from vibgym.tasks.patterns import Pattern
from vibgym.tasks.pose import Align, PoseTask, Rotate, Transport
from vibgym.tasks.push import Push
from vibgym.tasks.scoring import Step
from vibgym.tasks.sort import ArrangedTask, Singulate, Sort
from vibgym.tasks.starts import Starts
from vibgym.tasks.swap import Swap

TASKS: Registry[type[Task]] = Registry(
    "task",
    {
        "Transport": Transport,
        "Align": Align,
        "Rotate": Rotate,
        "Follow": Follow,
        "Sort": Sort,
        "Singulate": Singulate,
        "Pack": Pack,
        "Feed": Feed,
        "Swap": Swap,
        "Push": Push,
    },
)
"""Tasks by name; ``TASKS.register(name, cls)`` adds one of your own."""

__all__ = [
    "TASKS",
    "Align",
    "ArrangedTask",
    "Feed",
    "Follow",
    "Pack",
    "Pattern",
    "PoseTask",
    "Push",
    "Rotate",
    "Singulate",
    "Sort",
    "Start",
    "Starts",
    "Step",
    "Swap",
    "Task",
    "Transport",
    "in_stable_poses",
]
