"""Run jobs, in processes of their own where that is asked for."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from concurrent.futures import Future
from typing import Any

from tqdm import tqdm

from agents.evaluation.jobs import Job
from agents.workers import Submit
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

Judge = Callable[..., Any]
"""``judge(policy, info, seeds, environment, key, *more, quiet)`` runs a job and returns what is kept of it; a module's own
function, so that another process finds it."""


def run_jobs(
    submit: Submit,
    jobs: Mapping[tuple[str, ...], Job],
    judge: Judge,
    more: tuple[Any, ...] = (),
    *,
    alone: bool,
    quiet: bool,
) -> dict[tuple[str, ...], Any]:
    """What ``judge`` returns of every job, by key, in the order of the jobs.

    Args:
        submit: of :func:`agents.workers.side_by_side`.
        jobs: key -> job.
        judge: see :data:`Judge`.
        more: arguments of it.
        alone: whether there is this process and no other. Else jobs whose policies are plain data go to the others.
        quiet: no progress bars.
    """
    found: dict[tuple[str, ...], Any] = dict.fromkeys(jobs)
    for key in sorted((key for key, job in jobs.items() if job.plain and not alone), key=lambda key: jobs[key].size):
        job = jobs[key]
        found[key] = submit(_made_and_judged, judge, job.content, job.info, job.seeds, job.environment, key, more)
    for key, job in jobs.items():
        if found[key] is None:
            found[key] = judge(job.policy, job.info, job.seeds, job.environment, key, *more, quiet)
    waiting = tqdm(found.items(), desc="running policies", unit="pair", disable=quiet or alone)
    return {key: each.result() if isinstance(each, Future) else each for key, each in waiting}


def _made_and_judged(
    judge: Judge,
    content: Any,
    info: TaskInfo,
    seeds: list[int],
    environment: dict[str, Any],
    key: tuple[str, ...],
    more: tuple[Any, ...],
) -> Any:
    """The same in a process of its own, where the policy is made first."""
    policy: Policy = make_policy(content, info, seeds[0])
    return judge(policy, info, seeds, environment, key, *more, True)
