"""Published results: ``python -m agents publish CONFIG`` writes figures.csv, episodes.csv and report.json."""

from __future__ import annotations

import argparse
import csv
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from agents import command_line
from agents.command_line import Command
from agents.evaluation.plan import prepare
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import EFFECTS, OWN, PLACE, QUANTITIES, REPORT, Place, Quantity, places
from agents.locks import one_run
from agents.provenance import digest, portable
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, reason, write_together

PUBLISHED = Path("results/report")
FORMAT, VERSION = "vibgym-published", 1
RECORD, FIGURE_FILE, EPISODE_FILE = "report.json", "figures.csv", "episodes.csv"
KEPT = ("time", "commit", "host", "versions")
"""Provenance in results.json that is published."""

LEFT_OUT = ("output", "animations", "confidence", "resamples")
"""Settings that do not affect episodes."""

OPTIONAL = ("rate_over_bound", *OWN)
"""Columns that results of former versions lack."""

COLUMNS = [
    "success", "fallen", "steps", "time_to_goal_s", "time_over_bound", "position_error_m", "heading_error_rad", "path_error_m",
    "throughput_parts_per_s", "collisions", "path_efficiency", *OPTIONAL,
]  # fmt: skip
"""Metrics of episodes.csv: those from which figures are computed."""

DIGITS = 6
"""Significant digits of published metrics. All figures are computed from rounded values."""


@dataclass(frozen=True)
class Published:
    """Published results: the content of report.json, and its settings.

    Attributes:
        episodes: columns ``PLACE``, seed and :data:`COLUMNS`.
        figures: columns ``PLACE``, figure and value.
    """

    directory: Path
    record: Mapping[str, Any]
    settings: EvaluationSettings
    episodes: pd.DataFrame
    figures: pd.DataFrame


def rounded(episodes: pd.DataFrame) -> pd.DataFrame:
    """Return labels and metrics of published episodes, rounded to :data:`DIGITS`."""
    metrics = {name: [float(f"{value:.{DIGITS}g}") for value in episodes[name]] for name in COLUMNS}
    return episodes[[*PLACE, "seed"]].assign(**metrics)


def samples(episodes: pd.DataFrame) -> dict[tuple[Place, Quantity], np.ndarray]:
    """Return the finite values (n,) of every figure in every place where it has any."""
    known = {(place, figure): figure.sample(some) for place, some in places(episodes).items() for figure in QUANTITIES}
    return {key: sample for key, sample in known.items() if len(sample)}


def figure_rows(episodes: pd.DataFrame, level: float | None = None, resamples: int = 9999) -> list[dict[str, Any]]:
    """Return one row for every figure in every place; without ``level``, no intervals."""
    rows = []
    for (place, figure), sample in samples(episodes).items():
        row = {**place._asdict(), "figure": figure.name, "episodes": len(sample), "value": figure.value(sample)}
        if level is not None:
            interval = figure.interval(sample, level, resamples)
            row |= {"low": interval.low, "high": interval.high, "interval": interval.method}
        rows.append(row)
    return rows


