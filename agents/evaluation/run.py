"""Cases, the table of their episodes, and what is recorded of them: an interrupted run continues, see :func:`play`."""

from __future__ import annotations

import inspect
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
import pandas as pd
from tqdm import tqdm

from agents import parallel
from agents.evaluation import plots
from agents.evaluation.films import FILE, PAGE, Rollout, film_gif
from agents.evaluation.table import RECORDED, REPORT, Place, frame, where
from agents.provenance import digest, policy_files, policy_sources, provenance
from vibgym import checks
from vibgym.envs.vector import environment_id
from vibgym.files import write_together
from vibgym.imports import user_modules
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import Ends, rollout
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.catalogue import shipped_agents
from vibgym.rendering import Scenery

KEPT = "episodes"
"""Folder of recorded episodes in the output directory."""

LEARNED, BY_TASK = "learned", "by_task"
"""Policies: read from the shipped files; one for each task."""

PLOT, FILM, GIF = "png", "gif", "film.gif"
"""Pictures of a case, and the ends of their files: paths and errors, a film for a page, a large film."""


class Played(NamedTuple):
    """Episodes of one case, and its pictures by the ends of their files."""

    episodes: pd.DataFrame
    pictures: dict[str, bytes]


@dataclass(frozen=True)
class Case:
    """Episodes of one policy on one task and hardware.

    Attributes:
        place: labels in the table.
        training_seed: of the policy, if it was trained several times.
        task: environment; in a study it may differ from the label.
        info: public information on the task.
        seeds: of the episodes.
        environment: arguments other than action and observation.
        content: argument of :func:`vibgym.policies.registry.make_policy`.
        origin: digest of code that determines the episodes, see :data:`agents.evaluation.plan.PACKAGES`.
        recorder: what is recorded, see :func:`vibgym.policies.rollout.rollout`.
        pictures: among :data:`PLOT`, :data:`FILM` and :data:`GIF`, of a case with the recorder :class:`.films.Log`.
        scenery: of pictures.
        policy: None until :meth:`made`, and in transfer to a worker process.
        line: of the progress bar; 0 for cases in this process.
    """

    place: Place
    training_seed: int | None
    task: str
    info: TaskInfo
    seeds: list[int]
    environment: dict[str, Any]
    content: Any
    origin: str = ""
    recorder: type[Ends] = Measures
    pictures: tuple[str, ...] = ()
    scenery: Scenery | None = None
    policy: Policy | None = None
    line: int = 0

    def made(self) -> Case:
        """Return the case with its policy."""
        return replace(self, policy=make_policy(self.content, self.info, self.seeds[0]))

    def play(self, quiet: bool) -> Played:
        """Play the episodes and draw the pictures."""
        bar = tqdm(
            total=len(self.seeds),
            desc=f"{self.task:>9} {self.place.policy:<12}",
            unit="ep",
            disable=quiet,
            position=self.line,
            leave=not self.line,
        )
        with bar:
            policy = self.policy or self.made().policy
            arguments = {"seeds": self.seeds, "keep": self.recorder, "progress": bar.update}
            result = rollout(policy, self.task, **arguments, **self.environment)
        return Played(frame(result), {name: self._picture(name, result) for name in self.pictures})

    def _picture(self, name: str, result: Rollout) -> bytes:
        assert self.scenery is not None
        if name == PLOT:
            return plots.trajectories(result, self.info, self.scenery)
        return film_gif(result.film, self.scenery, result.step_time, PAGE if name == FILM else FILE)

    def labelled(self, episodes: pd.DataFrame) -> pd.DataFrame:
        """Return the rows of the table of episodes."""
        limit = (self.info.step_limit or 0) * self.info.step_time
        seed = -1 if self.training_seed is None else self.training_seed
        labels = self.place._asdict() | {"training_seed": seed, "limit_s": limit}
        return pd.concat([pd.DataFrame(labels, index=episodes.index), episodes], axis=1)

    @property
    def plain(self) -> bool:
        """Whether a worker process can play it: the policy is plain data, and workers can make the environment."""
        spec = gym.registry.get(environment_id(self.task))
        custom = spec is None or spec.namespace != "vibgym"
        plain = isinstance(self.content, str) or (isinstance(self.content, Mapping) and "policy" not in self.content)
        return plain and (not custom or bool(user_modules()))

    @property
    def order(self) -> tuple[bool, int]:
        """Sort key: tasks for one part first (each kernel is compiled once), then the longest."""
        parts = len(self.info.parts)
        return parts > 1, -len(self.seeds) * parts * (self.info.step_limit or 1)

    def file(self, folder: Path | None) -> Path | None:
        """Return the file of its recorded episodes: its name is a digest of the case, of code and of all files that the policy
        reads. None for a policy that is an object, whose code and files are not known."""
        if folder is None or not self.plain:
            return None
        task, content = self.info.name, self.content
        if isinstance(content, Mapping) and content.get("kind") == BY_TASK:
            content = content.get(task)
        texts, files = policy_sources(content, task)
        if LEARNED in texts:
            for agent in shipped_agents():
                if task in agent.tasks:
                    read = policy_sources(str(agent.path), task)[1]
                    files |= {Path(path).name: its_digest for path, its_digest in read.items()}
        values = [
            self.place, self.training_seed, self.task, self.environment, self.seeds, content, self.origin,
            self.recorder.__name__, self.pictures, files,
        ]  # fmt: skip
        return folder / f"{digest(json.dumps(values, sort_keys=True, default=repr))[:24]}.csv"

    def recorded(self, path: Path | None) -> Played | None:
        """Return recorded episodes, None if there are none; raise ValueError for a file of anything else."""
        if path is None or not path.exists():
            return None
        try:
            texts = pd.read_csv(path, dtype=str)  # pandas' own parser of numbers was not always exact
            episodes = texts.astype({name: np.int64 if name == "seed" else np.float64 for name in RECORDED})
            known = tuple(episodes) == RECORDED and bool(np.isin(episodes["success"], (0.0, 1.0)).all())
            if known and episodes["seed"].tolist() == self.seeds:
                pictures = {name: path.with_suffix(f".{name}").read_bytes() for name in self.pictures}
                return Played(episodes, pictures)
        except (OSError, ValueError, KeyError, TypeError):
            pass
        raise checks.refuse("recorded episodes", str(path), "those of this run; without the file they are played again")


