"""Published results: ``python -m agents publish CONFIG`` writes figures.csv, episodes.csv and report.json."""

from __future__ import annotations

import argparse
import csv
import json
import math
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
from agents.evaluation.table import EFFECTS, METRICS, OWN, PLACE, QUANTITIES, REPORT, Place, places, records
from agents.locks import one_run
from agents.provenance import digest, portable
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, reason, write_together

PUBLISHED = Path("results/report")
FORMAT, VERSION = "vibgym-published", 1
RECORD, FIGURE_FILE, EPISODE_FILE = "report.json", "figures.csv", "episodes.csv"
RESULTS = "results.json"

LEFT_OUT = ("output", "animations", "confidence", "resamples")
"""Settings that do not affect episodes."""

OPTIONAL = ("rate_over_bound", *OWN)
"""Columns that results of former versions lack."""

COLUMNS = (
    "success", "fallen", "steps", "time_to_goal_s", "time_over_bound", "position_error_m", "heading_error_rad", "path_error_m",
    "throughput_parts_per_s", "collisions", "path_efficiency", *OPTIONAL,
)  # fmt: skip
"""Metrics of episodes.csv: those from which figures are computed."""

DIGITS = 6
"""Significant digits of published metrics. All figures are computed from rounded values."""


@dataclass(frozen=True)
class Published:
    """Published results.

    Attributes:
        directory: of the files.
        record: content of report.json: provenance, settings, digests.
        settings: of the evaluation.
        episodes: all episodes, with the metrics :data:`COLUMNS`.
        figures: place and name of a figure -> value in figures.csv.
        digests: of the two CSV files as they are now.
    """

    directory: Path
    record: Mapping[str, Any]
    settings: EvaluationSettings
    episodes: pd.DataFrame
    figures: dict[tuple[Place, str], float]
    digests: Mapping[str, str]


def rounded(episodes: pd.DataFrame) -> pd.DataFrame:
    """Return labels and metrics of published episodes, rounded to :data:`DIGITS`."""
    metrics = {name: [float(f"{value:.{DIGITS}g}") for value in episodes[name]] for name in COLUMNS}
    return episodes[[*PLACE, "seed"]].assign(training_seed=-1, **metrics)


def figure_rows(episodes: pd.DataFrame, level: float | None = None, resamples: int = 9999) -> list[dict[str, Any]]:
    """Return one row for every figure in every place; without ``level``, no intervals."""
    rows = []
    for place, some in places(episodes).items():
        for figure in QUANTITIES:
            sample = figure.sample(some)
            if len(sample):
                row = place._asdict() | {"figure": figure.name, "episodes": len(sample), "value": figure.value(sample)}
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


