"""Verified entries of a suite: ``python -m agents score --entries DIR`` checks, plays and ranks them.

An entry is a folder with ``entry.yaml`` (policy, budget of training, digests of all files that it uses), these files, and
``episodes.csv``, the scores that it claims for each episode. ``--enter AUTHORS`` writes one from a scored policy.
"""

from __future__ import annotations

import csv
import io
import json
import math
import shutil
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import Field
from ruamel.yaml import YAML

from agents.evaluation.run import Results
from agents.evaluation.score import LEARNED, SuiteSettings
from agents.evaluation.statistics import suite_interval, suite_score
from agents.evaluation.table import markdown
from agents.provenance import digest, policy_files
from agents.training_settings import Plain
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.files import csv_text, output_directory, write_together
from vibgym.imports import take_part
from vibgym.policies.trained.catalogue import HARDWARE, shipped_agents
from vibgym.settings import BaseSettings, read

ENTRIES = Path("entries")
ENTRY, CLAIMS = "entry.yaml", "episodes.csv"
COLUMNS = ("task", "hardware", "seed", "score")
HERE = "{entry}"
"""Text in a policy's settings that stands for the entry's folder."""

ERRORS, MOST_DIFFERENCE = 3.0, 0.05
"""Standard errors by which the mean of played scores may differ from that of claimed ones, and the most in any case: chaotic
episodes can depend on the processor."""

SAME = 1e-9
"""Difference of two scores that are the same; claims have ten decimals."""


class EntryFile(BaseSettings):
    """Content of ``entry.yaml``."""

    policy: Plain  # name or mapping, as in a suite's settings
    training_steps: int = Field(ge=0)  # environment steps of all trainings, data of other policies included
    authors: str = Field(min_length=1, max_length=200)
    description: str = Field(default="", max_length=2000)
    episodes: int | None = Field(default=None, ge=1)  # at most so many of each task, for slow policies
    imports: tuple[str, ...] = ()  # modules that register the policy, such as entries.mine.policy
    sha256: dict[str, str] = {}  # file -> digest: all files of the folder, and those that the policy is read from


@dataclass(frozen=True)
class Entry:
    """A checked entry.

    Attributes:
        name: of its folder.
        content: policy, with the folder's path in place of :data:`HERE`.
        claims: (task, hardware) -> seed -> score.
    """

    name: str
    file: EntryFile
    content: Any
    claims: dict[tuple[str, str], dict[int, float]]


def load_entries(directory: Path, settings: SuiteSettings) -> list[Entry]:
    """Return all entries of a directory, by name.

    Raises:
        ValueError: there is none; a bad file, a wrong digest, a budget above the suite's, or claims for other episodes.
    """
    folders = sorted(path.parent for path in directory.glob(f"*/{ENTRY}"))
    if not folders:
        raise checks.refuse("--entries", str(directory), f"a directory with folders that contain {ENTRY}")
    return [_load(folder, settings) for folder in folders]


def _load(folder: Path, settings: SuiteSettings) -> Entry:
    with checks.within(folder / ENTRY):
        file = read(EntryFile, load_yaml(folder / ENTRY), "entry")
        if file.training_steps > settings.training_steps:
            most = f"at most {settings.training_steps}, the suite's budget"
            raise checks.refuse("entry.training_steps", file.training_steps, most)
        content = _placed(file.policy, folder)
        found = digests(folder, content, settings.tasks)
        for name in sorted({*found, *file.sha256}):
            if found.get(name) != file.sha256.get(name):
                got = "no such file" if name not in found else f"{found[name]}"
                raise checks.refuse(f"entry.sha256[{name!r}]", file.sha256.get(name, "nothing"), f"its digest: {got}")
        take_part(file.imports, "entry.imports")
    with checks.within(folder / CLAIMS):
        return Entry(folder.name, file, content, _claims(folder / CLAIMS, settings, file.episodes))


def _placed(value: Any, folder: Path) -> Any:
    """Return settings with the folder's path in place of :data:`HERE`."""
    if isinstance(value, str):
        return value.replace(HERE, folder.as_posix())
    if isinstance(value, Mapping):
        return {key: _placed(each, folder) for key, each in value.items()}
    return [_placed(each, folder) for each in value] if isinstance(value, list | tuple) else value


