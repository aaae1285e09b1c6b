"""The report's files: the page, which needs nothing else, a table and a JSON file."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from agents.evaluation.table import plain
from studies.accuracy import comparisons, figures
from studies.accuracy.friction_experiment import Block, Experiment
from studies.accuracy.ladder import Row, SceneResult
from studies.accuracy.report import FILES, Report
from studies.accuracy.rigid import stored
from studies.accuracy.tables import csv_text, error_text, json_text, significant
from vibgym import files


def page(report: Report) -> str:
    """The whole page as HTML."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.globals.update(
        error=error_text, short=significant, colour=lambda name: figures.style_of(name)[0], plain_name=plain_name
    )
    return environment.get_template("page.html.j2").render(
        report=report,
        settings=report.settings,
        truth=report.settings.truth_settings(),
        scenes=[_scene(report, index) for index in range(len(report.results))],
        heads=[_head(each) for each in report.headlines],
        advice=advice(report),
        overview=[
            (
                result.scene.name,
                [comparisons.choice(result, False, each) for each in report.settings.strong_tolerances]
                + [comparisons.choice(result, True, each) for each in report.settings.weak_tolerances],
            )
            for result in report.results
        ],
        troubles=[trouble for result in report.results for trouble in troubles(result)],
        convergence=_data(figures.convergence(report.orders)) if report.orders else None,
        cases=[case._asdict() | outcome._asdict() for case, outcome in report.hard_cases],
        friction=_friction(report.friction) if report.friction else None,
        gains=any(comparisons.order_gain(result) is not None for result in report.results),
        settings_text=json.dumps(plain(report.settings.model_dump()), indent=1),
    )


def write(report: Report, output: Path) -> Path:
    """Write report.html, results.csv and results.json into a directory, all or none; return the page's path."""
    contents = (csv_text(report), json_text(report), page(report))
    files.write_together({output / name: content for name, content in zip(FILES, contents, strict=True)})
    return output / "report.html"


