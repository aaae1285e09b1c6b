"""Actuators of the thesis's prototype: dead zone, limit, latency, spread between elements.

Known from the thesis: amplitudes below 0.1 mm were not realised (7.2, 7.3), the limit was near 0.25 mm (figs. 7.8 to 7.10),
the latency was one period (eq. 5.81). Resolution, bandwidth, spread (6.4.2, lost text) and the form of the dead zone are
assumptions; each is a setting.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import replace
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from pydantic import Field

from vibgym import checks
from vibgym.actuators.commands import Commands, inverse_of
from vibgym.actuators.stage import ActuatorStage, DataSheet
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import Drive, all_phasors, cartesian_drive, follow_phasors
from vibgym.physics.core.hardware import (
    DEAD_ZONE,
    FORMS,
    HARD,
    HARDWARE,
    LIMIT,
    NUMBERS,
    RESOLUTION,
    ROUNDING,
    Hardware,
    draw_elements,
)
from vibgym.physics.core.noise import KEY_DRAWS, keys_from
from vibgym.scene.surface import Surface
from vibgym.settings import Angle, Length

MAX_LATENCY = 1000
"""Periods: 40 s, longer than any episode."""

MAX_SPREAD = 0.5

MAX_GAIN = 10.0


FIXED = ("dead_zone_form", "seed", "gain", "phase", "elements", "compensate")
"""Settings without ranges."""

Share = Annotated[float, Ge(0.0), Le(1.0)]


class PrototypeActuators(ActuatorStage):
    """Elements with a dead zone, a limit, latency, spread, and faults.

    A commanded amplitude passes resolution, limit, dead zone, the gain and phase error of the element, and the largest
    amplitude of the surface, in this order.

    Raises:
        ValueError: settings that do not fit this surface.
    """

    class Settings(ActuatorStage.Settings):
        """Settings of the prototype's actuators."""

        dead_zone: Length = Field(default=1e-4, ge=0.0)
        """Amplitude below which commands are not fully realised."""

        dead_zone_form: Literal["hard", "soft", "cubic"] = "hard"
        """Response to a smaller amplitude ``a``: ``"hard"``: 0, ``"soft"``: a^2 / dead_zone, ``"cubic"``: a^3 / dead_zone^2."""

        limit: Length | None = Field(default=None, gt=0.0)
        """Largest amplitude; None: that of the surface."""

        latency: int = Field(default=1, ge=0, le=MAX_LATENCY)
        """Periods between a command and its effect; elements rest until the first one takes effect. Data sheet and estimators
        use this value, also where ``randomize`` draws others."""

        gain_spread: float = Field(default=0.05, ge=0.0, le=MAX_SPREAD)
        """Standard deviation of the elements' gains, normal."""

        phase_spread: Angle = Field(default=math.radians(5.0), ge=0.0, le=math.pi)
        """Standard deviation of the elements' phase errors, normal."""

        bandwidth: float | None = Field(default=None, gt=0.0, le=1e6)
        """Hz, of a first-order lag; None: no lag. With a lag every step reads all elements."""

        resolution: Length = Field(default=0.0, ge=0.0)
        """Of amplitudes; 0: continuous."""

        dead: Share | tuple[tuple[float, float], ...] = 0.0
        """Elements that never move: their share, drawn at random, or a list of [row, column]."""

        stuck: Share | tuple[tuple[float, float, float, float], ...] = 0.0
        """Elements with a fixed amplitude and phase: their share, or a list of [row, column, amplitude in m, phase in rad]."""

        seed: int | None = Field(default=None, ge=0, le=2**63 - 1)
        """Of one hardware instance, the same in all worlds and episodes; None: drawn for every episode."""

        gain: float = Field(default=1.0, ge=0.0, le=MAX_GAIN)
        """Factor that all elements have in common, as identified on a machine."""

        phase: Angle = Field(default=0.0, ge=-2.0 * math.pi, le=2.0 * math.pi)
        """Phase error that all elements have in common, as identified on a machine."""

        elements: tuple[tuple[tuple[Annotated[float, Ge(0.0), Le(MAX_GAIN)], float], ...], ...] | None = None
        """(rows, columns, 2) further factor and phase (rad) of each element of one machine, in addition to what the spreads
        draw (usually 0 then); None: 1 and 0."""

        compensate: bool = False
        """Whether commands are divided by ``gain``, ``phase`` and ``elements`` before the elements get them, so that an
        identified machine moves as commanded where its elements can. The data sheet has the limits of what results."""

    settings: Settings

    VARIED = tuple(name for name in Settings.model_fields if name not in FIXED)

    def __init__(self, surface: Surface, worlds: int, periods: int, settings: Settings | None = None) -> None:
        super().__init__(surface, worlds, periods, settings)
        assert surface.max_amplitude is not None
        own = self.settings
        self.most = most = surface.max_amplitude
        self.latency = own.latency
        self._faults = dead, stuck = _places("dead", own.dead, surface), _places("stuck", own.stuck, surface)
        if {*map(tuple, dead[:, :2])} & {*map(tuple, stuck[:, :2])}:
            raise checks.conflict("actuators.stuck and actuators.dead must name different elements")
        self._numbers = {
            **{name: getattr(own, name) for name in self.VARIED},
            "limit": most if own.limit is None else own.limit,
            "latency": float(own.latency),
            "bandwidth": math.inf if own.bandwidth is None else own.bandwidth,
            "dead": 0.0 if isinstance(own.dead, tuple) else own.dead,
            "stuck": 0.0 if isinstance(own.stuck, tuple) else own.stuck,
        }
        for name in ("dead_zone", "limit", "resolution"):
            checks.number(f"actuators.{name}", self._numbers[name], most=most)
        _check_dead_zone("actuators.dead_zone", self._numbers["dead_zone"], self._numbers["limit"])
        _check_shares("actuators.stuck", self._numbers["stuck"], self._numbers["dead"])
        self._response = self._complex_response()
        compensated = own.compensate and self._response is not None
        self._inverse = inverse_of(self._response, (surface.rows, surface.columns)) if compensated else None
        self._ranges: dict[str, tuple[float, float]] = {}
        self._own = {name: np.full(worlds, value) for name, value in self._numbers.items()}
        self._make()

    def _complex_response(self) -> np.ndarray | None:
        """Return the complex factor of every element in addition to the drawn ones, (rows, columns); None: 1."""
        gain, phase, elements = self.settings.gain, self.settings.phase, self.settings.elements
        if elements is None:
            return None if gain == 1.0 and phase == 0.0 else np.array(gain * np.exp(1j * phase))
        shape = (self.surface.rows, self.surface.columns, 2)
        own = checks.shaped("actuators.elements", elements, (shape,), "an array", " (rows, columns, gain and phase)")
        return gain * own[..., 0] * np.exp(1j * (phase + own[..., 1]))

    @property
    def _scale(self) -> float:
        """Mean gain from commands to motion that compensation hides, of the elements that work."""
        return 1.0 if self._inverse is None else float(np.mean(1.0 / np.abs(self._inverse[self._inverse != 0.0])))

    def compensated(self, command: Drive) -> Drive:
        if self._inverse is None:
            return command
        phasors, (zone, moving) = self._phasors, self._edge
        all_phasors(command, phasors)
        sent = (phasors[..., 0] + 1j * phasors[..., 1]) * self._inverse
        if self.settings.dead_zone_form == FORMS[HARD] and zone > 0.0:
            # A strong element must not fall into its dead zone where the one of the data sheet moves.
            size, requested = np.abs(sent), np.hypot(phasors[..., 0], phasors[..., 1])
            short = (requested >= (1.0 - ROUNDING) * zone * self._scale) & (size > 0.0) & (size < moving)
            sent[short] *= moving / size[short]
        self._sent[0], self._sent[1] = sent.real, sent.imag
        return cartesian_drive(*self._sent)

    def vary(self, ranges: Mapping[str, Any]) -> None:
        most, inside = self.most, {}
        bounds: dict[str, tuple[float, float]] = {
            "dead_zone": (0.0, most), "limit": (1e-9, most), "latency": (0, MAX_LATENCY), "gain_spread": (0.0, MAX_SPREAD),
            "phase_spread": (0.0, math.pi), "bandwidth": (1e-6, 1e6), "resolution": (0.0, most), "dead": (0.0, 1.0),
            "stuck": (0.0, 1.0),
        }  # fmt: skip
        for name, value in ranges.items():
            where = f"randomize[{name!r}]"
            low, high = checks.interval(where, value, *bounds[name])
            if name == "latency":
                for k, end in enumerate((low, high)):
                    checks.count(f"{where}[{k}]", int(end) if end == int(end) else end, least=0)
            inside[name] = (low, high)
        ends = {name: inside.get(name, (value, value)) for name, value in self._numbers.items()}
        name = "dead_zone" if "dead_zone" in inside else "limit"
        _check_dead_zone(f"randomize[{name!r}]", ends["dead_zone"][1], ends["limit"][0])
        name = "stuck" if "stuck" in inside else "dead"
        _check_shares(f"randomize[{name!r}]", ends["stuck"][1], ends["dead"][1])
        self._ranges = inside
        self._make()

    def _make(self) -> None:
        """Create everything that depends on settings and ranges."""
        surface, worlds = self.surface, self.worlds
        least, most = map(int, self._ranges.get("latency", (self.latency, self.latency)))
        self.most_latency, self._room = most, -(-most // self.periods) + 1
        # Instants of a step at which the command of any world may change. The step is split at all of them in all worlds: the
        # rounding of the averaged model depends on the splits, and a world's result must not depend on other worlds.
        self._edges = sorted({0, self.periods, *(delay % self.periods for delay in range(least, most + 1))})
        self._lagging = math.isfinite(self._numbers["bandwidth"]) or "bandwidth" in self._ranges
        keyed = self.settings.seed is None
        self.draws = (KEY_DRAWS if keyed else 0) + len(self._ranges)
        self._fixed_key = (
            None if keyed else np.random.SeedSequence(self.settings.seed).generate_state(2).astype(np.int64)
        )
        shape = (worlds, surface.rows, surface.columns)
        self._hardware = Pinned(
            HARDWARE,
            Hardware(
                source=np.full(worlds, -1),
                element=np.zeros((*shape, 4)),
                number=np.zeros((worlds, len(NUMBERS))),
                form=FORMS.index(self.settings.dead_zone_form),
                top=surface.full_scale,
            ),
        )
        self._reached = np.zeros((*shape, 2) if self._lagging else (0, 0, 0, 2))
        self._mean = np.zeros((2, *shape)) if self._lagging else np.zeros((2, 0, 0, 0))
        self._keep = np.zeros((worlds, 2))
        compensated = shape if self._inverse is not None else (0, 0, 0)
        self._phasors, self._sent = np.zeros((*compensated, 2)), np.zeros((2, *compensated))
        zone = self._ranges.get("dead_zone", (0.0, self._numbers["dead_zone"]))[1]
        moving = zone + 0.5 * self._numbers["resolution"]  # commands are rounded before the dead zone applies
        self._edge = zone * surface.angular_frequency**2, moving * surface.angular_frequency**2  # m/s^2
        self._everyone = np.arange(worlds)
        self._commands: Commands | None = None

    def prepare(self, command: Drive) -> None:
        command = self.compensated(command)
        step = sum(array.nbytes for array in command if isinstance(array, np.ndarray))
        checks.fitting("actuators.latency", self.most_latency, step / self.periods)
        self._commands = Commands(command, self.worlds, self._room)

    @property
    def data_sheet(self) -> DataSheet:
        own, scale = self._own_sheet, self._scale
        if scale == 1.0:
            return own
        limit, zone, resolution = (scale * length for length in (own.limit, own.dead_zone, own.resolution))
        return replace(own, limit=min(limit, self.most), dead_zone=zone, resolution=resolution)

    @property
    def _own_sheet(self) -> DataSheet:
        """Data sheet of the elements without compensation."""
        own, form = dict(self._numbers), self.settings.dead_zone_form
        if "dead_zone" in self._ranges:  # values that hold in every episode
            own["dead_zone"] = self._ranges["dead_zone"][1]
        if "limit" in self._ranges:
            own["limit"] = self._ranges["limit"][0]
        bandwidth = own["bandwidth"] if math.isfinite(own["bandwidth"]) else None
        return DataSheet(own["limit"], own["dead_zone"], form, self.latency, own["resolution"], bandwidth)

    @property
    def most_amplitude(self) -> float:
        if self._most_drawn("gain_spread") > 0.0 or self._stuck or self._response is not None:
            return self.most  # gains apply after the limit
        return self._most_drawn("limit")

    @property
    def least_latency(self) -> int:
        return 0 if self._stuck else int(self._ranges.get("latency", (self.latency, self.latency))[0])

    @property
    def _stuck(self) -> bool:
        """Whether an element may be stuck in motion."""
        return bool(len(self._faults[1])) or self._most_drawn("stuck") > 0.0

    def _most_drawn(self, name: str) -> float:
        return self._ranges.get(name, (0.0, self._numbers[name]))[1]

    def nominal(self) -> PrototypeActuators:
        sheet = self._own_sheet
        own = {
            "dead_zone": sheet.dead_zone,
            "limit": sheet.limit,
            "latency": 0,
            "gain_spread": 0.0,
            "phase_spread": 0.0,
        }
        settings = self.settings.model_copy(update={**own, "dead": 0.0, "stuck": 0.0, "seed": 0})
        return PrototypeActuators(self.surface, self.worlds, self.periods, settings)

    def drawn(self) -> dict[str, np.ndarray]:
        return {name: self._own[name] for name in self._ranges}

    @property
    def elements(self) -> np.ndarray:
        """(worlds, rows, columns, 4) response of every element, a copy: complex gain (1: as commanded, 0: none), and constant
        phasor as a fraction of full scale."""
        elements = self._hardware.record.element.copy()
        elements[..., 2:] /= max(self.surface.full_scale, 1e-300)
        return elements

    def reset(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        assert self._commands is not None
        self._commands.clear(worlds)
        self._hardware.record.source[worlds] = -1
        self._reached[worlds if self._lagging else slice(0)] = 0.0
        if len(worlds):
            self._draw(worlds, uniform)

    def _draw(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        """Draw elements and settings of new episodes."""
        keys = (
            keys_from(uniform[:, :KEY_DRAWS]) if self._fixed_key is None else np.tile(self._fixed_key, (len(worlds), 1))
        )
        own = self._own
        for k, (name, (low, high)) in enumerate(self._ranges.items()):
            share = uniform[:, self.draws - len(self._ranges) + k]
            own[name][worlds] = (
                low + np.floor(share * (high - low + 1)) if name == "latency" else low + share * (high - low)
            )
        scale, record = self.surface.angular_frequency**2, self._hardware.record
        for column, name in ((DEAD_ZONE, "dead_zone"), (LIMIT, "limit"), (RESOLUTION, "resolution")):
            record.number[worlds, column] = own[name][worlds] * scale
        spread = np.column_stack([own["gain_spread"][worlds], own["phase_spread"][worlds]])
        faulty = np.column_stack([own["dead"][worlds], own["stuck"][worlds]])
        draw_elements(self._hardware.address, worlds, keys, spread, faulty)
        if self._response is not None:
            element = record.element[worlds]
            turned = (element[..., 0] + 1j * element[..., 1]) * self._response
            element[..., 0], element[..., 1] = turned.real, turned.imag
            record.element[worlds] = element
        for fault in self._faults:
            for row, column, *motion in fault.tolist():
                amplitude, phase = motion or (0.0, 0.0)
                own_motion = [scale * amplitude * math.cos(phase), scale * amplitude * math.sin(phase)]
                record.element[worlds, int(row), int(column)] = [0.0, 0.0, *own_motion]
        if self._lagging:
            rate = 2.0 * math.pi * own["bandwidth"][worlds] * self.surface.period
            self._keep[worlds, 0], self._keep[worlds, 1] = np.exp(-rate), -np.expm1(-rate) / rate

    def apply(self, command: Drive) -> Iterable[tuple[Drive, int]]:
        assert self._commands is not None
        source, command = self._hardware.record.source, self.compensated(command)
        if self._room == 1 and not self._lagging:  # no latency: the command itself
            source[...] = self._everyone
            yield command._replace(hardware=self._hardware.address), self.periods
            return
        drive = self._commands.write(command, self._hardware.address)
        latency = self._own["latency"].astype(np.int64) if "latency" in self._ranges else self.latency
        for begin, end in zip(self._edges, self._edges[1:]):
            self._commands.rows(-((begin - latency) // self.periods), source)
            if not self._lagging:
                yield drive, end - begin
                continue
            for _ in range(end - begin):
                follow_phasors(drive, self._keep, self._reached, *self._mean)
                yield cartesian_drive(*self._mean), 1

    def live(self) -> dict[str, np.ndarray]:
        assert self._commands is not None
        record = self._hardware.record
        drawn = {"element": record.element, "number": record.number, "keep": self._keep}
        own = {f"own_{name}": self._own[name] for name in self._ranges}
        return {**self._commands.state(), **drawn, **own, "reached": self._reached}


def _places(name: str, value: float | tuple[tuple[float, ...], ...], surface: Surface) -> np.ndarray:
    """Return listed faults (n, 2 or 4): row, column, and for stuck elements amplitude (m) and phase (rad)."""
    if not isinstance(value, tuple) or not value:
        return np.zeros((0, 4))
    faults = np.array(value)
    places, most = faults[:, :2], [surface.rows, surface.columns]
    twice = len(np.unique(places, axis=0)) < len(faults)
    if twice or not ((places == np.floor(places)) & (places >= 0) & (places < most)).all():
        allowed = f"a list of different elements, rows 0 to {surface.rows - 1}, columns 0 to {surface.columns - 1}"
        raise checks.refuse(f"actuators.{name}", value, allowed)
    if name == "stuck":
        checks.array("actuators.stuck (amplitude)", faults[:, 2], (len(faults),), least=0.0, most=surface.max_amplitude)  # type: ignore[arg-type]
    return faults


def _check_dead_zone(where: str, dead_zone: float, limit: float) -> None:
    if dead_zone > 0.0 and dead_zone >= limit:
        raise checks.refuse(where, f"{dead_zone:g} m", f"less than the limit, {limit:g} m")


def _check_shares(where: str, stuck: float, dead: float) -> None:
    if stuck + dead > 1.0:
        raise checks.refuse(where, stuck, f"at most {1.0 - dead:g} with a share of {dead:g} dead elements")