def written_settings(settings: EvaluationSettings) -> dict[str, Any]:
    """Return the settings that determine episodes as JSON values that :class:`EvaluationSettings` reads.

    Raises:
        ValueError: a policy is an object, or a file outside the current directory.
    """
    policies = []
    for entry in settings.policies:
        content, field = entry.content, f"evaluation.policies ({entry.name})"
        if isinstance(content, str):
            content = {"kind": "trained", "path": content} if content.endswith(".json") else {"kind": content}
        if not isinstance(content, Mapping) or "policy" in content:
            raise checks.refuse(field, entry.content, "plain data, so that it can be published")
        path = content.get("path")
        if isinstance(path, str) and Path(path).is_absolute() and not Path(path).is_relative_to(Path.cwd()):
            raise checks.refuse(f"{field}.path", path, f"a path below {Path.cwd()}, which others have")
        policies.append({**portable(content), "name": entry.name, **entry.own})
    kept = {key: value for key, value in settings.as_written().items() if key not in LEFT_OUT}
    try:
        return json.loads(json.dumps({**kept, "policies": policies}, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise checks.refuse("evaluation", str(error), "plain data, so that it can be published") from None


def canonical(values: Any) -> str:
    """Return one text for equal JSON values."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"))


def changed(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the keys whose values differ; that of an absent key is None."""
    return [key for key in {**before, **now} if before.get(key) != now.get(key)]


def changed_settings(before: Mapping[str, Any], now: Mapping[str, Any]) -> list[str]:
    """Return the names of settings that differ; of policies also their names."""
    names = changed(before, now)
    if "policies" in names:
        pair = (side["policies"] for side in (before, now))
        policies = (side if isinstance(side, Mapping) else {one["name"]: one for one in side} for side in pair)
        names[names.index("policies")] = f"policies ({', '.join(changed(*policies)) or 'their order'})"
    return names


def load(directory: Path) -> Published:
    """Read published results.

    Raises:
        ValueError: a file is missing, of another format or version, or incomplete; names it.
    """
    path = directory / RECORD
    record = _record(path, ("format", "version", "settings", "digests", "versions"))
    if (record["format"], record["version"]) != (FORMAT, VERSION):
        stated = {key: record[key] for key in ("format", "version")}
        raise checks.refuse(str(path), stated, f"of format {FORMAT!r}, version {VERSION}")
    if not isinstance(record["digests"], dict) or not {"settings", "files", "policies"} <= set(record["digests"]):
        raise checks.missing("digests.settings, .files, .policies", f"of {path}")
    with checks.within(path):
        settings = EvaluationSettings.stored(record["settings"])
    path = directory / EPISODE_FILE
    episodes = _columns(path, PLACE, ["seed", *COLUMNS])
    good = episodes[["success", "fallen"]].isin((0.0, 1.0)).all(axis=1) & episodes["study"].isin((REPORT, EFFECTS))
    good &= episodes["seed"].between(0, 2**63, inclusive="left")
    for line in np.flatnonzero(~good)[:1]:
        cells = episodes.loc[line, ["study", "seed", "success", "fallen"]].to_dict()
        raise checks.refuse(f"{path}, line {line + 2}", cells, "a study, a seed, and 0 or 1")
    figures = _columns(directory / FIGURE_FILE, [*PLACE, "figure"], ["value"])
    return Published(directory, record, settings, episodes.astype({"seed": int}), figures)


def _record(path: Path, needed: Sequence[str]) -> dict[str, Any]:
    """Return the content of a JSON file with at least the keys ``needed``."""
    try:
        record = json.loads(path.read_bytes())
    except OSError as error:
        raise checks.refuse(str(path), reason(error), "a readable file of an evaluation") from None
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the results of an evaluation") from None
    absent = [name for name in needed if not isinstance(record, dict) or name not in record]
    if absent:
        raise checks.missing(", ".join(absent), f"of {path}")
    return record


def _columns(path: Path, texts: Sequence[str], numbers: Sequence[str]) -> pd.DataFrame:
    """Return ``texts`` and ``numbers`` (float64, nan if empty) of a CSV file, in this order."""
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            heads, *rows = csv.reader(file)
    except (OSError, ValueError, csv.Error) as error:  # ValueError: empty, not UTF-8, or an invalid file name
        raise checks.refuse(str(path), reason(error), "a readable file of an evaluation") from None
    absent = [name for name in (*texts, *numbers) if name not in (*heads, *OPTIONAL)]
    if absent or not rows:
        raise checks.missing(", ".join(absent) or "rows", f"of {path}")
    for line, row in enumerate(rows, 2):
        if len(row) != len(heads):
            raise checks.refuse(f"{path}, line {line}", len(row), f"{len(heads)} cells")
    table = pd.DataFrame(dict(zip(heads, zip(*rows, strict=True), strict=True)))
    table = table.reindex(columns=[*texts, *numbers], fill_value="")
    for name in texts:  # csv_text puts an apostrophe before names that a spreadsheet would read as a formula
        table[name] = table[name].str.removeprefix("'")
    for name in numbers:
        cells = table[name]
        table[name] = np.asarray(pd.to_numeric(cells.where(cells != "", "nan"), errors="coerce"), dtype=np.float64)
        for line in np.flatnonzero(table[name].isna() & ~cells.str.lower().isin(("", "nan")))[:1]:
            raise checks.refuse(f"{path}, line {line + 2}: {name}", cells[line], "a number, or empty")
    return table


def publish(config: Path, run: Path | None, directory: Path) -> Path:
    """Publish what ``python -m agents evaluate CONFIG`` found: figures, episodes, and a record with versions and digests.

    Args:
        config: of the evaluation. Its name is published, too: verifying compares its settings.
        run: directory of the evaluation's files; None: the ``output`` of the settings.
        directory: where all three files are written, or none; the record's path is returned.

    Raises:
        ValueError: there is no evaluation with these settings, or a policy cannot be published.
        WriteError: a file could not be written.
    """
    settings = EvaluationSettings.load(config)
    if settings.generalisation:
        raise checks.conflict(
            f"{config}: evaluation.generalisation cannot be published, only episodes of tasks and effects"
        )
    path = (Path(settings.output) if run is None else run) / "results.json"
    results = _record(path, (*KEPT, "policy_files", "settings", "episodes"))
    with checks.within(config):
        written = written_settings(settings)
        prepare(EvaluationSettings.stored(written))
    wanted = json.loads(canonical(settings.as_written()))
    apart = [name for name in changed_settings(wanted, results["settings"]) if name != "output"]
    if apart:
        raise checks.refuse(str(path), f"one with other settings ({', '.join(apart)})", f"a run of {config}")
    episodes = _episodes(path, results)
    files = {
        FIGURE_FILE: csv_text(figure_rows(episodes, settings.confidence, settings.resamples)),
        EPISODE_FILE: csv_text([
            {name: int(value) if isinstance(value, float) and value.is_integer() else value for name, value in row.items()}
            for row in episodes.to_dict("records")
        ]),
    }  # fmt: skip
    record = {
        "format": FORMAT,
        "version": VERSION,
        "config": portable(config.as_posix()),
        **{key: results[key] for key in KEPT},
        "confidence": settings.confidence,
        "digests": {
            "settings": digest(canonical(written)),
            "files": {name: digest(text) for name, text in files.items()},
            "policies": results["policy_files"],
        },
        "settings": written,
    }
    files[RECORD] = json.dumps(record, indent=1, allow_nan=False) + "\n"
    contents = {directory / name: text for name, text in files.items()}
    output_directory(directory, "--output")
    output_files(contents, "--output")
    with one_run(directory, "--output"):
        write_together(contents)
    return directory / RECORD


def _episodes(path: Path, results: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rounded table of all episodes in results.json."""
    try:
        rows = [{"study": REPORT, **row} for row in results["episodes"]]
        if "effects" in results:
            labels = {"study": EFFECTS, "task": results["effects"]["task"]}
            rows += [{**labels, "hardware": row["case"], **row} for row in results["effects"]["episodes"]]
        episodes = pd.DataFrame(rows)
        metrics = episodes.reindex(columns=COLUMNS).astype(np.float64)
        return rounded(episodes[[*PLACE, "seed"]].astype({"seed": int}).join(metrics))
    except (KeyError, TypeError, ValueError) as error:
        raise checks.refuse(f"{path}: episodes", repr(error), "the episodes of an evaluation") from None


def _arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser, "YAML file of the evaluation")
    parser.add_argument("--run", type=Path, metavar="DIR", help="the evaluation's files (default: its 'output')")


def command(arguments: argparse.Namespace) -> None:
    """Publish the figures and episodes of an evaluation."""
    print(f"published: {publish(arguments.config, arguments.run, arguments.output or PUBLISHED)}")


COMMANDS = {"publish": Command(_arguments, command, f"directory of published results (default: {PUBLISHED})")}
