"""The batched core under the single and the vector environment: worlds of one task, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.config import part_from, surface_from
from vibgym.envs.actions import ACTIONS, Action
from vibgym.envs.observations import OBSERVATIONS
from vibgym.physics.drive import all_phasors
from vibgym.scene.simulator import Simulator
from vibgym.tasks.pose import TERMS, PoseTask, begin, new_score, score

DEFAULT_PART = "aluminium_block"
SETTINGS = "surface, parts, model, action, observation, actuators, sensor, randomize, periods_per_step"


class Core:
    """Simulator, task, action and observation of ``worlds`` worlds.

    Args:
        task: the task's class.
        worlds: number of worlds.
        surface, parts, model, action, observation, actuators, sensor, randomize, periods_per_step: the environment's
            keyword arguments, see :class:`vibgym.envs.VibgymEnv`.

    Raises:
        ValueError: a bad setting.
    """

    def __init__(
        self,
        task: type[PoseTask],
        worlds: int,
        *,
        surface: Any = "prototype",
        parts: Any = None,
        model: str = "planar",
        action: str = "element",
        observation: str = "state",
        actuators: str = "ideal",
        sensor: Any = "ideal",
        randomize: Any = None,
        periods_per_step: int = 1,
        **unknown: Any,
    ) -> None:
        if unknown:
            raise checks.refuse("keyword arguments", sorted(unknown), f"{SETTINGS}, render_mode")
        self.surface = surface_from(surface)
        parts = [DEFAULT_PART] if parts is None else parts
        if isinstance(parts, str) or not isinstance(parts, Sequence) or len(parts) != 1:
            raise checks.refuse("parts", parts, "a list with one part: a shipped part's name or a mapping")
        self.part = part_from(parts[0])
        checks.choice("actuators", actuators, ("ideal",))
        checks.choice("sensor", sensor, ("ideal",))
        if randomize not in (None, {}):
            raise checks.refuse("randomize", randomize, "None or an empty mapping (nothing is randomized yet)")
        self.worlds = worlds
        self.periods = checks.count("periods_per_step", periods_per_step)
        self.task = task(self.surface, self.part)
        self.action: Action = ACTIONS[checks.choice("action", action, tuple(ACTIONS))](self.surface, self.part)
        seen = OBSERVATIONS[checks.choice("observation", observation, tuple(OBSERVATIONS))]
        self.observation = seen(self.surface, self.part, self.task)
        self.goal_reward = observation == "goal"
        self.term_names = ("goal",) if self.goal_reward else TERMS
        knobs = {"periods_per_call": self.periods} if model == "auto" else {}
        self.simulator = Simulator(self.surface, self.part, worlds=worlds, model=model, **knobs)
        self.idle = np.append(self.surface.idle_velocity(self.part.friction), 0.0)
        self.goal = np.zeros((worlds, 3))
        self.score = new_score(worlds)
        self.terms = self.score.terms[:, :1].copy() if self.goal_reward else self.score.terms
        self.drive: Any = None
        self.began = False

    def reset(self, worlds: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from its own generator."""
        draws = self.task.draws
        start, goal = self.task.draw(np.array([generator.random(draws) for generator in generators]))
        self.simulator.place(worlds, start[:, None, :], self.idle, 0.0)
        self.goal[worlds] = goal
        begin(self.task.rules, self.simulator.state.pose, self.goal, worlds, self.score)
        if self.goal_reward:
            self.terms[worlds] = 0.0
        self.began = True

    def step(self, action: np.ndarray) -> None:
        """Advance every world by one step under a checked action and score it."""
        state = self.simulator.state
        self.drive = self.action.drive(action, state.pose)
        self.simulator.run(self.drive, self.periods)
        score(self.task.rules, state.pose, self.goal, state.fallen, state.diverged, self.score)
        if self.goal_reward:
            seen = self.observe()
            info = {"fallen": state.fallen[:, 0]}
            reward = self.task.compute_reward(seen["achieved_goal"], seen["desired_goal"], info)
            self.score.reward[:] = reward
            self.terms[:, 0] = reward

    def observe(self) -> Any:
        """A fresh batch of observations."""
        state = self.simulator.state
        return self.observation.observe(state.pose, state.mean_velocity, self.goal, self.score)

    def phasors(self, world: int) -> np.ndarray:
        """(rows, columns, 2) phasors of the last step as fractions of full scale; zeros before the first."""
        shape = (self.simulator.worlds, self.surface.rows, self.surface.columns, 2)
        if self.drive is None or self.surface.full_scale == 0.0:
            return np.zeros(shape[1:])
        phasors = np.empty(shape)
        all_phasors(self.drive, phasors)
        return phasors[world] / self.surface.full_scale
