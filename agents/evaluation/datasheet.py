"""Data sheet: ``python -m agents datasheet [CONFIG]`` writes one printable page on a surface with a part."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np
from pydantic import Field

from agents.evaluation import films
from agents.evaluation.films import Log, Rollout
from agents.evaluation.pages import as_yaml, data_address, render
from agents.evaluation.run import Infos, Run
from agents.evaluation.settings import DEFAULT_FIRST_SEED, FileSettings
from agents.evaluation.statistics import quartiles
from agents.evaluation.study_settings import Seed
from agents.evaluation.table import Place, quantity
from agents.provenance import provenance
from vibgym import Part, Simulator, Surface, checks
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.bounds import TimeBound
from vibgym.config import DrawingSettings, parse
from vibgym.envs.viewer import scenery_of
from vibgym.files import write_atomically
from vibgym.policies.rollout import worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.drawings.drawing import read
from vibgym.scene.drawings.records import TOLERANCE, StablePose
from vibgym.scene.sliding import sliding_of
from vibgym.tasks.base import HOLD_PERIODS

PAGE = "datasheet.html"

POSES = 96
"""Poses, spread over an element and half a turn, at which a part's wrench is computed."""

TURNABLE = 0.05
"""Share of the largest push, at the radius of gyration, that has to turn a part at every pose."""

RUN_UP = 60
"""Periods until a part on a field in one direction has its final speed."""

RESTING = 25
"""Periods at the end of an episode over which the error of a part at its goal is averaged."""

MOST_POSES = 6
"""Most stable poses on a sheet."""

DISTANCE = 0.1
"""m: displacement of the least time on the sheet."""

SQUARE: dict[str, Any] = {
    "shape": "rectangle", "length_mm": 40.0, "width_mm": 40.0, "friction": 0.58, "name": "square part",
}  # fmt: skip
"""Default part of a data sheet."""


class DatasheetSettings(FileSettings):
    """Settings of ``python -m agents datasheet``.

    Attributes:
        title: of the sheet; None: the part's name.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields.
        part: the name of a shipped part, or a mapping: see :class:`vibgym.config.PartSettings`, and of a drawing
            :class:`vibgym.config.DrawingSettings`.
        model, actuators, sensor: arguments of the environments.
        policy: see :func:`vibgym.policies.make_policy`; it must serve Transport, Align and Rotate.
        episodes: of each measurement.
        first_seed: of the episodes.
        output: directory for the page.
    """

    where: ClassVar[str] = "datasheet"

    title: str | None = Field(default=None, min_length=1, max_length=60)
    surface: Any = "prototype"
    part: Any = SQUARE
    model: Any = "planar"
    actuators: Any = "prototype"
    sensor: Any = {"kind": "pose", "estimator": "model"}
    policy: Any = "pose"
    episodes: int = Field(default=48, ge=8, le=10_000)
    first_seed: Seed = DEFAULT_FIRST_SEED
    output: str = Field(default="runs/datasheet", min_length=1)

    @property
    def environment(self) -> dict[str, Any]:
        """Arguments of the environments."""
        scene = {"surface": self.surface, "parts": [self.part], "model": self.model}
        return {**scene, "actuators": self.actuators, "sensor": self.sensor}

    @property
    def seeds(self) -> list[int]:
        """Seeds of the episodes."""
        return list(range(self.first_seed, self.first_seed + self.episodes))

    def limited(self, episodes: int) -> dict[str, Any]:
        """Return the fields to change for another number of episodes, that of ``--episodes``."""
        return {"episodes": checks.count("--episodes", episodes, least=8, most=10_000)}


@dataclass(frozen=True)
class Limits:
    """Limits of a part on a surface, in SI units.

    Attributes:
        acceleration: m/s^2, of the part at rest, all elements under it at their largest amplitude.
        turn_acceleration: rad/s^2, at the worst and the best pose.
        top_speed: m/s, on an endless field in one direction.
        most_friction: of parts that slide all the time.
        smallest: scale at which this part could still be turned at every pose; nan if it cannot itself.
        circle: m, radius on which the part circles at rest.
        tipping: :attr:`vibgym.Part.tipping_ratio`; None: height not known.
        bound: least time to a pose.
    """

    acceleration: float
    turn_acceleration: tuple[float, float]
    top_speed: float
    most_friction: float
    smallest: float
    circle: float
    tipping: float | None
    bound: TimeBound


