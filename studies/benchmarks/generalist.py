"""How well policies do on parts that they may never have seen: ``python -m studies.benchmarks.generalist POLICY ...``.

Every policy plays the same episodes of Align with parts of random outlines (:mod:`agents.outlines`), half of them from
families that no policy is trained on, with ideal elements and with a share of them dead, drawn anew for every episode. Printed
are shares of successes by family, friction and size, with 95 % intervals for outlines drawn anew (bootstrap over outlines,
since episodes with one part are alike), and the median time to the goal. A policy is a name, the path of a trained one, or a
JSON mapping such as ``{"kind": "pose", "action": "wrench"}``.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np

from agents.evaluation.statistics import Interval, bootstrap, exact
from agents.outlines import TRAINING, UNSEEN, scenes
from studies.benchmarks import common
from vibgym import Part
from vibgym.config import part_from
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.outlines import is_convex

TASK = "Align"
FIRST_SEED = 3_000_000
LEVEL, RESAMPLES = 0.95, 2000
DEAD = 0.1
"""Share of dead elements."""

MACHINE = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}
"""Elements without any fault but those that are dead."""

CASES: dict[str, dict[str, Any]] = {"ideal": {}, f"{DEAD:.0%} dead": {"actuators": {**MACHINE, "dead": DEAD}}}


class Played(NamedTuple):
    """What became of a policy's episodes, by outline."""

    parts: list[Part]
    success: np.ndarray  # (outlines, episodes) bool
    fallen: np.ndarray  # (outlines, episodes) bool
    time: np.ndarray  # (outlines, episodes) s, to the goal; nan without success


def test_scenes(count: int, seed: int) -> list[dict[str, Any]]:
    """Half of them of families that are trained on, though other outlines, half of those kept for tests."""
    half = count // 2
    return [*scenes(count - half, seed, TRAINING), *scenes(half, seed + 1, UNSEEN)]


def play(policy: Any, drawn: Sequence[dict[str, Any]], episodes: int, case: dict[str, Any]) -> Played:
    """Let a policy play so many episodes with each part; the seeds are the same for all policies and cases.

    Args:
        policy: see :func:`vibgym.policies.registry.make_policy`.
        drawn: environment arguments of scenes with one part.
        episodes: of each.
        case: more environment arguments.
    """
    parts, found = [], []
    for number, scene in enumerate(drawn):
        environment = {**scene, **case}
        env = gym.make_vec(f"vibgym/{TASK}-v0", num_envs=1, **environment)
        acting = make_policy(policy, TaskInfo.of(env))
        env.close()
        first = FIRST_SEED + number * episodes
        found.append(rollout(acting, TASK, seeds=range(first, first + episodes), **environment))
        parts.append(part_from(scene["parts"][0]))
    return Played(
        parts,
        np.array([each.success for each in found]),
        np.array([each.fallen for each in found]),
        np.array([each.time_to_goal for each in found]),
    )


def largest_dimension(part: Part) -> float:
    """Largest distance between two points of the outline, m."""
    outline = part.outline
    return float(np.hypot(*(outline[:, None] - outline[None]).transpose(2, 0, 1)).max())


def groups(parts: Sequence[Part]) -> dict[str, np.ndarray]:
    """Which outlines count for each row of the table, (outlines,) bool by the row's name."""
    family = np.array([part.name for part in parts])
    friction = np.array([part.friction for part in parts])
    size = 1e3 * np.array([largest_dimension(part) for part in parts])
    convex = np.array([is_convex(part.outline) for part in parts])
    unseen = np.isin(family, UNSEEN)
    found = {"all": np.ones(len(parts), dtype=bool), "families trained on": ~unseen, "families never seen": unseen}
    found |= {f"  {name}": family == name for name in (*TRAINING, *UNSEEN)}
    found |= {"convex": convex, "not convex": ~convex}
    for name, values, edges in (("friction", friction, (0.3, 0.5, 0.7, 0.9)), ("mm", size, (20.0, 40.0, 60.0, 80.0))):
        for low, high in zip(edges, edges[1:]):
            found[f"{low:g} to {high:g} {name}"] = (values >= low) & (values <= high)
    return {name: which for name, which in found.items() if which.any()}


def interval(success: np.ndarray) -> Interval:
    """Of the share of successes (outlines, episodes), for outlines drawn anew."""
    rates = success.mean(axis=1)
    if np.ptp(rates) == 0.0:
        return exact(int(success.sum()), success.size, LEVEL)
    return bootstrap(rates, LEVEL, RESAMPLES)


def table(played: Played) -> list[dict[str, Any]]:
    """Rows of the table as JSON values."""
    rows = []
    for name, which in groups(played.parts).items():
        success, time = played.success[which], played.time[which]
        found = interval(success)
        rows.append(
            {
                "group": name,
                "outlines": int(which.sum()),
                "episodes": int(success.size),
                "success": float(success.mean()),
                "low": found.low,
                "high": found.high,
                "fallen": float(played.fallen[which].mean()),
                "median_time": float(np.nanmedian(time)) if success.any() else None,
            }
        )
    return rows


def show(title: str, rows: Sequence[dict[str, Any]]) -> None:
    """Print a table."""
    print(f"\n{title}\n  {'':22s} outlines episodes  success             fallen  median time")
    for row in rows:
        bracket = f"[{100 * row['low']:.1f}, {100 * row['high']:.1f}]"
        time = "     -" if row["median_time"] is None else f"{row['median_time']:6.2f}"
        print(
            f"  {row['group']:22s} {row['outlines']:8d} {row['episodes']:8d}  {100 * row['success']:5.1f} {bracket:14s}"
            f" {100 * row['fallen']:5.1f}  {time} s"
        )


def policy_of(text: str) -> Any:
    """A policy from the command line: a JSON mapping, or a name or path as it stands."""
    return json.loads(text) if text.lstrip().startswith("{") else text


def main(argv: Sequence[str] | None = None) -> None:
    """Play, and print a table for every policy and case."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("policies", nargs="+", metavar="POLICY", help="name, path of a trained one, or JSON mapping")
    parser.add_argument("--outlines", type=int, default=120, metavar="N")
    parser.add_argument("--episodes", type=int, default=16, metavar="N", help="with each outline")
    parser.add_argument("--seed", type=int, default=1000, metavar="N", help="of the outlines")
    parser.add_argument("--json", metavar="PATH", help="write the tables there as well")
    arguments = parser.parse_args(argv)
    drawn = test_scenes(arguments.outlines, arguments.seed)
    written: dict[str, Any] = {}
    for text in arguments.policies:
        for name, case in CASES.items():
            rows = table(play(policy_of(text), drawn, arguments.episodes, case))
            show(f"{text}, {name}", rows)
            written.setdefault(text, {})[name] = rows
        ideal, dead = (rows[0]["success"] for rows in written[text].values())
        print(f"\n  {DEAD:.0%} dead elements cost {100 * (ideal - dead):.1f} points")
    if arguments.json:
        with open(arguments.json, "w") as file:
            json.dump(written, file, indent=1)


if __name__ == "__main__":
    main()
