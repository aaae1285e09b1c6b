"""An environment whose world is a machine: :class:`HardwareEnv`.

Actions, estimators, observations, scoring and policies are those of the simulated environments. Only the two ends of a step
(:mod:`vibgym.envs.step`) differ: commands go to a driver, and poses come from it.

    action -> command -> amplitude, phase -> driver -> poses -> task: reward, info
                                                           \\-> reading -> measurement -> observation
"""

from __future__ import annotations

import contextlib
import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import gymnasium as gym
import numpy as np

from vibgym import checks
from vibgym.config import json_values
from vibgym.envs.core import Core
from vibgym.envs.options import StartOverride
from vibgym.envs.single import VibgymEnv
from vibgym.envs.step import Batch, Pipeline
from vibgym.envs.vector import environment_id
from vibgym.hardware.driver import Driver, MachineError, PoseMeasurement
from vibgym.hardware.watchdog import Stopped, Watchdog
from vibgym.physics.core.drive import Drive, all_phasors
from vibgym.scene.surface import Surface
from vibgym.sensing.effects import read_poses
from vibgym.sensing.measurement import new_reading
from vibgym.tasks import Start
from vibgym.tasks.episode import HELD

Locate = Callable[[np.ndarray], Any]
"""Image -> (parts, 3) poses, nan where a part was not found."""

CLOSE = 1e-2
"""Relative difference to the step time that a machine may report: nominal and identified frequencies differ."""

NO_NOISE = np.zeros(2)
LATER = np.ones(1, dtype=np.int64)
"""Number of a sample that is not the first of its episode."""


def write_motion(command: Drive, surface: Surface, amplitude: np.ndarray, phase: np.ndarray) -> None:
    """Write amplitude (m) and phase (rad) of every element, (rows, columns), of a command of one world."""
    phasors = np.empty((1, *amplitude.shape, 2))
    all_phasors(command, phasors)
    c, s = phasors[0, ..., 0], phasors[0, ..., 1]
    np.hypot(c, s, out=amplitude)
    amplitude /= surface.angular_frequency**2
    assert surface.max_amplitude is not None
    np.minimum(amplitude, surface.max_amplitude, out=amplitude)  # rounding
    np.arctan2(s, c, out=phase)


class Readings:
    """Readings, as of a sensor, from measured poses: headings continue, velocities are differences of poses.

    Args:
        parts: number of parts.
        step: s, time of a cycle. Velocities count whole cycles between samples.

    Attributes:
        last: the present reading.
        unseen: a reading that has measured no part.
    """

    def __init__(self, parts: int, step: float) -> None:
        self.step, self.last, self.unseen = step, new_reading(1, parts), new_reading(1, parts)
        self._world, self._key = np.zeros(1, dtype=np.int64), np.zeros((1, 2), dtype=np.int64)
        self._new, self._no_offset = np.zeros((1, parts), dtype=bool), np.zeros((1, parts, 3))
        self._pose, self._elapsed = np.zeros((1, parts, 3)), np.zeros((1, parts), dtype=np.int64)
        self._taken = np.zeros(parts)  # s, of each part's last sample

    def begin(self, pose: np.ndarray, gone: np.ndarray, taken: float) -> None:
        """Begin an episode with poses (parts, 3); ``gone``: (parts,) bool."""
        for reading in (self.last, self.unseen):
            reading.pose[0], reading.mean_velocity[...], reading.gone[0] = pose, 0.0, gone
        self.last.seen[...], self.unseen.seen[...] = True, False
        self._pose[0], self._taken[:] = pose, taken

    def add(self, pose: np.ndarray, taken: float) -> None:
        """Add poses (parts, 3), nan where a part was not measured."""
        reading = self.last
        reading.seen[...] = np.isfinite(pose).all(axis=1)
        seen = reading.seen[0]
        turns = np.rint((self._pose[0, :, 2] - pose[:, 2]) / (2.0 * math.pi), where=seen, out=np.zeros(len(pose)))
        reading.pose[0] = np.where(seen[:, None], pose, self._pose[0])
        reading.pose[0, :, 2] += 2.0 * math.pi * turns
        steps = np.maximum(np.rint((taken - self._taken) / self.step), 1.0)
        self._elapsed[0] = steps - 1.0  # the kernel counts this one
        read_poses(
            self._world, self._key, LATER, self._new, NO_NOISE, self._no_offset, 0.0, self.step, self._pose, self._elapsed,
            reading,
        )  # fmt: skip
        self._taken[seen] = taken


