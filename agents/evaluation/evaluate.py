"""From settings to results to files."""

from __future__ import annotations

import inspect
import itertools
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import gymnasium as gym
from tqdm import tqdm

import vibgym  # noqa: F401 - registers the environments
from agents.evaluation import animation, report, tables
from agents.evaluation.provenance import provenance
from agents.evaluation.results import Results, TaskFacts, row_of
from agents.evaluation.rollout import run
from agents.evaluation.settings import EvaluationSettings
from agents.evaluation.statistics import compare
from agents.policy import Policy, Situation, make_policy
from vibgym import checks
from vibgym.envs.core import Core
from vibgym.files import output_directory, write_atomically
from vibgym.tasks.pose import PoseTask


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
    core: Core  # of the first task: surface and part
    tasks: dict[str, TaskFacts]
    policies: dict[tuple[str, str], Policy]
    gif: Gif | None


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Evaluation:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    names = settings.named_policies()
    tasks: dict[str, TaskFacts] = {}
    policies: dict[tuple[str, str], Policy] = {}
    cores: list[Core] = []
    for task in settings.tasks:
        with _field("evaluation.environment"):
            env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **settings.environment)
        core: Core = env.unwrapped.core  # type: ignore[attr-defined]
        tasks[task] = _facts(task, core.task, env.unwrapped.max_episode_steps)  # type: ignore[attr-defined]
        situation = Situation(task, core.surface, core.part)
        for name, content in names.items():
            with _field(f"evaluation.policies ({name} on {task})"):
                policies[task, name] = make_policy(content, situation, settings.seed_list()[0])
        env.close()
        cores.append(core)
    if gif is not None:
        checks.choice("--gif TASK", gif.task, tuple(tasks))
        checks.choice("--gif POLICY", gif.policy, tuple(names))
        output_directory(gif.path.parent, "--gif PATH")
    output_directory(Path(settings.output), "evaluation.output")
    return Evaluation(settings, cores[0], tasks, policies, gif)


class _field:
    """Puts the name of a field before the message of a ValueError."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __enter__(self) -> None:
        pass

    def __exit__(self, kind: Any, error: BaseException | None, trace: Any) -> None:
        if isinstance(error, ValueError):
            raise ValueError(f"{self.name}: {error}") from None


def _facts(name: str, task: PoseTask, limit: int) -> TaskFacts:
    summary = (inspect.getdoc(type(task)) or "").split("\n\n")[0].replace("\n", " ")
    heading = task.heading_tolerance if task.has_heading else None
    return TaskFacts(name, summary, task.position_tolerance, heading, limit)


def _first_line(policy: Policy) -> str:
    """What the policy's documentation says of it, without the marks of code."""
    return (inspect.getdoc(policy) or "").partition("\n")[0].replace("`", "").replace('"', "")


def evaluate(evaluation: Evaluation, quiet: bool = False) -> Results:
    """Run every policy on every task and compare them; writes nothing."""
    settings = evaluation.settings
    level, resamples = settings.confidence, settings.resamples
    rollouts = {
        (task, name): run(policy, task, settings.seed_list(), settings.environment, name, quiet)
        for (task, name), policy in evaluation.policies.items()
    }
    names = list(settings.named_policies())
    pairs = [(task, *pair) for task in settings.tasks for pair in itertools.combinations(names, 2)]
    comparisons = [
        compare((first, second), rollouts[task, first], rollouts[task, second], level, resamples)
        for task, first, second in tqdm(pairs, desc="comparing policies", unit="pair", disable=quiet)
    ]
    described = {name: evaluation.policies[settings.tasks[0], name] for name in names}
    return Results(
        settings=settings,
        surface=evaluation.core.surface,
        part=evaluation.core.part,
        tasks=evaluation.tasks,
        policies={name: _first_line(policy) for name, policy in described.items()},
        rollouts=rollouts,
        rows=tuple(row_of(key[1], rollout, level, resamples) for key, rollout in rollouts.items()),
        comparisons=tuple(comparisons),
        provenance=provenance(),
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
