"""From the files of an evaluation to published results."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from agents.evaluation.jobs import effects_jobs, trials
from agents.evaluation.settings import EvaluationSettings, load_settings, settings_from
from agents.evaluation.verification.differences import settings_apart
from agents.evaluation.verification.published import (
    EPISODE_FILE,
    FIGURE_FILE,
    FORMAT,
    RECORD,
    VERSION,
    canonical,
    written_settings,
)
from agents.evaluation.verification.published_figures import COLUMNS, EFFECTS, REPORT, EpisodeTable, Place, figure_rows
from agents.locks import one_run
from agents.provenance import digest, portable
from vibgym import checks
from vibgym.files import csv_text, output_directory, output_files, reason, write_together

RESULTS = "results.json"


def publish(config: Path, run: Path | None, directory: Path) -> Path:
    """Publish what ``python -m agents evaluate CONFIG`` has found: figures, episodes, and a record with versions and digests.

    Args:
        config: of the evaluation. Its name is published, too: verifying tells whether the file still asks for the same.
        run: directory of the evaluation's files; None: the ``output`` of the settings.
        directory: where they go, all three files or none.

    Returns:
        The record's path.

    Raises:
        ValueError: no evaluation of these settings stands there, or one of policies that no file can say; nothing is written.
        WriteError: a file could not be written; then none is new.
    """
    settings = load_settings(config)
    path = (Path(settings.output) if run is None else run) / RESULTS
    found = _results(path)
    with checks.within(config):
        written = written_settings(settings)
        trials(settings_from(written))
        effects_jobs(settings)
    wanted, ran = _comparable(settings), {key: value for key, value in found["settings"].items() if key != "output"}
    apart = settings_apart(wanted, ran)
    if apart:
        raise checks.refuse(str(path), f"a run with other settings ({', '.join(apart)})", f"a run of {config}")
    episodes = _episodes(path, found)
    files = {
        FIGURE_FILE: csv_text(figure_rows(episodes, settings.confidence, settings.resamples)),
        EPISODE_FILE: csv_text([row for place, those in episodes.items() for row in _rows(place, those)]),
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
        **({"cost_per_period": found["cost_per_period"]} if "cost_per_period" in found else {}),
    }
    contents = {directory / name: text for name, text in files.items()}
    output_directory(directory, "--output")
    output_files([*contents, directory / RECORD], "--output")
    with one_run(directory, "--output"):
        write_together({**contents, directory / RECORD: json.dumps(record, indent=1, allow_nan=False) + "\n"})
    return directory / RECORD


def _comparable(settings: EvaluationSettings) -> dict[str, Any]:
    """Settings as results.json has them, but for where they were written to."""
    return {key: value for key, value in json.loads(canonical(settings.as_written())).items() if key != "output"}


def _results(path: Path) -> dict[str, Any]:
    """What results.json says."""
    try:
        found = json.loads(path.read_bytes())
    except OSError as error:
        raise checks.refuse(str(path), reason(error), "the results of an evaluation that has been run") from None
    except (ValueError, RecursionError) as error:
        raise checks.refuse(str(path), f"not JSON ({error})", "the results of an evaluation") from None
    needed = {"time", "commit", "machine", "versions", "policy_files", "settings", "episodes"}
    if not isinstance(found, dict) or not needed <= set(found):
        missing = sorted(needed - set(found)) if isinstance(found, dict) else "all"
        raise checks.refuse(str(path), f"nothing on {missing}", "the results of an evaluation by this version")
    return found


def _episodes(path: Path, found: dict[str, Any]) -> dict[Place, EpisodeTable]:
    """All episodes by their places."""
    effects = found.get("effects", {"task": "", "episodes": []})
    rows: dict[Place, list[dict[str, Any]]] = {}
    try:
        for row in found["episodes"]:
            rows.setdefault(Place(REPORT, row["task"], row["hardware"], row["policy"]), []).append(row)
        for row in effects["episodes"]:
            rows.setdefault(Place(EFFECTS, effects["task"], row["case"], row["policy"]), []).append(row)
        return {place: EpisodeTable.of(those) for place, those in rows.items()}
    except (KeyError, TypeError, ValueError) as error:
        raise checks.refuse(f"{path}: episodes", repr(error), "the episodes of an evaluation") from None


def _rows(place: Place, episodes: EpisodeTable) -> list[dict[str, Any]]:
    """One mapping per episode, whole numbers without a decimal point."""
    columns = [episodes.columns[name].tolist() for name in COLUMNS]
    return [
        place._asdict() | {"seed": seed} | dict(zip(COLUMNS, map(_short, values), strict=True))
        for seed, *values in zip(episodes.seeds, *columns, strict=True)
    ]


def _short(value: float) -> float | int:
    return int(value) if value.is_integer() else value
