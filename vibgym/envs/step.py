"""A step of a batch of worlds: three lists of stages in order.

Data flow:

    action -> command -> actuators -> drive -> simulation -> true state -> task: reward, info
                                                               \\-> sensor -> measurement -> observation
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from vibgym.envs.actions import all_finite_in_blocks, copy_finite
from vibgym.envs.info import InfoData
from vibgym.envs.observations import RowObservation, Writer

if TYPE_CHECKING:
    from vibgym.envs.core import Core


class Batch(SimpleNamespace):
    """What the stages of one step pass on."""

    action: np.ndarray
    """float32 (worlds, size), see :meth:`vibgym.envs.actions.Action.shaped`."""

    original: Any
    """The action before conversion, for errors."""

    command: Any
    """Of the elements."""


class Block(NamedTuple):
    """A block of worlds, and kernels with separate scratch memory, since several blocks run at the same time."""

    worlds: np.ndarray  # (n,) index
    score: list[Callable[[np.ndarray], None]]
    relate: Callable[[np.ndarray, np.ndarray, np.ndarray], None]
    write: list[Writer]  # one per array of a batch of observations


class Pipeline:
    """The stages of a step of a core, and all objects with addresses of its components' arrays.

    Args:
        core: its components exist; copies of a core get a new pipeline.

    Attributes:
        before: stages before the advance, called with the :class:`Batch`.
        by_block: stages of each block that follow its advance, on the thread that has advanced it.
        score: those of them that score a block's step by the true state.
        after: stages after all blocks, called with the batch.
        info: makes ``info``.
        report: fields of ``info`` of the last step; batches only.
        observations: batch of observations of the last step.
        now: block of all worlds, for use outside of steps.
    """

    def __init__(self, core: Core) -> None:
        self.core = core
        self.report: Any = None
        self.observations: Any = None
        self.measurement = core.sensing.measurement  # its arrays are live
        self._aim = self.measurement  # of the action
        if not core.all_driven:
            self._aim = self.measurement._replace(gone=np.zeros_like(self.measurement.gone))
        # A subclass of an observation that kernels write may override observe().
        observation = core.observation
        by_rows = isinstance(observation, RowObservation) and type(observation).observe is RowObservation.observe
        self._rows: RowObservation | None = observation if by_rows else None  # type: ignore[assignment]
        self._arrays: list[np.ndarray] = []
        self._advance = core.simulator.advance_drive
        if core.costs is not None and core.costs.needs_impulse:
            self._advance = core.costs.advance
        self.info = core.make_info(self._info_data())
        everyone = np.arange(core.worlds)
        self.now = self._new_block(everyone)
        self._blocks = [self._new_block(everyone[start:stop]) for start, stop in core.simulator.blocks.edges]
        self._list_stages()

    def _list_stages(self) -> None:
        """Set :attr:`before`, :attr:`by_block` and :attr:`after`, without stages that the settings do not need."""
        core = self.core
        self.before = _needed(
            (True, self.decode),
            (True, self.allocate),
            (core.reward, self.store_state),
            (core.disturbances, self.disturb),
        )
        shown = [self._shown_stages(block) for block in self._blocks]
        of_all = _needed(
            (core.reward, self.replace_reward), (core.costs, self.score_costs), (not core.sensing.exact, self.sense)
        )
        # Without stages of all worlds in between, one pass over the blocks is enough.
        self.score: list[list[Callable[[], None]]] = [
            [partial(kernel, block.worlds) for kernel in block.score] for block in self._blocks
        ]
        self.by_block = self.score
        if not of_all:
            self.by_block = [[*first, *then] for first, then in zip(self.score, shown, strict=True)]
        self._shown = shown
        self.after = [
            *of_all,
            *_needed(
                (of_all and shown[0], self.show),
                (self._rows is None, self.observe),
                (core.task.continuous_feed, self.reset_parts),
            ),
        ]

    def run(self, action: np.ndarray, original: Any = None) -> None:
        """Advance every world by one step under an action.

        Args:
            action: float32 (worlds, size), see :meth:`vibgym.envs.actions.Action.shaped`.
            original: the action before conversion, for errors.

        Raises:
            ValueError: a number that is not finite; nothing has changed.
        """
        batch = Batch(action=action, original=original)
        for stage in self.before:
            stage(batch)
        self.advance(batch)
        for stage in self.after:
            stage(batch)

    def decode(self, batch: Batch) -> None:
        """Compute the command from the action; parts that are not driven count as gone."""
        core, values = self.core, batch.action
        if core.kept_action is not None:
            finite, values = copy_finite(values, core.kept_action), core.kept_action
        else:
            finite = all_finite_in_blocks(values, core.simulator.blocks)
        if not finite:
            raise core.action.not_finite(batch.action if batch.original is None else batch.original)
        if not core.all_driven:
            np.logical_or(self.measurement.gone, ~core.task.driven, out=self._aim.gone)
        batch.command = core.action.command(values, self._aim)

    def allocate(self, batch: Batch | None = None) -> None:
        """Allocate a new batch of observations and reports; returned arrays are never overwritten."""
        if self._rows is not None:
            self._arrays, self.observations = self._rows.fresh(self.core.worlds)
        if self.core.by_batch:
            self.report = self.info.allocate()

    def store_state(self, batch: Batch) -> None:
        """Store the state before the step, for a reward that replaces the kernels'."""
        self.core.reward.begin_step()  # type: ignore[union-attr]

    def disturb(self, batch: Batch) -> None:
        """Apply impulse disturbances at random times."""
        self.core.disturbances.disturb(self.core.episode.present)  # type: ignore[union-attr]

    def advance(self, batch: Batch) -> None:
        """Advance all worlds under the drives that the actuators execute; the sensor samples the state at its instant."""
        core, advance, elapsed = self.core, self._advance, 0
        sensing = core.sensing
        instant = None if sensing.exact else sensing.instant
        for drive, periods in core.actuators.apply(batch.command):
            core.drive = drive
            end = elapsed + periods
            if instant is not None and elapsed < instant < end:
                advance(drive, instant - elapsed)
                sensing.sample(core.simulator.state)
                elapsed = instant
            advance(drive, end - elapsed, self.by_block if end == core.periods else ())
            if end == instant:
                sensing.sample(core.simulator.state)
            elapsed = end

    def replace_reward(self, batch: Batch) -> None:
        """Replace the kernels' reward."""
        self.core.reward.score()  # type: ignore[union-attr]

    def score_costs(self, batch: Batch) -> None:
        """Compute the costs of the step."""
        self.core.costs.score()  # type: ignore[union-attr]

    def sense(self, batch: Batch) -> None:
        """Predict the measurement under the command, and correct it by the reading that is due."""
        core = self.core
        core.sensing.predict(batch.command)
        core.sensing.correct()
        if core.task.continuous_feed and core.scoring.changed.any():  # parts that have arrived or left
            core.sensing.reset_parts(core.scoring.changed, core.simulator.state)

    def _shown_stages(self, block: Block) -> list[Callable[[], None]]:
        """Return the stages that write what a block's observations and ``info`` show."""
        return _needed(
            (not self.core.sensing.exact, partial(self.relate, block)),
            (self._rows, partial(self.write_observations, block)),
            (self.core.by_batch, partial(self.write_report, block)),
        )

    def relate(self, block: Block) -> None:
        """Compute errors and gaps of a block by the measured poses."""
        block.relate(block.worlds, self.measurement.pose, self.measurement.gone)

    def write_observations(self, block: Block) -> None:
        """Write the observations of a block."""
        for write, array in zip(block.write, self._arrays):
            write(block.worlds, array)

    def write_report(self, block: Block) -> None:
        """Write the fields of ``info`` of a block."""
        self.info.write(block.worlds, *self.report)

    def show(self, batch: Batch) -> None:
        """Write observations and ``info`` of all blocks, on all threads."""

        def work(k: int) -> None:
            for stage in self._shown[k]:
                stage()

        self.core.simulator.blocks.run(work)

    def observe(self, batch: Batch | None = None) -> None:
        """Compute observations that are implemented in Python; last, so that blocks need one pass only."""
        core = self.core
        self.observations = core.observation.observe(self.measurement, core.measured, core.episode)

    def reset_parts(self, batch: Batch) -> None:
        """Reset the memory of the action and the model for parts that have arrived or left."""
        core = self.core
        changed = core.scoring.changed
        if changed.any():
            for memory in core.action.live().values():
                if memory.shape[:2] == changed.shape:
                    memory[changed] = 0
            core.simulator.reset_parts(changed)

    def refresh(self, worlds: np.ndarray) -> None:
        """Update observations and reports of ``worlds`` (index array), whose episodes have just begun, in the present batch."""
        if self.core.by_batch:
            self.info.write(worlds, *self.report)
        for write, array in zip(self.now.write, self._arrays):
            write(worlds, array)
        if self._rows is None:
            self.observe()

    def _info_data(self) -> InfoData:
        """Return the live arrays of ``info``."""
        core = self.core
        state, scoring = core.simulator.state, core.scoring
        drawn = {name: getattr(state, name) for name in core.randomization.ranges} | core.actuators.drawn()
        nested = {"drawn": drawn, "measured": core.sensing.info(), "commanded": core.commanded}
        info, part_extra = scoring.info(), {**scoring.part_info(), **core.simulator.part_info()}
        if core.disturbances is not None:
            part_extra["disturbed"] = core.disturbances.disturbed
        if core.costs is not None:
            info, part_extra["cost"] = {**info, "cost": core.costs.total}, core.costs.part
            nested["costs"] = core.costs.named
        return InfoData(
            core.task.info_fields, info, core.episode, state.diverged, core.term_names, core.terms, core.part_terms,
            {name: group for name, group in nested.items() if group}, part_extra,
        )  # fmt: skip

    def _new_block(self, worlds: np.ndarray) -> Block:
        """Return a block of worlds with new scratch memory."""
        core, rows = self.core, self._rows
        write = [] if rows is None else rows.writers(self.measurement, core.measured, core.episode)
        return Block(worlds, core.scoring.stages(), core.scoring.relating(core.measured), write)


def _needed(*stages: tuple[Any, Callable[..., None]]) -> list[Callable[..., None]]:
    """Return the stages whose condition holds: neither None nor False nor empty."""
    return [stage for needed, stage in stages if needed is not None and needed is not False and needed != []]