def _data(content: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"


def _scene(report: Report, index: int) -> dict[str, Any]:
    result = report.results[index]
    surface = result.scene.surface
    horizontal = surface.horizontal_amplitude * surface.angular_frequency**2
    fronts = {weak: comparisons.front(result, weak) for weak in (False, True)}
    return {
        "anchor": f"scene-{index}",
        "result": result,
        "scene": result.scene,
        "check": report.checks[index] if report.checks else None,
        "figure": _data(figures.error_against_cost(result)),
        "choices": comparisons.choices(result),
        "models": result.models,
        "eps": result.scene.part.friction * surface.gravity / horizontal if horizontal else math.inf,
        "gain": comparisons.order_gain(result),
        "rows": [
            {"row": row, "strong_front": row in fronts[False], "weak_front": row in fronts[True]}
            for row in result.rows
            if not row.refused
        ],
        "absent": absent(result),
    }


def absent(result: SceneResult) -> list[tuple[str, str]]:
    """Methods that refuse the scene altogether, and why."""
    found = []
    for method in result.methods:
        rows = [row for row in result.rows if row.candidate.method == method]
        if all(row.refused for row in rows):
            found.append((method, rows[0].refused))
    return found


def troubles(result: SceneResult) -> list[tuple[str, str, str, str]]:
    """Scene, method, settings and what went wrong; settings with the same trouble together."""
    kinds: dict[tuple[str, str], list[Row]] = {}
    for row in result.rows:
        method = row.candidate.method
        if row.refused:
            kinds.setdefault((method, f"refused: {row.refused}"), []).append(row)
        for kind in row.failures:
            kinds.setdefault((method, f"failed: {kind}"), []).append(row)
        if row.doubtful:
            kinds.setdefault((method, "does not vouch for worlds where slip may have passed through zero"), []).append(
                row
            )
    found = []
    for (method, kind), rows in kinds.items():
        number = sum(row.candidate.method == method for row in result.rows)
        which = "every setting" if len(rows) == number else "; ".join(_counted(row, kind) for row in rows)
        if len(rows) == number and not kind.startswith("refused"):
            which = f"every setting, {_range([_count(row, kind) for row in rows])} of {rows[0].worlds} worlds"
        found.append((result.scene.name, method, which, kind))
    return found


def _count(row: Row, kind: str) -> int:
    if kind.startswith("failed: "):
        return row.failures[kind.removeprefix("failed: ")]
    return row.doubtful


def _range(values: list[int]) -> str:
    return str(values[0]) if min(values) == max(values) else f"{min(values)} to {max(values)}"


def _counted(row: Row, kind: str) -> str:
    if kind.startswith("refused"):
        return row.candidate.setting
    return f"{row.candidate.setting} ({_count(row, kind)} of {row.worlds} worlds)"


def _head(head: comparisons.Headline) -> dict[str, Any]:
    ratios = head.ratios
    return {
        "head": head,
        "wanted": "" if head.wanted is None else f"≥ {head.wanted:g} ×",
        "low": f"{significant(min(ratios), 3)} ×" if ratios else "–",
        "high": f"{significant(max(ratios), 3)} ×" if ratios else "–",
        "verdict": {None: "", True: "met", False: "missed"}[head.passed],
    }


def _friction(found: Experiment) -> dict[str, Any]:
    lines = []
    for block in found.blocks:
        name = plain_name(block.name)
        lines.append(
            f"{name}: fitted µ = {block.fitted:.4f} ± {block.standard_error:.4f} from measurements with "
            f"{1e3 * found.noise:g} mm of noise, put in {block.friction:g}; largest deviation from the closed forms away "
            f"from the transitions {100 * radius_deviation(found, block):.2g} %"
        )
    return {"figure": _data(figures.radius_over_frequency(found)), "lines": lines}


def radius_deviation(found: Experiment, block: Block) -> float:
    """Largest relative deviation of both sweeps from the closed forms, 2 % and more away from the transitions."""
    far = np.all([np.abs(found.frequencies / each - 1.0) > 0.02 for each in block.window], axis=0)
    pairs = ((block.up, block.expected_up), (block.down, block.expected_down))
    return max(float(np.abs(got[far] / wanted[far] - 1.0).max()) for got, wanted in pairs)


def plain_name(name: str) -> str:
    """The name of a part as one writes it in a sentence."""
    return name.replace("_", " ")


def _between(values: list[float], weak: bool) -> str:
    low, high = error_text(min(values), weak), error_text(max(values), weak)
    return low if low == high else f"{low} to {high}"


def advice(report: Report) -> list[str]:
    """What to use when, in sentences, from what was measured."""
    lines = []
    wins: dict[str, int] = {}
    total = 0
    for result in report.results:
        for choice in comparisons.choices(result):
            total += 1
            if choice.row is not None:
                wins[choice.row.candidate.method] = wins.get(choice.row.candidate.method, 0) + 1
    counted = ", ".join(f"{name} {number} times" for name, number in sorted(wins.items(), key=lambda each: -each[1]))
    lines.append(
        f"Of the {total} pairs of scene and tolerance below, the cheapest of our models is: {counted or 'none'}."
    )
    for method in comparisons.AVERAGED:
        levels = [each.weak for result in report.results for each in result.models if each.method == method]
        if levels:
            lines.append(
                f"The {method.replace('averaged, order 1', 'first-order').replace('averaged, order 2', 'second-order')} "
                f"averaged model itself is off by {_between(levels, True)} of the "
                "mean velocity, however fine its steps: use it where that is good enough."
            )
    met = [
        row.strong.median
        for result in report.results
        for row in result.rows
        if row.candidate.method == "planar" and not row.candidate.knobs and row.usable
    ]
    if met:
        lines.append(
            f"The planar model as it comes is off by {_between(met, False)} of the "
            "trajectory (medians of the scenes); it covers every scene here, sticking included."
        )
    worst = stored.largest_gap(report.rigid)
    lines.append(
        "The largest error of all is the model's: it presses evenly. A rigid part on random plates "
        f"({plain_name(worst['part'])}, {worst['amplitude']:g} of the largest amplitude) is "
        f"{significant(worst['gap_mm'])} mm and {significant(worst['gap_deg'])} deg elsewhere after 1 s."
    )
    gaps = [each.gap for each in report.checks if not each.trouble]
    if gaps:
        lines.append(
            "The planar run that counts as true differs from the independent reference by at most "
            f"{significant(1e6 * max(gaps))} µm."
        )
    return lines
