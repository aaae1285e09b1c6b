"""Success on shapes that are new to a policy: ``python -m studies.benchmarks.shapes [--episodes 500]``.

Controllers and agents run on the training split, on the test split (other parts of the same families), and on the held-out
family: ideal hardware, seeds from 300000. Intervals of success are bootstraps over shapes, since episodes with the same shape
are correlated; where all rates are equal, exact intervals.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from gymnasium.utils.seeding import np_random

from agents.evaluation.statistics import Interval, bootstrap, episode_scores, exact, quartiles
from agents.evaluation.table import quantity
from studies.benchmarks import common
from studies.kept import show
from vibgym.envs.drawn import drawn_shapes
from vibgym.policies import rollout
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.scene.library import FAMILIES, shapes
from vibgym.scene.library import SPLITS as LIBRARY
from vibgym.seeds import RANGES

SPLITS = ("train", "test", "held_out")
LEVEL, RESAMPLES = 0.95, 9999
PITCH, ACROSS = 92.0, 16
"""mm between the parts of the picture, and parts in a row."""

POLICIES: dict[str, dict[str, Any]] = {
    "AlignShapes": {
        "`pose`": {"kind": "pose", "action": "velocity"},
        "`lqr`": "lqr",
        "generalist (learned)": "learned",
    },
    "SortShapes": {"`planner`, `pose`": {"kind": "planner", "law": "pose"}, "learned": "learned"},
    "PackShapes": {"`two_phases`": "two_phases", "learned": "learned"},
    "PushShapes": {"`push`": "push", "learned": "learned"},
}


def first_shapes(task: str, split: str, seeds: Sequence[int]) -> np.ndarray:
    """Return the index of the first shape of each seed's episode, (seeds,)."""
    drawn = drawn_shapes(f"vibgym/{task}-v0", {"split": split})
    assert drawn is not None
    return drawn.draw(np.array([np_random(seed)[0].random(drawn.draws) for seed in seeds]))[:, 0]


def interval(success: np.ndarray, shape: np.ndarray) -> Interval:
    """Return the interval of a success rate for other shapes, from episodes (n,) and their shapes."""
    rates = np.array([success[shape == k].mean() for k in np.unique(shape)])
    if np.ptp(rates) == 0.0:
        return exact(int(success.sum()), success.size, LEVEL)
    return bootstrap(rates, LEVEL, RESAMPLES)


def row(task: str, name: str, episodes: int) -> list[str]:
    """Run a policy on all splits and format its row."""
    seeds, cells, rates = RANGES["held_out"][:episodes], [], {}
    for split in SPLITS:
        found: MeasuredOutcomes = rollout(POLICIES[task][name], task, seeds=seeds, keep=Measures, split=split)
        shape = first_shapes(task, split, seeds)
        spread, rates[split] = interval(found.success, shape), 100.0 * found.success.mean()
        time = quantity(quartiles(found.time_to_goal).median, 1.0, 2, "s")
        score = episode_scores(found).mean()
        cells.append(f"{rates[split]:.1f} % ({100 * spread.low:.1f} to {100 * spread.high:.1f}), {time}")
        cells[-1] += "" if np.isnan(score) else f", {score:.3f}"
        failed = np.unique(shape[~found.success], return_counts=True)
        print(task, name, split, cells[-1], *(f"{shapes(split)[k].name} x {n}" for k, n in zip(*failed, strict=True)))
    return [name, *cells, f"{rates['held_out'] - rates['test']:+.1f}"]


def picture(path: Path) -> None:
    """Draw all parts of the library to scale, a row or more for each split."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11.0, 6.4), layout="constrained")
    axes, row = figure.subplots(), 0
    for split in LIBRARY:
        for k, part in enumerate(shapes(split)):
            x, y = 1e3 * part.outline.T + np.array([[PITCH * (k % ACROSS)], [-PITCH * (row + k // ACROSS)]])
            axes.fill(x, y, color=f"C{list(FAMILIES).index(part.name.split('-')[0])}")
        axes.text(-0.6 * PITCH, -PITCH * row, split.replace("_", " "), rotation=90, ha="center", va="center")
        row += -(-len(shapes(split)) // ACROSS)
    axes.set(aspect="equal", xlim=(-0.8 * PITCH, (ACROSS - 0.4) * PITCH), ylim=(-(row - 0.4) * PITCH, 0.6 * PITCH))
    axes.set_axis_off()
    figure.savefig(path, dpi=90)


def main() -> None:
    """Evaluate and print; with ``--keep`` write the tables of the documentation, one for each task."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=500)
    parser.add_argument("--only", nargs="+", default=list(POLICIES), choices=list(POLICIES))
    parser.add_argument("--picture", type=Path, metavar="PNG", help="draw the library instead, as in docs/shapes.png")
    asked = parser.parse_args()
    if asked.picture is not None:
        picture(asked.picture)
        return
    for task in asked.only:
        lines = [row(task, name, asked.episodes) for name in POLICIES[task]]
        heads = (f"{task}: policy", *(split.replace("_", " ") for split in SPLITS), "held out less test, points")
        show(f"shapes-{task.removesuffix('Shapes').lower()}", heads, lines, asked.keep)


if __name__ == "__main__":
    main()
