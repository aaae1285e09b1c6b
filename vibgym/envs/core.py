"""The batched core of the single and the vector environment: components, resets, observations and snapshots."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.actuators import ACTUATORS, nominal
from vibgym.envs.actions import Action, check_command, new_action
from vibgym.envs.costs import Costs
from vibgym.envs.drawn import DrawnShapes
from vibgym.envs.info import BatchInfo, InfoData
from vibgym.envs.observations import OBSERVATIONS, GoalReward, Observation, check_batch
from vibgym.envs.options import (
    Options,
    StartOverride,
    first_difference,
    longest_paths,
    parts_from,
    task_settings,
)
from vibgym.envs.randomization import Disturbances, Randomization
from vibgym.envs.step import Pipeline
from vibgym.physics.core.drive import Drive, all_phasors
from vibgym.scene.surface import surface_from
from vibgym.sensing import MEASUREMENT_FEATURES, Sensing, sensing_from
from vibgym.sensing.measurement import new_measurement
from vibgym.simulation import MODELS, Simulator
from vibgym.snapshots import check_keys, copied, put_back, restored
from vibgym.tasks import TASKS, Start, Task
from vibgym.tasks.episode import Relations
from vibgym.tasks.scoring import CustomReward

NONE = np.zeros(0, dtype=np.int64)

BYTES_OF_WORLD, BYTES_OF_PART, BYTES_OF_ELEMENT = 2000, 1000, 64
"""Least memory of a world: its generator, arrays of the parts, and actions and drives of the elements."""


class Core:
    """Task, action, actuators, simulator, sensor and observation of ``worlds`` worlds, and the pipeline of a step.

    Args:
        options: settings of the environment.
        worlds: number of worlds.
        make_info: class that makes ``info``; a batch writes it world by world.

    Attributes:
        options, surface, parts: of the scene.
        identity: settings that a snapshot depends on, see :meth:`vibgym.envs.Options.identity`.
        idle: (parts, 3) velocities of parts that slide in place on elements at rest.
        longest: s, longest path of an episode.
        shape_draws: uniform numbers of an episode for its shapes, see :mod:`vibgym.envs.drawn`.
        began: whether an episode has begun.
        episode, relations: progress of every world, and errors and gaps of its parts, by the true state.
        measured: relations by the measured poses.
        reward: replaces that of the kernels: the task's method or the goal observation; None: the kernels.
        term_names: of the reward.  terms: (worlds, terms).  part_terms: (worlds, parts, terms).
        drive: the last one that was executed.
        commanded: live arrays (worlds, ...) for ``info["commanded"]``.
        all_driven: whether the task drives all parts.
        kept_action: (worlds, size) memory that actions are copied to; None for many worlds.
        by_batch: whether ``info`` is that of a batch.
        pipeline: of a step, see :class:`vibgym.envs.step.Pipeline`.

    Raises:
        ValueError: an invalid setting.
    """

    STATE = ("environment", "simulator", "episode", "action", "actuators", "sensor", "began")
    """Keys of a snapshot."""

    def __init__(self, options: Options, worlds: int, make_info: Callable[[InfoData], Any] = BatchInfo) -> None:
        cls = TASKS.choose("task", options.task)
        self.surface = surface_from(options.surface)
        self.options = options = self._with_shapes(options)
        self.parts = parts_from(options.parts, cls, self.surface)
        numbers = BYTES_OF_ELEMENT * self.surface.rows * self.surface.columns
        self.worlds = checks.fitting("num_envs", worlds, BYTES_OF_WORLD + BYTES_OF_PART * len(self.parts) + numbers)
        self.periods = options.periods_per_step
        self.actuators = ACTUATORS.make("actuators", options.actuators, self.surface, worlds, self.periods)
        drawn = cls.RANDOMIZED, self.actuators
        self.randomization = Randomization(options.randomize, *drawn, self.surface, self.parts)
        self.actuators.vary(self.randomization.actuators)
        settings = task_settings(options, cls, self.randomization.task)
        self.task: Task = cls(self.surface, self.parts, settings=settings)
        self.action = self.new_action()
        self.action.step_time = self.periods * self.surface.period
        self.simulator = self._new_simulator()
        disturbance, span = self.randomization.disturbance, self.periods * self.surface.period
        self.disturbances = None if disturbance is None else Disturbances(disturbance, self.simulator, span)
        self.sensing = self._new_sensing()
        measured = (name for each in self.sensing.tell for name in MEASUREMENT_FEATURES[each])
        self.task.features = (*self.task.features, *measured)
        self.observation = self._observation("observation", options.observation)
        self._observations = {options.observation: self.observation}
        self.all_driven = bool(self.task.driven.all())
        self.commanded = self.action.resolve_limits(self.actuators.data_sheet, worlds)
        command = self._resting_command()
        self.actuators.prepare(command)
        self.sensing.prepare(command)
        self.identity = options.identity(self.surface, self.parts, self.simulator.walls, worlds)
        self.idle = self._idle_velocity(np.ones(len(self.parts)))
        # Arrays of the state and of the scoring are allocated once and changed in place.
        state = self.simulator.state
        self.scoring = self.task.scoring(state, self.periods)
        self.episode, self.relations = self.scoring.episode, self.scoring.relations
        # An exact sensor needs no relations by measured poses.
        self.measured = self.relations
        if self.sensing.exact:
            self.sensing.reset(NONE, state, np.zeros((0, 0)))
        else:
            self.measured = Relations(*(values.copy() for values in self.relations))
        self.drive: Any = None
        self.costs: Costs | None = None
        if options.costs is not None:
            world = self.simulator, self.episode, self.relations, self.periods
            self.costs = Costs(options.costs, *world, self._all_phasors)
        self.reward = self._new_reward()
        self.term_names: tuple[str, ...] = tuple(self.task.made_of) if self.reward is None else self.reward.names
        rewarded = self.episode if self.reward is None else self.reward
        self.terms, self.part_terms = rewarded.terms, rewarded.part_terms
        self.make_info, self.by_batch = make_info, make_info is BatchInfo
        # Few worlds: actions are copied to the same memory at every step, so that drives need not be pinned again. For many
        # worlds a copy would take longer.
        few = len(self.simulator.blocks.edges) == 1
        self.kept_action = np.zeros((worlds, self.action.size), dtype=np.float32) if few else None
        self.pipeline = self.new_pipeline()
        self.longest = longest_paths(self.task, self.actuators, self.sensing.sensor, options.max_episode_periods)
        self.began = False
        self._checked = False  # the first batch of observations, against their space

    def new_pipeline(self) -> Pipeline:
        """Return the pipeline of a step."""
        return Pipeline(self)

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the pipeline, which has addresses of arrays."""
        return {name: value for name, value in vars(self).items() if name != "pipeline"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.pipeline = self.new_pipeline()

    def step(self, action: np.ndarray, given: Any = None) -> None:
        """Advance every world by one step under an action.

        Args:
            action: float32 (worlds, size), see :meth:`vibgym.envs.actions.Action.shaped`.
            given: the action before conversion, for errors.

        Raises:
            ValueError: a number that is not finite; nothing has changed.
        """
        self.pipeline.run(action, given)

    def _with_shapes(self, options: Options) -> Options:
        """Return the options with the parts of their shapes, if these are drawn for episodes; sets ``shape_draws``."""
        self.shape_draws = 0
        if options.split is None:
            if options.shapes is not None:
                raise checks.conflict("shapes require split, the library that they are from")
            return options
        drawn = DrawnShapes(options, self.surface)
        if drawn.shapes is None:
            raise checks.conflict(
                "a batch of worlds with one scene requires shapes=[...], indices of the split's parts; "
                "gym.make_vec without shapes makes a batch whose worlds draw them"
            )
        self.shape_draws = drawn.draws
        return drawn.fixed(options, drawn.shapes)

    def new_action(self) -> Action:
        """Create the action."""
        return new_action(self.options.action, self.surface, self.parts)

    def _new_simulator(self) -> Simulator:
        """Create the simulator, and check that it supports the conditions that episodes may draw."""
        options, randomization = self.options, self.randomization
        model, settings = MODELS.split("model", options.model)
        if model == "auto":
            settings.setdefault("periods_per_call", self.periods)
        if options.walls is not None and not self.task.HAS_WALLS:
            raise checks.conflict(f"walls cannot be set for task {options.task!r}")
        walls = () if options.walls is None else options.walls
        simulator = Simulator(self.surface, self.parts, worlds=self.worlds, model=model, walls=walls, **settings)
        if "patches" in randomization.ranges:
            simulator.allocate_patches()
        if randomization.ranges:
            extremes = randomization.extremes()
            simulator.check_conditions(extremes, extremes._asdict(), "randomize[{!r}]")
        return simulator

    def _new_sensing(self) -> Sensing:
        """Create the sensor and its estimator."""
        options, task, actuators = self.options, self.task, self.actuators
        sensing = sensing_from(
            options.sensor, self.surface, self.parts, self.worlds, self.periods,
            plant=nominal(actuators), latency=actuators.latency, walls=self.simulator.walls,
        )  # fmt: skip
        if task.flows and not sensing.sensor.renews:
            raise checks.conflict(
                f"sensor {options.sensor!r} does not support parts that arrive and leave (task {task.name!r})"
            )
        return sensing

    def _new_reward(self) -> CustomReward | GoalReward | None:
        """Create the reward source that replaces the kernels': the task's method or the goal observation; None: the kernels.

        Raises:
            ValueError: reward terms without a weight, or weights with a goal reward.
        """
        if self.observation.goal_reward:
            if self.task.settings.weights:
                raise checks.conflict("task_settings.weights cannot be set with observation='goal': see compute_reward")
            return GoalReward(self.observation, self.simulator.state, self.scoring)
        if self.task.has_custom_reward:
            return CustomReward(self.scoring, self._all_phasors)
        return None

    def reset(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride | None = None
    ) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from the world's generator.

        Args:
            override: reset options that replace drawn values.

        Raises:
            ValueError: an invalid start; only the generators have changed.
        """
        task = self.shape_draws
        actuators = task + self.task.draws
        sensing = actuators + self.actuators.draws
        randomization = sensing + self.sensing.draws
        disturbances = randomization + self.randomization.draws
        total = disturbances + (0 if self.disturbances is None else self.disturbances.draws)
        uniform = np.empty((len(worlds), total))
        for row, generator in zip(uniform, generators, strict=True):
            generator.random(out=row)
        start = self.start_of(worlds, uniform[:, task:actuators], override)
        drawn = self.randomization.values(uniform[:, randomization:disturbances])
        idle = self.idle
        if "friction" in drawn:
            idle = np.array([self._idle_velocity(factors) for factors in drawn["friction"]])
        self.put(worlds, start, np.where(start.present[..., None], idle, 0.0))
        self.simulator.condition(worlds, drawn)
        self.actuators.reset(worlds, uniform[:, actuators:sensing])
        self.sensing.reset(worlds, self.simulator.state, uniform[:, sensing:randomization])
        if self.disturbances is not None:
            self.disturbances.reset(worlds, uniform[:, disturbances:])
        self.relate(worlds)

    def put(self, worlds: np.ndarray, start: Start, velocity: Any, mean_velocity: Any = 0.0) -> None:
        """Place the parts of ``worlds`` (index array), at rest or in motion, and start scoring.

        With ideal actuators and sensor this is a complete reset; planners use it to continue from a measured state.

        Args:
            velocity, mean_velocity: (n, parts, 3) at this instant, and over the last period, m/s, m/s, rad/s.
        """
        self.simulator.place(worlds, start.pose, velocity, mean_velocity, ~start.present)
        self.scoring.begin(worlds, start)
        if self.terms is not self.episode.terms:  # else they have just been set
            self.terms[worlds], self.part_terms[worlds] = 0.0, 0.0
        if self.costs is not None:
            self.costs.begin(worlds)
        for memory in self.action.live().values():
            memory[worlds] = 0
        self.began = True

    def _idle_velocity(self, factors: np.ndarray) -> np.ndarray:
        """Return velocities (parts, 3) of parts that slide in place on elements at rest, with friction factors (parts,)."""
        pairs = zip(factors.tolist(), self.parts, strict=True)
        return np.array([np.append(self.surface.idle_velocity(each * part.friction), 0.0) for each, part in pairs])

    def start_of(self, worlds: np.ndarray, uniform: np.ndarray, override: StartOverride | None) -> Start:
        """Return the checked start of a reset from uniform numbers (n, task.draws) and reset options."""
        task = self.task
        start = task.start(uniform) if override is None else override.start(task, self.simulator, worlds, uniform)
        shape, present = (len(worlds), len(self.parts)), start.present
        checks.shaped(f"{task.name}: present", present, (shape,), "booleans", kinds="b")
        placed, aimed = present & (not task.flows), present & task.asked & task.has_goal  # parts of a flow arrive later
        least, most = (0.0, 0.0, -1e9), (self.surface.width, self.surface.depth, 1e9)
        for name, poses, counted in (("pose", start.pose, placed), ("goal", start.goal, aimed)):
            poses = checks.shaped(f"{task.name}: {name}", poses, ((*shape, 3),), "an array")
            off = ~((poses >= least) & (poses <= most)).all(axis=-1) & counted
            if off.any():
                allowed = f"on the surface, x in [0, {most[0]:g}] m and y in [0, {most[1]:g}] m, with a finite heading"
                raise checks.refuse(f"{task.name}: {name}", poses[off][0].tolist(), allowed)
        return start

    def check_start(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride
    ) -> None:
        """Raise ValueError if :meth:`reset` would; nothing changes, generators included."""
        task = self.shape_draws
        uniform = [copy.deepcopy(generator).random(task + self.task.draws)[task:] for generator in generators]
        self.start_of(worlds, np.array(uniform), override)

    def refresh_all(self) -> None:
        """Observe and report all worlds, in a new batch."""
        self.pipeline.allocate()
        self.refresh(self.pipeline.now.worlds)
        if not self._checked:
            name, space = f"observation {self.options.observation!r}", self.observation.space
            live = (*self.sensing.measurement, *self.measured, *self.episode)
            check_batch(name, space, self.observations, self.worlds, live)
            self._checked = True

    def refresh(self, worlds: np.ndarray) -> None:
        """Update observations and reports of ``worlds`` (index array), whose episodes have just begun, in the present batch."""
        self.pipeline.refresh(worlds)

    def relate(self, worlds: np.ndarray) -> None:
        """Update the relations by the measured poses in ``worlds`` (index array)."""
        if not self.sensing.exact:
            self.pipeline.now.relate(worlds, self.sensing.measurement.pose, self.sensing.measurement.gone)

    @property
    def observations(self) -> Any:
        """Batch of observations of the last step."""
        return self.pipeline.observations

    def observe(self) -> Any:
        """Return a new batch of observations."""
        return self.observation.observe(self.sensing.measurement, self.measured, self.episode)

    def observed(self, kind: str) -> Any:
        """Return a new batch of another observation of the same instant.

        Args:
            kind: as for ``observation=``.

        Raises:
            ValueError: an unknown observation, or one that task or sensor do not support.
        """
        name = checks.choice("kind", kind, OBSERVATIONS)
        if name not in self._observations:
            if not OBSERVATIONS[name].beside:
                have = [each for each in OBSERVATIONS if OBSERVATIONS[each].beside]
                raise checks.refuse("kind", kind, f"{', '.join(have)}, or the kind that the environment was made with")
            self._observations[name] = self._observation("kind", name)
        return self._observations[name].observe(self.sensing.measurement, self.measured, self.episode)

    def _observation(self, argument: str, kind: Any) -> Observation:
        """Create an observation by its name; ``argument`` is named in errors."""
        observation = OBSERVATIONS.make(argument, kind, self.task)
        observation.watch(self.sensing.sensor)
        if not isinstance(observation.space, spaces.Space):
            raise checks.refuse(f"space of observation {kind!r}", observation.space, "a gymnasium.spaces.Space")
        return observation

    def _resting_command(self) -> Drive:
        """Placeholder command that sizes the buffers of actuators and estimator."""
        shape = (self.worlds, len(self.parts))
        nowhere = new_measurement(*shape)
        nowhere.gone[...] = True
        command = self.action.command(np.zeros((self.worlds, self.action.size), dtype=np.float32), nowhere)
        return check_command(self.options.action, command, self.surface, self.worlds)

    def phasors(self, world: int) -> np.ndarray:
        """Return phasors (rows, columns, 2) of the last step as fractions of full scale; zeros before the first step."""
        return self._all_phasors(world, 1)[0]

    def _all_phasors(self, first: int = 0, worlds: int | None = None) -> np.ndarray:
        """Return phasors (worlds, rows, columns, 2) of ``worlds`` worlds from ``first`` on; None: all."""
        phasors = np.zeros((worlds or self.worlds, self.surface.rows, self.surface.columns, 2))
        if self.drive is not None and self.surface.full_scale > 0.0:
            all_phasors(self.drive, phasors, first)
            phasors /= self.surface.full_scale
        return phasors

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot without the generators."""
        return {
            "environment": self.identity,
            "simulator": self.simulator.get_state(),
            "episode": copied(self._progress()),
            "action": self.action.get_state(),
            "actuators": self.actuators.get_state(),
            "sensor": self.sensing.get_state(),
            "began": self.began,
        }

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of a core with the same settings.

        Raises:
            ValueError: a snapshot of another environment or with invalid values; nothing has changed.
        """
        check_keys("state", state, self.STATE)
        if not isinstance(state["environment"], str) or state["environment"] != self.identity:
            raise checks.refuse("state['environment']", *first_difference(state["environment"], self.identity))
        began = checks.flag("state['began']", state["began"])
        episode = restored("state['episode']", self._progress(), state["episode"])
        action = self.action.check_state(state["action"])
        actuators = self.actuators.check_state(state["actuators"])
        sensor = self.sensing.check_state(state["sensor"])
        self.simulator.set_state(state["simulator"])  # the last call that can raise, before it changes anything
        put_back(self._progress(), episode)
        self.action.set_state(action)
        self.actuators.set_state(actuators)
        self.sensing.set_state(sensor)
        if began:
            if self.sensing.exact:
                self.sensing.reset(NONE, self.simulator.state, np.zeros((0, self.sensing.draws)))
            self.relate(self.pipeline.now.worlds)
        self.drive, self.began = None, began

    def _progress(self) -> dict[str, np.ndarray]:
        """Return live arrays of the episodes."""
        return {
            **self.episode._asdict(),
            **self.relations._asdict(),
            **self.scoring.own_state(),
            **({} if self.disturbances is None else self.disturbances.live()),
            **({} if self.costs is None else self.costs.live()),
            "shown_terms": self.terms,
            "shown_part_terms": self.part_terms,
        }
