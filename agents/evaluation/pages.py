"""Pages from templates: HTML files that open offline; and what several of them show: tasks, parts, settings as YAML."""

from __future__ import annotations

import base64
import io
import json
import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import jinja2
import numpy as np
from markupsafe import Markup

from agents.evaluation.table import number, percent, percent_between, plain, quantity, signed, span
from vibgym.policies.task_info import TaskInfo
from vibgym.scene import Part

HOME = Path(__file__).parent

GOOD, BAD = (11, 122, 117), (209, 87, 42)
"""Colours (red, green, blue) of success rates 1 and 0."""

STRONGEST = 0.42
"""Their opacity: text on it stays readable on light and on dark pages."""

NUMBERS = ("no", "one", "two", "three", "four", "five", "six", "seven", "eight", "nine", "ten", "eleven", "twelve")


def render(template: Path | str, **values: Any) -> str:
    """Return a page from a template: a path, or the name of one of this folder.

    Templates may extend ``base.html.j2``, import ``pieces.html.j2`` and use :data:`FILTERS`; ``inline(name)`` is a script of
    this folder.
    """
    path = HOME / template
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader([path.parent, HOME]),
        autoescape=True,
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    environment.filters |= {each.__name__: each for each in FILTERS}
    environment.tests["finite"] = math.isfinite
    environment.globals["inline"] = lambda name: Markup((HOME / name).read_text(encoding="utf-8"))
    return environment.get_template(path.name).render(**values)


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
    found = text.getvalue().strip()
    return found.removeprefix("{").removesuffix("}") if flow else found


def hardware_cards(environments: Mapping[str, Mapping[str, Any]]) -> list[dict[str, str]]:
    """Return name and settings (YAML) of every hardware model; none if all are ideal."""
    keys = ("model", "actuators", "sensor", "randomize")
    found = {name: {key: each[key] for key in keys if key in each} for name, each in environments.items()}
    if not any(found.values()):
        return []
    return [{"name": name, "settings": as_yaml(each) if each else "ideal"} for name, each in found.items()]


def colour(share: float) -> str:
    """Return the colour of a success rate: strong at 0 and 1, faint at one half."""
    red, green, blue = GOOD if share > 0.5 else BAD
    return f"rgba({red}, {green}, {blue}, {STRONGEST * abs(2.0 * share - 1.0):.3f})"


def thousands(rate: float) -> str:
    """Return steps per second in thousands or millions; "–" for nan."""
    if not math.isfinite(rate):
        return "–"
    return f"{1e-6 * rate:.1f} M" if rate >= 999_500 else f"{1e-3 * rate:.0f} k"


def seeds_text(seeds: list[int]) -> str:
    """Return "3 to 7" for consecutive seeds, else all of them."""
    if len(seeds) > 2 and seeds == list(range(seeds[0], seeds[0] + len(seeds))):
        return f"{seeds[0]} to {seeds[-1]}"
    return ", ".join(map(str, seeds))


def joined(words: Sequence[str]) -> str:
    """Return "a", "a and b", "a, b and c"."""
    return " and ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def inventory(parts: Sequence[Part]) -> str:
    """Return the parts of a task in words."""
    alike: dict[Any, list[Part]] = {}
    for part in parts:
        alike.setdefault((part.name, part.friction, part.outline.tobytes()), []).append(part)
    found = []
    for (name, friction, _), those in alike.items():
        length, width = 1e3 * np.ptp(np.array(those[0].outline), axis=0)
        count = len(those)
        number = NUMBERS[count] if count < len(NUMBERS) else str(count)
        plural = name.replace("_", " ") + ("s" if count > 1 else "")
        found.append(f"{number} {plural} ({length:.3g} × {width:.3g} mm, friction {friction:g})")
    return joined(found)


def loads(tasks: Mapping[str, tuple[TaskInfo, int]]) -> list[dict[str, Any]]:
    """Return parts and number of episodes of tasks; tasks with the same ones together."""
    found: dict[tuple[str, int], list[str]] = {}
    for task, (info, episodes) in tasks.items():
        found.setdefault((inventory(info.parts), episodes), []).append(task)
    return [
        {"tasks": joined(names), "inventory": parts, "episodes": episodes} for (parts, episodes), names in found.items()
    ]


def success_criterion(task: TaskInfo) -> str:
    """Return what counts as success."""
    if task.flows:
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


def task_facts(task: TaskInfo, episodes: int) -> dict[str, Any]:
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
        "tasks": {name: task_facts(info, len(settings.seed_list(name))) for name, info in results.tasks.items()},
        "hardware": settings.environments(),
        "results": rows,
        **more,
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def common(results: Any) -> dict[str, Any]:
    """Return the values that all pages of results show."""
    settings = results.settings
    ran = results.hardware_of()
    return {
        "settings": settings,
        "confidence": f"{100 * settings.confidence:g} %",
        "hardware": ran,
        "machines": hardware_cards({name: settings.environments()[name] for name in ran}),
        "loads": loads({task: (info, len(settings.seed_list(task))) for task, info in results.tasks.items()}),
        "seeds": seeds_text(settings.seed_list()),
        "provenance": results.provenance,
        "settings_text": as_yaml(settings.as_written()),
    }


FILTERS = (colour, number, percent, percent_between, quantity, signed, span, thousands)
"""Functions that templates use to write values."""
