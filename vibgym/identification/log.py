"""Recordings of a machine: commands sent, poses seen by the camera, and the settings of the machine as far as known."""

from __future__ import annotations

import json
import math
import os
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.config import json_values
from vibgym.files import output_files, reason, write_atomically
from vibgym.scene.parts import Part, part_from
from vibgym.scene.surface import Surface, surface_from

ARRAYS = ("time", "amplitude", "phase", "pose", "taken")
"""Arrays of a file; it also has ``settings``, JSON as bytes."""

REQUIRED = ("surface", "actuators", "parts")
"""Keys that settings must have."""

MAX_BYTES = 4_000_000_000
"""Largest content of a file, uncompressed: more than an hour with 256 elements."""


@dataclass(frozen=True, eq=False)
class Log:
    """A recording of n control cycles. A cycle is one period of the table: row k of all arrays belongs to cycle k.

    The command of row k is the one that the machine was sent in cycle k and would execute from there on without latency. An
    image is assigned to the row in which it arrived; ``taken`` is when it was exposed. Rows may be missing (a gap in ``time``).

    Args:
        time: (n,) s, machine clock at which the command of each cycle was sent; strictly increasing. Only differences matter.
        amplitude: (n, rows, columns) m, commanded vertical amplitudes, as in :meth:`vibgym.Simulator.advance`.
        phase: (n, rows, columns) rad, commanded phases.
        pose: (n, parts, 3) measured x, y (m) and heading (rad), NaN for parts that were not seen. Rows without a new image
            are NaN, or repeat the previous image with its ``taken``.
        taken: (n,) s, the same clock, at which the image of the row was exposed; non-decreasing, NaN in rows without poses.
        settings: JSON values: nominal ``surface`` (mapping of :class:`vibgym.Surface` or ``"prototype"``), ``actuators`` (name
            or mapping, as for environments) and ``parts`` (list of names or mappings). Further keys are kept.

    Raises:
        ValueError: an array has the wrong shape, a value is not finite, timestamps decrease, or a setting is missing.
    """

    time: np.ndarray
    amplitude: np.ndarray
    phase: np.ndarray
    pose: np.ndarray
    taken: np.ndarray
    settings: Mapping[str, Any]

    def __post_init__(self) -> None:
        settings = _checked_settings(self.settings)
        surface = surface_from(settings["surface"])
        n = len(self.time) if checks.listed(self.time) else 0
        if n < 2:
            raise checks.refuse("log.time", f"{n} cycles", "at least two cycles")
        elements, parts = (n, surface.rows, surface.columns), len(settings["parts"])
        shapes = {"time": (n,), "amplitude": elements, "phase": elements, "pose": (n, parts, 3), "taken": (n,)}
        arrays: dict[str, Any] = {name: _exact(name, getattr(self, name), shape) for name, shape in shapes.items()}
        for name, least in (("time", -math.inf), ("amplitude", 0.0), ("phase", -math.inf)):
            checks.array(f"log.{name}", arrays[name], shapes[name], least=least)
        pose, taken = arrays["pose"], arrays["taken"]
        if np.isinf(pose).any() or (np.isnan(pose).any(axis=2) != np.isnan(pose).all(axis=2)).any():
            got = "infinity, or a pose that is partly NaN"
            raise checks.refuse("log.pose", got, "finite, or NaN for the whole pose")
        seen = ~np.isnan(pose[..., 0]).all(axis=1)
        if not np.isfinite(taken[seen]).all():
            raise checks.refuse("log.taken", "a row with poses but without a time", "finite in rows with poses")
        clocks = ("time", arrays["time"], np.arange(n)), ("taken", taken[seen], np.flatnonzero(seen))
        for name, values, rows in clocks:
            back = np.diff(values) <= 0.0 if name == "time" else np.diff(values) < 0.0
            if back.any():
                k = int(np.flatnonzero(back)[0])
                got = f"{values[k + 1]:.6f} s after {values[k]:.6f} s in row {rows[k + 1]}"
                raise checks.refuse(f"log.{name}", got, "increasing: timestamps of one clock, in the order of cycles")
        for name, value in {**arrays, "settings": settings}.items():
            object.__setattr__(self, name, value)  # the class is frozen

    def __len__(self) -> int:
        return len(self.time)

    @property
    def surface(self) -> Surface:
        """The nominal surface of the settings."""
        return surface_from(self.settings["surface"])

    @property
    def parts(self) -> tuple[Part, ...]:
        """The nominal parts of the settings."""
        return tuple(part_from(part) for part in self.settings["parts"])

    def save(self, path: str | Path) -> None:
        """Write the recording as one compressed ``.npz`` file, all or nothing.

        Raises:
            ValueError: the path is not that of a writable file.
        """
        path = Path(path)
        output_files([path], "log")
        content = BytesIO()
        text = np.frombuffer(json.dumps(self.settings).encode(), dtype=np.uint8)
        np.savez_compressed(content, settings=text, **{name: getattr(self, name) for name in ARRAYS})
        write_atomically(path, content.getvalue())

    @classmethod
    def load(cls, path: str | Path) -> Log:
        """Read a recording that :meth:`save` has written. No code of the file is executed.

        Raises:
            ValueError: the file cannot be read, is not a recording, or holds invalid values; names the file.
        """
        path = Path(path)
        try:
            with zipfile.ZipFile(path) as content:
                size = sum(member.file_size for member in content.infolist())
            if size > MAX_BYTES:
                raise checks.refuse(str(path), f"{size} bytes", f"a recording of at most {MAX_BYTES} bytes")
            with np.load(path, allow_pickle=False) as stored:
                for name in (*ARRAYS, "settings"):
                    if name not in stored:
                        raise checks.missing(f"{path}: {name}", f"a recording has {', '.join(ARRAYS)} and settings")
                values = {name: stored[name] for name in ARRAYS}
                settings = json.loads(stored["settings"].tobytes())
        except checks.Refused:
            raise
        except OSError as error:
            raise checks.refuse("log", os.fspath(path), f"a readable file ({reason(error)})") from None
        except Exception as error:  # zip, .npy headers and JSON
            raise checks.refuse(str(path), str(error), "a recording written by Log.save (.npz)") from None
        with checks.within(path):
            return cls(**values, settings=settings)


def _exact(name: str, value: Any, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of floats of exactly this shape; a broadcast one would repeat a row unnoticed."""
    meaning = {"amplitude": " (cycles, rows, columns) of the surface in the settings", "pose": " (cycles, parts, 3)"}
    return np.array(checks.shaped(f"log.{name}", value, (shape,), "an array", meaning.get(name, "")), dtype=np.float64)


def _checked_settings(settings: Any) -> dict[str, Any]:
    """Return settings as JSON values with all required keys."""
    if not isinstance(settings, Mapping):
        raise checks.refuse("log.settings", settings, f"a mapping with the keys {', '.join(REQUIRED)}")
    for name in REQUIRED:
        if name not in settings:
            raise checks.missing(f"log.settings: {name}")
    plain = json_values(settings)
    try:
        plain = json.loads(json.dumps(plain))  # a copy, as it will be read
    except (TypeError, ValueError, RecursionError) as error:
        raise checks.refuse("log.settings", str(error), "JSON values") from None
    parts = plain["parts"]
    if not isinstance(parts, list) or not parts:
        raise checks.refuse("log.settings['parts']", parts, "a list of parts")
    with checks.within("log.settings"):
        surface_from(plain["surface"])
        for k, part in enumerate(parts):
            part_from(part, f"parts[{k}]")
    return plain
