"""Page of a data sheet."""

from __future__ import annotations

import argparse
import contextlib
import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from agents.command_line import Command
from agents.evaluation import films
from agents.evaluation.commands import OUTPUT
from agents.evaluation.datasheet import RESTING, VARIANTS, DatasheetSettings, Sheet, measure
from agents.evaluation.pages import Lines, Picture, Section, data_address, render
from agents.evaluation.part_limits import TURNABLE, Limits
from agents.evaluation.statistics import quartiles
from agents.evaluation.table import quantity
from vibgym import checks
from vibgym.config import from_text
from vibgym.envs.viewer import scenery_of
from vibgym.files import output_directory, output_files, write_atomically
from vibgym.policies.rollout import worlds_of
from vibgym.rendering.files import png
from vibgym.tasks.base import HOLD_PERIODS

PAGE = "datasheet.html"

MOST_POSES = 4
"""Most stable poses on a sheet."""

DISTANCE = 0.1
"""m: displacement of the least time on the sheet."""

FOR_DEMONSTRATION = ("zero", "random", "open_loop")
"""Policies that are not named as suitable."""


def _picture(sheet: Sheet) -> bytes:
    """Draw the part half way to its goal, PNG."""
    env = worlds_of("Align", 1, **sheet.environment)
    scenery = scenery_of(env.unwrapped)  # type: ignore[arg-type]
    env.close()
    film = sheet.played["Align"].film
    left = np.hypot(*np.moveaxis(film.poses[:, 0, :2] - film.goals[:, 0, :2], -1, 0))
    frame = int((left <= 0.5 * left[0]).argmax())
    return png(films.picture(film, scenery, frame, films.painter_for(scenery, 1064)), 64)


Line = tuple[str, str, str]
"""Label, value and note."""


def groups(sheet: Sheet) -> dict[str, list[Line]]:
    """Return the lines of the sheet by their headings."""
    found = {
        "Rates": _rates(sheet),
        "Accuracy": _accuracy(sheet),
        "Limits": _limits(sheet),
        "Tasks and controllers": _tasks(sheet),
    }
    poses = [
        (f"Pose {k}", f"{100 * each.probability:.1f} %", f"{each.height:.3g} mm high, on {each.area:.3g} mm²")
        for k, each in enumerate(sheet.poses[:MOST_POSES])
    ]
    return {**found, "Stable poses": poses} if poses else found


def _rates(sheet: Sheet) -> list[Line]:
    bound, seconds = sheet.limits.bound, sheet.played["Transport"].time_to_goal
    hold = HOLD_PERIODS * sheet.info.surface.period
    least_way = float(bound.seconds([0.0, 0.0, 0.0], [DISTANCE, 0.0, 0.0])[0])
    lines = [
        ("Parts moved", _middle(60.0 / seconds, 1.0, 1, "a minute"), "one after another, to drawn places"),
        ("Transport", _middle(sheet.speed, 1e3, 0, "mm/s"), f"from rest to rest, with {hold:.2g} s to stay"),
        ("Top speed", quantity(sheet.limits.top_speed, 1e3, 0, "mm/s"), "on elements that all push one way"),
        (f"Least time for {1e3 * DISTANCE:g} mm", quantity(least_way, 1.0, 2, "s"), "no policy is faster"),
    ]
    if sheet.turn_speed is not None:
        # A quarter turn, or half of what makes the part look the same, if that is less.
        turn = min(0.5 * math.pi, math.pi / sheet.info.parts[0].symmetry)
        least_turn = float(bound.seconds([0.0, 0.0, 0.0], [0.0, 0.0, turn])[0])
        lines += [
            ("Rotation in place", _middle(np.degrees(sheet.turn_speed), 1.0, 0, "°/s"), "from rest to rest"),
            (f"Least time for {math.degrees(turn):g}°", quantity(least_turn, 1.0, 2, "s"), "no policy is faster"),
        ]
    return lines