class HardwarePipeline(Pipeline):
    """Stages of a step whose command goes to a driver, and whose poses come from it."""

    core: HardwareCore

    def run(self, action: np.ndarray, original: Any = None) -> None:
        episode = self.core.episode
        self.rewards = episode.reward, episode.part_reward, self.core.terms, self.core.part_terms
        self.missed_rewards = [np.zeros_like(reward) for reward in self.rewards]
        super().run(action, original)
        for reward, missed in zip(self.rewards, self.missed_rewards, strict=True):
            reward += missed

    def advance(self, batch: Batch) -> None:
        """Send the command, and receive the measurement of the next cycle."""
        core = self.core
        core.drive, state, reading = batch.command, core.simulator.state, core.readings.last
        with core.supervised():
            core.send(batch.command)
            self.predict(batch)
            measurement = core.driver.receive()
            core.received = core.clock()
            for _ in range(core.watchdog.check_clock(core.driver.now())):
                self.miss(batch)
            core.add(measurement)
        seen = reading.seen[0]
        state.pose[0, seen] = reading.pose[0, seen]
        state.mean_velocity[0, seen] = state.velocity[0, seen] = reading.mean_velocity[0, seen]
        if not seen[core.episode.present[0]].all():
            core.suspend_hold()
        for stage in self.by_block[0]:
            stage()

    def miss(self, batch: Batch) -> None:
        """Score a missed cycle with the last poses, and predict the next: the elements hold the command.

        Goals move on, and the reward is part of this step's.
        """
        core = self.core
        core.missed += 1
        core.suspend_hold()
        for stage in self.score[0]:
            stage()
        if core.reward is not None:
            self.replace_reward(batch)
            self.store_state(batch)
        for reward, missed in zip(self.rewards, self.missed_rewards, strict=True):
            missed += reward
        if not core.sensing.exact:
            core.sensing.estimator.correct(core.readings.unseen)
        self.predict(batch)

    def predict(self, batch: Batch) -> None:
        """Run the estimator's model for a cycle, while the machine runs."""
        if not self.core.sensing.exact:
            self.core.sensing.predict(batch.command)

    def sense(self, batch: Batch) -> None:
        """Correct the prediction by the reading."""
        self.core.sensing.estimator.correct(self.core.readings.last)


