"""Variants of registered tasks: ``python -m studies.benchmarks.variants [--episodes 100]``.

Pack with other gaps, starts and headings, Feed with other numbers of parts, and planning by simulation (``mpc``). Seeds from
300000, which are not used for tuning.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.statistics import quartiles
from agents.evaluation.table import number, quantity
from studies.benchmarks import common
from studies.benchmarks.common import HARDWARE
from studies.kept import show
from vibgym.policies import rollout
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.seeds import RANGES

GAPS_MM = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 37.0)
PACKERS: dict[str, Any] = {
    "two phases": "two_phases",
    "planner": {"kind": "planner", "law": "pose"},
    "independent": {"kind": "local_field", "law": "pose"},
}
KINDS = ["aluminium_block"] * 6 + ["steel_block"] * 6


class Case(NamedTuple):
    """Policy on a variant of a task."""

    name: str
    policy: Any
    task: str
    environment: dict[str, Any]
    share: float = 1.0  # of the episodes of --episodes


PACKS = (
    Case('`action="wrench"`', {"kind": "two_phases", "action": "wrench"}, "Pack", {}),
    Case('`start="crowded"`', "two_phases", "Pack", {"start": "crowded"}),
    Case('`start="pattern"`: unpacked and packed elsewhere', "two_phases", "Pack", {"start": "pattern"}),
    Case(
        "`heading_deg: 90`: four parts fill the width", "two_phases", "Pack", {"task_settings": {"heading_deg": 90.0}}
    ),
    Case("two kinds of six, each with its own columns", "two_phases", "Pack", {"parts": KINDS}),
    Case("`free: false`: every part has its own goal", "two_phases", "Pack", {"task_settings": {"free": False}}),
)
FEEDS = (
    *(
        Case(str(n), "lanes", "Feed", {"parts": ["steel_block", "aluminium_block"] * (n // 2)})
        for n in (4, 6, 8, 12, 18)
    ),
    Case("18 in heaps (`FeedHeaps-v0`)", "lanes", "FeedHeaps", {}),
    Case("18 in heaps, prototype", "lanes", "FeedHeaps", HARDWARE["prototype"]),
)


def planned(base: str | None = None, samples: int = 32, horizon: int = 12) -> dict[str, Any]:
    """Return the settings of the policy that plans by simulation."""
    return {"kind": "mpc", "samples": samples, "horizon": horizon, "base": base}


PLANS = (
    Case("Align, alone", planned(), "Align", {}, 0.5),
    Case("Align, on `pose`", planned("pose"), "Align", {}, 0.2),
    Case("Pack (12 parts), alone, 16 x 10 x 2", planned(None, 16, 10), "Pack", {}, 0.02),
    Case("Pack, on `two_phases`, 16 x 10 x 2", planned("two_phases", 16, 10), "Pack", {}, 0.04),
    Case("Swap (16 parts), alone, 16 x 10 x 2", planned(None, 16, 10), "Swap", {}, 0.02),
    Case("Swap, on `lanes`, 16 x 10 x 2", planned("lanes", 16, 10), "Swap", {}, 0.02),
)


def played(case: Case, episodes: int) -> MeasuredOutcomes:
    """Run the episodes of a case."""
    seeds = RANGES["held_out"][: max(1, round(case.share * episodes))]
    return rollout(case.policy, f"vibgym/{case.task}-v0", seeds=seeds, keep=Measures, **case.environment)


def ends(found: MeasuredOutcomes) -> list[str]:
    """Format success, time, time over bound, collisions and episodes."""
    return [
        quantity(found.success.mean(), 100.0, 1, "%"),
        quantity(quartiles(found.time_to_goal).median, 1.0, 2, "s"),
        quantity(quartiles(found.time_over_bound).median, 1.0, 2, ""),
        number(float(found.collisions.mean()), 2),
        str(len(found.success)),
    ]


END_HEADS = ("success", "time to goal", "over bound", "collisions", "episodes")


def gaps(episodes: int, keep: bool) -> None:
    """Pack over the gap: success and time of three policies."""
    lines = []
    for gap in GAPS_MM:
        settings = {"gap_mm": gap, **({"rows": 2} if gap > 36.0 else {})}
        cells = []
        for policy in PACKERS.values():
            found = played(Case("", policy, "Pack", {"task_settings": settings}, 0.5), episodes)
            time = quantity(quartiles(found.time_to_goal).median, 1.0, 2, "s")
            cells.append(f"{quantity(found.success.mean(), 100.0, 0, '%')} ({time})")
        lines.append([f"{gap:g}" + (" (two rows)" if "rows" in settings else ""), *cells])
    show("variants-gaps", ("Pack: gap, mm", *PACKERS), lines, keep)


def pack(episodes: int, keep: bool) -> None:
    """Other variants of Pack."""
    lines = [[case.name, *ends(played(case, episodes))] for case in PACKS]
    show("variants-pack", ("two phases, gap 2 mm", *END_HEADS), lines, keep)


def feed(episodes: int, keep: bool) -> None:
    """Feed over the number of parts."""
    lines = []
    for case in FEEDS:
        found = played(case._replace(share=0.5), episodes)
        good = found.reported("good_per_minute")
        faulty = sum(found.reported(f"{kind}_per_minute") for kind in ("tilted", "close", "wrong", "lost"))
        lines.append([
            case.name,
            f"{good.mean():.1f} ({good.min():.1f} to {good.max():.1f})",
            f"{np.mean(faulty):.1f}",
            f"{found.reported('transit').mean():.2f} s",
            f"{found.reported('on_table').mean():.1f}",
            quantity(quartiles(found.rate_over_bound).median, 100.0, 0, "%"),
            str(len(good)),
        ])  # fmt: skip
    heads = (
        "parts", "good per minute: mean (min to max)", "faulty", "transit", "on the table", "of the bound", "episodes"
    )  # fmt: skip
    show("variants-feed", heads, lines, keep)


def plans(episodes: int, keep: bool) -> None:
    """Planning by simulation."""
    lines = [[case.name, *ends(played(case, episodes))] for case in PLANS]
    show("variants-mpc", ("ideal hardware", *END_HEADS), lines, keep)


TABLES: dict[str, Callable[[int, bool], None]] = {"gaps": gaps, "pack": pack, "feed": feed, "mpc": plans}


def main() -> None:
    """Evaluate and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=100, help="of most variants; slow ones have fewer")
    parser.add_argument("--only", nargs="+", default=list(TABLES), choices=list(TABLES))
    asked = parser.parse_args()
    for name in asked.only:
        TABLES[name](asked.episodes, asked.keep)


if __name__ == "__main__":
    main()
