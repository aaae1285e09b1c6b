"""Interactive world: an environment, its policy, and the interventions of a visitor."""

from __future__ import annotations

import copy
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs import ACTIONS
from vibgym.physics.core.drive import all_phasors
from vibgym.plugins.play.choices import Settings, settings_of, usual_policy
from vibgym.policies import TaskInfo
from vibgym.policies.applicable import policies_of, policy_for
from vibgym.scene import overlaps

ONLY = np.zeros(1, dtype=np.int64)
"""Index of the world."""

SAME_WORLD = ("pose", "velocity", "mean_velocity", "sticking", "fallen", "friction", "mass", "incline")
"""Fields of the simulator's state that are kept when hardware or model change."""


class World:
    """An environment under a policy, except for painted elements.

    A lifted part (:meth:`lift`) is not simulated until it is put down. Where parts arrive and leave, it stays at its place.

    Args:
        settings: task, policy, hardware and model.
        seed: of the first episode.

    Attributes:
        env: the environment, whose actions are the phasors of all elements.
        policies: names of the policies that support the task.
        held: pose of each lifted part.
        paint: (rows, columns, 2) float32 phasors, as fractions of full scale; nan: not painted.
        info: of the last step.

    Raises:
        ValueError: incompatible settings.
    """

    def __init__(self, settings: Settings, seed: int = 0) -> None:
        self.env = settings.environment()
        self._about = TaskInfo.of(self.env)
        self.policies = policies_of(self._about)
        if not settings.policy:
            settings = settings_of(**{**vars(settings), "policy": usual_policy(self.policies, self._about)})
        self.settings = settings
        self.paint = np.full((self._about.surface.rows, self._about.surface.columns, 2), np.nan, dtype=np.float32)
        self._bind(policy_for(settings.policy, self._about))
        self.begin(seed)

    def _bind(self, policy: Any) -> None:
        """Set the policy."""
        core = self.env.core
        self.policy, self._state, self._fresh = policy, None, True
        self.action = ACTIONS[policy.action](core.surface, core.parts)
        self.action.step_time = core.action.step_time
        self.action.resolve_limits(core.actuators.data_sheet, 1)
        self._relate = core.scoring.relating(core.relations)

    @property
    def core(self) -> Any:
        """Core of the environment."""
        return self.env.core

    def begin(self, seed: int, options: dict[str, Any] | None = None) -> None:
        """Begin an episode, see :meth:`vibgym.envs.VibgymEnv.reset`.

        Raises:
            ValueError: a bad seed or option; nothing has changed.
        """
        _, self.info = self.env.reset(seed=seed, options=options)
        self.seed, self.held = seed, dict[int, np.ndarray]()
        self.wanted = np.zeros((*self.paint.shape[:2], 2))
        self._bind(self.policy)

    def step(self) -> None:
        """Step the environment with the policy's action, overridden by painted elements."""
        core = self.core
        seen = self.env.observed(self.policy.observation)
        start = np.array([True]) if self._fresh else None
        action, self._state = self.policy.predict(seen, self._state, start)
        self._fresh = False
        measured = core.sensing.measurement
        measured = measured._replace(gone=measured.gone | ~core.task.driven)
        drive = self.action.command(self.action.check(action, None), measured)
        wanted = np.zeros((1, *self.paint.shape[:2], 2))
        all_phasors(drive, wanted)
        if core.surface.full_scale > 0.0:
            wanted /= core.surface.full_scale
        self.done = np.where(np.isnan(self.paint), wanted[0], self.paint).astype(np.float32)
        self.observation, self.reward, self.terminated, _, self.info = self.env.step(self.done.reshape(-1))
        self.wanted = self.env.phasors()
        for part, pose in self.held.items():
            self._hold(part, pose)

    def part(self, part: Any) -> int:
        """Return the number of a part, checked.

        Raises:
            ValueError: an invalid number, or a part that is not in this episode.
        """
        part = checks.count("part", part, least=0, most=len(self.env.parts) - 1)
        if not self.core.episode.present[0, part]:
            raise checks.refuse("part", part, "a part that is in this episode")
        return part

    def lift(self, part: int) -> None:
        """Lift a part.

        Raises:
            ValueError: it is lifted already.
        """
        if part in self.held:
            raise checks.refuse("part", part, "a part that is not held")
        self.held[part] = self.core.simulator.state.pose[0, part].copy()
        self._hold(part, self.held[part])

    def carry(self, part: int, pose: np.ndarray) -> None:
        """Move a lifted part to any pose (3,), m, m, rad.

        Raises:
            ValueError: it is not lifted.
        """
        if part not in self.held:
            raise checks.refuse("part", part, f"a held part ({sorted(self.held) or 'none'})")
        self.held[part] = pose
        self._hold(part, pose)

    def _hold(self, part: int, pose: np.ndarray) -> None:
        if self.core.task.continuous_feed:  # there, parts off the table have left
            return
        state = self.core.simulator.state
        state.fallen[0, part] = True
        state.pose[0, part], state.velocity[0, part], state.mean_velocity[0, part] = pose, 0.0, 0.0

    def room(self, part: int) -> str:
        """Return the reason why a held part cannot be put down at its pose; empty if it can."""
        try:
            self._check_room(part)
        except ValueError as error:
            return str(error)
        return ""

    def _check_room(self, part: int) -> None:
        simulator = self.core.simulator
        pose, away = simulator.pose, simulator.fallen
        pose[0, part], away[0, part] = self.held[part], False
        overlaps.check_centres("pose", pose[:, part], simulator.surface)
        simulator.check_overlaps("pose", pose, away, overlaps.AT_REST)

    def place(self, part: int) -> None:
        """Put a lifted part down, at rest at its pose.

        Raises:
            ValueError: no room; it stays lifted.
        """
        self.carry(part, self.held.get(part, np.zeros(3)))
        self._check_room(part)
        core, state = self.core, self.core.simulator.state
        state.pose[0, part] = self.held.pop(part)
        state.velocity[0, part], state.mean_velocity[0, part] = core.idle[0, part], 0.0
        for flag in (state.fallen, state.sticking, state.doubtful):
            flag[0, part] = False
        state.pushed[0, part] = 0.0
        self._anew(np.arange(len(core.parts))[None] == part)

    def _anew(self, which: np.ndarray) -> None:
        """Reset the memory of model, sensor and action for moved parts, (1, parts) bool."""
        core = self.core
        core.simulator.reset_parts(which)
        core.sensing.reset_parts(which, core.simulator.state)
        for remembered in self.action.live().values():
            if remembered.shape[:2] == which.shape:
                remembered[which] = 0
        self._related()

    def _related(self) -> None:
        core = self.core
        state = core.simulator.state
        self._relate(ONLY, state.pose, state.fallen)
        core.relate(ONLY)

    def aim(self, part: int, pose: np.ndarray) -> None:
        """Set the goal pose (3,) of a part.

        Raises:
            ValueError: a task without fixed goals, a part without a goal, or a goal off the surface.
        """
        task = self.core.task
        if not task.has_goal or task.goal_moves:
            why = "moving goals" if task.goal_moves else "zones or positions instead of goal poses"
            raise checks.conflict(f"goals of {task.name} cannot be moved: it has {why}")
        if not task.scored[part]:
            raise checks.refuse("part", part, "a part that has a goal")
        overlaps.check_centres("pose", pose[None], self.core.surface)
        self.core.episode.goal[0, part] = pose
        self._related()

    def draw(self, elements: np.ndarray, phasor: np.ndarray) -> None:
        """Paint elements (n, 2), rows and columns, with a phasor (2,) as fractions of full scale; nan removes paint."""
        self.paint[elements[:, 0], elements[:, 1]] = phasor

    def switch(self, settings: Settings) -> None:
        """Change the settings; poses and motion of the parts are kept.

        Raises:
            ValueError: incompatible settings; nothing has changed.
        """
        if settings.policy not in self.policies:
            raise checks.unknown("policy", settings.policy, self.policies)
        if settings.arguments() == self.settings.arguments():
            policy = policy_for(settings.policy, self._about)
        else:
            env = settings.environment()
            about = TaskInfo.of(env)
            policy = policy_for(settings.policy, about)
            env.reset(seed=self.seed)
            _carry_over(self.env, env)
            self.env, self._about = env, about
            self.policies = policies_of(about)
        self.settings = settings
        self._bind(policy)
        for part, pose in self.held.items():
            self._hold(part, pose)
        self._related()

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot from which the world continues bit for bit."""
        own = (self.settings, self.seed, self.held, self.paint, self.wanted, self.info, self._state, self._fresh)
        return {"own": copy.deepcopy(own), "env": self.env.get_state(), "action": self.action.get_state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Restore a snapshot of :meth:`get_state`."""
        settings, *own = copy.deepcopy(state["own"])
        if settings != self.settings:
            if settings.arguments() != self.settings.arguments():
                self.env = settings.environment()
                self._about = TaskInfo.of(self.env)
                self.policies = policies_of(self._about)
            self.settings = settings
            self._bind(policy_for(settings.policy, self._about))
        self.seed, self.held, self.paint, self.wanted, self.info, self._state, self._fresh = own
        self.env.set_state(state["env"])
        self.action.set_state(self.action.check_state(state["action"]))


def _carry_over(old: Any, new: Any) -> None:
    """Copy episode, parts and motion to a new environment of the same task."""
    before, state = old.get_state(), new.get_state()
    for group, names in (("simulator", SAME_WORLD), ("episode", tuple(state["episode"]))):
        for name in names:
            values = before[group].get(name)
            if values is not None and values.shape == state[group][name].shape:
                state[group][name] = values
    new.set_state(state)
    new.core.sensing.reset_parts(np.ones((1, len(new.parts)), dtype=bool), new.core.simulator.state)
    new.core.relate(ONLY)