class HardwareCore(Core):
    """Core of one world whose state is measured; see :class:`HardwareEnv`.

    The state has the last measured poses, not those that the estimator predicts: success and reward are of the measured parts.
    Cycles in which a part is not measured do not count for the hold. Rewards of missed cycles are added to that of their step.

    Attributes:
        driver, watchdog, locate, clock: see :class:`HardwareEnv`.
        missed: cycles of this episode that the control loop has missed.
        received, sent: s on ``clock``, when the last measurement was received and the last command was sent.
        record: called in every cycle with the arguments of :meth:`vibgym.hardware.Recorder.add`; None: not recorded.
    """

    driver: Driver
    watchdog: Watchdog
    locate: Locate | None
    clock: Callable[[], float]
    record: Callable[..., None] | None = None
    pipeline_class = HardwarePipeline

    def __init__(self, *arguments: Any) -> None:
        super().__init__(*arguments)
        task, surface = self.task, self.surface
        if task.continuous_feed:
            raise checks.conflict(f"task {task.name!r} is not supported on hardware: its parts arrive and leave")
        if self.disturbances is not None:
            raise checks.conflict("randomize['disturbance'] is not supported on hardware")
        if self.costs is not None:
            raise checks.conflict("costs are not supported on hardware")
        if not self.observation.extra or "contacts" in self.sensing.report:
            raise checks.conflict(
                "observation='camera' and sensor.report with 'contacts' are not supported on hardware"
            )
        self._amplitude, self._phase = np.zeros((2, surface.rows, surface.columns))
        self.readings = Readings(len(self.parts), self.sensing.sensor.step)
        self._image: np.ndarray | None = None
        self._stopped = ""
        self._raw: tuple[float, np.ndarray, float] | None = None  # s, poses as measured and when, without a command yet
        self.missed, self.received, self.sent = 0, 0.0, 0.0

    def check_start(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride
    ) -> None:
        if override.pose is not None:
            raise checks.conflict("options['pose'] cannot be set on hardware: poses are measured")
        super().check_start(worlds, generators, override)

    def reset(
        self, worlds: np.ndarray, generators: Sequence[np.random.Generator], override: StartOverride | None = None
    ) -> None:
        """Begin an episode with the parts as measured; goals are drawn as in a simulated environment.

        Raises:
            ValueError: a part is not measured, or the task cannot start here.
            MachineError: see :meth:`Driver.receive`, :class:`Watchdog`.
        """
        start = self.drawn_start(generators[0], override)
        present = start.present[0]
        self._stopped = ""
        with self.supervised():
            pose, taken = self._first(present)
        lost = np.flatnonzero(present & ~np.isfinite(pose).all(axis=1))
        if lost.size:
            raise checks.conflict(f"part {lost[0]} is not measured at the start of the episode")
        goal = None if override is None else override.goal
        with checks.within("the parts as they are measured"):
            start = self.task.place(start, np.where(present[:, None], pose, start.pose[0])[None])
        start = start if goal is None else start._replace(goal=goal[worlds])
        self.put(worlds, start, np.where(start.present[..., None], self.idle, 0.0))
        self.readings.begin(start.pose[0], ~present, taken)
        if not self.sensing.exact:
            self.sensing.estimator.reset(worlds, self.readings.last)
        self.relate(worlds)

    def drawn_start(self, generator: np.random.Generator, override: StartOverride | None = None) -> Start:
        """Return the start of a simulated episode with this generator."""
        uniform = generator.random((1, self.starts.draws))
        return self.starts.draw(self.pipeline.now.worlds, uniform, override)[0]

    def stop(self, reason: str) -> None:
        """Stop the elements until the next episode."""
        self._stopped = reason
        with contextlib.suppress(MachineError, OSError):  # the machine stops by itself if it cannot be reached
            self.driver.stop()
        self._record(0.0, 0.0)

    def _record(self, amplitude: Any, phase: Any) -> None:
        """Record the motion commanded in this cycle, if it is the first one, and the cycle's measurement."""
        if self._raw is not None and self.record is not None:
            now, pose, taken = self._raw
            self.record(now, amplitude, phase, pose, taken)
        self._raw = None

    @contextlib.contextmanager
    def supervised(self) -> Iterator[None]:
        """Stop the elements if the block fails."""
        try:
            yield
        except BaseException as error:
            self.stop(str(error) or type(error).__name__)
            raise

    def _first(self, present: np.ndarray) -> tuple[np.ndarray, float]:
        """Return the poses at an episode's start, and when they were measured."""
        self._image, self._raw, self.missed = None, None, 0
        measurement = self.driver.receive()
        self.received = self.clock()
        walls, sensor = self.simulator.walls, self.sensing.sensor
        self.watchdog.start(self.surface, walls, sensor, self.driver.now(), measurement.taken)
        pose = self._poses(measurement)
        self._raw = self.driver.now(), pose, measurement.taken
        self.watchdog.check_parts(pose, present)
        return pose, measurement.taken

    def send(self, command: Drive) -> None:
        """Send a command to the machine."""
        if self._stopped:
            raise Stopped(self._stopped)
        self.watchdog.check_emergency()
        write_motion(self.actuators.compensated(command), self.surface, self._amplitude, self._phase)
        self.driver.send(self._amplitude, self._phase)
        self.sent = self.clock()
        self._record(self._amplitude, self._phase)

    def add(self, measurement: PoseMeasurement) -> None:
        """Add a measurement to the readings."""
        pose = self._poses(measurement)
        new = self.watchdog.is_new(measurement.taken, self._is_repeated(measurement.image))
        self._raw = self.driver.now(), pose, measurement.taken
        if not new:
            pose = np.full(pose.shape, np.nan)
        self.watchdog.check_parts(pose, self.episode.present[0])
        self.readings.add(pose, measurement.taken)

    def suspend_hold(self) -> None:
        """Do not count the present cycle for the hold: a part is not measured in it."""
        self.episode.count[:, HELD] -= self.periods

    def _is_repeated(self, image: np.ndarray | None) -> bool:
        """Return whether an image is the same as the last one, as of a frozen camera; noise makes images differ."""
        last, self._image = self._image, image
        return image is not None and last is not None and np.array_equal(image, last)

    def _poses(self, measurement: PoseMeasurement) -> np.ndarray:
        """Return the poses (parts, 3) of a measurement, nan where a part was not measured.

        Raises:
            MachineError: no poses, or not of these parts.
        """
        pose, image = measurement.pose, measurement.image
        if pose is None:
            if image is None or self.locate is None:
                raise MachineError("measurements without poses require an image, and locate= for the control loop")
            pose = self.locate(image)
        pose = np.asarray(pose, dtype=np.float64)
        if pose.shape != (len(self.parts), 3):
            raise MachineError(f"measured poses must have shape {(len(self.parts), 3)}, got {pose.shape}")
        return pose


