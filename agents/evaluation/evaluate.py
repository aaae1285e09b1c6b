"""From settings to results to files."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Mapping
from concurrent.futures import Future
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from tqdm import tqdm

import vibgym  # noqa: F401 - registers the environments
from agents.evaluation import animation, cost, report, tables
from agents.evaluation.cost import Cost
from agents.evaluation.processes import side_by_side, usable
from agents.evaluation.provenance import provenance
from agents.evaluation.results import Results, Row, row_of
from agents.evaluation.rollout import Rollout, run
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import compare
from agents.policy import Policy
from agents.registry import CONTROLLERS, make_policy
from agents.task_info import TaskInfo
from vibgym import checks
from vibgym.envs.viewer import scenery_of
from vibgym.files import csv_text, output_directory, output_files, write_together
from vibgym.rendering import Scenery

FILES = ("results.csv", "episodes.csv", "results.json", "report.html")
"""Of an evaluation, beside a film that is asked for."""


@dataclass(frozen=True)
class Gif:
    """Wish for a film of one policy on one task as a GIF file."""

    task: str
    policy: str
    path: Path


@dataclass(frozen=True)
class Evaluation:
    """A checked evaluation: environments and policies exist, the output directory can be written to."""

    settings: EvaluationSettings
    tasks: dict[str, TaskInfo]
    scenery: dict[str, Scenery]  # what pictures of each task show
    policies: dict[tuple[str, str], Policy]  # (task, policy)
    gif: Gif | None


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Evaluation:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    entries = settings.entries()
    tasks: dict[str, TaskInfo] = {}
    scenery: dict[str, Scenery] = {}
    policies: dict[tuple[str, str], Policy] = {}
    for task in settings.tasks:
        with _field("evaluation.environment"):
            env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **settings.environment)
        tasks[task] = info = TaskInfo.of(env, task)
        scenery[task] = scenery_of(env.unwrapped)  # type: ignore[arg-type]
        seed = settings.seed_list(task)[0]
        for entry in entries:
            if entry.tasks is None and not serves(entry.content, info):
                continue
            if entry.tasks is None or task in entry.tasks:
                with _field(f"evaluation.policies ({entry.name} on {task})"):
                    policies[task, entry.name] = make_policy(entry.content, info, seed)
        env.close()
        if not any(each == task for each, _ in policies):
            raise checks.refuse("evaluation.policies", [entry.name for entry in entries], f"one that serves {task}")
    for entry in entries:
        if not any(name == entry.name for _, name in policies):
            raise checks.refuse("evaluation.policies", entry.name, f"policies that serve one of {', '.join(tasks)}")
    if gif is not None:
        checks.choice("--gif TASK", gif.task, tuple(tasks))
        checks.choice("--gif POLICY", gif.policy, tuple(name for task, name in policies if task == gif.task))
        output_files([gif.path], "--gif PATH")
    directory = output_directory(Path(settings.output), "evaluation.output")
    output_files((directory / name for name in FILES), "evaluation.output")
    if gif is not None and gif.path.resolve() in [(directory / name).resolve() for name in FILES]:
        raise checks.refuse("--gif PATH", str(gif.path), "a name that no other file of the report has")
    return Evaluation(settings, tasks, scenery, policies, gif)


def serves(content: Any, info: TaskInfo) -> bool:
    """Whether a policy that names no tasks is meant for this one.

    A controller is where it can be made with its own defaults. All others are: where they do not fit, making them says so.
    """
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if not isinstance(kind, str) or kind not in CONTROLLERS or kind == "trained":
        return True
    try:
        make_policy(kind, info)
    except ValueError:
        return False
    return True


class _field:
    """Puts the name of a field before the message of a ValueError."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, ValueError):
            raise ValueError(f"{self.name}: {error}") from None


