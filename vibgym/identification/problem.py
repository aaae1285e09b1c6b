"""What is fitted: a recording, and the nominal machine."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from vibgym import checks
from vibgym.actuators import ACTUATORS
from vibgym.identification.guess import latencies_of
from vibgym.identification.law import Rise
from vibgym.identification.log import Log
from vibgym.identification.plant import Parameters
from vibgym.identification.segments import timing_of
from vibgym.identification.solver import Estimate
from vibgym.physics.core.hardware import FORMS, HARD
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

OUTSIDE = 0.05
"""m beyond the table at which a part may be measured: an offset of the camera."""

ERRATIC = 0.3
"""Heading changes between images, in periods of the part's symmetry, that a tenth may exceed; of random ones, 0.45."""

KNOWN = 1.05
"""Lift-off over the nominal limit up to which the elements' limit is the nominal one."""


class Problem:
    """A recording, the nominal machine, and what a fit finds besides numbers.

    Args:
        log: the recording.
        surface, parts: nominal ones.

    Attributes:
        surface: with the frequency of the recording, and lift-off as its largest amplitude; ``nominal`` without.
        limit: m, largest amplitude of the elements; commands have that of ``nominal``, which need not be the same.
        kinds, kind_of: different parts, and the kind of each part.
        sheet: data sheet of the nominal actuators.
        names: of the shared parameters, in the order of :meth:`Parameters.vector`.
        alternatives: see :class:`vibgym.identification.Fitted`.
        remarks: notes about the fit.
        faults: reasons not to use its result.
        laws: friction laws by kind, of those that require one.

    Raises:
        ValueError: commands for another surface, other parts, or too little data.
    """

    def __init__(self, log: Log, surface: Surface, parts: tuple[Part, ...]) -> None:
        _check_machine(log, surface, parts)
        self.log, self.nominal, self.parts = log, surface, parts
        self.timing = timing_of(log, surface.period)
        frequency = 1.0 / self.timing.period
        lift_off = surface.gravity / (2.0 * math.pi * frequency) ** 2
        self.surface = replace(surface, frequency=frequency, max_amplitude=lift_off)
        nominal_limit = min(surface.max_amplitude or math.inf, lift_off)
        self.limit = lift_off if lift_off > KNOWN * nominal_limit else nominal_limit
        self.kinds, self.kind_of = kinds_of(parts, Part.same_as)
        self.sheet = ACTUATORS.make("actuators", log.settings["actuators"], surface, 1, 1).data_sheet
        self.latencies = latencies_of(self.sheet)
        self.names = [*_friction_names(self.kinds), *Parameters.GLOBALS]
        self.alternatives: dict[str, float] = {}
        self.remarks: list[str] = []
        self.faults: list[str] = []
        self.laws: dict[int, Rise] = {}

    def fixed(self, now: Estimate) -> list[int]:
        """Return the indices of parameters without derivatives: a hard dead zone has steps."""
        return [self.names.index("dead_zone")] if now.parameters.dead_zone_form == FORMS[HARD] else []


def _check_machine(log: Log, surface: Surface, parts: Sequence[Part]) -> None:
    """Raise ValueError for a recording of another machine."""
    shape = log.amplitude.shape[1:]
    if shape != (surface.rows, surface.columns):
        raise checks.refuse(
            "log",
            f"commands for {shape[0]} x {shape[1]} elements",
            f"of this surface, {surface.rows} x {surface.columns}",
        )
    if log.surface.element_size != surface.element_size:
        got = f"elements of {log.surface.element_size:g} m"
        raise checks.refuse("log", got, f"of this surface, with elements of {surface.element_size:g} m")
    assert surface.max_amplitude is not None
    most = float(log.amplitude.max())
    if most > surface.max_amplitude * (1.0 + 1e-6):
        raise checks.refuse("log.amplitude", f"{most:g} m", f"at most the surface's {surface.max_amplitude:g} m")
    if len(parts) != log.pose.shape[1]:
        raise checks.refuse("parts", f"{len(parts)}", f"the {log.pose.shape[1]} of the recording, in its order")
    size, place = np.array([surface.width, surface.depth]), log.pose[..., :2]
    off = ((place < -OUTSIDE) | (place > size + OUTSIDE)).any(axis=2)
    if off.any():
        row, part = np.argwhere(off)[0].tolist()
        x, y = place[row, part].tolist()
        allowed = f"in m, on the table of {size[0]:g} x {size[1]:g} m or at most {OUTSIDE:g} m outside"
        raise checks.refuse("log.pose", f"x {x:g}, y {y:g} in row {row}", allowed)
    if np.abs(log.phase).max() > 2.0 * math.pi:
        raise checks.refuse("log.phase", f"{np.abs(log.phase).max():g}", "in [-2 pi, 2 pi] rad")
    for k, part in enumerate(parts):
        heading = log.pose[np.isfinite(log.pose[:, k, 2]), k, 2]
        turns = np.abs(np.diff(heading)) * max(part.symmetry, 1) / (2.0 * math.pi)
        if part.symmetry and len(turns) and np.quantile(np.abs(turns - np.round(turns)), 0.9) > ERRATIC:
            got = f"headings of part {k} that change at random between images, from {heading.min():g} to {heading.max():g}"
            raise checks.refuse("log.pose", got, "headings in rad, one image a period")
    if surface.horizontal_amplitude == 0.0:
        raise checks.refuse("surface.horizontal_amplitude", 0.0, "above 0: a still table does not move parts")


def _friction_names(kinds: Sequence[Part]) -> list[str]:
    """Return a name for the friction of each kind."""
    if len(kinds) == 1:
        return ["friction"]
    names = [f"friction.{kind.name}" for kind in kinds]
    return [name if names.count(name) == 1 else f"{name}-{k}" for k, name in enumerate(names)]
