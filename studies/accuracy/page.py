"""Files of the report: a self-contained page, a table and a JSON file; and the summary as text."""

from __future__ import annotations

import base64
import json
import math
from pathlib import Path
from typing import Any

import jinja2

from agents.evaluation.table import markdown, plain
from studies.accuracy import comparisons, figures
from studies.accuracy.ladder import Row, SceneResult
from studies.accuracy.report import FILES, Report
from vibgym import files


def write(report: Report, output: Path) -> Path:
    """Write report.html, results.csv and results.json into a directory, all or none; return the page's path."""
    contents = (csv_text(report), json_text(report), page(report))
    files.write_together({output / name: content for name, content in zip(FILES, contents, strict=True)})
    return output / "report.html"


# -- results.csv, results.json -----------------------------------------------------------------------------------------


def record(result: SceneResult, row: Row) -> dict[str, Any]:
    """Return one row of results.csv: SI units, costs in us; None where a value does not apply."""
    step = row.strong_step
    return {
        "scene": result.scene.name,
        "method": row.candidate.method,
        "setting": row.candidate.setting,
        "cost_us": row.cost,
        "timings": row.timings,
        "worlds": row.worlds,
        "strong_median_m": row.strong.median,
        "strong_p95_m": row.strong.p95,
        "strong_max_m": row.strong.worst,
        "strong_step_median_m": None if step is None else step.median,
        "strong_step_p95_m": None if step is None else step.p95,
        "weak": row.weak,
        "weak_step": row.weak_step,
        "failed_worlds": row.failed,
        "failures": "; ".join(f"{kind} ({number})" for kind, number in row.failures.items()),
        "doubtful_worlds": row.doubtful,
        "refused": row.refused,
        "front_strong": row in comparisons.front(result, False),
        "front_weak": row in comparisons.front(result, True),
    }


def csv_text(report: Report) -> str:
    """Return every candidate on every scene."""
    return files.csv_text([record(result, row) for result in report.results for row in result.rows])


def json_text(report: Report) -> str:
    """Return the content of the page as JSON."""
    heads = [
        {**each._asdict(), "found": [one._asdict() for one in each.found], "ratios": each.ratios, "passed": each.passed}
        for each in report.headlines
    ]
    content = {
        "provenance": report.provenance,
        "seconds": report.seconds,
        "settings": report.settings.model_dump(),
        "headlines": heads,
        "orders": [{**each._asdict(), "passed": each.passed} for each in report.orders],
        "auto": [each._asdict() for each in report.auto],
        "hard_cases": [
            {"name": case.name, "question": case.question, **outcome._asdict()} for case, outcome in report.hard_cases
        ],
        "rigid": report.rigid,
        "scenes": [_scene_record(report, index) for index in range(len(report.results))],
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def _scene_record(report: Report, index: int) -> dict[str, Any]:
    result = report.results[index]

    def named(row: Row | None) -> dict[str, Any] | None:
        if row is None:
            return None
        return {"method": row.candidate.method, "setting": row.candidate.setting, "cost_us": row.cost}

    return {
        "name": result.scene.name,
        "worlds": result.scene.worlds,
        "periods": result.scene.periods,
        "truth": report.checks[index]._asdict() if report.checks else None,
        "models": [{**each._asdict(), "strong": each.strong._asdict()} for each in result.models],
        "choices": [
            {
                "weak": each.weak,
                "tolerance": each.tolerance,
                "cheapest": named(each.row),
                "by_method": {name: named(row) for name, row in each.by_method.items()},
            }
            for each in comparisons.choices(result)
        ],
        "rows": [record(result, row) for row in result.rows],
    }


# -- text --------------------------------------------------------------------------------------------------------------


def significant(value: float | None, digits: int = 2) -> str:
    """Return a number with ``digits`` significant digits, without exponent where that is short; a dash for missing values."""
    if value is None or not math.isfinite(value):
        return "–"
    if value == 0.0:
        return "0"
    size = math.floor(math.log10(abs(value)))
    if size < -4 or size > 6:
        return f"{value:.{digits - 1}e}"
    return f"{round(value, digits - 1 - size):.{max(digits - 1 - size, 0)}f}"


def error_text(value: float | None, weak: bool) -> str:
    """Return an error with its unit: mm or %."""
    if value is None or not math.isfinite(value):
        return "–"
    return f"{significant((100.0 if weak else 1e3) * value)} {'%' if weak else 'mm'}"


def summary(report: Report) -> str:
    """Return the cheapest setting for every tolerance, and the ratios, in Markdown."""
    cheapest = []
    for result in report.results:
        for each in comparisons.choices(result):
            tolerance = f"{error_text(each.tolerance, each.weak)} of {'mean velocity' if each.weak else 'trajectory'}"
            name, cost = "no setting", "–"
            if each.row is not None:
                name = f"{each.row.candidate.method}: {each.row.candidate.setting}"
                cost = significant(each.row.cost, 3)
            cheapest.append((result.scene.name, tolerance, name, cost))
    ratios = []
    for head in report.headlines:
        low, high = (f"{pick(head.ratios):.3g} x" if head.ratios else "–" for pick in (min, max))
        wanted = "–" if head.wanted is None else f"{head.wanted:g} x"
        ratios.append((head.question, wanted, low, high, str(len(head.ratios))))
    return "\n\n".join(
        (
            markdown(("scene", "tolerance", "cheapest", "us per period"), cheapest),
            markdown(("at equal error", "wanted", "smallest ratio", "largest", "scenes"), ratios),
        )
    )


# -- report.html -------------------------------------------------------------------------------------------------------


def page(report: Report) -> str:
    """Return the page as HTML."""
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent), autoescape=True, undefined=jinja2.StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    environment.globals.update(
        error=error_text, short=significant, colour=lambda name: figures.style_of(name)[0],
        verdicts={None: "", True: "met", False: "missed"},
    )  # fmt: skip
    settings = report.settings
    return environment.get_template("page.html.j2").render(
        report=report,
        settings=settings,
        truth=settings.truth,
        scenes=[_scene(result) for result in report.results],
        overview=[
            [comparisons.choice(result, False, each) for each in settings.strong_tolerances]
            + [comparisons.choice(result, True, each) for each in settings.weak_tolerances]
            for result in report.results
        ],
        troubles=[trouble for result in report.results for trouble in troubles(result)],
        convergence=_data(figures.convergence(report.orders)) if report.orders else None,
        cases=[case._asdict() | outcome._asdict() for case, outcome in report.hard_cases],
        settings_text=json.dumps(plain(settings.model_dump()), indent=1),
    )


