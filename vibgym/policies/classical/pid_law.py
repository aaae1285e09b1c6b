"""The thesis's PID controller as a law for parts: by measured positions only."""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from vibgym.policies.classical.law import Law
from vibgym.policies.classical.measured import Measured, wrap
from vibgym.policies.classical.pid import POLES, Pid, PidMemory
from vibgym.policies.task_info import TaskInfo


class PidLawMemory(NamedTuple):
    """What the law remembers of an episode."""

    pid: PidMemory  # (batch, parts, 3) each
    heading: np.ndarray  # (batch, parts) rad, the last one
    known: np.ndarray  # (batch, parts) bool, whether there has been one


class PidLaw(Law):
    """One PID controller for x, y and heading of every part, see :mod:`vibgym.policies.classical.pid`.

    A heading's rate is taken from the measured headings, not from what is left to turn: this counts modulo the part's symmetry,
    and where headings do not count nothing is left, but spin has to be braked all the same.

    Args:
        info: task, scene and step time.
        poles, late, anti_windup: of :class:`vibgym.policies.classical.pid.Pid`.

    Raises:
        ValueError: a bad argument.
    """

    def __init__(self, info: TaskInfo, *, poles: Any = POLES, late: bool = True, anti_windup: bool = False) -> None:
        self.pid = Pid(info.step_time, poles=poles, late=late, anti_windup=anti_windup)
        self.lead = self.pid.gains.derivative / self.pid.gains.proportional
        self.symmetry = np.array([part.symmetry for part in info.parts])

    def initial(self, batch: int) -> PidLawMemory:
        """Before the first measurement."""
        shape = (batch, len(self.symmetry))
        return PidLawMemory(self.pid.initial((*shape, 3)), np.zeros(shape), np.zeros(shape, dtype=bool))

    def wanted(
        self, measured: Measured, way: np.ndarray, turn: np.ndarray, memory: PidLawMemory
    ) -> tuple[np.ndarray, PidLawMemory]:
        """See :meth:`vibgym.policies.classical.law.Law.wanted`."""
        error = np.concatenate([way, turn[..., None]], axis=-1)
        change = error - memory.pid.error
        turned = wrap(measured.heading - memory.heading, self.symmetry)
        change[..., 2] = np.where(memory.known, -turned, 0.0)
        wanted, pid = self.pid.output(error, memory.pid, change)
        return wanted, PidLawMemory(pid, measured.heading, np.ones_like(memory.known))

    def applied(self, measured: Measured, acceleration: np.ndarray, memory: PidLawMemory) -> PidLawMemory:
        """See :meth:`vibgym.policies.classical.law.Law.applied`."""
        return memory._replace(pid=self.pid.applied(acceleration, memory.pid))
