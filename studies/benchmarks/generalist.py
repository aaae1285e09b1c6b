"""Evaluate policies on parts of random outlines: ``python -m studies.benchmarks.generalist POLICY ...``.

Every policy plays the same episodes of Align with parts of random outlines (:mod:`agents.outlines`), half of them from families
that are not used in training, on ideal hardware and with randomly drawn dead elements. Output: success by family, friction and
size, with 95 % intervals (bootstrap over outlines, since episodes with a part are correlated), and median time to the goal. A
policy is a name, the path of a trained policy, or a JSON mapping such as ``{"kind": "pose", "action": "wrench"}``.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import Interval, bootstrap, exact
from agents.outlines import TRAINING, UNSEEN, scenes
from studies.benchmarks import common
from vibgym import Part
from vibgym.config import part_from
from vibgym.policies.rollout import rollout
from vibgym.scene.outlines import is_convex

TASK = "Align"
FIRST_SEED = 3_000_000
LEVEL, RESAMPLES = 0.95, 2000
DEAD = 0.1
"""Share of dead elements."""

MACHINE = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}
"""Ideal elements, except for dead ones."""

CASES: dict[str, dict[str, Any]] = {"ideal": {}, f"{DEAD:.0%} dead": {"actuators": {**MACHINE, "dead": DEAD}}}


class Played(NamedTuple):
    """Outcomes of a policy's episodes by outline."""

    parts: list[Part]
    success: np.ndarray  # (outlines, episodes) bool
    fallen: np.ndarray  # (outlines, episodes) bool
    time: np.ndarray  # (outlines, episodes) s, to the goal; nan without success


def test_scenes(count: int, seed: int) -> list[dict[str, Any]]:
    """Return scenes with new outlines: half of families used in training, half of unseen families."""
    half = count // 2
    return [*scenes(count - half, seed, TRAINING), *scenes(half, seed + 1, UNSEEN)]


def play(policy: Any, drawn: Sequence[dict[str, Any]], episodes: int, case: dict[str, Any]) -> Played:
    """Run episodes with each part; seeds are equal for all policies and cases.

    Args:
        policy: see :func:`vibgym.policies.registry.make_policy`.
        drawn: environment arguments of scenes with one part.
        episodes: per scene.
        case: more environment arguments.
    """
    found = []
    for number, scene in enumerate(drawn):
        first = FIRST_SEED + number * episodes
        found.append(rollout(policy, TASK, seeds=range(first, first + episodes), **{**scene, **case}))
    return Played(
        [part_from(scene["parts"][0]) for scene in drawn],
        np.array([each.success for each in found]),
        np.array([each.fallen for each in found]),
        np.array([each.time_to_goal for each in found]),
    )


def largest_dimension(part: Part) -> float:
    """Return the largest distance between two points of the outline, m."""
    outline = part.outline
    return float(np.hypot(*(outline[:, None] - outline[None]).transpose(2, 0, 1)).max())


def groups(parts: Sequence[Part]) -> dict[str, np.ndarray]:
    """Return the outlines of each row of the table, (outlines,) bool by name."""
    family = np.array([part.name for part in parts])
    friction = np.array([part.friction for part in parts])
    size = 1e3 * np.array([largest_dimension(part) for part in parts])
    convex = np.array([is_convex(part.outline) for part in parts])
    unseen = np.isin(family, UNSEEN)
    found = {"all": np.ones(len(parts), dtype=bool), "training families": ~unseen, "unseen families": unseen}
    found |= {f"  {name}": family == name for name in (*TRAINING, *UNSEEN)}
    found |= {"convex": convex, "not convex": ~convex}
    for name, values, edges in (("friction", friction, (0.3, 0.5, 0.7, 0.9)), ("mm", size, (20.0, 40.0, 60.0, 80.0))):
        for low, high in zip(edges, edges[1:]):
            found[f"{low:g} to {high:g} {name}"] = (values >= low) & (values <= high)
    return {name: which for name, which in found.items() if which.any()}


def interval(success: np.ndarray) -> Interval:
    """Return the interval of the success rate, from (outlines, episodes), for other outlines."""
    rates = success.mean(axis=1)
    if np.ptp(rates) == 0.0:
        return exact(int(success.sum()), success.size, LEVEL)
    return bootstrap(rates, LEVEL, RESAMPLES)


def show(title: str, played: Played) -> None:
    """Print a table."""
    print(f"\n{title}\n  {'':22s} outlines episodes  success             fallen  median time")
    for name, which in groups(played.parts).items():
        success, found = played.success[which], interval(played.success[which])
        bracket = f"[{100 * found.low:.1f}, {100 * found.high:.1f}]"
        time = f"{np.nanmedian(played.time[which]):6.2f}" if success.any() else "     -"
        print(
            f"  {name:22s} {which.sum():8d} {success.size:8d}  {100 * success.mean():5.1f} {bracket:14s}"
            f" {100 * played.fallen[which].mean():5.1f}  {time} s"
        )


def main() -> None:
    """Evaluate, and print a table for every policy and case."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("policies", nargs="+", metavar="POLICY", help="name, path of a trained policy, or JSON mapping")
    parser.add_argument("--outlines", type=int, default=120, metavar="N")
    parser.add_argument("--episodes", type=int, default=16, metavar="N", help="per outline")
    parser.add_argument("--seed", type=int, default=1000, metavar="N", help="of the outlines")
    arguments = parser.parse_args()
    drawn = test_scenes(arguments.outlines, arguments.seed)
    for text in arguments.policies:
        found = {name: play(common.policy(text), drawn, arguments.episodes, case) for name, case in CASES.items()}
        for name, played in found.items():
            show(f"{text}, {name}", played)
        ideal, dead = (played.success.mean() for played in found.values())
        print(f"\n  {DEAD:.0%} dead elements reduce success by {100 * (ideal - dead):.1f} percentage points")


if __name__ == "__main__":
    main()
