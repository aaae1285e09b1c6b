"""The batched core under the single and the vector environment: worlds of one task, stepped together."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.config import part_from, surface_from
from vibgym.envs.actions import ACTIONS, Action
from vibgym.envs.crowd_observations import CROWD_OBSERVATIONS
from vibgym.envs.observations import OBSERVATIONS
from vibgym.physics.core.drive import all_phasors
from vibgym.scene.parts import Part
from vibgym.simulation.simulator import Simulator
from vibgym.tasks import ManyTask, PoseTask, Task

SETTINGS = "surface, parts, model, action, observation, actuators, sensor, randomize, periods_per_step"


class Core:
    """Simulator, task, action and observation of ``worlds`` worlds.

    Args:
        task: the task's class.
        worlds: number of worlds.
        surface, parts, model, action, observation, actuators, sensor, randomize, periods_per_step: the environment's
            keyword arguments, see :class:`vibgym.envs.VibgymEnv`.
        more: those that only some tasks take.

    Raises:
        ValueError: a bad setting.
    """

    def __init__(
        self,
        task: type[Task],
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
        **more: Any,
    ) -> None:
        unknown = set(more) - set(task.SETTINGS)
        if unknown:
            own = [name for name in task.SETTINGS if name != "randomize"]
            raise checks.refuse("keyword arguments", sorted(unknown), ", ".join([SETTINGS, *own, "render_mode"]))
        self.surface = surface_from(surface)
        self.parts = _parts_from(parts, task)
        self.part = self.parts[0]
        checks.choice("actuators", actuators, ("ideal",))
        checks.choice("sensor", sensor, ("ideal",))
        if "randomize" in task.SETTINGS:
            more["randomize"] = randomize
        elif randomize not in (None, {}):
            raise checks.refuse("randomize", randomize, "None or an empty mapping (nothing is randomized yet)")
        self.worlds = worlds
        self.periods = checks.count("periods_per_step", periods_per_step)
        knobs: dict[str, Any] = {"periods_per_call": self.periods} if model == "auto" else {}
        if more.get("walls") is not None:
            knobs["walls"] = more["walls"]
        settings = {name: value for name, value in more.items() if name != "walls"}
        self.task = task.build(self.surface, self.parts, settings)
        self.action: Action = ACTIONS[checks.choice("action", action, tuple(ACTIONS))](self.surface, self.parts)
        self.observation = _observation(observation, self.task)
        self.goal_reward = observation == "goal"
        self.term_names = ("goal",) if self.goal_reward else self.task.TERMS
        self.simulator = Simulator(self.surface, self.parts, worlds=worlds, model=model, **knobs)
        velocity = [np.append(self.surface.idle_velocity(part.friction), 0.0) for part in self.parts]
        self.idle = np.array(velocity)
        self.goal = np.zeros((worlds, 3))
        self.score: Any = self.task.new_score(worlds)
        self.terms = self.score.terms[:, :1].copy() if self.goal_reward else self.score.terms
        self.drive: Any = None
        self.began = False

    def reset(self, worlds: np.ndarray, generators: Sequence[np.random.Generator]) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from its own generator."""
        draws = self.task.draws
        start = self.task.start(np.array([generator.random(draws) for generator in generators]))
        velocity = np.where(start.present[..., None], self.idle, 0.0)
        self.simulator.place(worlds, start.pose, velocity, 0.0, ~start.present)
        self.goal[worlds] = start.goal
        self.task.begin(self.simulator.state, start, self.goal, worlds, self.score)
        if self.goal_reward:
            self.terms[worlds] = 0.0
        self.began = True

    def step(self, action: np.ndarray) -> None:
        """Advance every world by one step under a checked action and score it."""
        state = self.simulator.state
        self.drive = self.action.drive(action, state.pose, state.fallen)
        self.simulator.run(self.drive, self.periods)
        self.task.score(state, self.goal, self.score)
        if self.goal_reward:
            seen = self.observe()
            reward = self.compute_reward(seen["achieved_goal"], seen["desired_goal"], {"fallen": state.fallen[:, 0]})
            self.score.reward[:] = reward
            self.terms[:, 0] = reward

    def compute_reward(self, achieved_goal: np.ndarray, desired_goal: np.ndarray, info: Any) -> np.ndarray:
        """Goal reward, see :meth:`vibgym.tasks.PoseTask.compute_reward`.

        Raises:
            AttributeError: the task has no goal pose.
        """
        if not isinstance(self.task, PoseTask):
            raise AttributeError(f"compute_reward: {type(self.task).__name__} has no goal pose")
        return self.task.compute_reward(achieved_goal, desired_goal, info)

    def observe(self) -> Any:
        """A fresh batch of observations."""
        state = self.simulator.state
        return self.observation.observe(state.pose, state.mean_velocity, self.goal, self.score)

    def facts(self) -> dict[str, np.ndarray]:
        """What ``info`` says besides ``reward_terms``, each (worlds,); live arrays."""
        return self.task.facts(self.simulator.state, self.score)

    def phasors(self, world: int) -> np.ndarray:
        """(rows, columns, 2) phasors of the last step as fractions of full scale; zeros before the first."""
        shape = (self.simulator.worlds, self.surface.rows, self.surface.columns, 2)
        if self.drive is None or self.surface.full_scale == 0.0:
            return np.zeros(shape[1:])
        phasors = np.empty(shape)
        all_phasors(self.drive, phasors)
        return phasors[world] / self.surface.full_scale


def _parts_from(parts: Any, task: type[Task]) -> tuple[Part, ...]:
    """The parts of a world from the keyword argument."""
    parts = task.DEFAULT_PARTS if parts is None else parts
    if isinstance(parts, str) or not isinstance(parts, Sequence) or not parts or (len(parts) != 1 and not task.MANY):
        allowed = "a list of parts" if task.MANY else "a list with one part"
        raise checks.refuse("parts", parts, f"{allowed}: a shipped part's name or a mapping")
    if task.MANY:
        return tuple(part_from(part, f"parts[{k}]") for k, part in enumerate(parts))
    return (part_from(parts[0]),)


def _observation(name: Any, task: Task) -> Any:
    """The observation of a task by its name."""
    if isinstance(task, ManyTask):
        if name == "goal":
            raise checks.refuse("observation", name, "'state', 'image' (only tasks with a goal pose have 'goal')")
        return CROWD_OBSERVATIONS[checks.choice("observation", name, tuple(CROWD_OBSERVATIONS))](task.surface, task)
    seen = OBSERVATIONS[checks.choice("observation", name, tuple(OBSERVATIONS))]
    return seen(task.surface, task.parts[0], task)
