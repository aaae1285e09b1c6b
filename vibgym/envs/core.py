"""The batched core of the single and the vector environment: components, resets, observations and snapshots."""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

import numpy as np
from gymnasium import spaces

from vibgym import checks
from vibgym.actuators import ACTUATORS
from vibgym.actuators.commands import check_command
from vibgym.envs.actions import Action, new_action
from vibgym.envs.costs import Costs
from vibgym.envs.drawn import DrawnShapes
from vibgym.envs.info import BatchInfo, InfoData
from vibgym.envs.observations import OBSERVATIONS, Observation, check_batch
from vibgym.envs.options import (
    Options,
    StartOverride,
    first_difference,
    longest_paths,
    parts_from,
    task_settings,
)
from vibgym.envs.randomization import Disturbances, Randomization
from vibgym.envs.starts import Starts
from vibgym.envs.step import Pipeline
from vibgym.physics.core.drive import Drive, all_phasors
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import surface_from
from vibgym.sensing import MEASUREMENT_FEATURES, Sensing, sensing_from
from vibgym.sensing.measurement import new_measurement
from vibgym.simulation import MODELS, Simulator
from vibgym.snapshots import check_keys, copied, restore, restored
from vibgym.tasks import TASKS, Start, Task
from vibgym.tasks.episode import Relations
from vibgym.tasks.reward import CustomReward, GoalReward, Reward

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
        options, surface: of the scene.
        kinds: parts of the worlds.
        shapes: what draws the shapes of the parts; None where they are fixed.
        identity: settings that a snapshot depends on, see :meth:`vibgym.envs.Options.identity`.
        idle: (worlds, parts, 3), or one row for all worlds: velocities of parts that slide in place on elements at rest.
        longest: s, longest path of an episode.
        shape_draws: uniform numbers of an episode for its shapes.
        starts: draws the starts of episodes.
        began: whether an episode has begun.
        episode, relations: progress of every world, and errors and gaps of its parts, by the true state.
        measured: relations by the measured poses.
        reward: replaces that of the kernels, see :meth:`_new_reward`; None: the kernels'.
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
    """Keys of a snapshot; with drawn shapes also ``"kinds"``."""

    pipeline_class: ClassVar[type[Pipeline]] = Pipeline
    """Class of the pipeline; :mod:`vibgym.hardware` has another."""

    def __init__(self, options: Options, worlds: int, make_info: Callable[[InfoData], Any] = BatchInfo) -> None:
        cls = TASKS.choose("task", options.task)
        self.surface = surface_from(options.surface)
        self.options = options = self._with_shapes(options)
        self.kinds = self._new_kinds(cls, worlds)
        numbers = BYTES_OF_ELEMENT * self.surface.rows * self.surface.columns
        self.worlds = checks.fitting("num_envs", worlds, BYTES_OF_WORLD + BYTES_OF_PART * len(self.kinds) + numbers)
        self.periods = options.periods_per_step
        self.actuators = ACTUATORS.make("actuators", options.actuators, self.surface, worlds, self.periods)
        drawn = cls.RANDOMIZED, self.actuators
        self.randomization = Randomization(options.randomize, *drawn, self.surface, self.kinds)
        self.actuators.vary(self.randomization.actuators)
        settings = task_settings(options, cls, self.randomization.task)
        self.task: Task = cls(self.surface, self.kinds, settings=settings)
        self.action = self.new_action()
        self.action.step_time = self.periods * self.surface.period
        self.simulator = self._new_simulator()
        self.starts = Starts(self.task, self.kinds, self.shapes, self.shape_draws, self.simulator.walls)
        disturbance, span = self.randomization.disturbance, self.periods * self.surface.period
        self.disturbances = None if disturbance is None else Disturbances(disturbance, self.simulator, span)
        self.sensing = self._new_sensing()
        measured = (name for quantity in self.sensing.report for name in MEASUREMENT_FEATURES[quantity])
        self.task.features = (*self.task.features, *measured)
        self.observation = self._observation("observation", options.observation)
        self._observations = {options.observation: self.observation}
        self.all_driven = bool(self.task.driven.all())
        self.commanded = self.action.resolve_limits(self.actuators.data_sheet, worlds)
        command = self._resting_command()
        self.actuators.prepare(command)
        self.sensing.prepare(command)
        parts = () if self.kinds.vary else self.parts
        self.identity = options.identity(self.surface, parts, self.simulator.walls, worlds)
        self.idle = self.kinds.values(lambda part: np.append(self.surface.idle_velocity(part.friction), 0.0))
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
            self.costs = Costs(options.costs, *world, self.phasors)
        self.reward = self._new_reward()
        self.term_names: tuple[str, ...] = tuple(self.task.made_of) if self.reward is None else self.reward.names
        for term in self.task.settings.weights:
            if term not in self.term_names:
                raise checks.unknown("term", term, self.term_names, of="task_settings.weights")
        rewarded = self.episode if self.reward is None else self.reward
        self.terms, self.part_terms = rewarded.terms, rewarded.part_terms
        self.make_info, self.by_batch = make_info, make_info is BatchInfo
        # Few worlds: actions are copied to the same memory at every step, so that drives need not be pinned again. For many
        # worlds a copy would take longer.
        few = len(self.simulator.blocks.edges) == 1
        self.kept_action = np.zeros((worlds, self.action.size), dtype=np.float32) if few else None
        self.pipeline = self.pipeline_class(self)
        self.longest = longest_paths(self.task, self.actuators, self.sensing.sensor, options.max_episode_periods)
        self.began = False
        self._checked = False  # the first batch of observations, against their space

    def __getstate__(self) -> dict[str, Any]:
        """Return the state without the pipeline, which has addresses of arrays."""
        return {name: value for name, value in vars(self).items() if name != "pipeline"}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self.pipeline = self.pipeline_class(self)

    def _with_shapes(self, options: Options) -> Options:
        """Return the options with the parts of their shapes, if these are drawn for episodes; sets ``shape_draws``."""
        self.shape_draws, self.shapes = 0, None
        if options.split is None:
            if options.shapes is not None:
                raise checks.conflict("shapes require split, the library that they are from")
            return options
        drawn = DrawnShapes(options)
        self.shape_draws = drawn.draws
        if drawn.shapes is None:
            self.shapes = drawn
            return options
        return drawn.fixed(options, drawn.shapes)

    def _new_kinds(self, task: type[Task], worlds: int) -> Kinds:
        """Return the parts of the worlds.

        Raises:
            ValueError: invalid parts, or drawn shapes with a task that does not support them.
        """
        if self.shapes is None:
            return Kinds.of(parts_from(self.options.parts, task, self.surface))
        parts_from(self.shapes.parts(range(self.shape_draws)), task, self.surface)
        if task.continuous_feed:
            raise checks.conflict(f"split cannot be set for task {self.options.task!r}, whose parts arrive and leave")
        return self.shapes.kinds(worlds)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of the first world."""
        return self.kinds.parts(0)

    def new_action(self) -> Action:
        """Create the action."""
        return new_action(self.options.action, self.surface, self.kinds)

    def _new_simulator(self) -> Simulator:
        """Create the simulator, and check that it supports the conditions that episodes may draw."""
        options, randomization = self.options, self.randomization
        model, settings = MODELS.split("model", options.model)
        if model == "auto":
            settings.setdefault("periods_per_call", self.periods)
        if options.walls is not None and not self.task.HAS_WALLS:
            raise checks.conflict(f"walls cannot be set for task {options.task!r}")
        walls = () if options.walls is None else options.walls
        simulator = Simulator(self.surface, self.kinds, worlds=self.worlds, model=model, walls=walls, **settings)
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
            options.sensor, self.surface, self.kinds, self.worlds, self.periods,
            plant=actuators.nominal(), latency=actuators.latency, walls=self.simulator.walls,
        )  # fmt: skip
        if task.continuous_feed and not sensing.sensor.resets_parts:
            raise checks.conflict(
                f"sensor {options.sensor!r} does not support parts that arrive and leave (task {task.name!r})"
            )
        return sensing

    def _new_reward(self) -> Reward | None:
        """Create the reward that replaces the kernels': of the goal observation, or of the task's override; None: the kernels'.

        Raises:
            ValueError: an invalid override, or weights with a goal reward.
        """
        if self.observation.goal_reward:
            if self.task.settings.weights:
                raise checks.conflict("task_settings.weights cannot be set with observation='goal': see compute_reward")
            return GoalReward(self.observation, self.scoring)
        return CustomReward(self.task, self.scoring, self.phasors) if self.task.has_custom_reward else None

    def reset(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride | None = None
    ) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from the world's generator.

        Args:
            override: reset options that replace drawn values.

        Raises:
            ValueError: an invalid start; only the generators have changed.
        """
        actuators = self.starts.draws
        sensing = actuators + self.actuators.draws
        randomization = sensing + self.sensing.draws
        disturbances = randomization + self.randomization.draws
        total = disturbances + (0 if self.disturbances is None else self.disturbances.draws)
        uniform = np.empty((len(worlds), total))
        for row, generator in zip(uniform, generators, strict=True):
            generator.random(out=row)
        start, kinds = self.starts.draw(worlds, uniform[:, :actuators], override)
        if self.kinds.vary:
            self.kinds.choose(worlds, kinds)
        drawn = self.randomization.values(uniform[:, randomization:disturbances])
        idle = self.idle[self.kinds.rows(worlds)]
        if "friction" in drawn:
            idle = np.array(list(map(self._idle_velocity, worlds.tolist(), drawn["friction"])))
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

    def _idle_velocity(self, world: int, factors: np.ndarray) -> np.ndarray:
        """Return velocities (parts, 3) of parts that slide in place on elements at rest, with friction factors (parts,)."""
        pairs = zip(factors.tolist(), self.kinds.parts(world), strict=True)
        return np.array([np.append(self.surface.idle_velocity(factor * part.friction), 0.0) for factor, part in pairs])

    def check_start(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride
    ) -> None:
        """Raise ValueError if :meth:`reset` would; nothing changes, generators included."""
        uniform = [copy.deepcopy(generator).random(self.starts.draws) for generator in generators]
        self.starts.draw(worlds, np.array(uniform), override)

    def refresh_all(self) -> None:
        """Observe and report all worlds, in a new batch."""
        self.pipeline.allocate()
        self.pipeline.refresh(self.pipeline.now.worlds)
        if not self._checked:
            name, space = f"observation {self.options.observation!r}", self.observation.space
            live = (*self.sensing.measurement, *self.measured, *self.episode)
            check_batch(name, space, self.pipeline.observations, self.worlds, live)
            self._checked = True

    def relate(self, worlds: np.ndarray) -> None:
        """Update the relations by the measured poses in ``worlds`` (index array)."""
        if not self.sensing.exact:
            self.pipeline.now.relate(worlds, self.sensing.measurement.pose, self.sensing.measurement.gone)

    def observed(self, kind: str) -> Any:
        """Return a new batch of another observation of the same instant.

        Args:
            kind: as for ``observation=``.

        Raises:
            ValueError: an unknown observation, or one that task or sensor do not support.
        """
        name = checks.choice("kind", kind, OBSERVATIONS)
        if name not in self._observations:
            if not OBSERVATIONS[name].extra:
                have = [observation for observation in OBSERVATIONS if OBSERVATIONS[observation].extra]
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
        shape = (self.worlds, len(self.kinds))
        nowhere = new_measurement(*shape)
        nowhere.gone[...] = True
        command = self.action.command(np.zeros((self.worlds, self.action.size), dtype=np.float32), nowhere)
        return check_command(self.options.action, command, self.surface, self.worlds)

    def phasors(self, world: int | None = None) -> np.ndarray:
        """Return phasors (rows, columns, 2) of a world in the last step over full scale; zeros before the first step.

        Args:
            world: None: of all worlds, (worlds, rows, columns, 2).
        """
        first, worlds = (0, self.worlds) if world is None else (world, 1)
        phasors = np.zeros((worlds, self.surface.rows, self.surface.columns, 2))
        if self.drive is not None and self.surface.full_scale > 0.0:
            all_phasors(self.drive, phasors, first)
            phasors /= self.surface.full_scale
        return phasors if world is None else phasors[0]

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
            **({"kinds": self.kinds.kind.copy()} if self.kinds.vary else {}),
        }

    @property
    def state_keys(self) -> tuple[str, ...]:
        """Keys of a snapshot."""
        return (*self.STATE, "kinds") if self.kinds.vary else self.STATE

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of a core with the same settings.

        Raises:
            ValueError: a snapshot of another environment or with invalid values; nothing has changed.
        """
        check_keys("state", state, self.state_keys)
        if not isinstance(state["environment"], str) or state["environment"] != self.identity:
            raise checks.refuse("state['environment']", *first_difference(state["environment"], self.identity))
        began = checks.flag("state['began']", state["began"])
        episode = restored("state['episode']", self._progress(), state["episode"])
        action = self.action.check_state(state["action"])
        actuators = self.actuators.check_state(state["actuators"])
        sensor = self.sensing.check_state(state["sensor"])
        before = self.kinds.kind.copy()
        if self.kinds.vary:
            self.kinds.choose(slice(None), checked_kinds(self.kinds, state["kinds"]))
        try:
            self.simulator.set_state(state["simulator"])  # the last call that can raise, before it changes anything
        except ValueError:
            if self.kinds.vary:
                self.kinds.choose(slice(None), before)
            raise
        restore(self._progress(), episode)
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
            **self.scoring.custom_state(),
            **({} if self.disturbances is None else self.disturbances.live()),
            **({} if self.costs is None else self.costs.live()),
            "shown_terms": self.terms,
            "shown_part_terms": self.part_terms,
        }


def checked_kinds(kinds: Kinds, values: Any) -> np.ndarray:
    """Return the kinds of a snapshot, (worlds, parts) int64.

    Raises:
        ValueError: another shape, or a kind that a part cannot have.
    """
    index = checks.shaped("state['kinds']", values, (kinds.kind.shape,), "whole numbers", kinds="iu")
    for part, options in enumerate(kinds.options):
        if not np.isin(index[:, part], options).all():
            raise checks.refuse(
                f"state['kinds'] of part {part}", index[:, part].tolist(), f"numbers among {list(options)}"
            )
    return index.astype(np.int64)
