"""The batched core of the single and the vector environment: worlds of one task, stepped together.

Data flow of a step (the stages are listed in :meth:`Core._list_stages`):

    action -> command -> actuators -> drive -> simulation -> true state -> task: reward, info
                                                               \\-> sensor -> measurement -> observation
"""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from itertools import groupby
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.actuators import actuators_from, nominal
from vibgym.config import surface_from
from vibgym.envs.actions import ACTIONS, all_finite_in_blocks, check_command, copy_finite
from vibgym.envs.info import BatchInfo, InfoData
from vibgym.envs.observations import OBSERVATIONS, Observation, RowObservation, Writer, check_batch
from vibgym.envs.options import Options, StartOverride, longest_paths, parts_from, step_limit, task_settings
from vibgym.envs.randomization import Disturbances, Randomization
from vibgym.physics.core.drive import Drive, all_phasors
from vibgym.sensing import MEASUREMENT_FEATURES, sensing_from
from vibgym.sensing.measurement import Measurement, new_measurement
from vibgym.simulation import MODELS, Simulator
from vibgym.snapshots import check_keys, copied, put_back, restored
from vibgym.tasks import TASKS, Start, Task
from vibgym.tasks.episode import new_relations
from vibgym.tasks.scoring import OwnReward
from vibgym.tasks.scoring import Stage as Kernel

NONE = np.zeros(0, dtype=np.int64)

BYTES_OF_WORLD, BYTES_OF_PART, BYTES_OF_ELEMENT = 2000, 1000, 64
"""Least memory of a world: its generator, arrays of the parts, and actions and drives of the elements."""

MOST_PERIODS = 1_000_000
"""Of a step: eleven hours of simulated time."""


class Stage(NamedTuple):
    """A stage of a step."""

    run: Callable[..., None]  # without arguments, or with the number of a block of worlds
    by_block: bool = False  # whether it runs block by block, on the thread that has advanced the block
    needed: bool = True  # with these settings


class Block(NamedTuple):
    """A block of worlds, and kernels with scratch memory of its own: several blocks run at the same time."""

    worlds: np.ndarray  # (n,) index
    score: list[Kernel]
    relate: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    write: list[Writer]  # one per array of a batch of observations