def _data(content: bytes) -> str:
    return f"data:image/png;base64,{base64.b64encode(content).decode('ascii')}"


def _scene(result: SceneResult) -> dict[str, Any]:
    return {
        "result": result,
        "scene": result.scene,
        "figure": _data(figures.error_against_cost(result)),
        "choices": comparisons.choices(result),
        "strong_front": comparisons.front(result, False),
        "weak_front": comparisons.front(result, True),
        "absent": absent(result),
    }


def absent(result: SceneResult) -> list[tuple[str, str]]:
    """Return the methods that refuse the scene at every setting, and why."""
    found = []
    for method in result.methods:
        rows = [row for row in result.rows if row.candidate.method == method]
        if all(row.refused for row in rows):
            found.append((method, rows[0].refused))
    return found


def troubles(result: SceneResult) -> list[tuple[str, str, str, str]]:
    """Return scene, method, settings and failure; settings with the same failure are merged."""
    kinds: dict[tuple[str, str], list[tuple[Row, int]]] = {}
    for row in result.rows:
        found = {f"failed: {kind}": number for kind, number in row.failures.items()}
        if row.refused:
            found[f"refused: {row.refused}"] = 0
        if row.doubtful:
            found["reports worlds as doubtful, where slip may have passed through zero"] = row.doubtful
        for kind, number in found.items():
            kinds.setdefault((row.candidate.method, kind), []).append((row, number))
    lines = []
    for (method, kind), rows in kinds.items():
        numbers, worlds = [number for _, number in rows], rows[0][0].worlds
        if len(rows) == sum(row.candidate.method == method for row in result.rows):
            low, high = min(numbers), max(numbers)
            several = f", {low}{f' to {high}' if high > low else ''} of {worlds} worlds" if high else ""
            which = f"every setting{several}"
        else:
            which = "; ".join(
                row.candidate.setting + (f" ({number} of {row.worlds} worlds)" if number else "")
                for row, number in rows
            )
        lines.append((result.scene.name, method, which, kind))
    return lines
