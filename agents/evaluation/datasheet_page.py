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
from agents.evaluation.part_limits import TURNABLE
from agents.evaluation.statistics import quartiles
from agents.evaluation.table import quantity
from agents.provenance import provenance
from vibgym import checks
from vibgym.config import from_text, load_yaml
from vibgym.files import output_directory, output_files, write_atomically
from vibgym.rendering.files import png
from vibgym.tasks.base import HOLD_PERIODS

PAGE = "datasheet.html"

MAX_POSES = 4
"""Most stable poses on a sheet."""

DISTANCE = 0.1
"""m: displacement of the least time on the sheet."""

FOR_DEMONSTRATION = ("zero", "random", "open_loop")
"""Policies that are not named as suitable."""

Line = tuple[str, str, str]
"""Label, value and note."""


def groups(sheet: Sheet) -> dict[str, list[Line]]:
    """Return the lines of the sheet by their headings."""
    limits, info = sheet.limits, sheet.infos["Align"]
    part, hardware, surface = info.parts[0], info.hardware, info.surface
    reached = {name: f"{run.success.sum()} of {sheet.settings.episodes}" for name, run in sheet.played.items()}
    moved = _middle(60.0 / sheet.played["Transport"].time_to_goal, 1, "a minute")
    hold = f"from rest to rest, with {HOLD_PERIODS * surface.period:.2g} s to stay"
    # A quarter turn, or half of what makes the part look the same, if that is less.
    turn = min(0.5 * math.pi, math.pi / max(part.symmetry, 1))
    least = limits.bound.seconds(np.zeros(3), [[DISTANCE, 0.0, 0.0], [0.0, 0.0, turn]])
    rates = [
        ("Parts moved", moved, "one after another, to drawn places"),
        ("Transport", _middle(1e3 * sheet.speed, 0, "mm/s"), hold),
        ("Top speed", quantity(limits.top_speed, 1e3, 0, "mm/s"), "on elements that all push one way"),
        (f"Least time for {1e3 * DISTANCE:g} mm", quantity(least[0], 1.0, 2, "s"), "no policy is faster"),
    ]
    position = _most(1e3 * sheet.at_rest("position_error"), "mm")
    accuracy = [("Position at rest", position, f"mean of {RESTING} periods at the goal")]
    if sheet.turn_speed is not None:
        rates += [
            ("Rotation in place", _middle(np.degrees(sheet.turn_speed), 0, "°/s"), "from rest to rest"),
            (f"Least time for {math.degrees(turn):g}°", quantity(least[1], 1.0, 2, "s"), "no policy is faster"),
        ]
        accuracy.append(("Heading at rest", _most(np.degrees(sheet.at_rest("heading_error")), "°"), "likewise"))
    for task, task_info in sheet.infos.items():
        heading = f", {math.degrees(task_info.heading_tolerance):g}°" if task_info.has_heading else ""
        label = f"{task} within {1e3 * task_info.position_tolerance:g} mm{heading}"
        accuracy.append((label, reached[task], f"episodes, held for {HOLD_PERIODS} periods"))
    for name, (_, note) in VARIANTS.items():
        label = f"Align, {name.lower()}"
        if name in sheet.unfit:
            accuracy.append((label, "–", sheet.unfit[name]))
        else:
            accuracy.append((label, f"{reached[name]}, {_middle(sheet.played[name].time_to_goal, 2, 's')}", note))
    lost = sum(int(outcomes.fallen.sum()) for outcomes in sheet.played.values())
    accuracy += [
        ("Circle at rest", quantity(limits.circle, 1e3, 2, "mm"), "radius, once a period"),
        ("Parts lost", str(lost), "off the surface, all episodes"),
    ]
    force = f"from rest, {limits.acceleration * part.mass:.2g} N"
    worst, best = limits.turn_acceleration
    spare = 100.0 * (1.0 - part.static_friction / limits.most_friction)
    small = 1e3 * limits.smallest * np.ptp(part.outline, axis=0)
    smallest = "none" if math.isnan(limits.smallest) else f"{small[0]:.0f} × {small[1]:.0f} mm"
    gap = "any" if limits.gap >= surface.element_size else f"up to {1e3 * limits.gap:.1f} mm"
    dead = quantity(hardware.dead_zone, 1e3, 2, "mm") if hardware.dead_zone > 0.0 else "none"
    pulse = "" if limits.pulse is None else f"; its edge shifts parts by {1e3 * limits.pulse:.1f} mm a period"
    late = quantity(hardware.latency * surface.period, 1e3, 0, "ms") if hardware.latency > 0 else "none"
    if limits.tipping is None:
        tipping = ("Tipping", "not known", "the part's height is not given")
    else:
        tallest = f"friction alone tips it from {1e3 * part.height / limits.tipping:.0f} mm of height on"
        tipping = ("Margin to tipping", f"{100 * (1.0 - limits.tipping):.0f} %", tallest)
    sections = {
        "Rates": rates,
        "Accuracy": accuracy,
        "Limits": [
            ("Acceleration", quantity(limits.acceleration, 1.0, 2, "m/s²"), force),
            ("Turning", f"{worst:.0f} to {best:.0f} rad/s²", "from rest, by where the part lies"),
            ("Sticking", f"static friction up to {limits.most_friction:.2f}",
             f"beyond it parts may stick; here {part.static_friction:.3g}, {spare:.0f} % less"),
            ("Smallest part", smallest, f"of this shape that turns wherever it lies ({100 * TURNABLE:g} % of the push)"),
            ("Gap between elements", gap, "that the part bridges, also where rows and columns cross"),
            ("Dead zone", dead, f"of {1e3 * hardware.limit:.2f} mm amplitude{pulse}"),
            ("Latency", late, "from command to motion"),
            tipping,
        ],
        "Tasks and controllers": _tasks(sheet),
    }  # fmt: skip
    if sheet.poses:
        sections["Stable poses"] = [
            (f"Pose {k}", f"{100 * pose.probability:.1f} %", f"{pose.height:.3g} mm high, on {pose.area:.3g} mm²")
            for k, pose in enumerate(sheet.poses[:MAX_POSES])
        ]
    return sections


