"""Data sheet: ``python -m agents datasheet [CONFIG]`` writes one printable page on a surface with a part."""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation import films
from agents.evaluation.films import Log, Rollout
from agents.evaluation.pages import as_yaml, data_address, render
from agents.evaluation.run import Infos, Run
from agents.evaluation.settings import DatasheetSettings
from agents.evaluation.table import Place, quantity
from agents.provenance import provenance
from vibgym import Part, Simulator, Surface, checks
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.allocator import strongest
from vibgym.bounds import TimeBound
from vibgym.envs.viewer import scenery_of
from vibgym.files import write_atomically
from vibgym.policies.rollout import worlds_of
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.sliding import sliding_of
from vibgym.tasks.base import HOLD_PERIODS

PLACES = 96
"""Poses, spread over an element and half a turn, at which a part's wrench is looked at."""

TURNABLE = 0.05
"""Share of the largest push, at the radius of gyration, that has to turn a part wherever it lies."""

RUN_UP = 60
"""Periods until a part on a field in one direction is as fast as it gets."""


@dataclass(frozen=True)
class Limits:
    """Numbers in SI units."""

    acceleration: float  # m/s^2, of the part at rest, all elements under it at their largest amplitude
    turn_acceleration: tuple[float, float]  # rad/s^2, at the worst and the best place
    top_speed: float  # m/s, on a field in one direction that does not end
    most_friction: float  # of parts that slide all the time
    smallest: float  # scale at which this part could still be turned wherever it lies; nan if it cannot itself
    circle: float  # m, radius on which the part circles at rest
    tipping: float | None  # share of the way to the edge that friction takes, at rest; None: height not known
    bound: TimeBound  # of a pose


def limits_of(surface: Surface, part: Part, sheet: DataSheet, tolerances: tuple[float, float]) -> Limits:
    """Of a part on a surface with actuators of a data sheet.

    Args:
        tolerances: m and rad, within which a pose is reached.

    Raises:
        ValueError: a part that might stick, of which the bounds say nothing.
    """
    share = strongest(surface, sheet)
    sliding = sliding_of(surface, [part], share)
    reach = reach_of(surface, part, sheet)
    turn = float(sliding.push[0]) / share / math.sqrt(part.gyration)
    heading = math.inf if part.symmetry == 0 else tolerances[1]
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
            position_tolerance=tolerances[0],
            heading_tolerance=heading,
            heading_period=0.0 if part.symmetry == 0 else 2.0 * math.pi / part.symmetry,
            amplitude=min(sheet.limit, surface.max_amplitude or 0.0),
            latency=sheet.latency,
        ),
    )


