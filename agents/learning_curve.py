"""Learning curves: deterministic episodes on the same seeds every so many steps, written beside the run, and read again."""

from __future__ import annotations

import math
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pandas as pd
from pydantic import ConfigDict, Field

from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.envs.vector import batch_of, environment_id
from vibgym.files import reason, write_atomically
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import run
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.residual import ResidualPolicy
from vibgym.settings import BaseSettings, read

FILE = "curve.csv"
COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "mean_time", "speed", "return_", "rate", "cost")

COST_SHARE = 0.95
"""Share of the episodes whose costs are at most the one of a row."""

RATE = "good_per_minute"
"""Field of ``info`` at the end of episodes of tasks that end only at their limit."""


class CurveRow(BaseSettings):
    """One evaluation in the file of a learning curve; empty cells have their defaults. Old files lack some columns."""

    model_config = ConfigDict(strict=False)  # cells are texts

    steps: int = Field(ge=0, le=2**53)  # environment steps
    seconds: float = Field(ge=0.0)  # wall time
    phase: str  # "imitation" or the name of the algorithm
    success: float = Field(ge=0.0, le=1.0)  # success rate
    time_to_goal: float = Field(default=math.nan, ge=0.0)  # s, median of successes
    return_: float
    mean_time: float = math.nan
    speed: float = math.nan  # 1/s
    rate: float = math.nan
    cost: float = math.nan


SHOWN = ["steps", "seconds", "phase", "success", "time_to_goal", "return_"]
"""Columns of a learning curve that reports have."""


def read_curve(path: Path, field: str) -> pd.DataFrame:
    """Return the columns :data:`SHOWN` of a learning curve, CSV with columns in any order; steps and seconds do not decrease.

    Args:
        path: of the file.
        field: of the settings that name it, for errors.

    Raises:
        ValueError: the file cannot be read, or is not a learning curve.
    """
    try:
        lines = read_texts(path).to_dict("records")
    except (OSError, ValueError) as error:  # ValueError: not UTF-8, no CSV, or an invalid file name
        why = reason(error) if isinstance(error, OSError) else "not UTF-8, or no CSV"
        raise checks.refuse(field, str(path), f"a readable learning curve ({why})") from None
    if not lines:
        raise checks.refuse(f"{path}: line 1", "no lines below", f"the columns {', '.join(COLUMNS)}, with lines below")
    rows: list[CurveRow] = []
    for index, line in enumerate(lines, 2):
        where = f"{path}: line {index}"
        rows.append(read(CurveRow, {name: cell for name, cell in line.items() if cell}, where))
        if rows[-1].success > 0.0 and math.isnan(rows[-1].time_to_goal):
            raise checks.missing(f"{where}: time_to_goal", "required with success")
        for name in ("steps", "seconds"):
            if index > 2 and getattr(rows[-1], name) < getattr(rows[-2], name):
                raise checks.refuse(f"{where}: {name}", getattr(rows[-1], name), "at least that of the line before")
    return pd.DataFrame([vars(row) for row in rows], columns=SHOWN)


def read_texts(path: Path) -> pd.DataFrame:
    """Return a CSV file as texts, without rows if it is empty."""
    try:
        return pd.read_csv(path, dtype=str, na_filter=False)
    except pd.errors.EmptyDataError:
        return pd.DataFrame()