def _tasks(sheet: Sheet) -> list[Line]:
    """Return the tasks that accept the part, and the policies that support them."""
    accepted = {
        name: [policy for policy in policies if policy not in FOR_DEMONSTRATION]
        for name, policies in sheet.tasks.items()
        if not isinstance(policies, str)
    }
    refused = [name for name in sheet.tasks if name not in accepted]
    learned = [name for name, policies in accepted.items() if any(policy.startswith("learned") for policy in policies)]
    first = next(iter(accepted.values()), [])
    everywhere = [policy for policy in first if all(policy in policies for policies in accepted.values())]
    count = len(sheet.tasks)
    return [
        ("Tasks", f"{len(accepted)} of {count}", ", ".join(accepted) or "none"),
        ("Learned agents", f"for {len(learned)}", ", ".join(learned) or "for none of them"),
        ("Controllers of all these tasks", str(len(everywhere)), ", ".join(everywhere) or "none"),
        ("Tasks without this part", f"{len(refused)} of {count}", ", ".join(refused) or "none"),
    ]


def _flat(value: Any) -> str:
    """Return settings in one line, numbers with four digits."""
    if isinstance(value, Mapping):
        return ", ".join(
            f"{name} ({_flat(entry)})" if isinstance(entry, Mapping) else f"{name} {_flat(entry)}"
            for name, entry in value.items()
        )
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def _middle(values: np.ndarray, digits: int, unit: str) -> str:
    """Return median and quartiles of the finite values."""
    low, middle, high = quartiles(values)
    if math.isnan(middle):
        return "–"
    return f"{middle:.{digits}f} {unit} ({low:.{digits}f} to {high:.{digits}f})".replace(" °", "°")


def _most(values: np.ndarray, unit: str) -> str:
    """Return the median, and the value below which nineteen of twenty episodes are."""
    if not np.isfinite(values).any():
        return "–"
    middle, most = np.nanquantile(values, (0.5, 0.95))
    return f"{middle:.2f} {unit}, 95 % below {most:.2f} {unit}".replace(" °", "°")


