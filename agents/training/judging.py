"""Learning curves: deterministic episodes on the same seeds every so many steps, written down beside the run."""

from __future__ import annotations

import csv
import io
from collections.abc import Mapping
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from agents.training.train_settings import TrainSettings
from vibgym import checks
from vibgym.envs.named import batch_of, environment_id
from vibgym.files import write_atomically
from vibgym.policies.protocol import Policy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import run
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.residual import ResidualPolicy

FILE = "curve.csv"
COLUMNS = ("steps", "seconds", "phase", "success", "time_to_goal", "mean_time", "return_", "rate")

RATE = "good_per_minute"
"""What ``info`` says at the end of episodes of tasks that have no other end than their limit."""


class Played(NamedTuple):
    """How episodes went, (episodes,) each."""

    success: np.ndarray  # bool
    steps: np.ndarray  # that they took
    returns: np.ndarray  # sums of rewards
    rate: np.ndarray  # good parts a minute; nan where parts stay


class Judge:
    """Plays a policy and writes ``curve.csv``: share of successes, median time to the goal (s), the same as a mean over
    all episodes, those that fail counted with their limit, median return, and where parts come and go the mean of good parts a
    minute.

    Args:
        settings: of the run; its ``judging`` says when and how long.
        directory: of the run.

    Attributes:
        rows: of the curve so far.

    Raises:
        ValueError: an environment that is not registered, or has no step limit.
    """

    def __init__(self, settings: TrainSettings, directory: Path) -> None:
        assert settings.judging is not None
        self.judging, self.path, self._last = settings.judging, directory / FILE, 0
        self.residual = settings.residual
        self._envs: list[tuple[Any, int]] = []
        self.rows: list[dict[Any, Any]] = []
        self.task = settings.task
        spec = gym.registry.get(environment_id(self.task))
        if spec is None or (spec.max_episode_steps is None and spec.kwargs.get("max_episode_periods") is None):
            allowed = "environments with a step limit: episodes must end"
            raise checks.refuse("judging", settings.task, allowed)
        scenes = settings.all_scenes
        shares = np.array_split(np.arange(self.judging.episodes), len(scenes))
        self._scenes = [
            (
                {**usual(settings.environment), **scene, "num_envs": len(share), "autoreset_mode": "Disabled"},
                int(share[0]),
            )
            for scene, share in zip(scenes, shares, strict=True)
            if len(share)
        ]

    def begin(self, steps: int) -> None:
        """A run begins, or goes on from so many steps: rows of steps that were lost go."""
        self.rows = []
        if steps and self.path.exists():
            with self.path.open(newline="") as file:
                self.rows = [row for row in csv.DictReader(file) if int(row["steps"]) <= steps]
        self._write()
        self._last = int(self.rows[-1]["steps"]) if self.rows else 0  # as if nothing had come between

    def due(self, steps: int) -> bool:
        """Whether it is time again."""
        return steps - self._last >= self.judging.every

    def judge(self, policy: Policy, steps: int, seconds: float, phase: str) -> dict[str, Any]:
        """Play, write a row, and return it.

        Args:
            policy: as it acts; of a correction the network alone, which is played on the base of each scene.
            steps, seconds: of the training so far.
            phase: of the training, ``"imitation"``, ``"ppo"``, ``"sac"`` or ``"offline"``.
        """
        self._last = steps
        if not self._envs:
            for arguments, first in self._scenes:
                observation = policy.observation if self.residual is None else ResidualPolicy.observation
                env = batch_of(self.task, **{**arguments, "observation": observation})
                self._envs.append((env, self.judging.first_seed + first))
        found = [play(self._whole(policy, env), env, seed) for env, seed in self._envs]
        success, steps_taken, returns, rate = (np.concatenate(each) for each in zip(*found, strict=True))
        env = self._envs[0][0].unwrapped
        reached = env.step_time * steps_taken[success]
        limits = [np.full(each.num_envs, each.unwrapped.max_episode_steps) for each, _ in self._envs]
        mean = env.step_time * np.where(success, steps_taken, np.concatenate(limits)).mean()
        row = {
            "steps": steps,
            "seconds": round(seconds, 1),
            "phase": phase,
            "success": round(float(success.mean()), 4),
            "time_to_goal": round(float(np.median(reached)), 4) if len(reached) else "",
            "mean_time": round(float(mean), 4),
            "return_": round(float(np.median(returns)), 4),
            "rate": round(float(rate.mean()), 4) if np.isfinite(rate).all() else "",
        }
        self.rows.append(row)
        self._write()
        return row

    def is_best(self, row: dict[str, Any]) -> bool:
        """Whether no row of the curve so far is better, see :func:`rank`."""
        return all(rank(each) >= rank(row) for each in self.rows)

    def _whole(self, policy: Policy, env: Any) -> Policy:
        """What acts in an environment: the policy, or the base that it corrects there."""
        if self.residual is None:
            return policy
        info = TaskInfo.of(env)
        return ResidualPolicy(info, make_policy(self.residual.base, info), policy, scale=self.residual.scale)

    def _write(self) -> None:
        text = io.StringIO()
        writer = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(self.rows)
        write_atomically(self.path, text.getvalue())


def rank(row: Mapping[str, Any]) -> tuple[float, float, float]:
    """Where a row of a curve stands, the best first: by good parts a minute where episodes have no success, else by successes,
    and among equals by time. Curves that were written before there were rates have none."""
    return -float(row.get("rate") or 0.0), -float(row["success"]), float(row["time_to_goal"] or "inf")


def usual(environment: dict[str, Any]) -> dict[str, Any]:
    """Without the longer hold that a policy may be trained with."""
    own = {name: value for name, value in environment.get("task_settings", {}).items() if name != "hold"}
    return (
        {**environment, "task_settings": own} if own else {k: v for k, v in environment.items() if k != "task_settings"}
    )


def play(policy: Policy, env: Any, first_seed: int) -> Played:
    """One deterministic episode in every world of ``env``, of which world k begins with ``first_seed + k``.

    Args:
        policy: as it acts.
        env: a batch of worlds with ``autoreset_mode="Disabled"``, with the action and observation of the policy.
    """
    found = run(policy, env, range(first_seed, first_seed + env.num_envs), env.spec.name)
    return Played(found.success, found.steps, found.returns, found.facts[RATE])