def digests(folder: Path, content: Any, tasks: Sequence[str]) -> dict[str, str]:
    """Return the digests of an entry's files by name: those in its folder, of its policy, and of shipped agents if used."""
    own = (path for path in sorted(folder.rglob("*")) if path.is_file() and path.name not in (ENTRY, CLAIMS))
    found = {path.relative_to(folder).as_posix(): path for path in own if "__pycache__" not in path.parts}
    named = {name: value or "unreadable" for name, value in policy_files((content, task) for task in tasks).items()}
    inside = {(folder / name).as_posix() for name in found}
    named = {name: value for name, value in named.items() if name not in inside}
    if LEARNED in json.dumps(content, default=repr):
        named |= _shipped(tasks)
    return {name: digest(path.read_bytes()) for name, path in found.items()} | named


def _shipped(tasks: Sequence[str]) -> dict[str, str]:
    """Return the digests of the files of the usual shipped agents for these tasks."""
    found: dict[str, str] = {}
    for task in tasks:
        for hardware in HARDWARE:
            mine = [each for each in shipped_agents() if task in each.tasks and each.hardware == hardware]
            if mine:
                agent = min(mine, key=lambda each: (each.variant, each.tasks.index(task)))
                files = policy_files([(str(agent.path), task)])
                found |= {name: value or "unreadable" for name, value in files.items()}
    return found


def _claims(path: Path, settings: SuiteSettings, most: int | None) -> dict[tuple[str, str], dict[int, float]]:
    try:
        text = path.read_text(encoding="utf-8")
        rows = [(row["task"], row["hardware"], int(row["seed"]), float(row["score"])) for row in _rows(text)]
    except (OSError, ValueError, KeyError, TypeError):
        raise checks.refuse("claims", str(path), f"a CSV file with columns {', '.join(COLUMNS)}") from None
    found: dict[tuple[str, str], dict[int, float]] = {}
    for task, hardware, seed, score in rows:
        if not 0.0 <= score <= 1.0:
            raise checks.refuse(f"score of {task}, {hardware}, seed {seed}", score, "a number in [0, 1]")
        if seed in found.setdefault((task, hardware), {}):
            raise checks.conflict(f"{task}, {hardware}: seed {seed} occurs twice")
        found[task, hardware][seed] = score
    limits = {machine.name: machine.episodes for machine in settings.hardware_entries()}
    for (task, hardware), scores in found.items():
        checks.choice("task", task, settings.tasks)
        seeds = settings.seed_list(task, limits[checks.choice("hardware", hardware, tuple(limits))])[:most]
        if list(scores) != seeds:
            raise checks.conflict(f"{task}, {hardware}: seeds must be those of the suite, {seeds[0]} to {seeds[-1]}")
    return found


def _rows(text: str) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(text)))


def entered(settings: SuiteSettings, entries: Sequence[Entry], episodes: int | None) -> SuiteSettings:
    """Return a suite whose policies are the entries.

    Args:
        episodes: at most so many of each task; None: all that are claimed.
    """
    policies = []
    for each in entries:
        content = each.content if isinstance(each.content, Mapping) else {"kind": each.content}
        most = min((n for n in (episodes, each.file.episodes) if n is not None), default=None)
        limit = {} if most is None else {"episodes": most}
        policies.append({**content, "name": each.name, "training_steps": each.file.training_steps, **limit})
    return settings.model_copy(update={"policies": tuple(policies)})


@dataclass(frozen=True)
class Verdict:
    """Comparison of an entry's claims with what was played."""

    name: str
    episodes: int  # played and claimed
    same: int  # of these, with the claimed score
    difference: float  # mean of played minus claimed
    error: float  # standard error of the difference
    missing: int  # played, but not claimed

    @property
    def verified(self) -> bool:
        """Whether the claims agree with what was played."""
        allowed = min(ERRORS * self.error, MOST_DIFFERENCE) + SAME
        return self.missing == 0 and self.episodes > 0 and abs(self.difference) <= allowed


def verify(entry: Entry, results: Results) -> Verdict:
    """Compare the played episodes of an entry with its claims."""
    differences, missing = [], 0
    for (place, _), found in results.rollouts.items():
        if place.policy == entry.name:
            claimed = entry.claims.get((place.task, place.hardware), {})
            for seed, score in zip(found.seeds, results.settings.scores(found).tolist(), strict=True):
                if seed in claimed:
                    differences.append(score - claimed[seed])
                else:
                    missing += 1
    values = np.array(differences) if differences else np.zeros(1)
    error = float(values.std() / math.sqrt(len(values)))
    same = int((np.abs(values) <= SAME).sum()) if differences else 0
    return Verdict(entry.name, len(differences), same, float(values.mean()), error, missing)


