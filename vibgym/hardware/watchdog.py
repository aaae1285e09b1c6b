"""Watchdog of a control loop: the conditions under which the elements stop."""

from __future__ import annotations

from collections.abc import Sequence
from threading import Event

import numpy as np

from vibgym import checks
from vibgym.hardware.driver import MachineError
from vibgym.scene.surface import Surface
from vibgym.sensing import Sensor


class Stopped(MachineError):
    """The watchdog has stopped the elements; the message is the reason."""


class Watchdog:
    """Checks every cycle of a control loop, and raises :class:`Stopped` where the elements have to stop.

    It reads no clock but the machine's. :meth:`stop` may be called by another thread or a signal handler.

    Args:
        hold: largest number of consecutive cycles that the control loop may miss; the machine holds its last command in them.
        stale: s, largest time without a new measurement, in addition to the nominal age of the sensor's measurements.
        lost: s, largest time without a measurement of a part, likewise.
        border: m, least distance of a part's centre to a border without a wall.
        jump: m, largest distance between two measurements of a part, in addition to the table's speed times their distance.

    Raises:
        ValueError: a bad limit.
    """

    def __init__(
        self, *, hold: int = 3, stale: float = 0.2, lost: float = 0.4, border: float = 0.01, jump: float = 0.05
    ) -> None:
        self.hold = checks.count("hold", hold, least=0)
        self.stale = checks.number("stale", stale, least=0.0)
        self.lost = checks.number("lost", lost, least=0.0)
        self.border = checks.number("border", border, least=0.0)
        self.jump = checks.number("jump", jump, least=0.0)
        self._emergency, self._reason = Event(), ""

    def start(self, surface: Surface, walls: Sequence[str], sensor: Sensor, now: float, taken: float) -> None:
        """Begin an episode in the present cycle.

        Args:
            surface, walls: of the table.
            sensor: its delay and rate are nominal.
            now: s, the machine's clock.
            taken: s, of the first measurement.

        Raises:
            Stopped: after :meth:`stop`, or a measurement from the future.
        """
        sides = {"left": (0, -1.0, 0.0), "right": (0, 1.0, surface.width), "bottom": (1, -1.0, 0.0)}
        sides["top"] = (1, 1.0, surface.depth)
        self._open = {name: side for name, side in sides.items() if name not in walls}
        self._speed = surface.horizontal_amplitude * surface.angular_frequency  # of the table; parts are slower
        self._step, self._delay = sensor.step, sensor.delay * surface.period
        self._oldest = self._delay + (sensor.every - 1) * sensor.step  # s, nominal age just before a new measurement
        self._now, self._fresh, self._taken = now, now, taken
        self._seen: np.ndarray | None = None
        self.check_emergency()
        self._check_future(taken)

    def stop(self, reason: str = "emergency stop") -> None:
        """Stop the elements at the next opportunity, within this cycle; the reason is one line."""
        self._reason = " ".join(reason.split())
        self._emergency.set()

    def release(self) -> None:
        """Allow motion again after :meth:`stop`."""
        self._emergency.clear()

    def check_emergency(self) -> None:
        """Raise Stopped after :meth:`stop`."""
        if self._emergency.is_set():
            raise Stopped(self._reason)

    def check_clock(self, now: float) -> int:
        """Return the number of cycles that were missed before the present one.

        Args:
            now: s, the machine's clock.

        Raises:
            Stopped: the clock has not advanced, or by more cycles than may be missed.
        """
        self.check_emergency()
        passed = now - self._now
        if not passed > 0.5 * self._step:  # nan, too
            raise Stopped(f"the machine's clock went from {self._now:.3f} s to {now:.3f} s in a cycle")
        missed = round(passed / self._step) - 1
        if missed > self.hold:
            jump = f"the machine's clock advanced by {passed:.3f} s between two cycles"
            raise Stopped(f"{jump}: {missed} cycles of {self._step:g} s were missed, at most {self.hold} are allowed")
        self._now = now
        return missed

    def is_new(self, taken: float, repeated: bool = False) -> bool:
        """Return whether a measurement can be used: it is newer than all earlier ones, and has the nominal delay.

        Args:
            taken: s, when it was taken.
            repeated: its image is the same as the last one.

        Raises:
            Stopped: it is from the future or older than an earlier one, or there has been no new one for too long.
        """
        now, delay = self._now, self._delay
        self._check_future(taken)
        if taken < self._taken:
            raise Stopped(f"the clock of measurements went back from {self._taken:.3f} s to {taken:.3f} s")
        again = taken == self._taken or repeated
        usable = not again and abs(now - taken - delay) < 0.5 * self._step
        self._taken = taken
        if usable:
            self._fresh = now
        elif now - self._fresh > self.stale + self._oldest:
            since = f"no usable measurement for {now - self._fresh:.3f} s"
            old = f"they are {now - taken:.3f} s old, sensor.delay is {delay:.3f} s"
            raise Stopped(f"{since}: {'the same one is repeated' if again else old}")
        return usable

    def _check_future(self, taken: float) -> None:
        now = self._now
        if not taken <= now + 0.5 * self._step:  # nan, too
            late = f"a measurement of {taken:.3f} s arrived at {now:.3f} s"
            raise Stopped(f"{late}: the clocks of machine and camera differ")

    def check_parts(self, pose: np.ndarray, present: np.ndarray) -> None:
        """Check the poses of a measurement.

        Args:
            pose: (parts, 3) m, m, rad; nan where a part was not measured.
            present: (parts,) bool, parts that are on the table.

        Raises:
            Stopped: a part is near a border, has jumped, or has not been measured for too long.
        """
        if self._seen is None:
            self._seen, self._place = np.full(len(pose), self._now), np.full((len(pose), 2), np.nan)
        measured, elapsed = np.isfinite(pose).all(axis=1), self._now - self._seen
        moved, most = np.hypot(*(pose[:, :2] - self._place).T), self.jump + self._speed * elapsed
        jumped = np.flatnonzero(measured & present & (moved > most))
        self._seen[measured | ~present], self._place[measured] = self._now, pose[measured, :2]
        for name, (axis, sign, edge) in self._open.items():
            away = sign * (edge - pose[:, axis])
            near = np.flatnonzero(measured & present & (away < self.border))
            if near.size:
                part, least = int(near[0]), 1e3 * self.border
                raise Stopped(f"part {part} is {1e3 * away[part]:.1f} mm from the {name} border, at least {least:g} mm")
        if jumped.size:
            k = int(jumped[0])
            far = f"part {k} has moved by {1e3 * moved[k]:.1f} mm in {elapsed[k]:.3f} s"
            raise Stopped(f"{far}, at most {1e3 * most[k]:.1f} mm are possible")
        unseen = self._now - self._seen
        if unseen.max() > self.lost + self._oldest:
            part = int(unseen.argmax())
            raise Stopped(f"part {part} has not been measured for {unseen[part]:.3f} s")
