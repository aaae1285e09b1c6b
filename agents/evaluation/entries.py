"""Entries of a suite: ``python -m agents score --entries DIR`` plays and ranks them.

An entry is a folder with ``entry.yaml`` and the files of a policy. ``--enter AUTHORS`` writes one from a policy's file.
"""

from __future__ import annotations

import io
import json
import math
import os
import re
import shutil
import tempfile
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from pydantic import Field
from ruamel.yaml import YAML

from agents.evaluation.entry_process import EntryPolicy, EntryProcess
from agents.evaluation.run import LEARNED, Results
from agents.evaluation.settings import MAX_NAME, PolicyEntry, SuiteSettings
from agents.evaluation.table import markdown, where
from agents.provenance import digest, policy_sources
from agents.training_settings import Plain, replaced
from vibgym import checks
from vibgym.config import load_yaml
from vibgym.files import csv_text, output_directory, write_together
from vibgym.policies.task_info import POLICIES
from vibgym.policies.trained.catalogue import SHIPPED, shipped_agents
from vibgym.settings import BaseSettings, read

ENTRIES = Path("entries")
ENTRY = "entry.yaml"
HERE = "{entry}"
"""Text in a policy's settings that stands for the entry's folder."""

SET_ELSEWHERE = ("name", "episodes", "training_steps", "group", "training_seeds", "curve")
"""Keys of a policy in a suite that an entry's policy cannot have."""

MIN_EPISODES = 5
"""Fewest episodes of a task with which a score has an interval. The bootstrap underestimates the variance by a factor of
(n - 1) / n, so that with five the interval is 11 % too narrow, with two 29 %, and with one there is none."""


class EntryFile(BaseSettings):
    """Content of ``entry.yaml``."""

    policy: Plain  # name or mapping, as in a suite's settings
    authors: str = Field(min_length=1, max_length=200)
    description: str = Field(default="", max_length=2000)
    training_steps: int = Field(default=0, ge=0)  # environment steps of all trainings, data of other policies included
    module: str | None = None  # "policy": policy.py in the folder, which registers the policy


@dataclass(frozen=True)
class Entry:
    """A checked entry, by the name of its folder.

    Attributes:
        content: policy, with the folder's path in place of :data:`HERE`.
        training_steps: those that it states, or those that its files state if these are more.
        digest: of all files of the folder.
        process: that runs its code; None without code.
    """

    name: str
    file: EntryFile
    content: Any
    training_steps: int
    digest: str
    process: EntryProcess | None


def load_entries(directory: Path, settings: SuiteSettings, trusted: Collection[str] = ()) -> dict[str, Entry]:
    """Return all entries of a directory by name, of which those ``trusted`` may have code. Runs no code of an entry.

    Raises:
        ValueError: there is none; a bad file, a file outside the folder, too many training steps, or code that is not trusted.
    """
    folders = sorted(path.parent for path in directory.glob(f"*/{ENTRY}"))
    if not folders:
        raise checks.refuse("--entries", str(directory), f"a directory with folders that contain {ENTRY}")
    for name in trusted:
        checks.choice("--trust", name, tuple(folder.name for folder in folders))
    entries = {}
    for folder in folders:
        with checks.within(folder):
            entries[folder.name] = _load(folder, settings, trusted)
    return entries


def _load(folder: Path, settings: SuiteSettings, trusted: Collection[str]) -> Entry:
    _word("name of the entry", folder.name)
    files = _files(folder)
    file = read(EntryFile, load_yaml(folder / ENTRY), "entry")
    content, process = replaced(file.policy, HERE, folder.as_posix()), None
    texts, named = _inside(folder, content, settings.tasks)
    if file.module is not None:
        module = folder / f"{_word('entry.module', file.module)}.py"
        if module not in files:
            raise checks.refuse("entry.module", file.module, f"the name of a Python file in {folder}, without .py")
        if folder.name not in trusted:
            raise checks.conflict(f"{module.name} is code: it runs only with --trust {folder.name}")
        process = EntryProcess(folder.name, module, content)
    if LEARNED in texts:
        named |= {agent.path for agent in shipped_agents() if set(agent.tasks) & set(settings.tasks)}
    steps = max(file.training_steps, _stated_steps({*files, *named}))
    if steps > settings.training_steps:
        raise checks.refuse("entry.training_steps", steps, f"at most {settings.training_steps}, the suite's budget")
    contents = {path.relative_to(folder).as_posix(): digest(path.read_bytes()) for path in files}
    return Entry(folder.name, file, content, steps, digest(json.dumps(contents)), process)


