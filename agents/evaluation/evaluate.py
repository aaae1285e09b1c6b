"""From settings to results to files."""

from __future__ import annotations

import inspect
import itertools
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from tqdm import tqdm

import vibgym  # noqa: F401 - registers the environments
from agents.control import CLASSICAL
from agents.evaluation import animation, cost, report, tables
from agents.evaluation.provenance import provenance
from agents.evaluation.results import Results, TaskFacts, row_of
from agents.evaluation.rollout import run
from agents.evaluation.scene import Scene, scene_of
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import compare
from agents.policy import Policy, Situation, make_policy
from vibgym import checks
from vibgym.envs.core import Core
from vibgym.files import output_directory, write_atomically
from vibgym.scene import Surface
from vibgym.tasks import ManyTask, PoseTask, Task


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
    surface: Surface
    tasks: dict[str, TaskFacts]
    scenes: dict[str, Scene]
    policies: dict[tuple[str, str], Policy]  # (task, policy)
    gif: Gif | None


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Evaluation:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    entries = settings.entries()
    tasks: dict[str, TaskFacts] = {}
    scenes: dict[str, Scene] = {}
    policies: dict[tuple[str, str], Policy] = {}
    surface = Surface()
    for task in settings.tasks:
        with _field("evaluation.environment"):
            env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **settings.environment)
        core: Core = env.unwrapped.core  # type: ignore[attr-defined]
        limit: int = env.unwrapped.max_episode_steps  # type: ignore[attr-defined]
        seeds = settings.seed_list(task)
        scenes[task], surface = scene_of(core), core.surface
        tasks[task] = _facts(task, core.task, limit, len(seeds))
        situation = Situation.of(core.task, task)
        for entry in entries:
            if entry.tasks is None and not serves(entry.content, situation):
                continue
            if entry.tasks is None or task in entry.tasks:
                with _field(f"evaluation.policies ({entry.name} on {task})"):
                    policies[task, entry.name] = make_policy(entry.content, situation, seeds[0])
        env.close()
        if not any(each == task for each, _ in policies):
            raise checks.refuse("evaluation.policies", [entry.name for entry in entries], f"one that serves {task}")
    for entry in entries:
        if not any(name == entry.name for _, name in policies):
            raise checks.refuse("evaluation.policies", entry.name, f"policies that serve one of {', '.join(tasks)}")
    if gif is not None:
        checks.choice("--gif TASK", gif.task, tuple(tasks))
        checks.choice("--gif POLICY", gif.policy, tuple(name for task, name in policies if task == gif.task))
        output_directory(gif.path.parent, "--gif PATH")
    output_directory(Path(settings.output), "evaluation.output")
    return Evaluation(settings, surface, tasks, scenes, policies, gif)


def serves(content: Any, situation: Situation) -> bool:
    """Whether a policy that names no tasks is meant for this one.

    A classical one is where it can be made with its own defaults. All others are: where they do not fit, making them says so.
    """
    kind = content.get("kind") if isinstance(content, Mapping) else content
    if not isinstance(kind, str) or kind not in CLASSICAL:
        return True
    try:
        make_policy(kind, situation)
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


def _facts(name: str, task: Task, limit: int, episodes: int) -> TaskFacts:
    summary = (inspect.getdoc(type(task)) or "").split("\n\n")[0].replace("\n", " ")
    position = heading = apart = None
    zones: dict[str, tuple[float, float, float, float]] = {}
    if isinstance(task, PoseTask):
        position = task.position_tolerance
        heading = task.heading_tolerance if task.has_heading else None
    elif isinstance(task, ManyTask):
        apart = task.apart() if task.apart() > 0.0 else None
        if task.zones is not None:
            zones = {kind: tuple(zone) for kind, zone in zip(task.names, task.zones.tolist(), strict=True)}
    return TaskFacts(
        name, summary, position, heading, limit, episodes, tuple(part.name for part in task.parts), zones, apart
    )


def _first_line(policy: Policy) -> str:
    """What the policy's documentation says of it, without the marks of code."""
    return (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")


def evaluate(evaluation: Evaluation, quiet: bool = False) -> Results:
    """Run every policy on every task and compare them; writes nothing."""
    settings = evaluation.settings
    level, resamples = settings.confidence, settings.resamples
    measured = cost.measure_alone(quiet) if settings.cost_per_period else None
    rollouts = {
        (task, name): run(policy, task, settings.seed_list(task), settings.environment, name, quiet)
        for (task, name), policy in evaluation.policies.items()
    }
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
        surface=evaluation.surface,
        tasks=evaluation.tasks,
        scenes=evaluation.scenes,
        policies={name: described[name] for name in settings.named_policies()},
        rollouts=rollouts,
        rows=tuple(row_of(key[1], rollout, level, resamples) for key, rollout in rollouts.items()),
        comparisons=tuple(comparisons),
        provenance=provenance(),
        cost=measured,
    )


def write(found: Results, gif: Gif | None = None, quiet: bool = False) -> Path:
    """Write report.html, results.csv, episodes.csv and results.json, each in one step; returns the page's path.

    Everything is made before the first file is replaced, so that an interruption hardly ever leaves a mixed set.
    """
    directory = Path(found.settings.output)
    episodes = [one for key, rollout in found.rollouts.items() for one in tables.episodes_of(key[1], rollout)]
    files = {
        "results.csv": tables.csv_text([vars(row) for row in found.rows]),
        "episodes.csv": tables.csv_text(episodes),
        "results.json": tables.json_text(found),
        "report.html": report.page(found, quiet),
    }
    if gif is not None:
        animation.write_film_gif(gif.path, found, gif.task, gif.policy)
    for name, content in files.items():
        write_atomically(directory / name, content)
    return directory / "report.html"