def reach_of(surface: Surface, part: Part, sheet: DataSheet) -> np.ndarray:
    """(PLACES,) largest push that turns the part at its radius of gyration, over the largest push there is."""
    rng, size = np.random.default_rng(0), surface.element_size
    centre = size * (np.array([surface.columns // 2, surface.rows // 2]) + 0.5)
    # Where small parts lie on a single element: in its middle, at headings that begin with its own.
    centred = np.column_stack([np.tile(centre, (PLACES // 4, 1)), np.arange(PLACES // 4) * (math.pi / (PLACES // 4))])
    drawn = rng.random((PLACES - len(centred), 3))
    drawn = np.column_stack([centre + size * (drawn[:, :2] - 0.5), math.pi * drawn[:, 2]])
    pose = np.vstack([centred, drawn])
    return Allocator(surface, [part], sheet).reach(pose[:, None])[:, 0]


def smallest_scale(surface: Surface, part: Part, sheet: DataSheet) -> float:
    """Scale of the smallest part of this shape that can be turned wherever it lies, see :data:`TURNABLE`; nan: not this one."""
    if reach_of(surface, part, sheet).min() < TURNABLE:
        return math.nan
    low, high = 0.0, 1.0
    for _ in range(8):
        middle = 0.5 * (low + high)
        smaller = Part.polygon(middle * part.outline, friction=part.friction)
        if reach_of(surface, smaller, sheet).min() < TURNABLE:
            low = middle
        else:
            high = middle
    return high


def top_speed(surface: Surface, part: Part, amplitude: float) -> float:
    """Mean speed over the last of :data:`RUN_UP` periods on elements that all push along x, m/s."""
    room = 2.0 * part.radius + RUN_UP * surface.period * surface.table_speed
    columns = math.ceil(room / surface.element_size) + 2
    rows = math.ceil((2.0 * part.radius + 0.2 * room) / surface.element_size) + 2
    long = Surface(
        rows, columns, surface.element_size, surface.horizontal_amplitude, surface.frequency, surface.gravity
    )
    simulator = Simulator(long, part, threads=1)
    simulator.reset([[[part.radius + long.element_size, 0.5 * long.depth, 0.0]]])
    # An element pushes towards (-S, -C): along x with a phase of -90 degrees.
    simulator.advance(np.full((rows, columns), amplitude), np.full((rows, columns), -0.5 * math.pi), RUN_UP)
    return float(np.hypot(*simulator.mean_velocity[0, 0, :2]))


RESTING = 25
"""Periods at the end of an episode over which a part at its goal is watched."""


@dataclass(frozen=True)
class Sheet:
    """All of it. Arrays are (episodes,), nan where an episode says nothing."""

    settings: DatasheetSettings
    info: TaskInfo  # of Align on this surface with this part
    limits: Limits
    speed: np.ndarray  # m/s, way over time from rest to rest
    seconds: np.ndarray  # s, of Transport
    turn_speed: np.ndarray | None  # rad/s, turn over time from rest to rest; None for discs
    position: np.ndarray  # m, mean error at rest
    heading: np.ndarray | None  # rad, likewise
    reached: dict[str, tuple[TaskInfo, int]]  # task -> what it asks for, and episodes that succeeded
    lost: int  # parts that fell off the surface, in all episodes
    picture: bytes  # PNG of the part on its way
    provenance: dict[str, Any]


def measure(settings: DatasheetSettings, quiet: bool = False) -> Sheet:
    """Everything of a sheet.

    Raises:
        ValueError: a surface, part, hardware or policy that does not work; the first fault, in one line.
    """
    environment = settings.environment
    info = Infos().of("Align", environment, "datasheet")
    part = info.parts[0]
    with checks.within("datasheet"):
        limits = limits_of(info.surface, part, info.hardware, (info.position_tolerance, info.heading_tolerance))
    turns = part.symmetry != 0
    environments = {"Transport": environment, "Align": environment, "rest": _resting(environment, info)}
    found = {name: _run(settings, name, each) for name, each in environments.items()}
    if turns:
        found["Rotate"] = _run(settings, "Rotate", environment)
    played = {name: run.play(quiet) for name, run in found.items()}
    moved, rest = played["Transport"], played["rest"]
    way = np.hypot(*np.moveaxis(moved.goals[:, 0, :2] - moved.poses[:, 0, 0, :2], -1, 0))
    return Sheet(
        settings=settings,
        info=info,
        limits=limits,
        speed=way / moved.time_to_goal,
        seconds=moved.time_to_goal,
        turn_speed=_turn_speed(played["Rotate"]) if turns else None,
        position=_at_rest(rest, "position_error"),
        heading=_at_rest(rest, "heading_error") if turns else None,
        reached={name: (found[name].info, int(each.success.sum())) for name, each in played.items() if name != "rest"},
        lost=sum(int(each.fallen.sum()) for each in played.values()),
        picture=_picture(played["Align"], environment),
        provenance=provenance(),
    )


def _resting(environment: dict[str, Any], info: TaskInfo) -> dict[str, Any]:
    """An episode is a success after all of its periods at the goal: so none ends before, and the part is seen at rest."""
    assert info.step_limit is not None  # Align has one
    return {**environment, "task_settings": {"hold": info.step_limit * info.periods_per_step}}


def _run(settings: DatasheetSettings, name: str, environment: dict[str, Any]) -> Run:
    """Return the run of a task; "rest" is Align without an end."""
    task = "Align" if name == "rest" else name
    with checks.within(f"datasheet ({task})"):
        info = Infos().of(task, environment, "environment")
        place = Place("datasheet", task, "", name)
        return Run(place, None, task, info, settings.seeds, environment, settings.policy, Log).made()


def _turn_speed(rollout: Rollout) -> np.ndarray:
    """rad/s; goals of Rotate are not wrapped."""
    return np.abs(rollout.goals[:, 0, 2] - rollout.poses[:, 0, 0, 2]) / rollout.time_to_goal


def _at_rest(rollout: Rollout, name: str) -> np.ndarray:
    """Mean error over the last periods; nan where the part was lost."""
    values = rollout.over_time(name)
    assert values is not None  # Align tells both
    return np.where(rollout.fallen, np.nan, np.abs(values[:, -RESTING:]).mean(axis=1))


def _picture(rollout: Rollout, environment: dict[str, Any]) -> bytes:
    """The part half way to its goal."""
    env = worlds_of("Align", 1, **environment)
    scenery = scenery_of(env.unwrapped)  # type: ignore[arg-type]
    env.close()
    film = rollout.film
    left = np.hypot(*np.moveaxis(film.poses[:, 0, :2] - film.goals[:, 0, :2], -1, 0))
    frame = int((left <= 0.5 * left[0]).argmax())
    return films.png(films.picture(film, scenery, frame, films.painter_for(scenery, 1064)), 64)


PAGE = "datasheet.html"

WAY, TURN = 0.1, 0.5 * math.pi
"""m and rad: of the least times that the sheet tells."""


class Line(NamedTuple):
    """A line of the sheet."""

    label: str
    value: str
    note: str = ""


def groups(sheet: Sheet) -> dict[str, list[Line]]:
    """The lines of the sheet by their headings."""
    return {"Rates": _rates(sheet), "Accuracy": _accuracy(sheet), "Limits": _limits(sheet)}


def _rates(sheet: Sheet) -> list[Line]:
    bound = sheet.limits.bound
    hold = HOLD_PERIODS * sheet.info.surface.period
    least_way = float(bound.seconds([0.0, 0.0, 0.0], [WAY, 0.0, 0.0])[0])
    lines = [
        Line("Parts moved", _middle(60.0 / sheet.seconds, 1.0, 1, "a minute"), "one after another, to drawn places"),
        Line("Transport", _middle(sheet.speed, 1e3, 0, "mm/s"), f"from rest to rest, with {hold:.2g} s to stay"),
        Line("Top speed", quantity(sheet.limits.top_speed, 1e3, 0, "mm/s"), "on elements that all push one way"),
        Line(f"Least time for {1e3 * WAY:g} mm", quantity(least_way, 1.0, 2, "s"), "no policy is faster"),
    ]
    if sheet.turn_speed is not None:
        least_turn = float(bound.seconds([0.0, 0.0, 0.0], [0.0, 0.0, _turn(sheet.info.parts[0])])[0])
        turned = f"{math.degrees(_turn(sheet.info.parts[0])):g}°"
        lines += [
            Line("Rotation in place", _middle(np.degrees(sheet.turn_speed), 1.0, 0, "°/s"), "from rest to rest"),
            Line(f"Least time for {turned}", quantity(least_turn, 1.0, 2, "s"), "no policy is faster"),
        ]
    return lines


def _turn(part: Part) -> float:
    """A quarter turn, or half of what makes the part look the same, if that is less."""
    return min(TURN, math.pi / part.symmetry)


def _accuracy(sheet: Sheet) -> list[Line]:
    lines = [Line("Position at rest", _most(sheet.position, 1e3, "mm"), f"mean of {RESTING} periods at the goal")]
    if sheet.heading is not None:
        lines.append(Line("Heading at rest", _most(sheet.heading, 180.0 / math.pi, "°"), "likewise"))
    for task, (asked, reached) in sheet.reached.items():
        within = f"{1e3 * asked.position_tolerance:g} mm"
        if asked.has_heading:
            within += f", {math.degrees(asked.heading_tolerance):g}°"
        held = f"episodes, held for {HOLD_PERIODS} periods"
        lines.append(Line(f"{task} within {within}", f"{reached} of {sheet.settings.episodes}", held))
    lines.append(Line("Circle at rest", quantity(sheet.limits.circle, 1e3, 2, "mm"), "radius, once a period"))
    lines.append(Line("Parts lost", str(sheet.lost), "off the surface, all episodes"))
    return lines


def _limits(sheet: Sheet) -> list[Line]:
    info, limits, part = sheet.info, sheet.limits, sheet.info.parts[0]
    hardware = info.hardware
    small, size = limits.smallest, 1e3 * np.ptp(part.outline, axis=0)
    smallest = "none" if small != small else f"{small * size[0]:.0f} × {small * size[1]:.0f} mm"
    dead = quantity(hardware.dead_zone, 1e3, 2, "mm") if hardware.dead_zone > 0.0 else "none"
    late = quantity(hardware.latency * info.surface.period, 1e3, 0, "ms") if hardware.latency > 0 else "none"
    worst, best = limits.turn_acceleration
    lines = [
        Line(
            "Acceleration",
            quantity(limits.acceleration, 1.0, 2, "m/s²"),
            f"from rest, {limits.acceleration * part.mass:.2g} N",
        ),
        Line("Turning", f"{worst:.0f} to {best:.0f} rad/s²", "from rest, by where the part lies"),
        Line(
            "Friction", f"up to {limits.most_friction:.2f}", f"so that it slides all the time; here {part.friction:g}"
        ),
        Line(
            "Smallest part", smallest, f"of this shape that turns wherever it lies ({100 * TURNABLE:g} % of the push)"
        ),
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
    """Median and quartiles."""
    found = factor * values[np.isfinite(values)]
    if not len(found):
        return "–"
    low, middle, high = np.quantile(found, (0.25, 0.5, 0.75))
    return f"{middle:.{digits}f} {unit} ({low:.{digits}f} to {high:.{digits}f})".replace(" °", "°")


def _most(values: np.ndarray, factor: float, unit: str) -> str:
    """Median, and what nineteen of twenty episodes stay below."""
    found = factor * values[np.isfinite(values)]
    if not len(found):
        return "–"
    middle, most = np.quantile(found, (0.5, 0.95))
    return f"{middle:.2f} {unit}, 95 % below {most:.2f} {unit}".replace(" °", "°")


def surface_lines(surface: Surface) -> list[str]:
    """Of the surface, in short."""
    return [
        f"{surface.rows} × {surface.columns} elements of {1e3 * surface.element_size:g} mm",
        f"{1e3 * surface.width:.0f} × {1e3 * surface.depth:.0f} mm",
        f"circles with {1e3 * surface.horizontal_amplitude:g} mm at {surface.frequency:g} Hz",
    ]


def part_lines(part: Part) -> list[str]:
    """Of the part, in short."""
    size = 1e3 * np.ptp(part.outline, axis=0)
    height = f", {1e3 * part.height:g} mm high" if part.height_is_known else ""
    shape = (
        f"disc of {size[0]:.3g} mm"
        if part.symmetry == 0
        else f"{size[0]:.3g} × {size[1]:.3g} mm, {len(part.outline)} corners"
    )
    return [f"{part.name}", shape + height, f"friction {part.friction:g}, {1e3 * part.mass:.3g} g"]


def write(sheet: Sheet) -> Path:
    """The page; returns its path.

    Raises:
        vibgym.files.WriteError: it cannot be written.
    """
    path, part = Path(sheet.settings.output) / PAGE, sheet.info.parts[0]
    text = render(
        "datasheet.html.j2",
        title=sheet.settings.title or part.name,
        surface=surface_lines(sheet.info.surface),
        part=part_lines(part),
        hardware=as_yaml({"actuators": sheet.settings.actuators, "sensor": sheet.settings.sensor}),
        groups=groups(sheet),
        picture=data_address(sheet.picture),
        settings=sheet.settings,
        provenance=sheet.provenance,
    )
    write_atomically(path, text)
    return path


def summary(sheet: Sheet) -> str:
    """The lines as text."""
    found: list[Any] = []
    for title, lines in groups(sheet).items():
        found += [title, *(f"  {each.label}: {each.value}; {each.note}" for each in lines)]
    return "\n".join(found)