def _word(field: str, value: str) -> str:
    """Return a name that is safe as that of a file."""
    if not re.fullmatch("[A-Za-z0-9_-]+", value) or len(value) > MAX_NAME:
        raise checks.refuse(field, value, f"at most {MAX_NAME} letters, digits, '-' and '_'")
    return value


def _files(folder: Path) -> list[Path]:
    """Return all files of a folder, hidden ones included; raise ValueError if it contains anything but files and folders."""
    paths = sorted(folder.rglob("*"))
    for path in (folder, *paths):
        if path.is_symlink() or not (path.is_file() or path.is_dir()):
            raise checks.refuse("file of the entry", str(path), "a file or folder, no link and no device")
    return [path for path in paths if path.is_file()]


def _inside(folder: Path, content: Any, tasks: Sequence[str]) -> tuple[set[str], set[Path]]:
    """Return the texts and the files of an entry's policy for all tasks.

    Raises:
        ValueError: a file that is neither in the folder nor shipped, or a key of :data:`SET_ELSEWHERE`.
    """
    for key in SET_ELSEWHERE:
        if isinstance(content, Mapping) and key in content:
            raise checks.conflict(f"entry.policy.{key} cannot be set")
    texts: set[str] = set()
    files: set[Path] = set()
    places = [Path(os.path.realpath(place)) for place in (folder, SHIPPED)]
    for task in tasks:
        named, sources = policy_sources(content, task)
        for name in sorted({*sources, *(text for text in named if "/" in text or os.sep in text)} - set(POLICIES)):
            if not any(Path(os.path.realpath(name)).is_relative_to(place) for place in places):
                raise checks.refuse("file of entry.policy", name, f"in the entry's folder, as '{HERE}/NAME'")
        texts |= named
        files |= {Path(name) for name in sources}
    return texts, files


def _stated_steps(files: Iterable[Path]) -> int:
    """Return the environment steps that trained policies state, with those of their data, in total."""
    total = 0
    for path in {Path(os.path.realpath(path)) for path in files}:
        try:
            training = json.loads(path.read_bytes())["training"]
            steps = training["steps"], training.get("data", {}).get("steps", 0)
        except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
            continue  # not a trained policy
        total += sum(checks.count(f"training.steps of {path.name}", number, least=0) for number in steps)
    return total


def entered(settings: SuiteSettings, entries: Mapping[str, Entry]) -> SuiteSettings:
    """Return a suite whose policies are the entries."""
    return settings.with_policies([
        {**(entry.content if isinstance(entry.content, Mapping) else {"kind": entry.content}), "name": name}
        for name, entry in entries.items()
    ])  # fmt: skip


def without_failures(results: Results) -> Results:
    """Return results in which an entry does not serve the tasks where its code failed."""
    failed = {
        case.place: case.policy.failure
        for case in results.cases
        if isinstance(case.policy, EntryPolicy) and case.policy.failure is not None
    }
    episodes = results.episodes
    for place in failed:
        episodes = episodes.drop(where(episodes, **place._asdict()).index)
    return replace(results, episodes=episodes, refused={**results.refused, **failed})


