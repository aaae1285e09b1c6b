"""The model that is fitted: segments of a recording, simulated in one batch for all finite differences."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks
from vibgym.identification.log import Log
from vibgym.identification.machine import Camera
from vibgym.identification.segments import Segment
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import polar_drive
from vibgym.physics.core.hardware import DEAD_ZONE, FORMS, HARDWARE, LIMIT, NUMBERS, RESOLUTION, Hardware
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import Simulator

LOCAL = 6
"""Numbers of a segment's initial state: pose and velocity."""

LOCAL_STEPS = np.array([2e-6, 2e-6, 1e-4, 1e-4, 1e-4, 2e-3])
ELEMENT_STEP = 2e-3
"""Steps of finite differences. Ten times larger ones cost accuracy: errors of the derivatives of nearly exchangeable parameters
count as information."""

FINE = {"steps": 10, "substeps": 4}
"""Time steps of predictions in a period, twice those of derivatives, whose errors only slow the convergence down."""

MAX_ELEMENTS = 3_000_000
"""Elements of all worlds in a batch: limits memory to about 100 MB."""


@dataclass(frozen=True)
class Parameters:
    """Parameters of a machine.

    Attributes:
        friction: (kinds,) coefficients.
        horizontal_amplitude: m.
        gain, phase: of all elements.
        dead_zone: m.
        dead_zone_form: see :data:`vibgym.physics.core.hardware.FORMS`.
        latency: periods.
        camera: (4,) scale, turn (rad), x and y (m), see :class:`Camera`.
        elements: (rows, columns, 2) gain of each element less the common gain, and phase error (rad). A relative error would
            bias the common gain by the square of the spread: where both are fitted, larger gains have smaller relative errors.
    """

    friction: np.ndarray
    horizontal_amplitude: float
    gain: float
    phase: float
    dead_zone: float
    dead_zone_form: str
    latency: int
    camera: np.ndarray
    elements: np.ndarray

    GLOBALS = (
        "horizontal_amplitude",
        "gain",
        "phase",
        "dead_zone",
        "camera_scale",
        "camera_turn",
        "camera_x",
        "camera_y",
    )

    def vector(self) -> np.ndarray:
        """Return friction and the parameters in :attr:`GLOBALS`; logarithms of positive factors, and the dead zone in mm."""
        scale, turn, x, y = self.camera
        own = [math.log(self.horizontal_amplitude), math.log(self.gain), self.phase, 1e3 * self.dead_zone]
        return np.array([*np.log(self.friction), *own, math.log(scale), turn, x, y])

    def changed(self, vector: np.ndarray, elements: np.ndarray) -> Parameters:
        """Return parameters with other values of :meth:`vector`, and of the elements."""
        n = len(self.friction)
        amplitude, gain, phase, dead_zone, scale, turn, x, y = vector[n:].tolist()
        return replace(
            self,
            friction=np.exp(vector[:n]),
            horizontal_amplitude=math.exp(amplitude),
            gain=math.exp(gain),
            phase=phase,
            dead_zone=max(1e-3 * dead_zone, 0.0),
            camera=np.array([math.exp(scale), turn, x, y]),
            elements=elements,
        )


GLOBAL_STEPS = {"friction": 2e-4, "horizontal_amplitude": 2e-4, "gain": 4e-4, "phase": 4e-4, "dead_zone": 4e-4}
"""Steps of finite differences in the units of :meth:`Parameters.vector`."""


class Derivatives(NamedTuple):
    """Derivatives of a segment's measured poses."""

    local: np.ndarray  # (n, 3, LOCAL)
    shared: np.ndarray  # (n, 3, kinds + GLOBALS)
    elements: np.ndarray  # (n, 3, elements of the segment, 2)


class _Batch(NamedTuple):
    """Worlds to simulate: (w,) and further axes."""

    segment: np.ndarray
    friction: np.ndarray
    response: np.ndarray  # (w, rows, columns) complex
    dead_zone: np.ndarray
    start: np.ndarray  # (w, LOCAL)


