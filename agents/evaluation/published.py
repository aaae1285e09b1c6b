"""Published results: ``python -m agents publish CONFIG`` writes figures.csv, episodes.csv and report.json."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.run import effects_runs, main_runs
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import EFFECTS, METRICS, OWN, QUANTITIES, REPORT, Place, Table
from agents.locks import one_run
from agents.provenance import digest, portable
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, reason, write_together

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
        table: all episodes, with the metrics :data:`COLUMNS`.
        figures: place and name of a figure -> value in figures.csv.
        digests: of the two CSV files as they are now.
    """

    directory: Path
    record: Mapping[str, Any]
    settings: EvaluationSettings
    table: Table
    figures: dict[tuple[Place, str], float]
    digests: Mapping[str, str]

    @property
    def last_seed(self) -> int:
        """Largest seed."""
        return int(self.table["seed"].max())


def rounded(table: Table) -> Table:
    """Return labels and metrics of published episodes, rounded to :data:`DIGITS`."""
    labels = {name: table[name] for name in (*Place._fields, "seed")}
    metrics = {name: np.array([float(f"{each:.{DIGITS}g}") for each in table[name]]) for name in COLUMNS}
    return Table({**labels, "training_seed": np.full(len(table), -1), **metrics})


def figure_rows(table: Table, level: float | None = None, resamples: int = 9999) -> list[dict[str, Any]]:
    """Return one row for every figure in every place; without ``level``, no intervals."""
    rows = []
    for place, those in table.places().items():
        for figure in QUANTITIES:
            sample = figure.sample(those)
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
    values = {key: value for key, value in settings.as_written().items() if key not in LEFT_OUT}
    policies = []
    for entry in settings.entries():
        content, field = entry.content, f"evaluation.policies ({entry.name})"
        if isinstance(content, str):
            trained = content.endswith(".json")
            content = {"kind": "trained", "path": content} if trained else {"kind": content}
        if not isinstance(content, Mapping) or "policy" in content:
            raise checks.refuse(field, entry.content, "plain data, so that it can be published")
        path = content.get("path")
        if isinstance(path, str) and Path(path).is_absolute() and not Path(path).is_relative_to(Path.cwd()):
            raise checks.refuse(f"{field}.path", path, f"a path below {Path.cwd()}, which others have")
        policies.append({**portable(content), "name": entry.name, **entry.own})
    try:
        return json.loads(json.dumps({**values, "policies": policies}, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise checks.refuse("evaluation", str(error), "plain data, so that it can be published") from None


def canonical(values: Any) -> str:
    """Return one text for equal JSON values."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"))


def settings_apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the names of settings that differ; of policies also their names."""
    named = {}
    for key in {**one, **other}:
        if one.get(key) != other.get(key):
            named[key] = key
            if key == "policies":
                first, second = (_by_name(each.get(key)) for each in (one, other))
                apart = [name for name in {**first, **second} if first.get(name) != second.get(name)]
                named[key] = f"policies ({', '.join(apart) or 'their order'})"
    return list(named.values())


def _by_name(policies: Any) -> Mapping[str, Any]:
    return policies if isinstance(policies, Mapping) else {each["name"]: each for each in policies or ()}


def load(directory: Path) -> Published:
    """Read published results.

    Raises:
        ValueError: a file is missing, of another format or version, or incomplete; names it.
    """
    path = directory / RECORD
    try:
        record = json.loads(_text(path))
    except (ValueError, RecursionError) as error:
        if isinstance(error, checks.Refused):
            raise
        raise checks.refuse(str(path), f"not JSON ({error})", "the record of published results") from None
    kind = {key: record.get(key) for key in ("format", "version")} if isinstance(record, dict) else type(record)
    if kind != {"format": FORMAT, "version": VERSION}:
        raise checks.refuse(str(path), kind, f"of format {FORMAT!r}, version {VERSION}")
    for key in ("settings", "digests", "versions"):
        if not isinstance(record.get(key), dict):
            raise checks.refuse(f"{path}: {key}", record.get(key), "a mapping")
    for key in ("settings", "files", "policies"):
        if key not in record["digests"]:
            raise checks.missing(f"digests.{key}", f"of {path}")
    with checks.within(path):
        settings = EvaluationSettings.checked(record["settings"])
    texts = {name: _text(directory / name) for name in (FIGURE_FILE, EPISODE_FILE)}
    rows = _rows(directory / EPISODE_FILE, texts[EPISODE_FILE], ("seed", *COLUMNS))
    for row in rows:
        if not (np.isfinite(row["seed"]) and row["success"] in (0.0, 1.0) and row["fallen"] in (0.0, 1.0)):
            given = {name: row[name] for name in ("seed", "success", "fallen")}
            raise checks.refuse(f"{directory / EPISODE_FILE}: {row['place']}", given, "a seed, and 0 or 1")
    labels = {name: np.array([row["place"][k] for row in rows], dtype=object) for k, name in enumerate(Place._fields)}
    seeds = {"seed": np.array([int(row["seed"]) for row in rows]), "training_seed": np.full(len(rows), -1)}
    metrics = {name: np.array([row[name] for row in rows]) for name in COLUMNS}
    figures = _rows(directory / FIGURE_FILE, texts[FIGURE_FILE], ("value",))
    return Published(
        directory,
        record,
        settings,
        Table({**labels, **seeds, **metrics}),
        {(row["place"], row["figure"]): row["value"] for row in figures},
        {name: digest(text) for name, text in texts.items()},
    )


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode()
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or an invalid file name
        raise checks.refuse(str(path), reason(error), "a readable file of published results") from None


def _rows(path: Path, text: str, numbers: tuple[str, ...]) -> list[dict[str, Any]]:
    """Return the rows of a CSV file with their place; ``numbers`` are floats, nan if empty."""
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    rows: list[dict[str, Any]] = []
    try:
        known = (*(reader.fieldnames or ()), *OPTIONAL)
        absent = [name for name in (*Place._fields, *numbers) if name not in known]
        if absent:
            raise checks.missing(", ".join(absent), f"columns of {path}")
        for row in reader:
            field = f"{path}, line {reader.line_num}"
            if None in row or None in row.values():
                raise checks.refuse(field, len(row) - 1, f"{len(reader.fieldnames or ())} cells")
            checks.choice(f"{field}: study", row["study"], (REPORT, EFFECTS))
            # csv_text puts an apostrophe before names that a spreadsheet would read as a formula.
            place = Place(*(row[name].removeprefix("'") for name in Place._fields))
            found: dict[str, Any] = {**row, "place": place}
            for name in numbers:
                try:
                    found[name] = float(row[name]) if row.get(name) else float("nan")
                except ValueError:
                    raise checks.refuse(f"{field}: {name}", row[name], "a number, or empty") from None
            rows.append(found)
    except csv.Error as error:
        raise checks.refuse(str(path), str(error), "comma-separated values") from None
    if not rows:
        raise checks.refuse(str(path), "no rows", "a table with at least one row")
    return rows


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
    found = _results(path)
    with checks.within(config):
        written = written_settings(settings)
        main_runs(EvaluationSettings.checked(written))
        effects_runs(settings)
    wanted = json.loads(canonical(settings.as_written()))
    apart = [each for each in settings_apart(wanted, found["settings"]) if each != "output"]
    if apart:
        raise checks.refuse(str(path), f"one with other settings ({', '.join(apart)})", f"a run of {config}")
    table = _episodes(path, found)
    episodes = table.records((*Place._fields, "seed", *COLUMNS))
    short = [{name: _short(value) for name, value in row.items()} for row in episodes]
    files = {
        FIGURE_FILE: csv_text(figure_rows(table, settings.confidence, settings.resamples)),
        EPISODE_FILE: csv_text(short),
    }
    record = {
        "format": FORMAT,
        "version": VERSION,
        "config": portable(config.as_posix()),
        **{key: found[key] for key in ("time", "commit", "machine", "versions")},
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


def _results(path: Path) -> dict[str, Any]:
    """Return the content of results.json."""
    try:
        found = json.loads(path.read_bytes())
    except OSError as error:
        raise checks.refuse(str(path), reason(error), "the results of an evaluation that has been run") from None
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the results of an evaluation") from None
    needed = {"time", "commit", "machine", "versions", "policy_files", "settings", "episodes"}
    absent = sorted(needed - set(found)) if isinstance(found, dict) else sorted(needed)
    if absent:
        raise checks.missing(", ".join(absent), f"of {path}")
    return found


def _episodes(path: Path, found: dict[str, Any]) -> Table:
    """Return the rounded table of all episodes in results.json."""
    effects = found.get("effects", {"task": "", "episodes": []})
    try:
        rows = [{"study": REPORT, **row} for row in found["episodes"]]
        rows += [
            {"study": EFFECTS, "task": effects["task"], "hardware": row["case"], **row} for row in effects["episodes"]
        ]
        nan = float("nan")
        metrics = {
            name: np.array([nan if row.get(name) is None else float(row[name]) for row in rows]) for name in METRICS
        }
        labels = {name: np.array([row[name] for row in rows], dtype=object) for name in Place._fields}
        return rounded(Table({**labels, "seed": np.array([int(row["seed"]) for row in rows]), **metrics}))
    except (KeyError, TypeError, ValueError) as error:
        raise checks.refuse(f"{path}: episodes", repr(error), "the episodes of an evaluation") from None
