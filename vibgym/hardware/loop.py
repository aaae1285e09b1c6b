"""Control loop: a policy acts on a machine, cycle by cycle."""

from __future__ import annotations

import contextlib
import gc
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils import seeding

from vibgym import checks
from vibgym.hardware.driver import Driver, MachineError, PoseMeasurement
from vibgym.hardware.env import HardwareEnv
from vibgym.hardware.record import Recorder
from vibgym.policies.registry import make_policy


@dataclass(frozen=True, eq=False)
class Outcome:
    """Result of a run.

    Attributes:
        reason: why it ended, one line: ``"success"``, ``"cycle limit"``, or the reason of the watchdog or the driver.
        success: whether the task has succeeded, by the measured poses.
        cycles: commands that were sent.
        missed: cycles that passed without a new command.
        computing: (cycles,) s from receiving a measurement to sending the command.
        period: (cycles,) s from one measurement to the next; nan for the last cycle if none followed.
        info: of the last step.
        log: path of the recording; None if there is none, or less than two cycles.
    """

    reason: str
    success: bool
    cycles: int
    missed: int
    computing: np.ndarray
    period: np.ndarray
    info: Mapping[str, Any]
    log: Path | None = None

    def __str__(self) -> str:
        worst = f", computing at most {1e3 * self.computing.max():.1f} ms" if self.cycles else ""
        return f"{self.reason} after {self.cycles} cycles, {self.missed} missed{worst}"


REHEARSAL, REHEARSED = 4, 0
"""Cycles before the first run, and the seed of their episode."""


class Still:
    """Driver of a machine whose parts rest where the episode of a seed begins; for rehearsals."""

    def __init__(self, env: HardwareEnv, seed: int) -> None:
        core = env.core
        self._pose = core.drawn_start(seeding.np_random(seed)[0]).pose[0]
        self._step, self._delay, self._now = env.step_time, core.sensing.sensor.delay * core.surface.period, 0.0

    def send(self, amplitude: np.ndarray, phase: np.ndarray) -> None:
        pass

    def receive(self) -> PoseMeasurement:
        self._now += self._step
        return PoseMeasurement(self._pose, self._now - self._delay)

    def now(self) -> float:
        return self._now

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass


class ControlLoop:
    """A policy on a machine.

    Args:
        driver: of the machine.
        task: id or short name of an environment.
        policy: anything that :func:`vibgym.make_policy` takes.
        **settings: of :class:`vibgym.hardware.HardwareEnv`: watchdog, locate, clock, and keyword arguments of the environment.

    Attributes:
        env: the environment, with the policy's action and observation.
        policy: the policy.

    Raises:
        ValueError: as by :class:`HardwareEnv` and :func:`vibgym.make_policy`.
    """

    def __init__(self, driver: Driver, task: str, policy: Any, **settings: Any) -> None:
        probe = HardwareEnv(driver, task, **settings)
        self.policy = make_policy(policy, probe)
        chosen = {"action": self.policy.action, "observation": self.policy.observation}
        for name, value in chosen.items():
            checks.choice(name, settings.get(name, value), (value,))
        self.env = HardwareEnv(driver, task, **{**settings, **chosen})
        still = HardwareEnv(Still(self.env, REHEARSED), task, **{**settings, **chosen, "watchdog": None})
        self._rehearse(still, policy)

    @staticmethod
    def _rehearse(env: HardwareEnv, policy: Any) -> None:
        """Run a few cycles of another policy of this kind, since the first calls may compile kernels for seconds."""
        acting, state = make_policy(policy, env), None
        with contextlib.suppress(MachineError):  # a part near the border
            observation, _ = env.reset(seed=REHEARSED)
            for _ in range(REHEARSAL):
                action, state = acting.predict(observation, state, deterministic=True)
                observation = env.step(action)[0]

    def run(
        self,
        cycles: int,
        *,
        seed: int | None = None,
        options: dict[str, Any] | None = None,
        beyond: bool = False,
        record: str | Path | None = None,
    ) -> Outcome:
        """Run until success, for a number of cycles, or until the watchdog stops the elements; then the elements stop.

        Args:
            cycles: largest number.
            seed: of goals that are drawn.
            options: of ``reset``: ``"goal"``, ``"paths"``, ``"parts"``.
            beyond: go on after success.
            record: path of a :class:`vibgym.identification.Log` to write, ``.npz``. Its settings have ``task``,
                ``environment``, ``seed`` and ``options`` of the run.

        Raises:
            ValueError: a bad argument, or a start that the task does not allow.
        """
        cycles = checks.count("cycles", cycles)
        env, core, policy = self.env, self.env.core, self.policy
        recorder = None
        if record is not None:
            settings = {**env.description(), "seed": seed, "options": options}
            surface = env.surface
            recorder = Recorder(record, settings, (surface.rows, surface.columns), len(env.parts))
        core.record = None if recorder is None else recorder.add
        computing, period = np.full((2, cycles), np.nan)
        reason, done, info, success, state = "cycle limit", 0, {}, False, None
        gc.collect()
        gc.freeze()  # a collection of all objects would take several cycles
        try:
            observation, info = env.reset(seed=seed, options=options)
            for k in range(cycles):
                began = core.received
                action, state = policy.predict(observation, state, deterministic=True)
                sent = core.sent
                try:
                    observation, _, _, _, info = env.step(action)
                finally:
                    if core.sent != sent:
                        done, computing[k] = k + 1, core.sent - began
                period[k] = core.received - began
                success = success or bool(info["is_success"])
                if success and not beyond:
                    reason = "success"
                    break
        except MachineError as error:
            reason = str(error)
        finally:
            core.stop("the control loop has ended")
            gc.unfreeze()
            log = None if recorder is None else recorder.save()
        return Outcome(reason, success, done, core.missed, computing[:done], period[:done], info, log)
