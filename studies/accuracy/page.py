"""Files of the report: a self-contained page, a table and a JSON file; and the summary as text."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import pandas as pd

from agents.evaluation.pages import data_address, render
from agents.evaluation.table import markdown, plain
from studies.accuracy import comparisons, figures
from studies.accuracy.ladder import SceneResult
from studies.accuracy.report import FILES, Report
from vibgym import files


def write(report: Report, output: Path) -> Path:
    """Write report.html, results.csv and results.json into a directory, all or none; return the page's path."""
    contents = (csv_text(report), json_text(report), page(report))
    files.write_together({output / name: content for name, content in zip(FILES, contents, strict=True)})
    return output / "report.html"


def csv_text(report: Report) -> str:
    """Return every candidate on every scene: SI units, costs in us; empty cells where a value does not apply."""
    table = pd.concat([result.table for result in report.results]).drop(columns=["peer", "strong_each"])
    table["failures"] = ["; ".join(f"{kind} ({number})" for kind, number in row.items()) for row in table["failures"]]
    return files.csv_text(table.to_dict("records"))


def json_text(report: Report) -> str:
    """Return what the table does not have as JSON: ratios, orders, checks, hard cases, settings and versions."""
    content = {
        "provenance": report.provenance,
        "seconds": report.seconds,
        "settings": report.settings.model_dump(),
        "headlines": [_plain(head, "ratios", "passed") for head in report.headlines],
        "orders": [_plain(order, "passed") for order in report.orders],
        "auto": [_plain(row) for row in report.auto],
        "hard_cases": [
            {"name": case.name, "question": case.question, **_plain(outcome)} for case, outcome in report.hard_cases
        ],
        "rigid": report.rigid,
        "truth": {result.scene.name: _plain(check) for result, check in zip(report.results, report.checks)},
        "models": {result.scene.name: [_plain(model) for model in result.models] for result in report.results},
    }
    return json.dumps(plain(content), indent=1, allow_nan=False) + "\n"


def _plain(record: Any, *more: str) -> dict[str, Any]:
    """Return a record, those in it, and some of its properties as mappings."""
    values = {**record._asdict(), **{name: getattr(record, name) for name in more}}
    return {key: _nested(value) for key, value in values.items()}


def _nested(value: Any) -> Any:
    if hasattr(value, "_asdict"):
        return _plain(value)
    return [_nested(entry) for entry in value] if isinstance(value, list | tuple) else value


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
        for choice in comparisons.choices(result):
            tolerance = (
                f"{error_text(choice.tolerance, choice.weak)} of {'mean velocity' if choice.weak else 'trajectory'}"
            )
            name, cost = "no setting", "–"
            if choice.row is not None:
                name, cost = f"{choice.row.method}: {choice.row.setting}", significant(choice.row.cost_us, 3)
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
    settings, about = report.settings, report.provenance
    return render(
        Path(__file__).with_name("page.html.j2"),
        error=error_text,
        short=significant,
        colour=lambda name: figures.style_of(name)[0],
        verdicts={None: "", True: "met", False: "missed"},
        report=report,
        settings=settings,
        truth=settings.truth,
        scenes=[_scene(result) for result in report.results],
        overview=[
            [comparisons.choice(result, False, tolerance) for tolerance in settings.strong_tolerances]
            + [comparisons.choice(result, True, tolerance) for tolerance in settings.weak_tolerances]
            for result in report.results
        ],
        troubles=[trouble for result in report.results for trouble in troubles(result)],
        convergence=data_address(figures.convergence(report.orders)) if report.orders else None,
        cases=[case._asdict() | outcome._asdict() for case, outcome in report.hard_cases],
        facts={"time": about["time"], "commit": about["commit"], **about["host"], **about["versions"]},
        settings_text=json.dumps(plain(settings.model_dump()), indent=1),
    )


def _scene(result: SceneResult) -> dict[str, Any]:
    return {
        "result": result,
        "scene": result.scene,
        "figure": data_address(figures.error_against_cost(result)),
        "choices": comparisons.choices(result),
        "rows": list(result.table[result.table["refused"] == ""].itertuples()),
        "absent": absent(result),
    }


def absent(result: SceneResult) -> list[tuple[str, str]]:
    """Return the methods that refuse the scene at every setting, and why."""
    refused = result.table.groupby("method", sort=False)["refused"]
    return [(str(method), reasons.iloc[0]) for method, reasons in refused if (reasons != "").all()]


def troubles(result: SceneResult) -> list[tuple[str, str, str, str]]:
    """Return scene, method, settings and failure; settings with the same failure are merged."""
    kinds: dict[tuple[str, str], list[tuple[Any, int]]] = {}
    for row in result.table.itertuples():
        failures = {f"failed: {kind}": number for kind, number in row.failures.items()}
        if row.refused:
            failures[f"refused: {row.refused}"] = 0
        if row.doubtful_worlds:
            failures["reports worlds as doubtful, where slip may have passed through zero"] = row.doubtful_worlds
        for kind, number in failures.items():
            kinds.setdefault((str(row.method), kind), []).append((row, number))
    lines = []
    for (method, kind), rows in kinds.items():
        numbers, worlds = [number for _, number in rows], rows[0][0].worlds
        if len(rows) == (result.table["method"] == method).sum():
            low, high = min(numbers), max(numbers)
            several = f", {low}{f' to {high}' if high > low else ''} of {worlds} worlds" if high else ""
            which = f"every setting{several}"
        else:
            which = "; ".join(
                row.setting + (f" ({number} of {row.worlds} worlds)" if number else "") for row, number in rows
            )
        lines.append((result.scene.name, method, which, kind))
    return lines