def _about(sheet: Sheet) -> list[Line]:
    """Return surface, part and hardware; the elements of an identified machine are summed up."""
    info, actuators = sheet.infos["Align"], sheet.settings.actuators
    surface, part = info.surface, info.parts[0]
    width, depth = 1e3 * np.ptp(part.outline, axis=0)
    corners = f"{width:.3g} × {depth:.3g} mm, {len(part.outline)} corners"
    shape = f"disc of {width:.3g} mm" if part.symmetry == 0 else corners
    height = f", {1e3 * part.height:g} mm high" if part.height_is_known else ""
    elements = f"{surface.rows} × {surface.columns} elements of {1e3 * surface.element_size:g} mm"
    circles = f"circles with {1e3 * surface.horizontal_amplitude:.4g} mm at {surface.frequency:.4g} Hz"
    if isinstance(actuators, Mapping) and actuators.get("elements") is not None:
        gain, phase = np.moveaxis(np.array(actuators["elements"], dtype=float), -1, 0)
        turn = np.degrees(phase)
        spread = f"gain {gain.min():.2f} to {gain.max():.2f}, phase {turn.min():.0f} to {turn.max():.0f} deg"
        actuators = {**actuators, "elements": spread}
    lines = [
        ("Surface", elements, f"{1e3 * surface.width:.0f} × {1e3 * surface.depth:.0f} mm, {circles}"),
        ("Part", part.name, f"{shape}{height}, friction {part.friction:.4g}, {1e3 * part.mass:.3g} g"),
    ]
    for label, value in (("Actuators", actuators), ("Sensor", sheet.settings.sensor)):
        settings = dict(value) if isinstance(value, Mapping) else {"kind": value}
        lines.append((label, str(settings.pop("kind")), _flat(settings)))
    return lines


def write(sheet: Sheet) -> Path:
    """Write the page, with a picture of the part half way to its goal, and return its path.

    Raises:
        vibgym.files.WriteError: it cannot be written.
    """
    settings, film = sheet.settings, sheet.played["Align"].film
    origin: dict[str, Any] = provenance()
    left = np.linalg.norm(film.poses[:, 0, :2] - film.goals[:, 0, :2], axis=-1)
    frame = int((left <= 0.5 * left[0]).argmax())
    drawn = films.picture(film, sheet.scenery, frame, films.painter_for(sheet.scenery, 1064))
    alt = "The part on the surface, on its way to a goal, and the drive of every element"
    about = [Lines(_about(sheet)), Picture(data_address(png(drawn, 64)), alt)]
    source = (
        f"Surface, actuators and sensor are those of {settings.machine}; the episodes are simulated."
        if settings.machine
        else "No figure comes from a real machine."
    )
    footer = (
        f"Rates: median and middle half of {settings.episodes} simulated episodes with drawn starts and goals, seeds "
        f"{settings.seeds[0]} to {settings.seeds[-1]}. {source} Least times hold for every policy on the planar model; limits "
        "follow from surface, part and the actuators' data sheet.",
        f"Made on {origin['time']}, vibgym {origin['versions']['vibgym'] or ''}, commit {origin['commit'] or 'not known'}.",
    )
    text = render(
        "page.html.j2",
        command="datasheet",
        title=settings.title or sheet.infos["Align"].parts[0].name,
        lead="vibgym data sheet",
        sections=[
            Section("about", "Surface, part and hardware", about),
            *(Section(title, title, [Lines(lines)]) for title, lines in groups(sheet).items()),
        ],
        footer=footer,
    )
    path = Path(settings.output) / PAGE
    write_atomically(path, text)
    return path


def summary(sheet: Sheet) -> str:
    """Return the lines as text."""
    rows: list[str] = []
    for title, lines in groups(sheet).items():
        rows += [title, *(f"  {label}: {value}; {note}" for label, value, note in lines)]
    return "\n".join(rows)


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
    config, options = arguments.config, dict[str, Any]()
    if arguments.machine is not None:
        options["machine"] = arguments.machine
    if arguments.part is not None:
        options["part"] = from_text("--part", arguments.part)
    data = {} if config is None else load_yaml(config)
    output = None if arguments.output is None else str(arguments.output)
    with contextlib.nullcontext() if config is None else checks.within(config):
        settings = DatasheetSettings.checked({**data, **options}, arguments.episodes, output)
        output_files([output_directory(Path(settings.output), "datasheet.output") / PAGE], "datasheet.output")
        sheet = measure(settings, arguments.quiet)
    print(f"{summary(sheet)}\n\npage: {write(sheet)}")


COMMANDS = {"datasheet": Command(_arguments, command, OUTPUT)}