def _first_line(policy: Policy) -> str:
    """What the policy's documentation says of it, without the marks of code."""
    return (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")


def evaluate(evaluation: Evaluation, quiet: bool = False) -> Results:
    """Run every policy on every task and compare them; writes nothing."""
    settings = evaluation.settings
    level, resamples = settings.confidence, settings.resamples
    alone = usable(settings.processes) == 1
    measured: Cost | Future[Cost] | None = None
    found: dict[tuple[str, str], Any] = dict.fromkeys(evaluation.policies)
    with side_by_side(settings.processes) as submit:
        if settings.cost_per_period:
            measured = cost.measure_alone(quiet) if alone else submit(cost.measure, True)
        given = settings.named_policies()
        named = [] if alone else [pair for pair in found if _plain(given[pair[1]])]
        for task, name in sorted(named, key=lambda pair: _order(evaluation.tasks[pair[0]], settings)):
            info, seeds = evaluation.tasks[task], settings.seed_list(task)
            asked = (given[name], info, seeds, settings.environment, name, level, resamples)
            found[task, name] = submit(_made_and_judged, *asked)
        for (task, name), future in found.items():
            if future is None:
                policy, seeds = evaluation.policies[task, name], settings.seed_list(task)
                found[task, name] = _judged(policy, task, seeds, settings.environment, name, level, resamples, quiet)
        waiting = tqdm(found.items(), desc="running policies", unit="pair", disable=quiet or alone)
        found = {pair: each.result() if isinstance(each, Future) else each for pair, each in waiting}
        if isinstance(measured, Future):
            measured = measured.result()
    rollouts: dict[tuple[str, str], Rollout] = {pair: rollout for pair, (rollout, _) in found.items()}
    pairs = [
        (task, *pair)
        for task in settings.tasks
        for pair in itertools.combinations((name for each, name in rollouts if each == task), 2)
    ]
    comparisons = [
        compare((first, second), rollouts[task, first], rollouts[task, second], level, resamples)
        for task, first, second in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet)
    ]
    described = {name: _first_line(policy) for (_, name), policy in reversed(evaluation.policies.items())}
    return Results(
        settings=settings,
        tasks=evaluation.tasks,
        scenery=evaluation.scenery,
        policies={name: described[name] for name in settings.named_policies()},
        rollouts=rollouts,
        rows=tuple(row for _, row in found.values()),
        comparisons=tuple(comparisons),
        provenance=provenance(),
        cost=measured,
    )


def _order(info: TaskInfo, settings: EvaluationSettings) -> tuple[bool, int]:
    """Tasks for one part first, while the cost of several is measured: so hardly a kernel is compiled twice.

    Then those that take longest, lest one is left over in the end.
    """
    return len(info.parts) > 1, -len(settings.seed_list(info.name)) * len(info.parts) * (info.step_limit or 1)


def _plain(content: Any) -> bool:
    """Whether a policy is made from plain data, as well in another process; objects stay here, whatever they remember."""
    return isinstance(content, str) or (isinstance(content, Mapping) and "policy" not in content)


def _judged(
    policy: Policy,
    task: str,
    seeds: list[int],
    environment: dict[str, Any],
    name: str,
    level: float,
    resamples: int,
    quiet: bool = True,
) -> tuple[Rollout, Row]:
    """A policy's rollout on a task, and its statistics."""
    rollout = run(policy, task, seeds, environment, name, quiet)
    return rollout, row_of(name, rollout, level, resamples)


def _made_and_judged(content: Any, info: TaskInfo, seeds: list[int], *asked: Any) -> tuple[Rollout, Row]:
    """The same in a process of its own, where the policy is made first."""
    return _judged(make_policy(content, info, seeds[0]), info.name, seeds, *asked)


def write(found: Results, gif: Gif | None = None, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv and results.json, and the film that is asked for.

    Returns:
        The page's path.

    Raises:
        WriteError: a file could not be written; then none is new.
    """
    directory = Path(found.settings.output)
    episodes = [one for key, rollout in found.rollouts.items() for one in tables.episodes_of(key[1], rollout)]
    tabled = csv_text([vars(row) for row in found.rows]), csv_text(episodes), tables.json_text(found)
    contents: dict[Path, str | bytes] = {}
    for name, content in zip(FILES, (*tabled, report.page(found, quiet)), strict=True):
        contents[directory / name] = content
    if gif is not None:
        rollout = found.rollouts[gif.task, gif.policy]
        contents[gif.path] = animation.film_gif(rollout.film, found.scenery[gif.task], rollout.step_time)
    write_together(contents)
    return directory / "report.html"