class Core:
    """Task, action, actuators, simulator, sensor and observation of ``worlds`` worlds.

    Args:
        options: settings of the environment.
        worlds: number of worlds.
        make_info: class that makes ``info``; a batch writes it world by world.

    Attributes:
        options: as given.
        episode: progress of every world, by the true state.  relations: errors and gaps of the parts by the true state.
        info: makes ``info``.
        report: fields of ``info`` of the last step; batches only.
        observations: batch of observations of the last step.
        term_names, terms: names of the reward terms, and their values (worlds, terms).
        part_terms: their values for each part alone, (worlds, parts, terms).
        step_limit: steps after which episodes are truncated, or None.  longest: s, longest path of an episode.

    Raises:
        ValueError: an invalid setting.
    """

    STATE = ("environment", "simulator", "episode", "action", "actuators", "sensor", "began")
    """Keys of a snapshot."""

    def __init__(self, options: Options, worlds: int, make_info: Callable[[InfoData], Any] = BatchInfo) -> None:
        cls = TASKS.choose("task", options.task)
        self.options = options
        self.surface = surface_from(options.surface)
        self.parts = parts_from(options.parts, cls)
        numbers = BYTES_OF_ELEMENT * self.surface.rows * self.surface.columns
        self.worlds = checks.fitting("num_envs", worlds, BYTES_OF_WORLD + BYTES_OF_PART * len(self.parts) + numbers)
        self.periods = checks.count("periods_per_step", options.periods_per_step, most=MOST_PERIODS)
        self.actuators = actuators_from(options.actuators, self.surface, worlds, self.periods)
        names = cls.RANDOMIZED, self.actuators.VARIED
        self.randomization = Randomization(options.randomize, *names, self.surface, self.parts)
        self.actuators.vary(self.randomization.actuators)
        settings, weights = task_settings(options, cls, self.randomization.task)
        self.task: Task = checks.made("task", cls, (self.surface, self.parts), settings)
        self.task.weigh(weights)
        self.action = ACTIONS.choose("action", options.action)(self.surface, self.parts)
        model, knobs = checks.named("model", options.model, MODELS)
        if model == "auto":
            knobs.setdefault("periods_per_call", self.periods)
        if options.walls is not None and not cls.HAS_WALLS:
            raise checks.conflict(f"walls cannot be set for task {options.task!r}")
        walls = () if options.walls is None else options.walls
        self.simulator = Simulator(self.surface, self.parts, worlds=worlds, model=model, walls=walls, **knobs)
        if "patches" in self.randomization.ranges:
            self.simulator.allocate_patches()
        disturbance, span = self.randomization.disturbance, self.periods * self.surface.period
        self.disturbances = None if disturbance is None else Disturbances(disturbance, self.simulator, span)
        self.sensing = sensing_from(
            options.sensor, self.surface, self.parts, worlds, self.periods,
            plant=nominal(self.actuators), latency=self.actuators.latency, walls=walls,
        )  # fmt: skip
        if self.task.flows and not self.sensing.sensor.renews:
            raise checks.conflict(
                f"sensor {options.sensor!r} does not support parts that arrive and leave (task {self.task.name!r})"
            )
        measured = (name for each in self.sensing.tell for name in MEASUREMENT_FEATURES[each])
        self.task.features = (*self.task.features, *measured)
        self.observation = self._observation("observation", options.observation)
        self._observations = {options.observation: self.observation}
        self._all_driven = bool(self.task.driven.all())
        self._commanded = self.action.resolve_limits(self.actuators.data_sheet, worlds)
        command = self._resting_command()
        self.actuators.prepare(command)
        self.sensing.prepare(command)
        if self.randomization.ranges:
            extremes = self.randomization.extremes()
            self.simulator.check_conditions(extremes, extremes._asdict(), "randomize[{!r}]")
        self.identity = _identity(options, self)
        self.idle = self._idle_velocity(np.ones(len(self.parts)))
        # Arrays of the state and of the scoring live as long as the core and are changed in place.
        state = self.simulator.state
        self.scoring = self.task.scoring(state, self.periods)
        self.episode, self.relations = self.scoring.episode, self.scoring.relations
        # An exact sensor needs no relations by measured poses.
        self._measured = self.relations
        if self.sensing.exact:
            self.sensing.reset(NONE, state, np.zeros((0, 0)))
        else:
            self._measured = new_relations(worlds, len(self.parts))
        self.drive: Any = None
        self._own_reward: OwnReward | None = None
        self._choose_reward(weights)
        self._make_info = make_info
        self._by_batch = make_info is BatchInfo
        # Few worlds: actions are copied to the same memory at every step, so that drives need not be pinned again. For many
        # worlds a copy would take longer.
        few = len(self.simulator.blocks.edges) == 1
        self._kept_action = np.zeros((worlds, self.action.size), dtype=np.float32) if few else None
        self._bind()
        self.step_limit = step_limit(self.periods, options.max_episode_periods)
        self.longest = longest_paths(self.task, self.actuators, self.sensing.sensor, options.max_episode_periods)
        self.began = False
        self._checked = False  # the first batch of observations, against their space

    def step(self, action: np.ndarray, given: Any = None) -> None:
        """Advance every world by one step under an action, score it, measure and observe.

        The stages are those of :meth:`_list_stages`.

        Args:
            action: float32 (worlds, size), see :meth:`vibgym.envs.actions.Action.shaped`.
            given: the action before conversion, for errors.

        Raises:
            ValueError: a number that is not finite; nothing has changed.
        """
        self._action, self._given = action, given
        for run in self._pipeline:
            run()

    def _list_stages(self) -> tuple[Stage, ...]:
        """List the stages of a step in order; stages that these settings do not need are left out."""
        exact, rows, own_reward = self.sensing.exact, self._rows is not None, self._own_reward is not None
        flows = self.task.flows
        stages = (
            Stage(self._decode),
            Stage(self._allocate),
            Stage(self._predict, needed=not exact),
            Stage(self._begin_own_reward, needed=own_reward),
            Stage(self._disturb, needed=self.disturbances is not None),
            Stage(self._actuate_and_advance),
            Stage(self._score, by_block=True),
            Stage(self._reward_by_task, needed=own_reward),
            Stage(self._reward_goals, needed=self.observation.goal_reward),
            Stage(self._correct, needed=not exact),
            Stage(self._renew_measurement, needed=not exact and flows),
            Stage(self._relate, by_block=True, needed=not exact),
            Stage(self._write_rows, by_block=True, needed=rows),
            Stage(self._write_report, by_block=True, needed=self._by_batch),
            Stage(self._observe, needed=not rows),
            Stage(self._clear_departed, needed=flows),
        )
        return tuple(stage for stage in stages if stage.needed)

    def _run_by_block(self, stages: Sequence[Callable[[int], None]]) -> None:
        """Run block stages on all threads."""

        def work(k: int) -> None:
            for run in stages:
                run(k)

        self.simulator.blocks.run(work)

    def _decode(self) -> None:
        """Compute the command from the action."""
        values = self._action
        if self._kept_action is not None:
            finite, values = copy_finite(values, self._kept_action), self._kept_action
        else:
            finite = all_finite_in_blocks(values, self.simulator.blocks)
        if not finite:
            raise self.action.not_finite(self._action if self._given is None else self._given)
        self._command = self.action.command(values, self._measurement if self._all_driven else self._driven_alone())

    def _driven_alone(self) -> Measurement:
        """Return the measurement for actions, in which parts that are not driven count as gone."""
        measurement = self._measurement
        return measurement._replace(gone=measurement.gone | ~self.task.driven)

    def _allocate(self) -> None:
        """Begin a batch of observations and reports: arrays that were handed out are not written again."""
        if self._rows is not None:
            self._arrays, self.observations = self._rows.fresh(self.worlds)
        if self._by_batch:
            self.report = self.info.allocate()

    def _predict(self) -> None:
        """Predict the state under the command."""
        self.sensing.predict(self._command)

    def _begin_own_reward(self) -> None:
        """Store the state before the step, for a task with its own reward."""
        self._own_reward.begin_step()  # type: ignore[union-attr]

    def _disturb(self) -> None:
        """Disturb parts at random times."""
        self.disturbances.strike(self.episode.present)  # type: ignore[union-attr]

    def _actuate_and_advance(self) -> None:
        """Advance all worlds under the drives of the command; the sensor samples the state at its instant."""
        advance, sensing, elapsed = self.simulator.go_on, self.sensing, 0
        instant = None if sensing.exact else sensing.instant
        for drive, periods in self.actuators.apply(self._command):
            self.drive = drive
            end = elapsed + periods
            if instant is not None and elapsed < instant < end:
                advance(drive, instant - elapsed)
                sensing.look(self.simulator.state)
                elapsed = instant
            advance(drive, end - elapsed, self._after_advance if end == self.periods else ())
            if end == instant:
                sensing.look(self.simulator.state)
            elapsed = end

    def _score(self, k: int) -> None:
        """Score the step by the true state."""
        block = self._blocks[k]
        for score in block.score:
            score(block.worlds)

    def _reward_by_task(self) -> None:
        """Replace the reward by that of the task's own method."""
        self._own_reward.score()  # type: ignore[union-attr]

    def _reward_goals(self) -> None:
        """Replace the reward by that of the goal observation."""
        state, present, reached = self.simulator.state, self.episode.present, self.observation.reached  # type: ignore[attr-defined]
        goal_reward = self.task.compute_reward  # type: ignore[attr-defined]
        reward = goal_reward(reached(state.pose), reached(self.episode.goal), {"fallen": self.episode.fallen})
        self.episode.reward[:] = reward
        self.terms[:, 0] = reward
        self.episode.part_reward[:] = self.part_terms[..., 0] = np.where(present, reward[:, None], 0.0)

    def _correct(self) -> None:
        """Correct the measurement by the reading that is due."""
        self.sensing.correct()

    def _renew_measurement(self) -> None:
        """Restart the estimates of parts that have arrived or left."""
        if self.scoring.changed.any():
            self.sensing.renew(self.scoring.changed, self.simulator.state)

    def _relate(self, k: int) -> None:
        """Compute errors and gaps by the measured poses."""
        block, measured = self._blocks[k], self._measurement
        block.relate(block.worlds, measured.pose, measured.gone)

    def _write_rows(self, k: int) -> None:
        """Write the observations of a block."""
        block = self._blocks[k]
        for write, array in zip(block.write, self._arrays):
            write(block.worlds, array)

    def _write_report(self, k: int) -> None:
        """Write the fields of ``info`` of a block."""
        self.info.write(self._blocks[k].worlds, *self.report)

    def _observe(self) -> None:
        """Compute an observation that is implemented in Python."""
        self.observations = self.observe()

    def _clear_departed(self) -> None:
        """Clear the memory of the action and the model for parts that have arrived or left."""
        changed = self.scoring.changed
        if changed.any():
            for memory in self.action.live().values():
                if memory.shape[:2] == changed.shape:
                    memory[changed] = 0
            self.simulator.renew(changed)

    def _choose_reward(self, weights: Mapping[str, Any]) -> None:
        """Select the reward source: built-in kernel, task override or goal reward.

        Raises:
            ValueError: reward terms without a weight, or weights with a goal reward.
        """
        worlds, parts = self.worlds, len(self.parts)
        self.term_names: tuple[str, ...] = tuple(self.task.made_of)
        self.terms, self.part_terms = self.episode.terms, self.episode.part_terms
        if self.observation.goal_reward:
            if weights:
                raise checks.conflict(
                    "task_settings['weights'] cannot be set with observation='goal': see compute_reward"
                )
            self.term_names = ("goal",)
            self.terms, self.part_terms = np.zeros((worlds, 1)), np.zeros((worlds, parts, 1))
        elif self.task.has_own_reward:
            state = self.simulator.state
            self._own_reward = own = OwnReward(self.task, self.scoring, state, self.periods, self._all_phasors, weights)
            self.term_names, self.terms, self.part_terms = own.names, own.terms, own.part_terms

    BOUND = (
        "info", "report", "observations", "_arrays", "_blocks", "_now", "_after_advance", "_pipeline", "_measurement",
    )  # fmt: skip
    """Attributes that hold addresses or views of the core's arrays; copies create them again."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in self.BOUND}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()

    def _bind(self) -> None:
        """Create everything that holds addresses or views of the core's own arrays."""
        state, sensing, scoring, observation = self.simulator.state, self.sensing, self.scoring, self.observation
        drawn = {name: getattr(state, name) for name in self.randomization.ranges} | self.actuators.drawn()
        nested = {"drawn": drawn, "measured": sensing.facts(), "commanded": self._commanded}
        part_extra = {**scoring.part_facts(), **self.simulator.part_info()}
        if self.disturbances is not None:
            part_extra["struck"] = self.disturbances.struck
        data = InfoData(
            self.task.FACTS, scoring.facts(), self.episode, state.diverged, self.term_names, self.terms, self.part_terms,
            {name: each for name, each in nested.items() if each}, part_extra,
        )  # fmt: skip
        self.info = self._make_info(data)
        self.report: Any = None
        self.observations: Any = None
        self._arrays: list[np.ndarray] = []
        self._measurement = sensing.measurement  # its arrays are live
        # A subclass of an observation that kernels write may override observe().
        by_rows = isinstance(observation, RowObservation) and type(observation).observe is RowObservation.observe
        self._rows: RowObservation | None = observation if by_rows else None  # type: ignore[assignment]
        everyone = np.arange(self.worlds)
        self._now = self._new_block(everyone)  # outside of steps
        self._blocks = [self._new_block(everyone[start:stop]) for start, stop in self.simulator.blocks.edges]
        by_block = groupby(self._list_stages(), lambda stage: stage.by_block)
        groups = [[stage.run for stage in group] for _, group in by_block]  # those at odd positions are of blocks
        # The thread that has advanced a block runs the first block stages right away.
        self._pipeline, self._after_advance = groups[0], groups[1]
        for position, group in enumerate(groups[2:]):
            self._pipeline += [partial(self._run_by_block, group)] if position % 2 else group

    def _new_block(self, worlds: np.ndarray) -> Block:
        """Return a block of worlds with scratch memory of its own."""
        rows = self._rows
        write = [] if rows is None else rows.writers(self._measurement, self._measured, self.episode)
        return Block(worlds, self.scoring.stages(), self.scoring.relating(self._measured), write)

    def reset(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride | None = None
    ) -> None:
        """Begin new episodes in ``worlds`` (index array), each drawn from its own generator.

        Args:
            override: reset options that replace drawn values.

        Raises:
            ValueError: an invalid start; only the generators have changed.
        """
        draws = [each.draws for each in (self.task, self.actuators, self.sensing, self.randomization)]
        total = sum(draws) + (0 if self.disturbances is None else self.disturbances.draws)
        uniform = np.array([generator.random(total) for generator in generators])
        of_task, of_actuators, of_sensor, of_conditions, of_disturbances = np.split(uniform, np.cumsum(draws), axis=1)
        start = self.start_of(worlds, of_task, override)
        drawn = self.randomization.values(of_conditions)
        idle = self.idle
        if "friction" in drawn:
            idle = np.array([self._idle_velocity(factors) for factors in drawn["friction"]])
        self.put(worlds, start, np.where(start.present[..., None], idle, 0.0))
        self.simulator.condition(worlds, drawn)
        self.actuators.reset(worlds, of_actuators)
        self.sensing.reset(worlds, self.simulator.state, of_sensor)
        if self.disturbances is not None:
            self.disturbances.reset(worlds, of_disturbances)
        self.relate(worlds)

    def put(self, worlds: np.ndarray, start: Start, velocity: Any, mean_velocity: Any = 0.0) -> None:
        """Place the parts of ``worlds`` (index array), at rest or in motion, and start scoring.

        With ideal actuators and sensor this is a complete reset; planners use it to continue from a measured state.

        Args:
            velocity, mean_velocity: (n, parts, 3) at this instant, and over the last period, m/s, m/s, rad/s.
        """
        self.simulator.place(worlds, start.pose, velocity, mean_velocity, ~start.present)
        self.scoring.begin(worlds, start)
        if self.terms is not self.episode.terms:  # those have just been set
            self.terms[worlds], self.part_terms[worlds] = 0.0, 0.0
        for memory in self.action.live().values():
            memory[worlds] = 0
        self.began = True

    def _idle_velocity(self, factors: np.ndarray) -> np.ndarray:
        """Return velocities (parts, 3) of parts that slide in place on elements at rest, with friction factors (parts,)."""
        pairs = zip(factors.tolist(), self.parts, strict=True)
        return np.array([np.append(self.surface.idle_velocity(each * part.friction), 0.0) for each, part in pairs])

    def start_of(self, worlds: np.ndarray, uniform: np.ndarray, override: StartOverride | None) -> Start:
        """Return the start of a reset from uniform numbers (n, task.draws) and reset options."""
        if override is None:
            return self.task.start(uniform)
        return override.start(self.task, self.simulator, worlds, uniform)

    def relate(self, worlds: np.ndarray) -> None:
        """Update the relations by the measured poses in ``worlds`` (index array)."""
        if not self.sensing.exact:
            self._now.relate(worlds, self.sensing.measurement.pose, self.sensing.measurement.gone)

    def refresh(self, worlds: np.ndarray) -> None:
        """Observe and report ``worlds`` (index array) again in the present batch: their episodes have just begun."""
        if self._by_batch:
            self.info.write(worlds, *self.report)
        for write, array in zip(self._now.write, self._arrays):
            write(worlds, array)
        if self._rows is None:
            self._observe()

    def refresh_all(self) -> None:
        """Observe and report all worlds, in a new batch."""
        self._allocate()
        self.refresh(self._now.worlds)
        if not self._checked:
            name, space = f"observation {self.options.observation!r}", self.observation.space
            check_batch(name, space, self.observations, self.worlds)
            self._checked = True

    def observe(self) -> Any:
        """Return a new batch of observations."""
        return self.observation.observe(self.sensing.measurement, self._measured, self.episode)

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
                raise checks.refuse("kind", kind, f"{', '.join(have)}, or what the environment was made with")
            self._observations[name] = self._observation("kind", name)
        return self._observations[name].observe(self.sensing.measurement, self._measured, self.episode)

    def _observation(self, argument: str, kind: Any) -> Observation:
        """Create an observation by its name; ``argument`` is named in errors."""
        observation = OBSERVATIONS.choose(argument, kind)(self.task)
        observation.watch(self.sensing.sensor)
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
            raise checks.refuse("state['environment']", *_difference(state["environment"], self.identity))
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
            self.relate(self._now.worlds)
        self.drive, self.began = None, began

    def _progress(self) -> dict[str, np.ndarray]:
        """Return live arrays of the episodes."""
        return {
            **self.episode._asdict(),
            **self.relations._asdict(),
            **self.scoring.own_state(),
            **({} if self.disturbances is None else self.disturbances.live()),
            "shown_terms": self.terms,
            "shown_part_terms": self.part_terms,
        }


def _identity(options: Options, core: Core) -> str:
    """Return the settings that a snapshot depends on, as JSON."""

    def plain(value: Any) -> Any:
        return value.tolist() if isinstance(value, np.ndarray | np.generic) else repr(value)

    content = {
        **options.of_state(),
        "surface": vars(core.surface),
        "parts": [part.to_dict() for part in core.parts],
        "walls": core.simulator.walls,
        "worlds": core.worlds,
    }
    return json.dumps(content, sort_keys=True, default=plain)


def _difference(theirs: Any, mine: str) -> tuple[str, str]:
    """Return the first setting that differs, in the snapshot and here."""
    try:
        other, own = json.loads(theirs), json.loads(mine)
        name = next(key for key in own if other.get(key) != own[key])
        return f"a state of another environment, with {name}={other.get(name)!r}", f"{name}={own[name]!r}"
    except (TypeError, ValueError, AttributeError, StopIteration, RecursionError):
        return checks.shown(theirs), "the description of an environment with these settings"
