"""An evaluation whose settings are checked, and what it is going to run."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from agents.evaluation.jobs import Job, effects_jobs, trials, writable
from agents.evaluation.records import Trial
from agents.evaluation.report.load import Loaded, load_jobs
from agents.evaluation.settings import EvaluationSettings
from vibgym import checks
from vibgym.files import output_files
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery

FILES = ("results.csv", "episodes.csv", "results.json", "report.html")
"""Of an evaluation, beside a film that is asked for."""


@dataclass(frozen=True)
class Gif:
    """Wish for a film of one policy on one task as a GIF file, on the first hardware that it runs on if none is named."""

    task: str
    policy: str
    path: Path
    hardware: str | None = None


@dataclass(frozen=True)
class Evaluation:
    """A checked evaluation: environments and policies exist, the output directory can be written to."""

    settings: EvaluationSettings
    tasks: dict[str, TaskInfo]
    scenery: dict[str, Scenery]  # what pictures of each task show
    jobs: dict[Trial, Job]
    study: dict[tuple[str, str], Job]  # (case, policy) of the study of effects, case after case
    load: dict[Loaded, Job]
    film: tuple[Trial, Path] | None  # that is asked for as a file


def prepare(settings: EvaluationSettings, gif: Gif | None = None) -> Evaluation:
    """Build all that can fail for bad input, before anything runs.

    Raises:
        ValueError: a bad environment setting, an unknown or unfitting policy, or a place that cannot be written to.
    """
    import agents.evaluation.report.report_page  # noqa: F401 - a package that pages need is missed before anything runs

    tasks, scenery, jobs = trials(settings)
    study, load = effects_jobs(settings), dict(load_jobs(settings))
    film = None if gif is None else (_filmed(gif, jobs), gif.path)
    writable(settings, FILES)
    if gif is not None and gif.path.resolve() in [(Path(settings.output) / name).resolve() for name in FILES]:
        raise checks.refuse("--gif PATH", str(gif.path), "a name that no other file of the report has")
    return Evaluation(settings, tasks, scenery, jobs, study, load, film)


def _filmed(gif: Gif, jobs: dict[Trial, Job]) -> Trial:
    """The trial whose film is asked for, checked."""
    checks.choice("--gif TASK", gif.task, tuple({trial.task: None for trial in jobs}))
    some = [trial for trial in jobs if trial.task == gif.task]
    if gif.hardware is not None:
        checks.choice("--gif-hardware", gif.hardware, tuple({trial.hardware: None for trial in some}))
        some = [trial for trial in some if trial.hardware == gif.hardware]
    checks.choice("--gif POLICY", gif.policy, tuple({trial.policy: None for trial in some}))
    output_files([gif.path], "--gif PATH")
    return next(trial for trial in some if trial.policy == gif.policy)
