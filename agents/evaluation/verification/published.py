"""The files of published results: read back whole, or refused in one line."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from agents.evaluation.settings import EvaluationSettings, settings_from
from agents.evaluation.verification.published_figures import (
    COLUMNS,
    EFFECTS,
    OPTIONAL,
    REPORT,
    EpisodeTable,
    Place,
    place_of,
)
from agents.provenance import digest, portable
from vibgym import checks
from vibgym.files import reason

FORMAT, VERSION = "vibgym-published", 1
RECORD, FIGURE_FILE, EPISODE_FILE = "report.json", "figures.csv", "episodes.csv"
LEFT_OUT = ("output", "animations", "cost_per_period", "confidence", "resamples")
"""Settings that change no episode."""


@dataclass(frozen=True)
class Published:
    """Published results.

    Attributes:
        directory: where they stand.
        record: of report.json: provenance, settings, digests.
        settings: what was run.
        episodes: of every policy in every place.
        figures: rows of figures.csv as they stand there: place and name of the figure -> value.
        digests: of the two CSV files as they are now.
    """

    directory: Path
    record: Mapping[str, Any]
    settings: EvaluationSettings
    episodes: dict[Place, EpisodeTable]
    figures: dict[tuple[Place, str], float]
    digests: Mapping[str, str]

    @property
    def last_seed(self) -> int:
        """The largest seed of all."""
        return max(max(those.seeds) for those in self.episodes.values())


def written_settings(settings: EvaluationSettings) -> dict[str, Any]:
    """Those that episodes come from, as JSON values of which :func:`agents.evaluation.settings_from` makes them again.

    Raises:
        ValueError: there are policies among them that are objects, or files that no one else has.
    """
    plain = {key: value for key, value in settings.as_written().items() if key not in LEFT_OUT}
    policies = []
    for entry in settings.entries():
        content = entry.content
        if isinstance(content, str):
            trained = content.endswith(".json")
            content = {"kind": "trained", "path": content} if trained else {"kind": content}
        if not isinstance(content, Mapping) or "policy" in content:
            raise checks.refuse(f"evaluation.policies ({entry.name})", entry.content, "policies that a file can say")
        path = content.get("path")
        if isinstance(path, str) and Path(path).is_absolute() and not Path(path).is_relative_to(Path.cwd()):
            field = f"evaluation.policies ({entry.name}).path"
            raise checks.refuse(field, path, f"a path below {Path.cwd()}: others have no file there")
        policies.append({**portable(content), "name": entry.name, **entry.limits})
    try:
        return json.loads(json.dumps({**plain, "policies": policies}, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise checks.refuse("evaluation", str(error), "settings that a file can say") from None


def canonical(values: Any) -> str:
    """One text for the same JSON values."""
    return json.dumps(values, sort_keys=True, separators=(",", ":"))


def load_published(directory: Path) -> Published:
    """Published results from their directory.

    Raises:
        ValueError: a file is missing, of another format or version, or not whole; names it.
    """
    path = directory / RECORD
    text = _text(path)
    try:
        record = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the record of published results") from None
    kind = {key: record.get(key) for key in ("format", "version")} if isinstance(record, dict) else type(record)
    if kind != {"format": FORMAT, "version": VERSION}:
        raise checks.refuse(str(path), kind, f"format {FORMAT!r}, version {VERSION}")
    for key in ("settings", "digests", "versions"):
        if not isinstance(record.get(key), dict):
            raise checks.refuse(f"{path}: {key}", record.get(key), "a mapping")
    for key in ("settings", "files", "policies"):
        if key not in record["digests"]:
            raise checks.refuse(f"{path}: digests", list(record["digests"]), "'settings', 'files' and 'policies'")
    with checks.within(path):
        settings = settings_from(record["settings"])
    texts = {name: _text(directory / name) for name in (FIGURE_FILE, EPISODE_FILE)}
    episodes = _episodes(directory / EPISODE_FILE, texts[EPISODE_FILE])
    return Published(
        directory,
        record,
        settings,
        episodes,
        _figures(directory / FIGURE_FILE, texts[FIGURE_FILE]),
        {name: digest(text) for name, text in texts.items()},
    )


def _text(path: Path) -> str:
    try:
        return path.read_bytes().decode()
    except (OSError, ValueError) as error:  # ValueError: no text, or a name that no file has
        raise checks.refuse(str(path), reason(error), "a readable file of published results") from None


def _rows(path: Path, text: str, numbers: tuple[str, ...]) -> list[dict[str, Any]]:
    """Rows of a CSV file with a place in front; ``numbers`` as float, nan where nothing stands."""
    reader = csv.DictReader(io.StringIO(text, newline=""), strict=True)
    wanted = (*Place._fields, *numbers)
    rows: list[dict[str, Any]] = []
    try:
        missing = [name for name in wanted if name not in (*(reader.fieldnames or ()), *OPTIONAL)]
        if missing:
            raise checks.refuse(f"{path}: columns", reader.fieldnames, f"also {', '.join(missing)}")
        for row in reader:
            field = f"{path}, line {reader.line_num}"
            if None in row or None in row.values():
                raise checks.refuse(field, len(row) - 1, f"{len(reader.fieldnames or ())} cells")
            checks.choice(f"{field}: study", row["study"], (REPORT, EFFECTS))
            found: dict[str, Any] = {**row, "place": place_of(row)}
            for name in numbers:
                try:
                    found[name] = float(row[name]) if row.get(name) else float("nan")
                except ValueError:
                    raise checks.refuse(f"{field}: {name}", row[name], "a number, or nothing") from None
            rows.append(found)
    except csv.Error as error:
        raise checks.refuse(str(path), str(error), "rows of comma-separated values") from None
    if not rows:
        raise checks.refuse(str(path), "no rows", "one at least")
    return rows


def _episodes(path: Path, text: str) -> dict[Place, EpisodeTable]:
    by_place: dict[Place, list[dict[str, Any]]] = {}
    for row in _rows(path, text, ("seed", *COLUMNS)):
        if not (np.isfinite(row["seed"]) and row["success"] in (0.0, 1.0) and row["fallen"] in (0.0, 1.0)):
            given = {name: row[name] for name in ("seed", "success", "fallen")}
            raise checks.refuse(f"{path}: {row['place']}", given, "a seed, and 0 or 1 for success and fallen")
        by_place.setdefault(row["place"], []).append(row)
    return {place: EpisodeTable.of(rows) for place, rows in by_place.items()}


def _figures(path: Path, text: str) -> dict[tuple[Place, str], float]:
    return {(row["place"], row["figure"]): row["value"] for row in _rows(path, text, ("value",))}
