"""A custom task, parking a part at the left end: ``python examples/custom_task.py [EPISODES]``; see docs/extending.md."""

import sys

import gymnasium as gym
import numpy as np

from vibgym.policies import rollout
from vibgym.settings import Length
from vibgym.tasks import TASKS, PoseTask


class Park(PoseTask):
    """Bring the part to the left end, at half the table's width, at any heading."""

    position_tolerance = 0.005  # m
    draws = 3  # uniform numbers that a start needs

    class Settings(PoseTask.Settings):
        column: Length = 0.05
        """Distance of the goal from the left border."""

    def draw(self, uniform):
        """Return starts and goals of n worlds, (n, 3) each, from ``uniform`` (n, draws)."""
        start = np.column_stack([self.somewhere(uniform[:, :2]), 2.0 * np.pi * uniform[:, 2] - np.pi])
        goal = np.tile([self.settings.column, 0.5 * self.surface.depth, 0.0], (len(uniform), 1))
        return start, goal


TASKS.register("Park", Park)
gym.register(
    "mine/Park-v0",
    entry_point="vibgym.envs:VibgymEnv",
    vector_entry_point="vibgym.envs:VibgymVectorEnv",
    max_episode_steps=250,
    kwargs={"task": "Park", "task_settings": {"column_mm": 60}, "max_episode_periods": 250},
)

episodes = int(sys.argv[1]) if len(sys.argv) > 1 else 100
for name in ("zero", "local_field", "pose"):
    result = rollout(name, "mine/Park-v0", seeds=range(episodes))
    times = result.time_to_goal[result.success]
    median = f"median {np.median(times):.2f} s" if len(times) else "never there"
    print(f"{name:12} {100 * result.success.mean():5.1f} %, {median}")
