"""Scenes: a part, a surface and a drive in many worlds, drawn from a seed."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import AfterValidator, Field

from vibgym import checks, fields
from vibgym.registry import Registry
from vibgym.scene.parts import Part, part_from
from vibgym.scene.surface import Surface, surface_from
from vibgym.settings import Angle, BaseSettings, Length, Speed, Unit, read


def _ordered(ends: tuple[float, float]) -> tuple[float, float]:
    if ends[0] > ends[1]:
        raise checks.conflict(f"the low end must be <= the high one, got {list(ends)}")
    return ends


Lengths = Annotated[tuple[Length, Length], AfterValidator(_ordered)]
Angles = Annotated[tuple[Angle, Angle], AfterValidator(_ordered)]
Spins = Annotated[tuple[float, float], Unit("rad/s"), AfterValidator(_ordered)]


class StartSettings(BaseSettings):
    """Distribution of the start, uniform over ranges.

    Attributes:
        x, y: of the centre of mass, m; None: within an element of the middle of the surface, and its inner half.
        heading: rad.
        spin: rad/s.
        velocity: ``"rest"``, ``"idle"`` (as on elements at rest, thesis eq. 3.30) or its components, m/s.
    """

    x: Lengths | None = None
    y: Lengths | None = None
    heading: Angles = (0.0, 2.0 * math.pi)
    spin: Spins = (0.0, 0.0)
    velocity: Literal["rest", "idle"] | tuple[Speed, Speed] = "idle"


class RandomDrive(BaseSettings):
    """Every element's phasor drawn uniformly from a disc.

    Attributes:
        strength, least_strength: radius of the disc and of its hole, as fractions of the largest amplitude.
        every: periods between new phasors; None: constant.
    """

    strength: float = Field(default=1.0, ge=0.0, le=1.0)
    least_strength: float = Field(default=0.0, ge=0.0, le=1.0)
    every: int | None = Field(default=None, ge=1)


class UniformDrive(BaseSettings):
    """One motion for all elements: amplitude (m; None is the largest) and phase (rad)."""

    amplitude: Length | None = Field(default=None, ge=0.0)
    phase: Angle = 1.5 * math.pi


class FieldsDrive(BaseSettings):
    """A sum of fields of ``vibgym.fields``.

    Attributes:
        fields: mappings of ``kind`` (uniform, squeeze, radial, tangential) and that field's arguments.
        lead: whether their direction is corrected for friction (``vibgym.fields.lead_angle``).
    """

    fields: tuple[Any, ...] = Field(min_length=1)
    lead: bool = True


Drive = RandomDrive | UniformDrive | FieldsDrive
DRIVES: Registry[type[Drive]] = Registry(
    "drive", {"random": RandomDrive, "uniform": UniformDrive, "fields": FieldsDrive}
)
FIELDS: Registry[Callable[..., fields.Field]] = Registry(
    "field", {field.__name__: field for field in (fields.uniform, fields.squeeze, fields.radial, fields.tangential)}
)


class SceneSettings(BaseSettings):
    """One scene.

    Attributes:
        name: shown in the report; unique.
        note: a sentence about it.
        surface, part: as for the environments: a name or a mapping.
        worlds: number of different worlds.
        periods: duration.
        settle: periods at the beginning that are left out of the mean velocity, so that it is the steady one.
        seed: of all random values.
        start: distribution of the start.
        drive: mapping of ``kind`` among :data:`DRIVES` and its settings.
        strong_tolerances, weak_tolerances: override the report's.
    """

    name: str = Field(min_length=1, max_length=60)
    note: str = ""
    surface: Any = "prototype"
    part: Any = "aluminium_block"
    worlds: int = Field(default=32, ge=1, le=10_000)
    periods: int = Field(default=25, ge=1, le=100_000)
    settle: int = Field(default=0, ge=0)
    seed: int = Field(default=0, ge=0, lt=2**63)
    start: StartSettings = StartSettings()
    drive: Any
    strong_tolerances: tuple[Annotated[Length, Field(gt=0.0)], ...] | None = None
    weak_tolerances: tuple[Annotated[float, Field(gt=0.0)], ...] | None = None


class Segment(NamedTuple):
    """A drive that is held for some periods: amplitude (m) and phase (rad), each (worlds, rows, columns)."""

    amplitude: np.ndarray
    phase: np.ndarray
    periods: int


class Scene(NamedTuple):
    """Input of every candidate."""

    name: str
    note: str
    surface: Surface
    part: Part
    pose: np.ndarray  # (worlds, 3) m and rad, at the start
    velocity: np.ndarray  # (worlds, 3) m/s and rad/s
    segments: tuple[Segment, ...]  # drives one after the other; one of them ends after ``settle`` periods
    settle: int
    strong_tolerances: tuple[float, ...]
    weak_tolerances: tuple[float, ...]

    @property
    def worlds(self) -> int:
        """Number of worlds."""
        return len(self.pose)

    @property
    def periods(self) -> int:
        """Duration of the run."""
        return sum(segment.periods for segment in self.segments)

    @property
    def slides(self) -> bool:
        """Whether the part slides all the time under any drive."""
        return self.surface.slides_permanently(self.part.static_friction)

    @property
    def held(self) -> bool:
        """Whether the drive is constant."""
        return all(segment.amplitude is self.segments[0].amplitude for segment in self.segments)

    @property
    def lever(self) -> float:
        """Lever of rotations in errors, m: 0 for discs."""
        return self.part.radius if self.part.symmetry else 0.0


def first_periods(scene: Scene, periods: int, worlds: int) -> Scene:
    """Return the beginning of a scene: at most ``periods``, and its first worlds."""
    segments, left = [], periods
    for amplitude, phase, length in scene.segments:
        if left > 0:
            segments.append(Segment(amplitude[:worlds], phase[:worlds], min(length, left)))
            left -= length
    pose, velocity = scene.pose[:worlds], scene.velocity[:worlds]
    return scene._replace(pose=pose, velocity=velocity, segments=tuple(segments), settle=0)


def scenes_from(
    listed: Sequence[Any], strong_tolerances: Sequence[float] = (1e-4,), weak_tolerances: Sequence[float] = (0.02,)
) -> list[Scene]:
    """Return scenes from mappings of :class:`SceneSettings`.

    Args:
        listed: the mappings.
        strong_tolerances, weak_tolerances: defaults for scenes.

    Raises:
        ValueError: the first fault, in one line that begins with ``scenes.<number>``.
    """
    scenes: list[Scene] = []
    for index, data in enumerate(listed):
        where = f"scenes.{index}"
        scene = scene_from(data, where, strong_tolerances, weak_tolerances)
        if any(scene.name == other.name for other in scenes):
            raise checks.refuse(f"{where}.name", scene.name, "a name that no other scene has")
        scenes.append(scene)
    return scenes


def scene_from(
    data: Any, where: str, strong_tolerances: Sequence[float] = (1e-4,), weak_tolerances: Sequence[float] = (0.02,)
) -> Scene:
    """Return one scene; see :func:`scenes_from`."""
    settings = read(SceneSettings, data, where)
    with checks.within(f"{where}.surface"):
        surface = surface_from(settings.surface)
    with checks.within(f"{where}.part"):
        part = part_from(settings.part, "part")
    if settings.settle >= settings.periods:
        raise checks.refuse(f"{where}.settle", settings.settle, f"less than the {settings.periods} periods of the run")
    kind, own = DRIVES.split(f"{where}.drive", settings.drive)
    drive = read(DRIVES[kind], own, f"{where}.drive")
    rng = np.random.default_rng(settings.seed)
    pose, velocity = _starts(settings.start, surface, part, settings.worlds, rng, f"{where}.start")
    checks.label(f"{where}.name", settings.name)
    if settings.note:
        checks.label(f"{where}.note", " ".join(settings.note.split()), most=2000)
    segments = _segments(drive, surface, part, settings, rng, f"{where}.drive")
    strong, weak = settings.strong_tolerances, settings.weak_tolerances
    return Scene(
        settings.name, settings.note, surface, part, pose, velocity, segments, settings.settle,
        tuple(strong_tolerances) if strong is None else strong, tuple(weak_tolerances) if weak is None else weak,
    )  # fmt: skip


def _starts(
    start: StartSettings, surface: Surface, part: Part, worlds: int, rng: np.random.Generator, where: str
) -> tuple[np.ndarray, np.ndarray]:
    def within(name: str, ends: tuple[float, float] | None, extent: float) -> tuple[float, float]:
        middle, reach = 0.5 * extent, min(surface.element_size, 0.25 * extent)
        low, high = (middle - reach, middle + reach) if ends is None else ends
        if not 0.0 <= low <= high <= extent:
            raise checks.refuse(f"{where}.{name}", (low, high), f"a range [low, high] within [0, {extent:g}] m")
        return low, high

    ranges = [within("x", start.x, surface.width), within("y", start.y, surface.depth), start.heading]
    pose = np.stack([rng.uniform(*ends, size=worlds) for ends in ranges], axis=1)
    velocity = np.zeros((worlds, 3))
    if start.velocity == "idle":
        velocity[:, :2] = surface.idle_velocity(part.friction)
    elif start.velocity != "rest":
        velocity[:, :2] = start.velocity
    velocity[:, 2] = rng.uniform(*start.spin, size=worlds)
    return pose, velocity


def _segments(
    drive: Drive, surface: Surface, part: Part, settings: SceneSettings, rng: np.random.Generator, where: str
) -> tuple[Segment, ...]:
    periods, settle = settings.periods, settings.settle
    shape = (settings.worlds, surface.rows, surface.columns)
    assert surface.max_amplitude is not None
    largest = surface.max_amplitude
    if isinstance(drive, RandomDrive) and drive.every is not None:
        if settle % drive.every:
            allowed = f"a divisor of settle, {settle}, so that both end at once"
            raise checks.refuse(f"{where}.every", drive.every, allowed)
        lengths = [min(drive.every, periods - done) for done in range(0, periods, drive.every)]
        return tuple(Segment(*_random(drive, largest, shape, rng), length) for length in lengths)
    if isinstance(drive, RandomDrive):
        amplitude, phase = _random(drive, largest, shape, rng)
    elif isinstance(drive, UniformDrive):
        level = largest if drive.amplitude is None else drive.amplitude
        level = checks.number(f"{where}.amplitude", level, most=largest)
        amplitude, phase = np.full(shape, level), np.full(shape, drive.phase)
    else:
        total = _fields(drive.fields, f"{where}.fields")
        sampled = total.drive(surface, friction=part.friction if drive.lead else None)
        amplitude, phase = (np.ascontiguousarray(np.broadcast_to(array, shape)) for array in sampled)
    held = [periods] if settle == 0 else [settle, periods - settle]
    return tuple(Segment(amplitude, phase, length) for length in held)


def _random(
    drive: RandomDrive, largest: float, shape: tuple[int, ...], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    low = min(drive.least_strength, drive.strength) ** 2
    share = np.sqrt(low + (drive.strength**2 - low) * rng.uniform(size=shape))
    return largest * np.minimum(share, 1.0), rng.uniform(0.0, 2.0 * math.pi, shape)


def _fields(listed: Sequence[Any], where: str) -> fields.Field:
    parts = []
    for index, entry in enumerate(listed):
        at = f"{where}.{index}"
        for name, value in FIELDS.split(at, entry)[1].items():
            checks.number(f"{at}.{name}", value)
        with checks.within(at):
            parts.append(FIELDS.make("field", entry))
    return sum(parts[1:], start=parts[0])