def _accuracy(sheet: Sheet) -> list[Line]:
    position = _most(sheet.at_rest("position_error"), 1e3, "mm")
    lines = [("Position at rest", position, f"mean of {RESTING} periods at the goal")]
    if sheet.turn_speed is not None:
        heading = _most(sheet.at_rest("heading_error"), 180.0 / math.pi, "°")
        lines.append(("Heading at rest", heading, "likewise"))
    for task, asked in sheet.infos.items():
        within = f"{1e3 * asked.position_tolerance:g} mm"
        if asked.has_heading:
            within += f", {math.degrees(asked.heading_tolerance):g}°"
        reached = f"{sheet.played[task].success.sum()} of {sheet.settings.episodes}"
        lines.append((f"{task} within {within}", reached, f"episodes, held for {HOLD_PERIODS} periods"))
    lines += [_variant(sheet, name) for name in VARIANTS]
    lines.append(("Circle at rest", quantity(sheet.limits.circle, 1e3, 2, "mm"), "radius, once a period"))
    lines.append(("Parts lost", str(sheet.lost), "off the surface, all episodes"))
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
    spare = 100.0 * (1.0 - part.static_friction / limits.most_friction)
    slides = f"beyond it parts may stick; here {part.static_friction:.3g}, {spare:.0f} % less"
    lines = [
        ("Acceleration", quantity(limits.acceleration, 1.0, 2, "m/s²"), force),
        ("Turning", f"{worst:.0f} to {best:.0f} rad/s²", "from rest, by where the part lies"),
        ("Sticking", f"static friction up to {limits.most_friction:.2f}", slides),
        ("Smallest part", smallest, turns),
        ("Gap between elements", _gap(sheet), "that the part bridges, also where rows and columns cross"),
        ("Dead zone", dead, f"of {1e3 * hardware.limit:.2f} mm amplitude{_pulse(limits)}"),
        ("Latency", late, "from command to motion"),
    ]
    if limits.tipping is None:
        lines.append(("Tipping", "not known", "the part's height is not given"))
    else:
        tallest = f"friction alone tips it from {1e3 * part.height / limits.tipping:.0f} mm of height on"
        lines.append(("Margin to tipping", f"{100 * (1.0 - limits.tipping):.0f} %", tallest))
    return lines


def _pulse(limits: Limits) -> str:
    """Return the effect of a hard dead zone on a part, as a phrase."""
    return "" if limits.pulse is None else f"; its edge shifts parts by {1e3 * limits.pulse:.1f} mm a period"


def _gap(sheet: Sheet) -> str:
    """Return the gap that the part bridges."""
    gap, size = sheet.limits.gap, sheet.info.surface.element_size
    return "any" if gap >= size else f"up to {1e3 * gap:.1f} mm"


def _variant(sheet: Sheet, name: str) -> Line:
    """Return the line of a variant's measurement."""
    models = {
        "Camera": "errors of the prototype's camera instead of this sensor's",
        "Rigid part": "tilting model: the part rocks on the elements",
    }
    label = f"Align, {name.lower()}"
    if name in sheet.unfit:
        return (label, "–", sheet.unfit[name])
    run = sheet.played[name]
    seconds = _middle(run.time_to_goal, 1.0, 2, "s")
    return (label, f"{run.success.sum()} of {sheet.settings.episodes}, {seconds}", models[name])


def _tasks(sheet: Sheet) -> list[Line]:
    """Return the tasks that accept the part, and the policies that support them."""
    accepted = {
        name: [each for each in policies if each not in FOR_DEMONSTRATION]
        for name, policies in sheet.tasks.items()
        if not isinstance(policies, str)
    }
    refused = [name for name in sheet.tasks if name not in accepted]
    learned = [name for name, policies in accepted.items() if any(each.startswith("learned") for each in policies)]
    everywhere = [
        each for each in next(iter(accepted.values()), []) if all(each in those for those in accepted.values())
    ]
    named = (
        ("Tasks", list(accepted), "none"),
        ("Learned agents", learned, "for none of them"),
        ("Controllers of all these tasks", everywhere, "none"),
        ("Tasks without this part", refused, "none"),
    )
    count = len(sheet.tasks)
    values = (f"{len(accepted)} of {count}", f"for {len(learned)}", str(len(everywhere)), f"{len(refused)} of {count}")
    return [
        (label, value, ", ".join(those) or empty) for (label, those, empty), value in zip(named, values, strict=True)
    ]