def write(
    entries: Mapping[str, Entry],
    results: Results,
    rows: Sequence[Mapping[str, Any]],
    totals: Sequence[Mapping[str, Any]],
    protocol: SuiteSettings,
) -> tuple[str, Path]:
    """Write ``ranking.csv`` and ``ranking.md``; return the text and the path of the latter.

    Args:
        entries, results: entries by name, and the results of all.
        rows, totals: see :func:`agents.evaluation.score.rows`.
        protocol: the suite with all its episodes.
    """
    ranked = []
    for total in totals:
        entry = entries[total["policy"]]
        mine = [row for row in rows if all(row[name] == total[name] for name in ("hardware", "policy"))]
        enough = all(row["episodes"] >= MIN_EPISODES for row in mine if row["served"])
        ranked.append({
            "hardware": total["hardware"],
            "entry": entry.name,
            "authors": entry.file.authors,
            "score": total["score"],
            **{f"score_{end}": total[f"score_{end}"] if enough else math.nan for end in ("low", "high")},
            "training_steps": entry.training_steps,
            "episodes": sum(row["episodes"] for row in mine),
            "sha256": entry.digest,
            **{row["task"]: row["score"] for row in mine},
        })  # fmt: skip
    order = list(results.settings.machines())
    ranked.sort(key=lambda row: (order.index(row["hardware"]), -row["score"]))
    heads, lines = ("hardware", "entry", "score", "training steps", "episodes"), []
    for row in ranked:
        low, high = row["score_low"], row["score_high"]
        between = "(no interval)" if math.isnan(low) else f"({low:.3f} to {high:.3f})"
        steps = f"{row['training_steps']:,}".replace(",", " ")
        lines.append([row["hardware"], row["entry"], f"{row['score']:.3f} {between}", steps, str(row["episodes"])])
    played, whole = _episodes(results.settings), _episodes(protocol)
    more = "." if played == whole else f"; the protocol has {whole}."
    unserved = [
        f"- {place.policy}, {place.task}, {place.hardware}: scores 0 ({why})" for place, why in results.refused.items()
    ]
    parts = markdown(heads, lines), f"Episodes of each task: {played}{more}", "\n".join(unserved)
    text = "\n\n".join(part for part in parts if part)
    directory = output_directory(Path(results.settings.output), "--output")
    page = directory / "ranking.md"
    write_together({directory / "ranking.csv": csv_text(ranked), page: f"{text}\n"})
    return text, page


def _episodes(settings: SuiteSettings) -> str:
    """Return the numbers of episodes of all tasks: "2", or "50 to 200"."""
    machines = settings.machines().values()
    numbers = {len(settings.seed_list(task, machine.episodes)) for task in settings.tasks for machine in machines}
    return " to ".join(str(number) for number in sorted({min(numbers), max(numbers)}))


def enter(entry: PolicyEntry, source: Path, authors: str, settings: SuiteSettings) -> Path:
    """Write an entry from the file of its policy; return its folder. A trained policy is copied with its tensors.

    Raises:
        ValueError: see :func:`new_folder` and :func:`load_entries`.
    """
    content, folder = entry.content, new_folder(entry, source, settings)
    ENTRIES.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(prefix=".entry-", dir=ENTRIES) as place:
        made = Path(place) / folder.name
        made.mkdir()
        if _trained(entry, source):
            for path in policy_sources(str(source), "")[1]:
                shutil.copy(path, made / Path(path).name)
            content = {"kind": "trained", "path": f"{HERE}/{source.name}"}
        plain = {"policy": content, "training_steps": entry.training_steps or 0, "authors": authors}
        text = io.StringIO()
        YAML().dump(json.loads(json.dumps(plain)), text)
        write_together({made / ENTRY: text.getvalue()})
        _load(made, settings, ())
        made.rename(folder)
    return folder


def new_folder(entry: PolicyEntry, source: Path, settings: SuiteSettings) -> Path:
    """Return the folder of a new entry in :data:`ENTRIES`.

    Raises:
        ValueError: it exists, a bad name, or files of the policy that would be outside.
    """
    folder = ENTRIES / _word("name of the entry", entry.name)
    if folder.exists():
        raise checks.refuse("--enter", entry.name, f"the name of a folder that does not exist yet in {ENTRIES}")
    if not _trained(entry, source):
        with checks.within(source):
            _inside(folder, entry.content, settings.tasks)
    return folder


def _trained(entry: PolicyEntry, source: Path) -> bool:
    """Return whether a policy's file is that of a trained policy."""
    return entry.content == {"kind": "trained", "path": str(source)}