def limits_of(info: TaskInfo) -> Limits:
    """Return the limits of the part of a task, on its surface with its actuators.

    Raises:
        ValueError: a part that may stick, to which the bounds do not apply.
    """
    surface, part, sheet = info.surface, info.parts[0], info.hardware
    share = strongest(surface, sheet)
    sliding = sliding_of(surface, [part], share)
    reach = reach_of(surface, part, sheet)
    turn = float(sliding.push[0]) / share / math.sqrt(part.gyration)
    most = min(sheet.limit, surface.lift_off_amplitude)
    return Limits(
        acceleration=float(sliding.push[0]),
        turn_acceleration=(turn * float(reach.min()), turn * float(reach.max())),
        top_speed=top_speed(surface, part, most),
        most_friction=surface.horizontal_amplitude
        * surface.angular_frequency**2
        / (surface.gravity + most * surface.angular_frequency**2),
        smallest=smallest_scale(surface, part, sheet),
        circle=part.friction * surface.gravity / surface.angular_frequency**2,
        tipping=part.tipping_ratio if part.height_is_known else None,
        bound=TimeBound(
            surface,
            part,
            position_tolerance=info.position_tolerance,
            heading_tolerance=math.inf if part.symmetry == 0 else info.heading_tolerance,
            heading_period=0.0 if part.symmetry == 0 else 2.0 * math.pi / part.symmetry,
            amplitude=min(sheet.limit, surface.max_amplitude or 0.0),
            latency=sheet.latency,
        ),
    )