def play(case: Case, folder: Path | None, quiet: bool) -> Played:
    """Return a case's episodes: recorded ones if code and files are the same, else played now, and recorded."""
    path = case.file(folder)
    if (kept := case.recorded(path)) is not None:
        return kept
    played = case.play(quiet)
    # A file of the policy that changed meanwhile: it is not known which content was played.
    if path is not None and path == case.file(folder):
        path.parent.mkdir(parents=True, exist_ok=True)
        pictures = {path.with_suffix(f".{name}"): data for name, data in played.pictures.items()}
        write_together({**pictures, path: played.episodes.to_csv(index=False)})
    return played


def play_all(
    cases: Sequence[Case], folder: Path | None = None, processes: int = 1, ray: str | None = None, quiet: bool = False
) -> list[Played]:
    """Play cases in parallel, in order.

    Args:
        cases: those whose policy is an object are played in this process.
        folder: of recorded episodes; None: nothing is recorded.
        processes: worker processes on this host.
        ray: address of a Ray cluster, or None.
        quiet: no progress bars.

    Raises:
        ValueError: a file of recorded episodes that is none; nothing is played.
    """
    all_played = [case.recorded(case.file(folder)) for case in cases]
    todo = [k for k, played in enumerate(all_played) if played is None]
    workers = parallel.usable(processes)
    alone = ray is None and workers == 1
    elsewhere = [] if alone else sorted((k for k in todo if cases[k].plain), key=lambda k: cases[k].order)
    for k in todo:
        if k not in elsewhere:
            all_played[k] = play(cases[k], folder, quiet)
    items = [
        (replace(cases[k], policy=None, line=n % workers + 1), folder, quiet or ray is not None)
        for n, k in enumerate(elsewhere)
    ]
    with tqdm(total=len(items), desc="running policies", unit="run", disable=quiet or alone) as bar:
        results = parallel.run(play, items, workers=processes, ray=ray, done=bar.update)
    for k, played in zip(elsewhere, results, strict=True):
        all_played[k] = played
    return all_played  # type: ignore[return-value]


def run(cases: Sequence[Case], **options: Any) -> pd.DataFrame:
    """Return the table of the episodes of cases, see :mod:`.table`; ``options`` are those of :func:`play_all`."""
    return joined(cases, play_all(cases, **options))


def joined(cases: Sequence[Case], played: Sequence[Played]) -> pd.DataFrame:
    """Return the table of episodes."""
    rows = [case.labelled(result.episodes) for case, result in zip(cases, played, strict=True)]
    return pd.concat(rows, ignore_index=True)


@dataclass(frozen=True)
class Prepared:
    """Checked settings and their cases.

    Attributes:
        tasks: public information by task, on the settings' own environment.
        cases: with policies.
        code: digest of the code that determines episodes, see :data:`agents.evaluation.plan.PACKAGES`.
        refused: place -> why the policy cannot run there, where that is no error.
        curves: (task, policy) -> training seed -> learning curve.
    """

    settings: Any
    tasks: dict[str, TaskInfo]
    cases: tuple[Case, ...]
    code: str
    refused: dict[Place, str] = field(default_factory=dict)
    curves: dict[tuple[str, str], dict[int | None, pd.DataFrame]] = field(default_factory=dict)


@dataclass(frozen=True, kw_only=True)
class Results(Prepared):
    """Prepared cases, the table of their episodes, and pictures by place."""

    episodes: pd.DataFrame
    pictures: dict[Place, dict[str, bytes]]
    provenance: dict[str, Any]

    @property
    def main(self) -> pd.DataFrame:
        """Episodes without those of studies."""
        return where(self.episodes, study=REPORT)

    def hardware_of(self, task: str | None = None) -> list[str]:
        """Return the hardware models that the task (or any) ran on, in the order of the settings."""
        ran = {
            case.place.hardware for case in self.cases if case.place.study == REPORT and task in (None, case.place.task)
        }
        return [name for name in self.settings.machines() if name in ran]

    def policies(self) -> dict[str, str]:
        """Return the first line of each policy's docstring by name, without markup."""
        texts: dict[str, str] = {}
        for case in self.cases:
            text = (inspect.getdoc(case.policy) or "").partition("\n")[0].replace("`", "").replace('"', "")
            texts.setdefault(case.place.policy, text)
        return texts


def evaluate(prepared: Prepared, quiet: bool = False, ray: str | None = None) -> Results:
    """Play all cases, or the rest of them, see :func:`play_all`. Writes nothing but recorded episodes."""
    cases, settings = prepared.cases, prepared.settings
    # Before the runs: files may change meanwhile.
    files = policy_files((case.content, case.info.name) for case in cases)
    origin = provenance() | {"code": prepared.code, "policy_files": files}
    played = play_all(cases, Path(settings.output) / KEPT, settings.processes, ray, quiet)
    pictures = {case.place: result.pictures for case, result in zip(cases, played, strict=True)}
    return Results(**vars(prepared), episodes=joined(cases, played), pictures=pictures, provenance=origin)