def _flat(value: Any) -> str:
    """Return settings in one line, numbers with four digits."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{name} ({_flat(each)})" if isinstance(each, Mapping) else f"{name} {_flat(each)}"
            for name, each in value.items()
        )
    return f"{value:.4g}" if isinstance(value, float) else str(value)


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


def _about(sheet: Sheet) -> list[Line]:
    """Return surface, part and hardware; the elements of an identified machine are summed up."""
    surface, part, actuators = sheet.info.surface, sheet.info.parts[0], sheet.settings.actuators
    size = 1e3 * np.ptp(part.outline, axis=0)
    height = f", {1e3 * part.height:g} mm high" if part.height_is_known else ""
    corners = f"{size[0]:.3g} × {size[1]:.3g} mm, {len(part.outline)} corners"
    shape = f"disc of {size[0]:.3g} mm" if part.symmetry == 0 else corners
    circles = f"circles with {1e3 * surface.horizontal_amplitude:.4g} mm at {surface.frequency:.4g} Hz"
    if isinstance(actuators, Mapping) and actuators.get("elements") is not None:
        gain, phase = np.moveaxis(np.array(actuators["elements"], dtype=float), -1, 0)
        turn = np.degrees(phase)
        elements = f"gain {gain.min():.2f} to {gain.max():.2f}, phase {turn.min():.0f} to {turn.max():.0f} deg"
        actuators = {**actuators, "elements": elements}
    lines = [
        (
            "Surface",
            f"{surface.rows} × {surface.columns} elements of {1e3 * surface.element_size:g} mm",
            f"{1e3 * surface.width:.0f} × {1e3 * surface.depth:.0f} mm, {circles}",
        ),
        ("Part", part.name, f"{shape}{height}, friction {part.friction:.4g}, {1e3 * part.mass:.3g} g"),
    ]
    for label, given in (("Actuators", actuators), ("Sensor", sheet.settings.sensor)):
        settings = dict(given) if isinstance(given, Mapping) else {"kind": given}
        lines.append((label, str(settings.pop("kind")), _flat(settings)))
    return lines


def write(sheet: Sheet) -> Path:
    """Write the page and return its path.

    Raises:
        vibgym.files.WriteError: it cannot be written.
    """
    path, part, settings = Path(sheet.settings.output) / PAGE, sheet.info.parts[0], sheet.settings
    origin, versions = sheet.provenance, sheet.provenance["versions"]
    alt = "The part on the surface, on its way to a goal, and the drive of every element"
    sections = [
        Section(
            "about", "Surface, part and hardware", [Lines(_about(sheet)), Picture(data_address(_picture(sheet)), alt)]
        )
    ]
    sections += [Section(title, title, [Lines(lines)]) for title, lines in groups(sheet).items()]
    source = (
        f"Surface, actuators and sensor are those of {settings.machine}; the episodes are simulated."
        if settings.machine
        else "No figure comes from a real machine."
    )
    footer = (
        f"Rates: median and middle half of {settings.episodes} simulated episodes with drawn starts and goals, seeds "
        f"{settings.seeds[0]} to {settings.seeds[-1]}. {source} Least times hold for every policy on the planar model; limits "
        "follow from surface, part and the actuators' data sheet.",
        f"Made on {origin['time']}, vibgym {versions['vibgym'] or ''}, commit {origin['commit'] or 'not known'}.",
    )
    title = settings.title or part.name
    text = render(
        "page.html.j2", command="datasheet", title=title, lead="vibgym data sheet", sections=sections, footer=footer
    )
    write_atomically(path, text)
    return path


def summary(sheet: Sheet) -> str:
    """Return the lines as text."""
    found: list[str] = []
    for title, lines in groups(sheet).items():
        found += [title, *(f"  {label}: {value}; {note}" for label, value, note in lines)]
    return "\n".join(found)


# -- command -----------------------------------------------------------------------------------------------------------


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "config", type=Path, nargs="?", metavar="CONFIG", help="see configs/datasheets (default: the prototype)"
    )
    parser.add_argument("--machine", metavar="FILE", help="settings of an identified machine, such as machine.yaml")
    parser.add_argument(
        "--part", metavar="PART", help="drawing, name of a shipped part, or a JSON mapping as in CONFIG"
    )
    parser.add_argument("--episodes", type=int, metavar="N", help="episodes of each measurement")


def command(arguments: argparse.Namespace) -> None:
    """Measure a part on a surface, and write and print the sheet."""
    given = {name: getattr(arguments, name) for name in ("machine", "part") if getattr(arguments, name) is not None}
    if "part" in given:
        given["part"] = from_text("--part", given["part"])
    output = None if arguments.output is None else str(arguments.output)
    settings = DatasheetSettings.given(arguments.config, given, arguments.episodes, output)
    output_files([output_directory(Path(settings.output), "datasheet.output") / PAGE], "datasheet.output")
    with contextlib.nullcontext() if arguments.config is None else checks.within(arguments.config):
        found = measure(settings, arguments.quiet)
    page = write(found)
    print(f"{summary(found)}\n\npage: {page}")


COMMANDS = {"datasheet": Command(_arguments, command, OUTPUT)}
