"""The sheet as a page of A4, and in words."""

from __future__ import annotations

import math
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.datasheet.limits import TURNABLE
from agents.evaluation.datasheet.measure import RESTING, Sheet
from agents.evaluation.machine import sentences
from agents.evaluation.pages import data_address, render
from agents.evaluation.tables import quantity
from vibgym import Part, Surface
from vibgym.files import write_atomically
from vibgym.tasks.base import HOLD_PERIODS

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


def hardware_lines(sheet: Sheet) -> list[str]:
    """Of actuators and sensor."""
    return sentences(sheet.settings.environment, sheet.info.surface)


def write(sheet: Sheet) -> Path:
    """The page; returns its path.

    Raises:
        vibgym.files.WriteError: it cannot be written.
    """
    path, part = Path(sheet.settings.output) / PAGE, sheet.info.parts[0]
    text = render(
        Path(__file__).with_name("datasheet.html.j2"),
        title=sheet.settings.title or part.name,
        surface=surface_lines(sheet.info.surface),
        part=part_lines(part),
        hardware=hardware_lines(sheet),
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