def ranking(entries: Sequence[Entry], settings: SuiteSettings, verdicts: Mapping[str, Verdict]) -> list[dict[str, Any]]:
    """Return a row for each entry and hardware by claimed score, the best first; entries that are not verified come last."""
    rows = []
    for entry in entries:
        for hardware in settings.named_hardware():
            claimed = [np.array(list(entry.claims.get((task, hardware), {0: 0.0}).values())) for task in settings.tasks]
            interval = suite_interval(claimed, settings.confidence, settings.resamples)
            verdict = verdicts[entry.name]
            rows.append({
                "hardware": hardware,
                "entry": entry.name,
                "authors": entry.file.authors,
                "score": suite_score(claimed),
                "score_low": math.nan if interval is None else interval.low,
                "score_high": math.nan if interval is None else interval.high,
                "training_steps": entry.file.training_steps,
                "verified": verdict.verified,
                "episodes_played": verdict.episodes,
                "same": verdict.same,
                "difference": verdict.difference,
                **{task: float(each.mean()) for task, each in zip(settings.tasks, claimed, strict=True)},
            })  # fmt: skip
    order = list(settings.named_hardware())
    return sorted(rows, key=lambda row: (order.index(row["hardware"]), not row["verified"], -row["score"]))


def table(rows: Sequence[Mapping[str, Any]]) -> str:
    """Return the ranking in Markdown."""
    heads = ("hardware", "entry", "score", "training steps", "verified", "played again", "the same", "mean difference")
    lines = [
        [
            row["hardware"], row["entry"], f"{row['score']:.3f} ({row['score_low']:.3f} to {row['score_high']:.3f})",
            f"{row['training_steps']:,}".replace(",", " "), "yes" if row["verified"] else "NO", str(row["episodes_played"]),
            str(row["same"]), f"{row['difference']:+.4f}",
        ]
        for row in rows
    ]  # fmt: skip
    return markdown(heads, lines)


def write(rows: Sequence[Mapping[str, Any]], directory: Path) -> Path:
    """Write ``ranking.csv`` and ``ranking.md``; return the path of the latter."""
    directory = output_directory(directory, "--output")
    page = directory / "ranking.md"
    write_together({directory / "ranking.csv": csv_text(rows), page: table(rows) + "\n"})
    return page


def enter(results: Results, name: str, source: Path | None, authors: str) -> Path:
    """Write an entry from the results of one policy; return its folder.

    Args:
        results: of a suite with this policy alone, or among others.
        name: of the entry, and of the policy in the results.
        source: policy file of ``--policy``; the JSON file of a trained policy is copied with its tensors.
        authors: who made it.

    Raises:
        ValueError: the folder exists.
    """
    entry = next(each for each in results.settings.entries() if each.name == name)
    rows: list[dict[str, Any]] = [
        dict(zip(COLUMNS, (place.task, place.hardware, seed, round(score, 10)), strict=True))
        for (place, _), found in results.rollouts.items()
        if place.policy == name
        for seed, score in zip(found.seeds, results.settings.scores(found).tolist(), strict=True)
    ]
    content, folder = entry.content, new_folder(name)
    ENTRIES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".entry-", dir=ENTRIES) as place:
        made = Path(place) / name
        made.mkdir()
        if source is not None and source.suffix == ".json":
            tensors = source.with_name(json.loads(source.read_text(encoding="utf-8"))["tensors"])
            for path in (source, tensors):
                shutil.copy(path, made / path.name)
            content = {"kind": "trained", "path": f"{HERE}/{source.name}"}
        plain = {
            "policy": content, "training_steps": entry.training_steps or 0, "authors": authors,
            **({} if entry.episodes is None else {"episodes": entry.episodes}),
            "sha256": digests(made, _placed(content, made), results.settings.tasks),
        }  # fmt: skip
        text = io.StringIO()
        YAML().dump(json.loads(json.dumps(plain)), text)
        write_together({made / ENTRY: text.getvalue(), made / CLAIMS: csv_text(rows)})
        made.rename(folder)
    return folder


def new_folder(name: str) -> Path:
    """Return the folder of a new entry in :data:`ENTRIES`.

    Raises:
        ValueError: it exists, or a bad name.
    """
    folder = ENTRIES / checks.label("--enter", name)
    if folder.exists():
        raise checks.refuse("--enter", name, f"the name of a folder that does not exist yet in {ENTRIES}")
    return folder
