"""Records of runs: written by :class:`Recorder`, played by :class:`ReplayDriver`."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.files import output_files
from vibgym.hardware.driver import MachineError, PoseMeasurement
from vibgym.identification import Log

MIN_ROWS = 2
"""Fewest cycles of a log."""


class Recorder:
    """Writes a :class:`vibgym.identification.Log`; rows wait in memory.

    Args:
        path: of the log, ``.npz``.
        settings: of the log.
        elements: rows and columns of the surface.
        parts: number of parts.

    Raises:
        ValueError: the path is not that of a writable file.
    """

    def __init__(self, path: str | Path, settings: Mapping[str, Any], elements: tuple[int, int], parts: int) -> None:
        self.path, self._settings = Path(path), settings
        output_files([self.path], "record")
        fields = [("time", "f8"), ("taken", "f8"), ("pose", "f8", (parts, 3))]
        self._type = np.dtype([*fields, *((name, "f8", elements) for name in ("amplitude", "phase"))])
        self._rows: list[np.ndarray] = []
        self._last = -np.inf

    def add(self, time: float, amplitude: Any, phase: Any, pose: np.ndarray, taken: float) -> None:
        """Add a cycle: see :class:`vibgym.identification.Log`. A second command at the same time is not recorded."""
        if not time > self._last:
            return
        row = np.zeros((), self._type)
        row["time"], row["taken"], row["amplitude"], row["phase"] = time, taken, amplitude, phase
        row["pose"] = np.where(np.isfinite(pose).all(axis=1, keepdims=True), pose, np.nan)
        self._rows.append(row)
        self._last = time

    def save(self) -> Path | None:
        """Write the log and return its path; None if there are less than two cycles."""
        if len(self._rows) < MIN_ROWS:
            return None
        rows = np.stack(self._rows)
        Log(**{name: rows[name] for name in rows.dtype.names or ()}, settings=self._settings).save(self.path)
        return self.path


class ReplayDriver:
    """A recorded machine as a :class:`vibgym.hardware.Driver`: the measurements of a log, independent of the commands.

    Args:
        log: of a run.

    Attributes:
        sent: (n, 2, rows, columns) amplitude (m) and phase (rad) sent in each cycle; nan where none has been sent.
    """

    def __init__(self, log: Log) -> None:
        self.log, self._cycle = log, -1
        self.sent = np.full((len(log), 2, *log.amplitude.shape[1:]), np.nan)
        seen = np.isfinite(log.taken)
        # Rows without an image repeat the last one.
        self._taken = np.maximum.accumulate(np.where(seen, log.taken, -np.inf))
        if not seen[0]:
            raise checks.conflict("log: a replay requires an image in the first cycle")

    def send(self, amplitude: np.ndarray, phase: np.ndarray) -> None:
        self.sent[self._cycle] = amplitude, phase

    def receive(self) -> PoseMeasurement:
        if self._cycle + 1 == len(self.log):
            raise MachineError("end of the recording")
        self._cycle += 1
        return PoseMeasurement(self.log.pose[self._cycle], float(self._taken[self._cycle]))

    def now(self) -> float:
        return float(self.log.time[max(self._cycle, 0)])

    def stop(self) -> None:
        pass

    def close(self) -> None:
        pass

    @property
    def difference(self) -> np.ndarray:
        """(n,) m, largest difference of an element's motion in each cycle to that of the log, as vectors; nan: none sent."""
        sent, log = self.sent, self.log
        sent_vector, log_vector = sent[:, 0] * np.exp(1j * sent[:, 1]), log.amplitude * np.exp(1j * log.phase)
        return np.abs(sent_vector - log_vector).max(axis=(1, 2))