class LearningCurve:
    """Evaluation of a policy during training, written to ``curve.csv``.

    Columns: success rate, median time to the goal (s), its mean over all episodes (failures count with their limit), mean of
    its inverse (1/s, 0 for failures), median return, for tasks in which parts come and go the mean number of good parts per
    minute, and with ``costs`` the cost that 95 % of the episodes do not exceed. Contacts are certified, also if those of the
    training are fast.

    Args:
        settings: of the run; its ``selection`` has the number of episodes and the interval.
        directory: of the run.

    Attributes:
        rows: of the curve so far.

    Raises:
        ValueError: an environment that is not registered, or has no step limit; a cost limit without costs.
    """

    def __init__(self, settings: TrainSettings, directory: Path) -> None:
        assert settings.selection is not None
        self.selection, self.path, self._last = settings.selection, directory / FILE, 0
        self.residual, self._velocities = settings.residual, settings.adds_velocities
        self._envs: list[tuple[Any, int]] = []  # and the seed of their first world
        self.rows: list[dict[Any, Any]] = []
        self.task = settings.task
        spec = gym.registry.get(environment_id(self.task))
        if spec is None or (spec.max_episode_steps is None and spec.kwargs.get("max_episode_periods") is None):
            raise checks.conflict(f"selection requires a task with a step limit, got {settings.task!r}")
        if self.selection.cost_limit is not None and {**spec.kwargs, **settings.environment}.get("costs") is None:
            raise checks.conflict("selection.cost_limit requires environment.costs")
        scenes = evaluation_environments(settings)
        shares = np.array_split(np.arange(self.selection.episodes), len(scenes))
        self._scenes = [
            ({**scene, "num_envs": len(share), "autoreset_mode": "Disabled"}, int(share[0]))
            for scene, share in zip(scenes, shares, strict=True)
            if len(share)
        ]

    def begin(self, steps: int) -> None:
        """Start a run, or continue it from ``steps``: later rows are removed."""
        self.rows = []
        if steps and self.path.exists():
            self.rows = [row for row in read_texts(self.path).to_dict("records") if int(row["steps"]) <= steps]
        self._write()
        self._last = int(self.rows[-1]["steps"]) if self.rows else 0

    def due(self, steps: int) -> bool:
        """Return whether the next evaluation is due."""
        return steps - self._last >= self.selection.every

    def measure(self, policy: Policy, steps: int, seconds: float, phase: str) -> dict[str, Any]:
        """Evaluate a policy, write a row, and return it.

        Args:
            policy: of a residual policy the network alone; the base of each scene is added.
            steps, seconds: of the training so far.
            phase: of the training, ``"imitation"`` or the name of the algorithm.
        """
        self._last = steps
        if not self._envs:
            for arguments, first in self._scenes:
                observation = policy.observation if self.residual is None else ResidualPolicy.observation
                env = batch_of(self.task, **{**arguments, "observation": observation})
                self._envs.append((env, self.selection.first_seed + first))
        episodes = pd.concat([self._episodes(policy, env, first) for env, first in self._envs])
        columns = ("success", "steps", "limit", "return_", "rate", "cost")
        success, taken, limit, returns, rate, cost = (episodes[name].to_numpy() for name in columns)
        step = self._envs[0][0].unwrapped.step_time
        time = step * taken
        row = {
            "steps": steps,
            "seconds": round(seconds, 1),
            "phase": phase,
            "success": round(float(success.mean()), 4),
            "time_to_goal": round(float(np.median(time[success])), 4) if success.any() else "",
            "mean_time": round(float(np.where(success, time, step * limit).mean()), 4),
            "speed": round(float((success / np.maximum(time, step)).mean()), 5),
            "return_": round(float(np.median(returns)), 4),
            "rate": round(float(rate.mean()), 4) if np.isfinite(rate).all() else "",
            "cost": round(float(np.quantile(cost, COST_SHARE)), 5) if np.isfinite(cost).all() else "",
        }
        self.rows.append(row)
        self._write()
        return row

    def is_best(self, row: dict[str, Any]) -> bool:
        """Return whether no row of the curve so far is better, see :func:`rank`."""
        criterion = self.selection.best, self.selection.cost_limit
        return all(rank(other, *criterion) >= rank(row, *criterion) for other in self.rows)

    def _episodes(self, policy: Policy, env: Any, first: int) -> pd.DataFrame:
        """Run an episode in every world; world k starts with seed ``first + k``. Return a row for each."""
        if self.residual is not None:
            info = TaskInfo.of(env)
            base, scale = make_policy(self.residual.base, info), self.residual.scale
            policy = ResidualPolicy(info, base, policy, scale=scale, velocities=self._velocities)
        result = run(policy, env, range(first, first + env.num_envs), env.spec.name)
        measured = {"success": result.success, "steps": result.steps, "return_": result.returns, "cost": result.cost}
        return pd.DataFrame({**measured, "rate": result.reported(RATE), "limit": env.unwrapped.max_episode_steps})

    def _write(self) -> None:
        text = pd.DataFrame(self.rows, columns=list(COLUMNS)).to_csv(index=False, lineterminator="\n")
        write_atomically(self.path, text)


def rank(row: Mapping[str, Any], best: str = "success", cost_limit: float | None = None) -> tuple[float, ...]:
    """Return the sort key of a row, the best first: by the excess of the cost limit, good parts per minute where tasks have no
    success, else by ``best``, ``"success"`` or ``"speed"``, then by time. Old curves have neither rates nor speeds."""
    excess = 0.0 if cost_limit is None else max(float(row["cost"]) - cost_limit, 0.0)
    return excess, -float(row.get("rate") or 0.0), -float(row.get(best) or 0.0), float(row["time_to_goal"] or "inf")


def without_hold(settings: TrainSettings) -> list[dict[str, Any]]:
    """Return the arguments of a run's environments, one for each scene, without the longer hold that training may have."""
    common = dict(settings.environment)
    own = {name: value for name, value in common.pop("task_settings", {}).items() if name != "hold"}
    return [{**common, **({"task_settings": own} if own else {}), **scene} for scene in settings.all_scenes]


def evaluation_environments(settings: TrainSettings) -> list[dict[str, Any]]:
    """Return :func:`without_hold` with certified contacts, in which a run is evaluated."""
    changed = without_hold(settings)
    for scene in changed:
        model = scene.get("model", "planar")
        if not isinstance(model, str):
            scene["model"] = {name: value for name, value in model.items() if name != "contacts"}
    return changed
