"""What follows the simulation in a step: score, relate, observe, tell, block by block on the thread that has the block at hand.

What only Python can do, a sensor, a reward or an observation of one's own, stands for all worlds between what kernels do. Which
stage comes when is decided once.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from vibgym.envs.base import Observation, RowObservation, Writer
from vibgym.envs.info import Information, Told
from vibgym.sensing.stage import Sensing
from vibgym.simulation.threads import Blocks
from vibgym.tasks.episode import Relations
from vibgym.tasks.scoring import Scoring


class Stages:
    """Bound to the arrays of a core: a copy of it makes its own.

    Args:
        blocks: of worlds.
        scoring: of the episodes.
        sensing: what measures.
        measured: how parts stand by the measured poses; of an exact sensor the relations of the score.
        observation, information: what is made of a step.
        reward: what rewards a step in Python, for all worlds; None: the score itself.

    Attributes:
        by_blocks: for each block what follows at once.
        afterwards: what follows for all worlds, one after the other.
        seen: batch of observations of the last step.  told: what ``info`` says of it.
    """

    def __init__(
        self,
        blocks: Blocks,
        scoring: Scoring,
        sensing: Sensing,
        measured: Relations,
        observation: Observation,
        information: Information,
        reward: Callable[[], None] | None,
    ) -> None:
        self._blocks, self._scoring, self._sensing, self._measured = blocks, scoring, sensing, measured
        self._observation, self._information = observation, information
        self._everyone = np.arange(blocks.worlds)
        self._arrays: list[np.ndarray] = []
        self.seen: Any = None
        self.told: Told = information.fresh()
        # A subclass of an observation that kernels write may observe in a way of its own.
        by_rows = isinstance(observation, RowObservation) and type(observation).observe is RowObservation.observe
        self._rows: RowObservation | None = observation if by_rows else None  # type: ignore[assignment]
        self._relating = [] if sensing.exact else [scoring.relating(measured)]
        self._writing = self._writers()
        waits = not sensing.exact
        self.by_blocks = self._stages(score=True, see=not waits, tell=not waits and reward is None)
        self.afterwards: list[Callable[[], None]] = [] if reward is None else [reward]
        if waits or reward is not None:
            then = self._stages(relate=waits, see=waits, tell=True)
            self.afterwards.append(lambda: blocks.run(lambda k: then[k]()))
        if self._rows is None:
            self.afterwards.append(self._observe)

    def open(self) -> None:
        """Begin a batch of observations, and of what there is to tell: what was handed out is not written again."""
        self.told = self._information.fresh()
        if self._rows is not None:
            self._arrays, self.seen = self._rows.fresh(self._blocks.worlds)

    def relate(self, worlds: np.ndarray) -> None:
        """Bring the relations of what is measured in ``worlds`` (index array) up to date."""
        measured = self._sensing.measurement
        for relate in self._relating:
            relate(worlds, measured.pose, measured.gone)

    def show(self, worlds: np.ndarray) -> None:
        """Observe and tell of ``worlds`` (index array) anew, in the batch of this step: their episodes have just begun."""
        self._information.write(worlds, *self.told)
        for write, array in zip(self._writing, self._arrays):
            write(worlds, array)
        if self._rows is None:
            self._observe()

    def show_all(self) -> None:
        """Observe and tell of all worlds, in a batch of its own."""
        self.open()
        self.show(self._everyone)

    def _observe(self) -> None:
        """Ask an observation that only Python can make."""
        self.seen = self._observation.observe(self._sensing.measurement, self._measured, self._scoring.episode)

    def _writers(self) -> list[Writer]:
        """What writes observations world by world, with working arrays of its own."""
        if self._rows is None:
            return []
        return self._rows.writers(self._sensing.measurement, self._measured, self._scoring.episode)

    def _stages(
        self, *, score: bool = False, relate: bool = False, see: bool = False, tell: bool = False
    ) -> list[Callable[[], None]]:
        """Some stages for each block, with working arrays of their own."""

        def stage(start: int, stop: int) -> Callable[[], None]:
            worlds = self._everyone[start:stop]
            scoring = self._scoring.stages() if score else []
            relating = [self._scoring.relating(self._measured)] if relate else []
            writing = self._writers() if see else []
            telling = [self._information.write] if tell else []
            measured = self._sensing.measurement

            def run() -> None:
                for each in scoring:
                    each(worlds)
                for each in relating:
                    each(worlds, measured.pose, measured.gone)
                for write, array in zip(writing, self._arrays):
                    write(worlds, array)
                for each in telling:
                    each(worlds, *self.told)

            return run

        return [stage(*edges) for edges in self._blocks.edges]
