"""A step of a batch of worlds: a list of stages, which :class:`vibgym.envs.core.Core` inherits.

Data flow (the stages are listed in :meth:`Pipeline._list_stages`):

    action -> command -> actuators -> drive -> simulation -> true state -> task: reward, info
                                                               \\-> sensor -> measurement -> observation
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import groupby
from operator import attrgetter
from typing import Any, NamedTuple

import numpy as np

from vibgym.actuators import ActuatorStage
from vibgym.envs.actions import Action, all_finite_in_blocks, copy_finite
from vibgym.envs.costs import Costs
from vibgym.envs.info import InfoData
from vibgym.envs.observations import GoalReward, Observation, RowObservation, Writer
from vibgym.envs.randomization import Disturbances, Randomization
from vibgym.sensing import Sensing
from vibgym.simulation import Simulator
from vibgym.tasks import Task
from vibgym.tasks.episode import Episode, Relations
from vibgym.tasks.scoring import OwnReward, Scoring


class Stage(NamedTuple):
    """A stage of a step."""

    group: str  # part of a step that it belongs to, see docs/code.md
    run: Callable[..., None]  # without arguments; by block: with the number of a block of worlds
    by_block: bool = False  # whether it runs block by block, on several threads
    needed: bool = True  # with these settings


class Block(NamedTuple):
    """A block of worlds, and kernels with separate scratch memory, since several blocks run at the same time."""

    worlds: np.ndarray  # (n,) index
    score: list[Callable[[np.ndarray], None]]
    relate: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    write: list[Writer]  # one per array of a batch of observations


class Pipeline:
    """The stages of a step, and all objects with addresses of the components' arrays.

    A subclass sets the components and calls :meth:`_bind`.

    Attributes:
        info: makes ``info``.
        report: fields of ``info`` of the last step; batches only.
        observations: batch of observations of the last step.
    """

    worlds: int
    periods: int  # of a step
    task: Task
    action: Action
    actuators: ActuatorStage
    simulator: Simulator
    randomization: Randomization
    disturbances: Disturbances | None
    costs: Costs | None
    sensing: Sensing
    observation: Observation
    scoring: Scoring
    episode: Episode  # progress of every world, by the true state
    relations: Relations  # errors and gaps of the parts by the true state
    drive: Any  # the last one that was executed
    term_names: tuple[str, ...]  # of the reward
    terms: np.ndarray  # (worlds, terms) of the reward
    part_terms: np.ndarray  # (worlds, parts, terms)
    _measured: Relations  # by the measured poses
    _reward: OwnReward | GoalReward | None  # replaces that of the kernels
    _commanded: dict[str, np.ndarray]  # live arrays (worlds, ...) for info["commanded"]
    _all_driven: bool  # whether the task drives all parts
    _kept_action: np.ndarray | None  # (worlds, size) memory that actions are copied to
    _make_info: Callable[[InfoData], Any]
    _by_batch: bool  # whether info is that of a batch

    def step(self, action: np.ndarray, given: Any = None) -> None:
        """Advance every world by one step under an action: run the stages of :meth:`_list_stages`.

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
        """Return the stages of a step in order, without those that the settings do not need."""
        estimated, flows, by_kernel = not self.sensing.exact, self.task.flows, self._rows is not None
        stages = (
            Stage("decode", self._decode),
            Stage("prepare", self._allocate),
            Stage("prepare", self._store_state, needed=isinstance(self._reward, OwnReward)),
            Stage("actuate", self._disturb, needed=self.disturbances is not None),
            Stage("advance", self._actuate_and_advance),
            Stage("score", self._score, by_block=True),
            Stage("score", self._replace_reward, needed=self._reward is not None),
            Stage("score", self._score_costs, needed=self.costs is not None),
            Stage("sense", self._sense, needed=estimated),
            Stage("observe", self._relate, by_block=True, needed=estimated),
            Stage("observe", self._write_observations, by_block=True, needed=by_kernel),
            Stage("report", self._write_report, by_block=True, needed=self._by_batch),
            Stage("observe", self._observe, needed=not by_kernel),  # in Python: last, so that blocks need one pass only
            Stage("renew", self._renew_parts, needed=flows),
        )
        return tuple(stage for stage in stages if stage.needed)

    def _bind_stages(self) -> None:
        """Build the pipeline of a step. Consecutive stages by block share one pass over the blocks.

        Those that follow the advance run for each block on the thread that has advanced it.
        """
        self._pipeline: list[Callable[[], None]] = []
        before = ""
        for by_block, group in groupby(self._list_stages(), attrgetter("by_block")):
            stages = list(group)
            runs = [stage.run for stage in stages]
            if not by_block:
                self._pipeline += runs
            elif before == "advance":
                self._after_advance = runs
            else:
                self._pipeline.append(partial(self._run_by_block, runs))
            before = stages[-1].group

    def _run_by_block(self, runs: Sequence[Callable[[int], None]]) -> None:
        """Run stages for every block, on all threads."""

        def work(k: int) -> None:
            for run in runs:
                run(k)

        self.simulator.blocks.run(work)

    def _decode(self) -> None:
        """Compute the command from the action; parts that are not driven count as gone."""
        values = self._action
        if self._kept_action is not None:
            finite, values = copy_finite(values, self._kept_action), self._kept_action
        else:
            finite = all_finite_in_blocks(values, self.simulator.blocks)
        if not finite:
            raise self.action.not_finite(self._action if self._given is None else self._given)
        measurement = self._measurement
        if not self._all_driven:
            measurement = measurement._replace(gone=measurement.gone | ~self.task.driven)
        self._command = self.action.command(values, measurement)

    def _allocate(self) -> None:
        """Allocate a new batch of observations and reports; returned arrays are never overwritten."""
        if self._rows is not None:
            self._arrays, self.observations = self._rows.fresh(self.worlds)
        if self._by_batch:
            self.report = self.info.allocate()

    def _store_state(self) -> None:
        """Store the state before the step, for a task that overrides the reward."""
        self._reward.begin_step()  # type: ignore[union-attr]

    def _disturb(self) -> None:
        """Apply impulse disturbances at random times."""
        self.disturbances.strike(self.episode.present)  # type: ignore[union-attr]

    def _actuate_and_advance(self) -> None:
        """Advance all worlds under the drives that the actuators execute; the sensor samples the state at its instant."""
        advance, sensing, elapsed = self._advance, self.sensing, 0
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
        """Score the step of a block by the true state."""
        block = self._blocks[k]
        for score in block.score:
            score(block.worlds)

    def _replace_reward(self) -> None:
        """Replace the reward by that of the task's method, or of the goal observation."""
        self._reward.score()  # type: ignore[union-attr]

    def _score_costs(self) -> None:
        """Compute the costs of the step."""
        self.costs.score()  # type: ignore[union-attr]

    def _sense(self) -> None:
        """Predict the measurement under the command, and correct it by the reading that is due."""
        self.sensing.predict(self._command)
        self.sensing.correct()
        if self.task.flows and self.scoring.changed.any():  # parts that have arrived or left
            self.sensing.renew(self.scoring.changed, self.simulator.state)

    def _relate(self, k: int) -> None:
        """Compute errors and gaps of a block by the measured poses."""
        block, measured = self._blocks[k], self._measurement
        block.relate(block.worlds, measured.pose, measured.gone)

    def _write_observations(self, k: int) -> None:
        """Write the observations of a block."""
        block = self._blocks[k]
        for write, array in zip(block.write, self._arrays):
            write(block.worlds, array)

    def _observe(self) -> None:
        """Compute observations that are implemented in Python."""
        self.observations = self.observe()

    def _write_report(self, k: int) -> None:
        """Write the fields of ``info`` of a block."""
        self.info.write(self._blocks[k].worlds, *self.report)

    def _renew_parts(self) -> None:
        """Reset the memory of the action and the model for parts that have arrived or left."""
        changed = self.scoring.changed
        if changed.any():
            for memory in self.action.live().values():
                if memory.shape[:2] == changed.shape:
                    memory[changed] = 0
            self.simulator.renew(changed)

    BOUND = (
        "info", "report", "observations", "_advance", "_arrays", "_blocks", "_now", "_after_advance", "_pipeline",
        "_measurement",
    )  # fmt: skip
    """Attributes with addresses or views of the core's arrays; copies recreate them."""

    def __getstate__(self) -> dict[str, Any]:
        return {name: value for name, value in vars(self).items() if name not in self.BOUND}

    def __setstate__(self, state: dict[str, Any]) -> None:
        vars(self).update(state)
        self._bind()

    def _bind(self) -> None:
        """Create all objects with addresses or views of the core's arrays."""
        state, sensing, scoring, observation = self.simulator.state, self.sensing, self.scoring, self.observation
        drawn = {name: getattr(state, name) for name in self.randomization.ranges} | self.actuators.drawn()
        nested = {"drawn": drawn, "measured": sensing.facts(), "commanded": self._commanded}
        part_extra = {**scoring.part_facts(), **self.simulator.part_info()}
        if self.disturbances is not None:
            part_extra["struck"] = self.disturbances.struck
        facts, costs = scoring.facts(), self.costs
        self._advance = self.simulator.go_on
        if costs is not None:
            facts, nested["costs"], part_extra["cost"] = {**facts, "cost": costs.total}, costs.named, costs.part
            if costs.needs_impulse:
                self._advance = costs.advance
        data = InfoData(
            self.task.FACTS, facts, self.episode, state.diverged, self.term_names, self.terms, self.part_terms,
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
        self._now = self._new_block(everyone)  # for use outside of steps
        self._blocks = [self._new_block(everyone[start:stop]) for start, stop in self.simulator.blocks.edges]
        self._bind_stages()

    def _new_block(self, worlds: np.ndarray) -> Block:
        """Return a block of worlds with new scratch memory."""
        rows = self._rows
        write = [] if rows is None else rows.writers(self._measurement, self._measured, self.episode)
        return Block(worlds, self.scoring.stages(), self.scoring.relating(self._measured), write)

    def relate(self, worlds: np.ndarray) -> None:
        """Update the relations by the measured poses in ``worlds`` (index array)."""
        if not self.sensing.exact:
            self._now.relate(worlds, self.sensing.measurement.pose, self.sensing.measurement.gone)

    def refresh(self, worlds: np.ndarray) -> None:
        """Update observations and reports of ``worlds`` (index array), whose episodes have just begun, in the present batch."""
        if self._by_batch:
            self.info.write(worlds, *self.report)
        for write, array in zip(self._now.write, self._arrays):
            write(worlds, array)
        if self._rows is None:
            self._observe()

    def observe(self) -> Any:
        """Return a new batch of observations."""
        return self.observation.observe(self.sensing.measurement, self._measured, self.episode)