class HardwareEnv(VibgymEnv):
    """An environment with the interface of :class:`vibgym.envs.VibgymEnv`, whose world is a machine.

    - ``reset`` begins an episode with the parts where they lie. Goals are drawn from the seed, or set by ``options``.
    - ``step`` sends a command and returns at the next cycle of the machine. If cycles have passed since the last call, the
      elements have held their command in them: the estimator predicts through them, and ``core.missed`` counts them.
    - Reward, success and ``info`` are those of the measured parts. A hold counts the cycles in which all parts are measured.
    - After a :class:`MachineError` the elements stop until the next ``reset``.

    Args:
        driver: of the machine. If it has a mapping ``machine`` (:attr:`SocketDriver.machine`), its values must be those of the
            environment.
        task: id or short name of an environment.
        watchdog: None: with its default limits.
        locate: computes poses from images, for drivers whose measurements are images.
        clock: s, for measurements of the computing time; decisions depend on the machine's clock alone.
        **environment: keyword arguments of the environment. Surface, parts, actuators and sensor describe the machine:
            policies and estimators use the nominal limits, dead zone, latency, delay and noise.

    Raises:
        ValueError: an unknown environment, another machine, or a setting that has no meaning on hardware.
    """

    core: HardwareCore
    core_class = HardwareCore

    def __init__(
        self,
        driver: Driver,
        task: str,
        *,
        watchdog: Watchdog | None = None,
        locate: Locate | None = None,
        clock: Callable[[], float] = time.perf_counter,
        **environment: Any,
    ) -> None:
        spec = gym.spec(environment_id(task))
        super().__init__(**{**spec.kwargs, **environment})
        self._environment = json_values(environment)
        if self.core.shapes is not None:
            raise checks.conflict("hardware requires shapes=[...], since it cannot draw them")
        surface = self.surface
        own = {"rows": surface.rows, "columns": surface.columns, "parts": len(self.parts), "step_time": self.step_time}
        reported = getattr(driver, "machine", None)
        reported = reported if isinstance(reported, Mapping) else {}
        for name, value in own.items():
            got = reported.get(name, value)
            if not math.isclose(got, value, rel_tol=CLOSE if name == "step_time" else 0.0):
                raise checks.refuse(f"driver.machine[{name!r}]", got, f"{value:g}, that of the environment")
        self.spec, core = spec, self.core
        core.driver, core.locate, core.clock = driver, locate, clock
        core.watchdog = watchdog or Watchdog()

    @property
    def watchdog(self) -> Watchdog:
        """The watchdog; ``watchdog.stop()`` is an emergency stop."""
        return self.core.watchdog

    def description(self) -> dict[str, Any]:
        """Return the settings of a log, JSON values: the scene, and ``task`` and ``environment``, this class's arguments."""
        options = self.core.options
        assert self.spec is not None
        return {
            "surface": json_values(options.surface), "actuators": json_values(options.actuators),
            "parts": [part.to_dict() for part in self.parts], "task": self.spec.id, "environment": self._environment,
        }  # fmt: skip

    def close(self) -> None:
        """Stop the elements, and close the window."""
        self.core.stop("the environment is closed")
        super().close()
