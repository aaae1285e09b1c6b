"""Costs of policies, and an agent with a limit on them: ``python -m studies.benchmarks.constrained [--episodes 500]``.

Swap with the impulse of contacts as cost: the usual agent, the agent trained with a limit
(``configs/agents/constrained.yaml``) and the lanes, on seeds from 300000. *within the limit*: share of episodes whose cost
does not exceed it, and the score *at limited cost* counts only these.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from agents.evaluation.statistics import episode_scores, exact, quartiles
from agents.evaluation.table import quantity
from studies.benchmarks import common
from studies.kept import show
from vibgym.policies import rollout
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.seeds import RANGES

TASK, LIMIT = "Swap", 0.2  # N s
ENVIRONMENT: dict[str, Any] = {
    "costs": {"impulse": 1.0},
    "task_settings": {"weights": {"success": 20.0, "fallen": 20.0}},
}
POLICIES: dict[str, Any] = {
    "learned, unconstrained": "learned",
    f"learned, limit {LIMIT:g} N s": {"kind": "learned", "variant": "gentle"},
    "`lanes`": {"kind": "lanes", "action": "velocity"},
}


def row(name: str, episodes: int) -> list[str]:
    """Run a policy and format its row."""
    seeds = RANGES["held_out"][:episodes]
    found: MeasuredOutcomes = rollout(POLICIES[name], TASK, seeds=seeds, keep=Measures, **ENVIRONMENT)
    within = found.cost <= LIMIT
    share = exact(int(within.sum()), episodes, 0.95)
    return [
        name,
        f"{np.median(found.cost):.3f} ({np.quantile(found.cost, 0.05):.3f} to {np.quantile(found.cost, 0.95):.3f})",
        f"{100 * within.mean():.1f} % ({100 * share.low:.1f} to {100 * share.high:.1f})",
        f"{found.returns.mean():.2f}",
        quantity(found.success.mean(), 100.0, 1, "%"),
        quantity(quartiles(found.time_to_goal).median, 1.0, 2, "s"),
        f"{episode_scores(found).mean():.3f}",
        f"{np.where(found.cost <= LIMIT, episode_scores(found), 0.0).mean():.3f}",
        f"{found.collisions.mean():.1f}",
        f"{found.action_change.mean():.3f}",
        f"{found.overshoots.mean():.1f}; {found.corrections.mean():.1f}",
    ]


HEADS = (
    "Swap", "impulse an episode, N s: median (5 to 95 %)", "within the limit", "return", "success", "time to goal", "score",
    "at limited cost", "collisions", "change of commands", "overshoots; corrections",
)  # fmt: skip


def main() -> None:
    """Evaluate and print; with ``--keep`` write the table of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=500)
    asked = parser.parse_args()
    show("constrained", HEADS, [row(name, asked.episodes) for name in POLICIES], asked.keep)


if __name__ == "__main__":
    main()