def reach_of(surface: Surface, part: Part, sheet: DataSheet) -> np.ndarray:
    """Return (POSES,) the largest push that turns the part at its radius of gyration, over the largest push of all."""
    rng, size = np.random.default_rng(0), surface.element_size
    centre = size * (np.array([surface.columns // 2, surface.rows // 2]) + 0.5)
    # Where small parts lie on a single element: in its middle, at headings that begin with its own.
    centred = np.column_stack([np.tile(centre, (POSES // 4, 1)), np.arange(POSES // 4) * (math.pi / (POSES // 4))])
    drawn = rng.random((POSES - len(centred), 3))
    drawn = np.column_stack([centre + size * (drawn[:, :2] - 0.5), math.pi * drawn[:, 2]])
    pose = np.vstack([centred, drawn])
    return Allocator(surface, [part], sheet).reach(pose[:, None])[:, 0]


def smallest_scale(surface: Surface, part: Part, sheet: DataSheet) -> float:
    """Return the scale of the smallest part of this shape that can be turned at every pose (:data:`TURNABLE`); nan: not even
    this one."""
    if reach_of(surface, part, sheet).min() < TURNABLE:
        return math.nan
    low, high = 0.0, 1.0
    for _ in range(8):
        middle = 0.5 * (low + high)
        holes = [middle * hole for hole in part.holes]
        smaller = Part.polygon(middle * part.rim, holes=holes, friction=part.friction)
        if reach_of(surface, smaller, sheet).min() < TURNABLE:
            low = middle
        else:
            high = middle
    return high


def top_speed(surface: Surface, part: Part, amplitude: float) -> float:
    """Return the mean speed over the last of :data:`RUN_UP` periods on elements that all push along x, m/s."""
    room = 2.0 * part.radius + RUN_UP * surface.period * surface.table_speed
    columns = math.ceil(room / surface.element_size) + 2
    rows = math.ceil((2.0 * part.radius + 0.2 * room) / surface.element_size) + 2
    long = replace(surface, rows=rows, columns=columns, max_amplitude=None)
    simulator = Simulator(long, part, threads=1)
    simulator.reset([[[part.radius + long.element_size, 0.5 * long.depth, 0.0]]])
    # An element pushes towards (-S, -C): along x with a phase of -90 degrees.
    simulator.advance(np.full((rows, columns), amplitude), np.full((rows, columns), -0.5 * math.pi), RUN_UP)
    return float(np.hypot(*simulator.mean_velocity[0, 0, :2]))


@dataclass(frozen=True)
class Sheet:
    """Measurements of a part on a surface.

    Attributes:
        settings: of the command.
        info: of Align on this surface with this part.
        limits: see :class:`Limits`.
        played: task -> its episodes; "rest" is Align without an end. Discs lack Rotate.
        infos: task -> public information, without "rest".
        provenance: see :func:`agents.provenance.provenance`.
        poses: of a part from an STL file, most probable first.
    """

    settings: DatasheetSettings
    info: TaskInfo
    limits: Limits
    played: dict[str, Rollout]
    infos: dict[str, TaskInfo]
    provenance: dict[str, Any]
    poses: tuple[StablePose, ...] = ()

    @property
    def speed(self) -> np.ndarray:
        """Distance over time from rest to rest, m/s, (episodes,); nan without success."""
        moved = self.played["Transport"]
        way = np.hypot(*np.moveaxis(moved.goals[:, 0, :2] - moved.poses[:, 0, 0, :2], -1, 0))
        return way / moved.time_to_goal

    @property
    def turn_speed(self) -> np.ndarray | None:
        """Turn over time from rest to rest, rad/s, (episodes,); None for discs. Goals of Rotate are not wrapped."""
        if "Rotate" not in self.played:
            return None
        turned = self.played["Rotate"]
        return np.abs(turned.goals[:, 0, 2] - turned.poses[:, 0, 0, 2]) / turned.time_to_goal

    def at_rest(self, name: str) -> np.ndarray:
        """Return the mean error at the goal, m or rad, (episodes,); nan where the part was lost."""
        rest = self.played["rest"]
        values = rest.over_time(name)
        assert values is not None  # Align reports both
        return np.where(rest.fallen, np.nan, np.abs(values[:, -RESTING:]).mean(axis=1))

    @property
    def lost(self) -> int:
        """Parts that fell off the surface, in all episodes."""
        return sum(int(each.fallen.sum()) for each in self.played.values())


def measure(settings: DatasheetSettings, quiet: bool = False) -> Sheet:
    """Measure everything of a sheet.

    Raises:
        ValueError: a surface, part, hardware or policy that does not work; the first fault, in one line.
    """
    environment, infos = settings.environment, Infos()
    info = infos.of("Align", environment, "datasheet")
    with checks.within("datasheet"):
        limits = limits_of(info)
    # An episode at rest is a success only after all of its periods at the goal, so none ends before.
    assert info.step_limit is not None
    resting = {**environment, "task_settings": {"hold": info.step_limit * info.periods_per_step}}
    tasks = ("Transport", "Align", "rest", *(("Rotate",) if info.parts[0].symmetry else ()))
    runs = {}
    for name in tasks:
        task, arguments = ("Align", resting) if name == "rest" else (name, environment)
        with checks.within(f"datasheet ({task})"):
            of_task, place = infos.of(task, arguments, "environment"), Place("datasheet", task, "", name)
            runs[name] = Run(place, None, task, of_task, settings.seeds, arguments, settings.policy, Log).made()
    played = {name: run.play(quiet) for name, run in runs.items()}
    of_tasks = {name: run.info for name, run in runs.items() if name != "rest"}
    return Sheet(settings, info, limits, played, of_tasks, provenance(), poses_of(settings.part))


def poses_of(part: Any) -> tuple[StablePose, ...]:
    """Return the stable poses of the part in an STL file; none of other parts."""
    if not (isinstance(part, Mapping) and str(part.get("file", "")).lower().endswith(".stl")):
        return ()
    given = parse(DrawingSettings, part, "datasheet.part")
    tolerance = TOLERANCE if given.tolerance is None else 1e3 * given.tolerance
    solid = read(given.file, tolerance, units=given.units, stable_pose=given.stable_pose).solid
    return () if solid is None else solid.poses


def _picture(sheet: Sheet) -> bytes:
    """Draw the part half way to its goal, PNG."""
    env = worlds_of("Align", 1, **sheet.settings.environment)
    scenery = scenery_of(env.unwrapped)  # type: ignore[arg-type]
    env.close()
    film = sheet.played["Align"].film
    left = np.hypot(*np.moveaxis(film.poses[:, 0, :2] - film.goals[:, 0, :2], -1, 0))
    frame = int((left <= 0.5 * left[0]).argmax())
    return films.png(films.picture(film, scenery, frame, films.painter_for(scenery, 1064)), 64)


class Line(NamedTuple):
    """A line of the sheet."""

    label: str
    value: str
    note: str = ""


def groups(sheet: Sheet) -> dict[str, list[Line]]:
    """Return the lines of the sheet by their headings."""
    found = {"Rates": _rates(sheet), "Accuracy": _accuracy(sheet), "Limits": _limits(sheet)}
    poses = [
        Line(f"Pose {k}", f"{100 * each.probability:.1f} %", f"{each.height:.3g} mm high, on {each.area:.3g} mm²")
        for k, each in enumerate(sheet.poses[:MOST_POSES])
    ]
    return {**found, "Stable poses": poses} if poses else found


def _rates(sheet: Sheet) -> list[Line]:
    bound, seconds = sheet.limits.bound, sheet.played["Transport"].time_to_goal
    hold = HOLD_PERIODS * sheet.info.surface.period
    least_way = float(bound.seconds([0.0, 0.0, 0.0], [DISTANCE, 0.0, 0.0])[0])
    lines = [
        Line("Parts moved", _middle(60.0 / seconds, 1.0, 1, "a minute"), "one after another, to drawn places"),
        Line("Transport", _middle(sheet.speed, 1e3, 0, "mm/s"), f"from rest to rest, with {hold:.2g} s to stay"),
        Line("Top speed", quantity(sheet.limits.top_speed, 1e3, 0, "mm/s"), "on elements that all push one way"),
        Line(f"Least time for {1e3 * DISTANCE:g} mm", quantity(least_way, 1.0, 2, "s"), "no policy is faster"),
    ]
    if sheet.turn_speed is not None:
        # A quarter turn, or half of what makes the part look the same, if that is less.
        turn = min(0.5 * math.pi, math.pi / sheet.info.parts[0].symmetry)
        least_turn = float(bound.seconds([0.0, 0.0, 0.0], [0.0, 0.0, turn])[0])
        lines += [
            Line("Rotation in place", _middle(np.degrees(sheet.turn_speed), 1.0, 0, "°/s"), "from rest to rest"),
            Line(f"Least time for {math.degrees(turn):g}°", quantity(least_turn, 1.0, 2, "s"), "no policy is faster"),
        ]
    return lines


def _accuracy(sheet: Sheet) -> list[Line]:
    position = _most(sheet.at_rest("position_error"), 1e3, "mm")
    lines = [Line("Position at rest", position, f"mean of {RESTING} periods at the goal")]
    if sheet.turn_speed is not None:
        heading = _most(sheet.at_rest("heading_error"), 180.0 / math.pi, "°")
        lines.append(Line("Heading at rest", heading, "likewise"))
    for task, asked in sheet.infos.items():
        within = f"{1e3 * asked.position_tolerance:g} mm"
        if asked.has_heading:
            within += f", {math.degrees(asked.heading_tolerance):g}°"
        reached = f"{sheet.played[task].success.sum()} of {sheet.settings.episodes}"
        lines.append(Line(f"{task} within {within}", reached, f"episodes, held for {HOLD_PERIODS} periods"))
    lines.append(Line("Circle at rest", quantity(sheet.limits.circle, 1e3, 2, "mm"), "radius, once a period"))
    lines.append(Line("Parts lost", str(sheet.lost), "off the surface, all episodes"))
    return lines


def _limits(sheet: Sheet) -> list[Line]:
    limits, part, hardware = sheet.limits, sheet.info.parts[0], sheet.info.hardware
    small, size = limits.smallest, 1e3 * np.ptp(part.outline, axis=0)
    smallest = "none" if math.isnan(small) else f"{small * size[0]:.0f} × {small * size[1]:.0f} mm"
    dead = quantity(hardware.dead_zone, 1e3, 2, "mm") if hardware.dead_zone > 0.0 else "none"
    late = quantity(hardware.latency * sheet.info.surface.period, 1e3, 0, "ms") if hardware.latency > 0 else "none"
    worst, best = limits.turn_acceleration
    force = f"from rest, {limits.acceleration * part.mass:.2g} N"
    turns = f"of this shape that turns wherever it lies ({100 * TURNABLE:g} % of the push)"
    slides = f"so that it slides all the time; here {part.friction:g}"
    lines = [
        Line("Acceleration", quantity(limits.acceleration, 1.0, 2, "m/s²"), force),
        Line("Turning", f"{worst:.0f} to {best:.0f} rad/s²", "from rest, by where the part lies"),
        Line("Friction", f"up to {limits.most_friction:.2f}", slides),
        Line("Smallest part", smallest, turns),
        Line("Dead zone", dead, f"of {1e3 * hardware.limit:.2f} mm amplitude"),
        Line("Latency", late, "from command to motion"),
    ]
    if limits.tipping is None:
        lines.append(Line("Tipping", "not known", "the part's height is not given"))
    else:
        tallest = f"friction alone tips it from {1e3 * part.height / limits.tipping:.0f} mm of height on"
        lines.append(Line("Margin to tipping", f"{100 * (1.0 - limits.tipping):.0f} %", tallest))
    return lines


def _middle(values: np.ndarray, factor: float, digits: int, unit: str) -> str:
    """Return median and quartiles of the finite values."""
    low, middle, high = factor * np.array(quartiles(values))
    if math.isnan(middle):
        return "–"
    return f"{middle:.{digits}f} {unit} ({low:.{digits}f} to {high:.{digits}f})".replace(" °", "°")


def _most(values: np.ndarray, factor: float, unit: str) -> str:
    """Return the median, and the value below which nineteen of twenty episodes are."""
    found = factor * values[np.isfinite(values)]
    if not len(found):
        return "–"
    middle, most = np.quantile(found, (0.5, 0.95))
    return f"{middle:.2f} {unit}, 95 % below {most:.2f} {unit}".replace(" °", "°")


def _surface_lines(surface: Surface) -> list[str]:
    return [
        f"{surface.rows} × {surface.columns} elements of {1e3 * surface.element_size:g} mm",
        f"{1e3 * surface.width:.0f} × {1e3 * surface.depth:.0f} mm",
        f"circles with {1e3 * surface.horizontal_amplitude:g} mm at {surface.frequency:g} Hz",
    ]


def _part_lines(part: Part) -> list[str]:
    size = 1e3 * np.ptp(part.outline, axis=0)
    height = f", {1e3 * part.height:g} mm high" if part.height_is_known else ""
    corners = f"{size[0]:.3g} × {size[1]:.3g} mm, {len(part.outline)} corners"
    shape = f"disc of {size[0]:.3g} mm" if part.symmetry == 0 else corners
    return [part.name, shape + height, f"friction {part.friction:g}, {1e3 * part.mass:.3g} g"]


def write(sheet: Sheet) -> Path:
    """Write the page and return its path.

    Raises:
        vibgym.files.WriteError: it cannot be written.
    """
    path, part = Path(sheet.settings.output) / PAGE, sheet.info.parts[0]
    text = render(
        "datasheet.html.j2",
        title=sheet.settings.title or part.name,
        surface=_surface_lines(sheet.info.surface),
        part=_part_lines(part),
        hardware=as_yaml({"actuators": sheet.settings.actuators, "sensor": sheet.settings.sensor}),
        groups=groups(sheet),
        picture=data_address(_picture(sheet)),
        settings=sheet.settings,
        provenance=sheet.provenance,
    )
    write_atomically(path, text)
    return path


def summary(sheet: Sheet) -> str:
    """Return the lines as text."""
    found: list[str] = []
    for title, lines in groups(sheet).items():
        found += [title, *(f"  {each.label}: {each.value}; {each.note}" for each in lines)]
    return "\n".join(found)
