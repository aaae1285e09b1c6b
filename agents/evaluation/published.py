"""Published results: ``python -m agents publish CONFIG`` writes figures.csv, episodes.csv and report.json."""

from __future__ import annotations

import csv
import io
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from agents.evaluation.run import effects_cases, main_cases
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.table import EFFECTS, METRICS, OWN, PLACE, QUANTITIES, REPORT, Place, places, records, values
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

    @property
    def last_seed(self) -> int:
        """Largest seed."""
        return int(values(self.episodes, "seed").max())


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
    kept = {key: value for key, value in settings.as_written().items() if key not in LEFT_OUT}
    policies = []
    for entry in settings.entries():
        content, field = entry.content, f"evaluation.policies ({entry.name})"
        if isinstance(content, str):
            content = {"kind": "trained", "path": content} if content.endswith(".json") else {"kind": content}
        if not isinstance(content, Mapping) or "policy" in content:
            raise checks.refuse(field, entry.content, "plain data, so that it can be published")
        path = content.get("path")
        if isinstance(path, str) and Path(path).is_absolute() and not Path(path).is_relative_to(Path.cwd()):
            raise checks.refuse(f"{field}.path", path, f"a path below {Path.cwd()}, which others have")
        policies.append({**portable(content), "name": entry.name, **entry.own})
    try:
        return json.loads(json.dumps({**kept, "policies": policies}, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise checks.refuse("evaluation", str(error), "plain data, so that it can be published") from None


def canonical(values: Any) -> str:
    """Return one text for equal JSON values."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"))


def settings_apart(one: Mapping[str, Any], other: Mapping[str, Any]) -> list[str]:
    """Return the names of settings that differ; of policies also their names."""
    named = []
    for key in {**one, **other}:
        if one.get(key) != other.get(key):
            named.append(key)
            if key == "policies":
                first, second = (_by_name(each.get(key)) for each in (one, other))
                apart = [name for name in {**first, **second} if first.get(name) != second.get(name)]
                named[-1] = f"policies ({', '.join(apart) or 'their order'})"
    return named


def _by_name(policies: Any) -> Mapping[str, Any]:
    return policies if isinstance(policies, Mapping) else {each["name"]: each for each in policies or ()}


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
    texts = {name: _text(directory / name) for name in (FIGURE_FILE, EPISODE_FILE)}
    path = directory / EPISODE_FILE
    episodes = _columns(path, texts[EPISODE_FILE], ("seed", *COLUMNS))
    good = episodes["success"].isin((0.0, 1.0)) & episodes["fallen"].isin((0.0, 1.0))
    wrong = np.flatnonzero(~(good & (episodes["seed"] >= 0) & (episodes["seed"] < 2**63)))
    if len(wrong):
        given = {name: float(episodes[name].iloc[wrong[0]]) for name in ("seed", "success", "fallen")}
        raise checks.refuse(f"{path}, line {wrong[0] + 2}", given, "a seed, and 0 or 1")
    episodes = episodes.assign(seed=episodes["seed"].astype(int), training_seed=-1)
    figures = _columns(directory / FIGURE_FILE, texts[FIGURE_FILE], ("value",), ("figure",))
    stated = {(Place(*row[:4]), row[4]): row[5] for row in figures.itertuples(index=False)}
    return Published(
        directory, record, settings, episodes, stated, {name: digest(text) for name, text in texts.items()}
    )


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode()
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, or an invalid file name
        raise checks.refuse(str(path), reason(error), "a readable file of an evaluation") from None


def _record(path: Path, needed: Sequence[str]) -> dict[str, Any]:
    """Return the content of a JSON file with at least the keys ``needed``."""
    text = _text(path)
    try:
        found = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the results of an evaluation") from None
    absent = [name for name in needed if not isinstance(found, dict) or name not in found]
    if absent:
        raise checks.missing(", ".join(absent), f"of {path}")
    return found


def _columns(path: Path, text: str, numbers: Sequence[str], texts: Sequence[str] = ()) -> pd.DataFrame:
    """Return labels of places, ``texts`` and ``numbers`` (float64, nan if empty) of a CSV file, in this order."""
    try:
        heads, *rows = csv.reader(io.StringIO(text, newline=""), strict=True)
    except (csv.Error, ValueError) as error:
        raise checks.refuse(str(path), str(error), "comma-separated values") from None
    for line, row in enumerate(rows, 2):
        if len(row) != len(heads):
            raise checks.refuse(f"{path}, line {line}", len(row), f"{len(heads)} cells")
    found = pd.DataFrame(rows, columns=heads)
    labels = (*PLACE, *texts)
    absent = [name for name in (*labels, *numbers) if name not in (*found.columns, *OPTIONAL)]
    if absent or found.empty:
        raise checks.missing(", ".join(absent) or "rows", f"of {path}")

    def number(line: int, name: str, cell: str) -> float:
        try:
            return float(cell or "nan")
        except ValueError:
            raise checks.refuse(f"{path}, line {line}: {name}", cell, "a number, or empty") from None

    columns: dict[str, Any] = {}
    for name in labels:  # csv_text puts an apostrophe before names that a spreadsheet would read as a formula
        columns[name] = found[name].str.removeprefix("'")
    for line, study in enumerate(columns["study"], 2):
        checks.choice(f"{path}, line {line}: study", study, (REPORT, EFFECTS))
    for name in numbers:
        cells = found[name] if name in found else [""] * len(found)
        columns[name] = [number(line, name, cell) for line, cell in enumerate(cells, 2)]
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
        main_cases(EvaluationSettings.stored(written))
        effects_cases(settings)
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
