"""Scenes: a part, a surface and a drive in many worlds, drawn from a seed."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Annotated, Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks, fields
from vibgym.config import Settings, parse, part_from, surface_from
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

Range = Annotated[list[float], Field(min_length=2, max_length=2)]


class StartSettings(Settings):
    """Where the parts start, drawn evenly from ranges; None is within an element of the
    middle of the surface, and its inner half.

    Attributes:
        x, y: of the centre of mass, m.
        heading: rad.
        spin: rad/s.
        velocity: ``"rest"``, ``"idle"`` (as on elements at rest, thesis eq. 3.30) or its components, m/s.
    """

    x: Range | None = None
    y: Range | None = None
    heading: Range = [0.0, 2.0 * math.pi]
    spin: Range = [0.0, 0.0]
    velocity: Literal["rest", "idle"] | Range = "idle"


class DriveSettings(Settings):
    """How the elements move.

    Attributes:
        kind: ``"random"``: every element's phasor drawn evenly from a disc; ``"uniform"``: one motion for all;
            ``"fields"``: a sum of the fields of ``vibgym.fields``.
        strength: random, the disc's radius as a fraction of the largest amplitude; ``least_strength`` of its hole.
        every: random, new phasors after so many periods; None holds the first.
        amplitude, phase: uniform, m (None is the largest) and rad.
        fields: mappings of ``kind`` (uniform, squeeze, radial, tangential) and that field's own arguments.
        lead: fields, whether their direction is corrected for friction (``vibgym.fields.lead_angle``).
    """

    kind: Literal["random", "uniform", "fields"]
    strength: float = Field(default=1.0, ge=0.0, le=1.0)
    least_strength: float = Field(default=0.0, ge=0.0, le=1.0)
    every: int | None = Field(default=None, ge=1)
    amplitude: float | None = None
    phase: float = 1.5 * math.pi
    fields: list[Any] = []
    lead: bool = True


DRIVE_FIELDS = {
    "random": ("strength", "least_strength", "every"),
    "uniform": ("amplitude", "phase"),
    "fields": ("fields", "lead"),
}


class SuccessSettings(Settings):
    """When the run counts as a success: all that is given holds at the end.

    Attributes:
        point: x and y (m) that the centre of mass must be within ``within`` (m) of.
        line: x, y (m) and direction (rad) of a line, likewise.
        heading_within: rad, of the part's heading from the line's, whichever of its equal headings is nearest.
    """

    point: Range | None = None
    line: Annotated[list[float], Field(min_length=3, max_length=3)] | None = None
    within: float | None = Field(default=None, gt=0.0)
    heading_within: float | None = Field(default=None, gt=0.0)


class SceneSettings(Settings):
    """One scene.

    Attributes:
        name: shown in the report; each once.
        note: a sentence about it.
        surface, part: as for the environments: a name or a mapping.
        worlds: how many, all different.
        periods: that every world runs.
        settle: of these, left out of the mean velocity, so that it is the steady one.
        seed: of everything that is drawn.
        start, drive, success: mappings, see the classes above.
        strong_tolerances, weak_tolerances: instead of the report's.
    """

    name: str = Field(min_length=1, max_length=60)
    note: str = ""
    surface: Any = "prototype"
    part: Any = "aluminium_block"
    worlds: int = Field(default=32, ge=1, le=10_000)
    periods: int = Field(default=25, ge=1, le=100_000)
    settle: int = Field(default=0, ge=0)
    seed: int = Field(default=0, ge=0, lt=2**63)
    start: Any = {}
    drive: Any
    success: Any = None
    strong_tolerances: list[float] | None = None
    weak_tolerances: list[float] | None = None


class Segment(NamedTuple):
    """A drive that is held for some periods: amplitude (m) and phase (rad), each (worlds, rows, columns)."""

    amplitude: np.ndarray
    phase: np.ndarray
    periods: int


@dataclass(frozen=True)
class Scene:
    """What every candidate runs.

    Attributes:
        pose, velocity: (worlds, 3) at the start.
        segments: drives one after the other; one of them ends after ``settle`` periods.
        success: pose (worlds, 3) -> (worlds,) bool, or None.
    """

    name: str
    note: str
    surface: Surface
    part: Part
    pose: np.ndarray
    velocity: np.ndarray
    segments: tuple[Segment, ...]
    settle: int
    success: Callable[[np.ndarray], np.ndarray] | None
    strong_tolerances: tuple[float, ...]
    weak_tolerances: tuple[float, ...]

    @property
    def worlds(self) -> int:
        """How many."""
        return len(self.pose)

    @property
    def periods(self) -> int:
        """That every world runs."""
        return sum(each.periods for each in self.segments)

    @property
    def slides(self) -> bool:
        """Whether the part slides all the time under any drive."""
        return self.surface.slides_permanently(self.part.static_friction)

    @property
    def held(self) -> bool:
        """Whether one drive lasts all the time."""
        return all(each.amplitude is self.segments[0].amplitude for each in self.segments)


def first_periods(scene: Scene, periods: int, worlds: int) -> Scene:
    """The beginning of a scene: so many periods at most, and its first worlds."""
    segments, left = [], periods
    for amplitude, phase, length in scene.segments:
        if left > 0:
            segments.append(Segment(amplitude[:worlds], phase[:worlds], min(length, left)))
            left -= length
    pose, velocity = scene.pose[:worlds], scene.velocity[:worlds]
    return dataclasses.replace(scene, pose=pose, velocity=velocity, segments=tuple(segments), settle=0)


def scenes_from(
    given: list[Any], strong_tolerances: Sequence[float] = (1e-4,), weak_tolerances: Sequence[float] = (0.02,)
) -> list[Scene]:
    """Scenes from mappings of :class:`SceneSettings`.

    Args:
        given: the mappings.
        strong_tolerances, weak_tolerances: of scenes that have none of their own.

    Raises:
        ValueError: the first fault, in one line that begins with ``scenes.<number>``.
    """
    found: list[Scene] = []
    for index, data in enumerate(given):
        where = f"scenes.{index}"
        scene = scene_from(data, where, strong_tolerances, weak_tolerances)
        if any(scene.name == other.name for other in found):
            raise checks.refuse(f"{where}.name", scene.name, "a name that no other scene has")
        found.append(scene)
    return found


def scene_from(
    data: Any, where: str, strong_tolerances: Sequence[float] = (1e-4,), weak_tolerances: Sequence[float] = (0.02,)
) -> Scene:
    """One scene; see :func:`scenes_from`."""
    settings = parse(SceneSettings, data, where)
    try:
        surface = surface_from(settings.surface)
    except ValueError as error:
        text = str(error)
        raise checks.Refused(f"{where}.{text if text.startswith('surface') else f'surface.{text}'}") from None
    try:
        part = part_from(settings.part, f"{where}.part")
    except ValueError as error:
        text = str(error)
        raise checks.Refused(text if text.startswith(where) else f"{where}.part.{text}") from None
    if settings.settle >= settings.periods:
        raise checks.refuse(f"{where}.settle", settings.settle, f"less than the {settings.periods} periods of the run")
    drive = parse(DriveSettings, settings.drive, f"{where}.drive")
    for name in set(drive.model_fields_set) - {"kind", *DRIVE_FIELDS[drive.kind]}:
        allowed = f"the fields of drive kind {drive.kind!r}: {', '.join(DRIVE_FIELDS[drive.kind])}"
        raise checks.refuse(f"{where}.drive.{name}", getattr(drive, name), allowed)
    rng = np.random.default_rng(settings.seed)
    start = parse(StartSettings, settings.start, f"{where}.start")
    pose, velocity = _starts(start, surface, part, settings.worlds, rng, f"{where}.start")
    checks.label(f"{where}.name", settings.name)
    if settings.note:
        checks.label(f"{where}.note", " ".join(settings.note.split()), most=2000)
    segments = _segments(drive, surface, part, settings, rng, f"{where}.drive")
    tolerances = {}
    for name, common in (("strong_tolerances", strong_tolerances), ("weak_tolerances", weak_tolerances)):
        own = getattr(settings, name)
        values = common if own is None else own
        tolerances[name] = tuple(checks.number(f"{where}.{name}", each, above=0.0) for each in values)
    return Scene(
        name=settings.name,
        note=settings.note,
        surface=surface,
        part=part,
        pose=pose,
        velocity=velocity,
        segments=segments,
        settle=settings.settle,
        success=_success(settings.success, part, f"{where}.success"),
        **tolerances,
    )


def _starts(
    start: StartSettings, surface: Surface, part: Part, worlds: int, rng: np.random.Generator, where: str
) -> tuple[np.ndarray, np.ndarray]:
    def within(name: str, given: list[float] | None, extent: float) -> tuple[float, float]:
        middle, reach = 0.5 * extent, min(surface.element_size, 0.25 * extent)
        low, high = (middle - reach, middle + reach) if given is None else given
        if not 0.0 <= low <= high <= extent:
            raise checks.refuse(f"{where}.{name}", (low, high), f"a range [low, high] within [0, {extent:g}] m")
        return low, high

    for name in ("heading", "spin"):
        low, high = getattr(start, name)
        if not low <= high:
            raise checks.refuse(f"{where}.{name}", (low, high), "a range [low, high]")
    ranges = [within("x", start.x, surface.width), within("y", start.y, surface.depth), start.heading]
    pose = np.stack([rng.uniform(*each, size=worlds) for each in ranges], axis=1)
    velocity = np.zeros((worlds, 3))
    if start.velocity == "idle":
        velocity[:, :2] = surface.idle_velocity(part.friction)
    elif start.velocity != "rest":
        velocity[:, :2] = start.velocity
    velocity[:, 2] = rng.uniform(*start.spin, size=worlds)
    return pose, velocity


def _segments(
    drive: DriveSettings, surface: Surface, part: Part, settings: SceneSettings, rng: np.random.Generator, where: str
) -> tuple[Segment, ...]:
    periods, settle = settings.periods, settings.settle
    shape = (settings.worlds, surface.rows, surface.columns)
    assert surface.max_amplitude is not None
    largest = surface.max_amplitude
    if drive.kind == "random" and drive.every is not None:
        if settle % drive.every:
            raise checks.refuse(
                f"{where}.every", drive.every, f"a divisor of settle, {settle}, so that both end at once"
            )
        lengths = [min(drive.every, periods - done) for done in range(0, periods, drive.every)]
        return tuple(Segment(*_random(drive, largest, shape, rng), length) for length in lengths)
    if drive.kind == "random":
        amplitude, phase = _random(drive, largest, shape, rng)
    elif drive.kind == "uniform":
        level = largest if drive.amplitude is None else drive.amplitude
        level = checks.number(f"{where}.amplitude", level, least=0.0, most=largest)
        amplitude, phase = np.full(shape, level), np.full(shape, drive.phase)
    else:
        total = _fields(drive.fields, f"{where}.fields")
        sampled = total.drive(surface, friction=part.friction if drive.lead else None)
        amplitude, phase = (np.ascontiguousarray(np.broadcast_to(each, shape)) for each in sampled)
    held = [periods] if settle == 0 else [settle, periods - settle]
    return tuple(Segment(amplitude, phase, length) for length in held)


def _random(
    drive: DriveSettings, largest: float, shape: tuple[int, ...], rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray]:
    low = min(drive.least_strength, drive.strength) ** 2
    share = np.sqrt(low + (drive.strength**2 - low) * rng.uniform(size=shape))
    return largest * np.minimum(share, 1.0), rng.uniform(0.0, 2.0 * math.pi, shape)


def _fields(given: list[Any], where: str) -> fields.Field:
    makers: dict[str, Callable[..., fields.Field]] = {
        "uniform": fields.uniform,
        "squeeze": fields.squeeze,
        "radial": fields.radial,
        "tangential": fields.tangential,
    }
    if not given:
        raise checks.refuse(where, given, f"at least one mapping with 'kind' among {', '.join(makers)}")
    total = None
    for index, each in enumerate(given):
        at = f"{where}.{index}"
        if not isinstance(each, dict):
            raise checks.refuse(at, each, f"a mapping with 'kind' among {', '.join(makers)}")
        arguments = {name: value for name, value in each.items() if name != "kind"}
        kind = checks.choice(f"{at}.kind", each.get("kind"), tuple(makers))
        known = {"uniform": ("direction", "strength"), "squeeze": ("x", "y", "angle", "strength", "reach")}
        names = known.get(kind, ("x", "y", "strength", "reach"))
        for name, value in arguments.items():
            if name not in names:
                raise checks.refuse(f"{at}.{name}", value, f"arguments of {kind!r}: {', '.join(names)}")
            checks.number(f"{at}.{name}", value)
        for name in names:
            if name not in arguments and name not in ("strength", "reach"):
                raise checks.missing(f"{at}.{name}", f"required for a field of kind {kind!r}")
        field = makers[kind](**arguments)
        total = field if total is None else total + field
    assert total is not None
    return total


def _success(given: Any, part: Part, where: str) -> Callable[[np.ndarray], np.ndarray] | None:
    if given is None:
        return None
    wanted = parse(SuccessSettings, given, where)
    if (wanted.point is None) == (wanted.line is None):
        raise checks.refuse(where, given, "either 'point' or 'line'")
    if wanted.within is None and wanted.heading_within is None:
        raise checks.missing(f"{where}.within", "or 'heading_within'")
    if wanted.heading_within is not None and (wanted.line is None or part.symmetry == 0):
        raise checks.refuse(
            f"{where}.heading_within", wanted.heading_within, "only with 'line' and a part that is no disc"
        )
    if wanted.point is not None and wanted.within is None:
        raise checks.missing(f"{where}.within", "required with 'point'")

    def met(pose: np.ndarray) -> np.ndarray:
        good = np.isfinite(pose).all(axis=1)
        if wanted.point is not None:
            assert wanted.within is not None
            away = np.hypot(pose[:, 0] - wanted.point[0], pose[:, 1] - wanted.point[1])
            return np.asarray(good & (away <= wanted.within))
        assert wanted.line is not None
        x, y, angle = wanted.line
        if wanted.within is not None:
            across = (pose[:, 1] - y) * math.cos(angle) - (pose[:, 0] - x) * math.sin(angle)
            good = good & (np.abs(across) <= wanted.within)
        if wanted.heading_within is not None:
            turn = 2.0 * math.pi / part.symmetry
            off = np.abs(np.mod(pose[:, 2] - angle + 0.5 * turn, turn) - 0.5 * turn)
            good = good & (off <= wanted.heading_within)
        return np.asarray(good)

    return met