def settings_apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the names of settings that differ; of policies also their names."""
    named = [key for key in {**one, **other} if one.get(key) != other.get(key)]
    if "policies" in named:
        first, second = (_by_name(each["policies"]) for each in (one, other))
        apart = [name for name in {**first, **second} if first.get(name) != second.get(name)]
        named[named.index("policies")] = f"policies ({', '.join(apart) or 'their order'})"
    return named


def _by_name(policies: Any) -> Mapping[str, Any]:
    return policies if isinstance(policies, Mapping) else {each["name"]: each for each in policies}


def load(directory: Path) -> Published:
    """Read published results.

    Raises:
        ValueError: a file is missing, of another format or version, or incomplete; names it.
    """
    path = directory / RECORD
    record = _record(path, ("format", "version", "settings", "digests", "versions"))
    if (record["format"], record["version"]) != (FORMAT, VERSION):
        given = {key: record[key] for key in ("format", "version")}
        raise checks.refuse(str(path), given, f"of format {FORMAT!r}, version {VERSION}")
    if not isinstance(record["digests"], dict) or not {"settings", "files", "policies"} <= set(record["digests"]):
        raise checks.missing("digests.settings, .files, .policies", f"of {path}")
    with checks.within(path):
        settings = EvaluationSettings.stored(record["settings"])
    path = directory / EPISODE_FILE
    episodes = _columns(path, PLACE, ("seed", *COLUMNS))
    good = episodes["success"].isin((0.0, 1.0)) & episodes["fallen"].isin((0.0, 1.0))
    good &= (episodes["seed"] >= 0) & (episodes["seed"] < 2**63) & episodes["study"].isin((REPORT, EFFECTS))
    for line in np.flatnonzero(~good)[:1]:
        given = episodes.loc[line, ["study", "seed", "success", "fallen"]].to_dict()
        raise checks.refuse(f"{path}, line {line + 2}", given, "a study, a seed, and 0 or 1")
    episodes = episodes.astype({"seed": int}).assign(training_seed=-1)
    figures = _columns(directory / FIGURE_FILE, (*PLACE, "figure"), ("value",))
    stated = {(Place(*row[:4]), row[4]): row[5] for row in figures.itertuples(index=False)}
    digests = {name: digest((directory / name).read_bytes()) for name in (FIGURE_FILE, EPISODE_FILE)}
    return Published(directory, record, settings, episodes, stated, digests)


def _record(path: Path, needed: Sequence[str]) -> dict[str, Any]:
    """Return the content of a JSON file with at least the keys ``needed``."""
    try:
        found = json.loads(path.read_bytes())
    except OSError as error:
        raise checks.refuse(str(path), reason(error), "a readable file of an evaluation") from None
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the results of an evaluation") from None
    absent = [name for name in needed if not isinstance(found, dict) or name not in found]
    if absent:
        raise checks.missing(", ".join(absent), f"of {path}")
    return found


def _columns(path: Path, texts: Sequence[str], numbers: Sequence[str]) -> pd.DataFrame:
    """Return ``texts`` and ``numbers`` (float64, nan if empty) of a CSV file, in this order."""
    try:
        with path.open(newline="", encoding="utf-8") as file:
            widths = [len(cells) for cells in csv.reader(file)]
        found = pd.read_csv(path, dtype=str, keep_default_na=False)
    except (OSError, ValueError, csv.Error) as error:  # ValueError: not UTF-8, no CSV, or an invalid file name
        raise checks.refuse(str(path), reason(error), "a readable file of an evaluation") from None
    absent = [name for name in (*texts, *numbers) if name not in (*found.columns, *OPTIONAL)]
    if absent or found.empty:
        raise checks.missing(", ".join(absent) or "rows", f"of {path}")
    for line in np.flatnonzero(np.array(widths) != widths[0])[:1]:
        raise checks.refuse(f"{path}, line {line + 1}", widths[line], f"{widths[0]} cells")
    # csv_text puts an apostrophe before names that a spreadsheet would read as a formula.
    columns: dict[str, Any] = {name: found[name].str.removeprefix("'") for name in texts}
    for name in numbers:
        cells = found[name] if name in found else pd.Series("", index=found.index)
        columns[name] = np.asarray(pd.to_numeric(cells.where(cells != "", "nan"), errors="coerce"), dtype=np.float64)
        for line in np.flatnonzero(np.isnan(columns[name]) & ~cells.str.lower().isin(("", "nan")))[:1]:
            raise checks.refuse(f"{path}, line {line + 2}: {name}", cells[line], "a number, or empty")
    return pd.DataFrame(columns)


def publish(config: Path, run: Path | None, directory: Path) -> Path:
    """Publish what ``python -m agents evaluate CONFIG`` found: figures, episodes, and a record with versions and digests.

    Args:
        config: of the evaluation. Its name is published, too: verifying compares its settings.
        run: directory of the evaluation's files; None: the ``output`` of the settings.
        directory: where all three files are written, or none.

    Returns:
        The record's path.

    Raises:
        ValueError: there is no evaluation with these settings, or a policy cannot be published; nothing is written.
        WriteError: a file could not be written; then none is new.
    """
    settings = EvaluationSettings.load(config)
    path = (Path(settings.output) if run is None else run) / RESULTS
    kept = ("time", "commit", "machine", "versions")
    found = _record(path, (*kept, "policy_files", "settings", "episodes"))
    with checks.within(config):
        written = written_settings(settings)
        prepare(EvaluationSettings.stored(written))
    wanted = json.loads(canonical(settings.as_written()))
    apart = [name for name in settings_apart(wanted, found["settings"]) if name != "output"]
    if apart:
        raise checks.refuse(str(path), f"one with other settings ({', '.join(apart)})", f"a run of {config}")
    episodes = _episodes(path, found)
    files = {
        FIGURE_FILE: csv_text(figure_rows(episodes, settings.confidence, settings.resamples)),
        EPISODE_FILE: csv_text(
            [
                {name: _short(value) for name, value in row.items()}
                for row in records(episodes, (*PLACE, "seed", *COLUMNS))
            ]
        ),
    }
    record = {
        "format": FORMAT,
        "version": VERSION,
        "config": portable(config.as_posix()),
        **{key: found[key] for key in kept},
        "confidence": settings.confidence,
        "digests": {
            "settings": digest(canonical(written)),
            "files": {name: digest(text) for name, text in files.items()},
            "policies": found["policy_files"],
        },
        "settings": written,
    }
    contents = {directory / name: text for name, text in files.items()}
    output_directory(directory, "--output")
    output_files([*contents, directory / RECORD], "--output")
    with one_run(directory, "--output"):
        write_together({**contents, directory / RECORD: json.dumps(record, indent=1, allow_nan=False) + "\n"})
    return directory / RECORD


def _short(value: Any) -> Any:
    """Return whole numbers without a decimal point."""
    return int(value) if isinstance(value, bool) or (isinstance(value, float) and value.is_integer()) else value


def _episodes(path: Path, found: Mapping[str, Any]) -> pd.DataFrame:
    """Return the rounded table of all episodes in results.json."""
    try:
        effects = found.get("effects", {"task": "", "episodes": []})
        rows = [{"study": REPORT, **row} for row in found["episodes"]]
        for row in effects["episodes"]:
            rows.append({"study": EFFECTS, "task": effects["task"], "hardware": row["case"], **row})
        labels = {name: [row[name] for row in rows] for name in PLACE}
        metrics = {name: np.array([row.get(name, math.nan) for row in rows], dtype=np.float64) for name in METRICS}
        return rounded(pd.DataFrame({**labels, "seed": [int(row["seed"]) for row in rows], **metrics}))
    except (KeyError, TypeError, ValueError) as error:
        raise checks.refuse(f"{path}: episodes", repr(error), "the episodes of an evaluation") from None


def _arguments(parser: argparse.ArgumentParser) -> None:
    command_line.config(parser, "YAML file of the evaluation")
    parser.add_argument("--run", type=Path, metavar="DIR", help="the evaluation's files (default: its 'output')")


def command(arguments: argparse.Namespace) -> None:
    """Publish the figures and episodes of an evaluation."""
    print(f"published: {publish(arguments.config, arguments.run, arguments.output or PUBLISHED)}")


COMMANDS = {"publish": Command(_arguments, command, f"directory of published results (default: {PUBLISHED})")}
