"""Pages: HTML files that open offline, from one template and blocks of text, tables, pictures and cards."""

from __future__ import annotations

import base64
import io
import json
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from agents.evaluation.statistics import Estimate
from agents.evaluation.table import markdown, percent, percent_between, plain, signed
from vibgym.policies.task_info import TaskInfo
from vibgym.scene import Part

HOME = Path(__file__).parent

GOOD, BAD = (11, 122, 117), (209, 87, 42)
"""Colours (red, green, blue) of success rates 1 and 0."""

STRONGEST = 0.42
"""Their opacity: text on it stays readable on light and on dark pages."""


@dataclass(frozen=True)
class Cell:
    """Cell of a table: text and small print. ``kind``: classes; ``colour``: of the background; ``dot``: before it."""

    text: str
    small: str = ""
    kind: str = ""
    colour: str = ""
    dot: str = ""
    link: str = ""
    title: str = ""
    sort: str | None = None


@dataclass(frozen=True)
class Grid:
    """A table: rows of as many cells as there are heads."""

    label: str
    heads: Sequence[str]
    rows: Sequence[Sequence[Cell | str]]
    kind: str = ""
    block = "grid"

    def markdown(self) -> str:
        """Return the table in Markdown, small print in parentheses."""
        return markdown(self.heads, [[_text(cell) for cell in row] for row in self.rows])


def _text(cell: Cell | str) -> str:
    if isinstance(cell, str):
        return cell
    return f"{cell.text} ({cell.small})" if cell.small else cell.text


def grid(label: str, rows: Sequence[Any], columns: Mapping[str, Callable[[Any], Cell | str]], kind: str = "") -> Grid:
    """Return a table with a line for every row; columns without a value and a hardware that is always the same are left out.

    Args:
        label: of the table.
        rows: of statistics.
        columns: head -> function of a row that returns its cell.
        kind: class of the table.
    """
    cells = {head: [make(row) for row in rows] for head, make in columns.items()}
    texts = {head: {_text(cell) for cell in column} for head, column in cells.items()}
    heads = [head for head in cells if texts[head] != {"–"} and not (head == "hardware" and len(texts[head]) == 1)]
    return Grid(label, heads, list(zip(*(cells[head] for head in heads), strict=True)), kind)


@dataclass(frozen=True)
class Picture:
    """An embedded picture; with ``summary`` it opens on a click."""

    source: str
    alt: str
    caption: str = ""
    summary: str = ""
    block = "picture"


@dataclass(frozen=True)
class Card:
    """Text and pictures in a frame; ``code`` is shown unchanged."""

    title: str
    text: str = ""
    note: str = ""
    code: str = ""
    aside: str = ""
    dot: str = ""
    id: str = ""
    pictures: Sequence[Picture] = ()


@dataclass(frozen=True)
class Cards:
    """Cards side by side; ``wide`` ones two in a row."""

    cards: Sequence[Card]
    wide: bool = False
    block = "cards"


@dataclass(frozen=True)
class Lines:
    """A table without heads: label, value and notes of each line."""

    lines: Sequence[tuple[str, ...]]
    block = "lines"


@dataclass(frozen=True)
class Heading:
    """A heading within a section."""

    text: str
    id: str = ""
    block = "heading"


@dataclass(frozen=True)
class Section:
    """Blocks under a heading: a text is a paragraph, and a tuple a list."""

    id: str
    title: str
    blocks: Sequence[Any]