class Plant:
    """Simulates segments of a recording with given parameters.

    Args:
        log: the recording.
        segments: of it.
        length: periods of the longest segment.
        surface: with the frequency of the recording.
        kinds: different parts.
        limit, resolution: m, of the actuators' amplitudes.
        fine: predict with finer time steps than the derivatives'.

    Attributes:
        top: m, largest amplitude of the elements, after their gain.
    """

    def __init__(
        self,
        log: Log,
        segments: Sequence[Segment],
        length: int,
        surface: Surface,
        kinds: Sequence[Part],
        limit: float,
        resolution: float,
        *,
        fine: bool = False,
    ) -> None:
        self.segments, self.surface, self.kinds, self._length = list(segments), surface, list(kinds), length
        self._drive = polar_drive(log.amplitude, log.phase, surface.angular_frequency)
        self._rows = len(log)
        self._first = np.array([segment.first for segment in self.segments])
        self._limit, self._resolution, self.top = limit, resolution, float(surface.max_amplitude or 0.0)
        self._finer = FINE if fine else {}

    def predict(
        self, which: Sequence[int], parameters: Parameters, starts: np.ndarray, zones: np.ndarray | None = None
    ) -> list[np.ndarray]:
        """Return predicted measurements of segments ``which`` from their initial states (segments, LOCAL).

        Args:
            zones: dead zones (m) instead of that of the parameters, with the time steps of derivatives.

        Returns:
            For each segment (n, 3), or (zones, n, 3).
        """
        tried = np.array([parameters.dead_zone]) if zones is None else zones
        knobs = self._finer if zones is None else {}
        predicted: dict[int, np.ndarray] = {}
        for kind, some in self._groups(which, len(tried)):
            batch = self._batch(np.repeat(some, len(tried)), parameters, starts)
            batch = batch._replace(dead_zone=np.tile(tried, len(some)))
            path = self._simulate(kind, batch, parameters, parameters.horizontal_amplitude, **knobs)
            for k, segment in enumerate(some):
                seen = self._at(segment, path[:, k * len(tried) : (k + 1) * len(tried)])
                predicted[segment] = Camera(*parameters.camera.tolist()).measured(seen, self.surface).swapaxes(0, 1)
        return [predicted[segment][0] if zones is None else predicted[segment] for segment in which]

    def laws(
        self,
        which: Sequence[int],
        parameters: Parameters,
        starts: np.ndarray,
        kind: int,
        laws: Sequence[Mapping[str, Any]],
    ) -> list[np.ndarray]:
        """Return changes (1 + laws, n, 3) of predicted measurements by other friction laws of a kind, first by none: zeros."""
        part = self.kinds[kind]
        some = [k for k in which if self.segments[k].kind == kind]
        changes = {k: np.zeros((1 + len(laws), len(self.segments[k].instant), 3)) for k in which}
        predicted = []
        try:
            # The first law is constant, summed over points too.
            for law in [part.friction_law or {"kind": "stribeck"}, *laws]:
                self.kinds[kind] = replace(part, friction_law=dict(law))
                predicted.append(self.predict(some, parameters, starts))
        finally:
            self.kinds[kind] = part
        for k, *seen in zip(some, *predicted, strict=True):
            changes[k][:] = np.array(seen) - seen[0]
        return [changes[k] for k in which]

    def differentiate(
        self,
        which: Sequence[int],
        parameters: Parameters,
        starts: np.ndarray,
        elements: bool = False,
    ) -> list[Derivatives]:
        """Return derivatives of the predictions of segments ``which``.

        Args:
            starts: (segments, LOCAL) initial states of all segments.
            elements: compute derivatives by the elements, else return empty ones.
        """
        derivatives: dict[int, Derivatives] = {}
        most = max((len(self.segments[k].elements) for k in which), default=1)
        direct = [*(() if elements else ("gain", "phase")), "friction", "dead_zone"]  # see _assemble
        for kind, some in self._groups(which, 1 + LOCAL + 4 + (2 * most if elements else 0)):
            columns: list[tuple[int, str, int]] = []
            edges = [0]
            for segment in some:
                columns.append((segment, "base", 0))
                columns += [(segment, "local", k) for k in range(LOCAL)]
                columns += [(segment, name, 0) for name in direct]
                if elements:
                    columns += [(segment, "element", k) for k in range(2 * len(self.segments[segment].elements))]
                edges.append(len(columns))
            batch = self._batch(np.array([column[0] for column in columns]), parameters, starts)
            unit = _unit(parameters)
            for world, (segment, name, k) in enumerate(columns):
                self._perturb(batch, unit, parameters.gain, world, segment, name, k)
            path = self._simulate(kind, batch, parameters, parameters.horizontal_amplitude)
            factor = math.exp(GLOBAL_STEPS["horizontal_amplitude"])
            base = self._batch(np.array(some), parameters, starts)
            wider = self._simulate(kind, base, parameters, factor * parameters.horizontal_amplitude)
            for k, segment in enumerate(some):
                own = slice(edges[k], edges[k + 1])
                derivatives[segment] = self._assemble(segment, columns[own], path[:, own], wider[:, k], parameters)
        return [derivatives[segment] for segment in which]

    def _groups(self, which: Sequence[int], worlds: int) -> list[tuple[int, list[int]]]:
        """Return kinds and segments of batches that fit into memory, with this many worlds for a segment."""
        size = max(MAX_ELEMENTS // (worlds * self.surface.rows * self.surface.columns), 1)
        groups = []
        for kind in range(len(self.kinds)):
            some = [k for k in which if self.segments[k].kind == kind]
            groups += [(kind, some[k : k + size]) for k in range(0, len(some), size)]
        return groups

    def _batch(self, worlds: np.ndarray, parameters: Parameters, starts: np.ndarray) -> _Batch:
        """Return unperturbed worlds of segments."""
        response = np.maximum(parameters.gain + parameters.elements[..., 0], 0.0) * _unit(parameters)
        kinds = np.array([self.segments[k].kind for k in worlds])
        return _Batch(
            worlds,
            parameters.friction[kinds],
            np.tile(response, (len(worlds), 1, 1)),
            np.full(len(worlds), parameters.dead_zone),
            starts[worlds].copy(),
        )

    def _perturb(
        self, batch: _Batch, unit: np.ndarray, gain: float, world: int, segment: int, name: str, k: int
    ) -> None:
        """Change a world of a batch by the step of a finite difference; ``unit``: responses with a gain of 1."""
        if name == "local":
            batch.start[world, k] += LOCAL_STEPS[k]
        elif name == "friction":
            batch.friction[world] *= math.exp(GLOBAL_STEPS[name])
        elif name == "gain":
            batch.response[world] += gain * math.expm1(GLOBAL_STEPS[name]) * unit
        elif name == "phase":
            batch.response[world] *= np.exp(1j * GLOBAL_STEPS[name])
        elif name == "dead_zone":
            batch.dead_zone[world] += 1e-3 * GLOBAL_STEPS[name]
        elif name == "element":
            row, column = self.segments[segment].elements[k // 2]
            if k % 2:
                batch.response[world, row, column] *= np.exp(1j * ELEMENT_STEP)
            else:
                batch.response[world, row, column] += ELEMENT_STEP * unit[row, column]

    def _simulate(
        self, kind: int, batch: _Batch, parameters: Parameters, horizontal_amplitude: float, **knobs: Any
    ) -> np.ndarray:
        """Return poses (length + 1, w, 3) of worlds of one kind; ``knobs`` of the simulator."""
        surface = replace(self.surface, horizontal_amplitude=horizontal_amplitude)
        worlds, scale = len(batch.segment), surface.angular_frequency**2
        part = self.kinds[kind]
        simulator = Simulator(surface, part, worlds=worlds, **knobs)
        start = batch.start[:, None]
        simulator.place(slice(None), start[..., :3], start[..., 3:], start[..., 3:])
        with checks.within("log: the fit has diverged, check units, axes and nominal settings", kind=checks.Refused):
            simulator.condition(slice(None), {"friction": (batch.friction / part.friction)[:, None]})
        number = np.zeros((worlds, len(NUMBERS)))
        number[:, DEAD_ZONE] = batch.dead_zone * scale
        number[:, LIMIT], number[:, RESOLUTION] = self._limit * scale, self._resolution * scale
        element = np.zeros((*batch.response.shape, 4))
        element[..., 0], element[..., 1] = np.real(batch.response), np.imag(batch.response)
        form = FORMS.index(parameters.dead_zone_form)
        hardware = Pinned(HARDWARE, Hardware(np.zeros(worlds, np.int64), element, number, form, self.top * scale))
        drive = self._drive._replace(hardware=hardware.address)
        rows, path = self._first[batch.segment] - parameters.latency, np.empty((self._length + 1, worlds, 3))
        path[0] = batch.start[:, :3]
        for k in range(self._length):
            hardware.record.source[...] = np.minimum(rows + k, self._rows - 1)  # before the first row: at rest
            np.maximum(hardware.record.source, -1, out=hardware.record.source)
            simulator.advance_drive(drive, 1)
            path[k + 1] = simulator.state.pose[:, 0]
        return path

    def _at(self, segment: int, path: np.ndarray) -> np.ndarray:
        """Return poses (n, ...) at a segment's images by linear interpolation along the first axis of a path."""
        instant = self.segments[segment].instant
        before = np.clip(np.floor(instant + 1e-9).astype(int), 0, len(path) - 2)
        share = (instant - before).reshape(-1, *[1] * (path.ndim - 1))
        return path[before] * (1.0 - share) + path[before + 1] * share

    def _assemble(
        self,
        segment: int,
        columns: list[tuple[int, str, int]],
        path: np.ndarray,
        wider: np.ndarray,
        parameters: Parameters,
    ) -> Derivatives:
        """Return a segment's derivatives from its worlds."""
        poses = self._at(segment, path)  # (n, worlds, 3)
        camera, middle = Camera(*parameters.camera.tolist()), 0.5 * np.array([self.surface.width, self.surface.depth])
        seen = camera.measured(poses, self.surface)
        n, kinds, base = len(poses), len(self.kinds), seen[:, 0]
        shared = np.zeros((n, 3, kinds + len(Parameters.GLOBALS)))
        local, elements = np.zeros((n, 3, LOCAL)), []
        place = {name: kinds + k for k, name in enumerate(Parameters.GLOBALS)}
        place["friction"] = self.segments[segment].kind
        for world, (_, name, k) in enumerate(columns):
            change = seen[:, world] - base
            if name == "local":
                local[..., k] = change / LOCAL_STEPS[k]
            elif name == "element":
                elements.append(change / ELEMENT_STEP)
            elif name != "base":
                shared[..., place[name]] = change / GLOBAL_STEPS[name]
        change = camera.measured(self._at(segment, wider), self.surface) - base
        shared[..., place["horizontal_amplitude"]] = change / GLOBAL_STEPS["horizontal_amplitude"]
        off = base[:, :2] - middle - parameters.camera[2:]  # scaled and turned
        shared[:, :2, place["camera_scale"]] = off
        shared[:, 0, place["camera_turn"]], shared[:, 1, place["camera_turn"]] = -off[:, 1], off[:, 0]
        shared[:, 2, place["camera_turn"]] = 1.0
        shared[:, 0, place["camera_x"]] = shared[:, 1, place["camera_y"]] = 1.0
        stacked = (np.stack(elements, axis=-1) if elements else np.zeros((n, 3, 0))).reshape(n, 3, -1, 2)
        # Only sums of common and own errors act: derivatives that differed would forbid an exchange between them.
        if elements:
            shared[..., place["gain"]] = parameters.gain * stacked[..., 0].sum(axis=-1)
            shared[..., place["phase"]] = stacked[..., 1].sum(axis=-1)
        return Derivatives(local, shared, stacked)


def _unit(parameters: Parameters) -> np.ndarray:
    """Return (rows, columns) complex responses of elements with a gain of 1."""
    return np.exp(1j * (parameters.phase + parameters.elements[..., 1]))