def render(template: Path | str, **values: Any) -> str:
    """Return a page from a template: a path, or the name of one of this folder."""
    path = HOME / template
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([path.parent, HOME]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.globals["inline"] = lambda name: Markup((HOME / name).read_text(encoding="utf-8"))
    return environment.get_template(path.name).render(**values)


def page(results: Any, command: str, title: str, lead: str, sections: Sequence[Section]) -> str:
    """Return the page of results (:class:`agents.evaluation.run.Results`), with settings and versions at the end."""
    settings, origin = results.settings, results.provenance
    ran = {name: settings.environments()[name] for name in results.hardware_of()}
    keys = ("model", "actuators", "sensor", "randomize")
    machines = {name: {key: arguments[key] for key in keys if key in arguments} for name, arguments in ran.items()}
    cards = [Card(name, code=as_yaml(machine) if machine else "ideal") for name, machine in machines.items()]
    about = (
        "Settings of the hardware models of actuators and sensor (docs/hardware.md). All results are simulated; rewards and "
        "success are computed from the true poses, not from measurements."
    )
    if any(machines.values()):
        sections = [*sections, Section("hardware", "Hardware", [about, Cards(cards)])]
    info = {
        "Date": origin["time"],
        "Commit": origin["commit"] or "not known",
        "Seeds": seeds_text(settings.seed_list()),
        "Processor": f"{origin['host']['processor']}, {origin['host']['cores']} cores",
        "System": origin["host"]["system"],
        **{name: version or "not installed" for name, version in origin["versions"].items()},
    }
    return render(
        "page.html.j2",
        command=command,
        title=title,
        lead=lead,
        sections=sections,
        footer=(),
        info=info,
        settings_text=as_yaml(settings.as_written()),
    )


def success_cell(row: Mapping[str, Any], **more: Any) -> Cell:
    """Return the cell of a success rate, with its interval."""
    shown = {"colour": colour(row["success_rate"]), "title": row["success_interval_method"], **more}
    return Cell(f"{percent(row)} %", f"{percent_between(row)} %", **shown)


def estimate_cell(estimate: Estimate | None, factor: float, digits: int, unit: str = "") -> Cell:
    """Return the cell of a difference, bold if zero is outside its interval; "–" for None."""
    if estimate is None:
        return Cell("–")
    interval = estimate.interval
    text = f"{signed(factor * estimate.value, digits)}{unit}" if math.isfinite(estimate.value) else "–"
    if interval is None:
        return Cell(text)
    small = f"{signed(factor * interval.low, digits)} to {signed(factor * interval.high, digits)}"
    return Cell(text, small, kind="clear" if estimate.clear else "", title=interval.method)


def data_address(content: bytes, kind: str = "png") -> str:
    """Return the address of a picture that is embedded in the page."""
    return f"data:image/{kind};base64,{base64.b64encode(content).decode('ascii')}"


def as_yaml(value: Any, flow: bool = False) -> str:
    """Return values as YAML, in block style or, with ``flow``, in one line."""
    from ruamel.yaml import YAML

    writer, text = YAML(typ="safe", pure=True), io.StringIO()
    writer.default_flow_style = flow
    writer.width = 10_000 if flow else 100
    writer.sort_base_mapping_type_on_output = False  # type: ignore[assignment]
    # Through JSON: YAML would write references for a mapping that occurs twice.
    writer.dump(json.loads(json.dumps(plain(value))), text)
    content = text.getvalue().strip()
    return content.removeprefix("{").removesuffix("}") if flow else content


def colour(share: float) -> str:
    """Return the colour of a success rate: strong at 0 and 1, faint at one half."""
    red, green, blue = GOOD if share > 0.5 else BAD
    return f"rgba({red}, {green}, {blue}, {STRONGEST * abs(2.0 * share - 1.0):.3f})"


def seeds_text(seeds: list[int]) -> str:
    """Return "3 to 7" for consecutive seeds, else all of them."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def joined(words: Sequence[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def inventory(parts: Sequence[Part]) -> str:
    """Return the parts of a task in words: "3 × steel block (50 × 40 mm, friction 0.64)"."""
    sizes = [1e3 * np.ptp(np.array(part.outline), axis=0) for part in parts]
    kinds = Counter(
        f"{part.name.replace('_', ' ')} ({length:.3g} × {width:.3g} mm, friction {part.friction:g})"
        for part, (length, width) in zip(parts, sizes, strict=True)
    )
    return joined([f"{count} × {kind}" for kind, count in kinds.items()])


def success_criterion(task: TaskInfo) -> str:
    """Return what counts as success."""
    if task.continuous_feed:
        return "parts that leave through the gate of their kind, straight and apart"
    criteria = []
    if task.has_goal:
        heading = f" and {math.degrees(task.heading_tolerance):.3g}°" if task.has_heading else ""
        moves = " of a goal that moves along a path, throughout" if task.goal_moves else ""
        criteria.append(f"within {1e3 * task.position_tolerance:g} mm{heading}{moves}")
    if task.zones is not None:
        criteria.append("all parts in their zones")
    if task.apart is not None:
        criteria.append(f"all parts more than {1e3 * task.apart:.1f} mm apart")
    return joined(criteria) or "see its documentation"


def task_cards(results: Any) -> Cards:
    """Return a card for each task: what is asked, with which parts, and what counts."""
    cards = []
    for name, info in results.tasks.items():
        limit = f"{info.step_limit} steps ({info.step_limit * info.step_time:g} s)"
        count = len(results.settings.seed_list(name))
        note = f"{inventory(info.parts)}; counted: {success_criterion(info)}; limit: {limit}; {count} episodes"
        cards.append(Card(name, info.summary, note))
    return Cards(cards)


def task_info(task: TaskInfo, episodes: int) -> dict[str, Any]:
    """Return a task for results.json; None where something does not apply."""
    zones = {} if task.zones is None else dict(zip(task.kinds, task.zones.tolist(), strict=True))
    return {
        "name": task.name,
        "summary": task.summary,
        "position_tolerance": task.position_tolerance if task.has_goal else None,
        "heading_tolerance": task.heading_tolerance if task.has_heading else None,
        "step_limit": task.step_limit,
        "episodes": episodes,
        "parts": [part.name for part in task.parts],
        "zones": zones,
        "apart": task.apart,
    }


def json_text(results: Any, rows: Sequence[Mapping[str, Any]], more: Mapping[str, Any]) -> str:
    """Return a JSON file: provenance, settings, tasks, hardware, rows of statistics, and more; null where not applicable.

    Args:
        results: see :class:`agents.evaluation.run.Results`.
    """
    settings = results.settings
    content = {
        **results.provenance,
        "settings": settings.as_written(),
        "seeds": settings.seed_list(),
        "tasks": {name: task_info(info, len(settings.seed_list(name))) for name, info in results.tasks.items()},
        "hardware": settings.environments(),
        "results": rows,
        **more,
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"
