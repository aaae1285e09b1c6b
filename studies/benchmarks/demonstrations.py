"""Success against the number of demonstrations: ``python -m studies.benchmarks.demonstrations [--processes 2]``.

Policies learn Push from episodes of the rule (``configs/recordings/push.yaml``), and Transport from images of episodes of a
controller (``configs/recordings/images.yaml``). Data sets are recorded first if they are missing. The methods are those of
``configs/agents/demonstrations.yaml``, with several seeds each. Policies play seeds from 300000. A run takes minutes to a
quarter of an hour; finished runs in the output directory are not repeated.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import numpy as np

from agents import parallel
from agents.evaluation.statistics import success_interval
from agents.offline import DataLearner
from agents.recording import record
from agents.train import Training
from agents.training_file import load_settings
from studies import common
from studies.common import LEVEL, RESAMPLES
from studies.kept import show
from vibgym.policies import rollout
from vibgym.policies.rollout import Outcomes
from vibgym.seeds import RANGES

CONFIG = Path("configs/agents/demonstrations.yaml")
RECORDINGS = {"Push": Path("configs/recordings/push.yaml"), "Transport": Path("configs/recordings/images.yaml")}


class Method(NamedTuple):
    """A method and the numbers of demonstrations that it is given."""

    title: str
    counts: tuple[int, ...]


METHODS = {
    "Push": {
        "flow": Method("flow matching, one row for all", (1000, 200)),
        "cloned": Method("cloning, one row for all", (1000, 200)),
        "iql": Method("IQL, one row for all", (1000,)),
        "apart": Method("cloning, a row for each part", (1000,)),
    },
    "Transport": {"flow": Method("flow matching, images", (200, 20)), "cloned": Method("cloning, images", (200, 20))},
}
"""Methods by task and name in the training file."""


def recorded(task: str, directory: Path) -> None:
    """Record the demonstrations, unless they are there."""
    settings = record.load_settings(RECORDINGS[task])
    if not (directory / settings.dataset).is_dir():
        record.record(settings.model_copy(update={"directory": str(directory)}))


def learn(task: str, method: str, count: int, seed: int, steps: int | None, episodes: int, output: Path) -> Outcomes:
    """Train on the first ``count`` demonstrations, and play; a finished run is not repeated."""
    settings = load_settings(CONFIG, f"{task}/{method}", seed)
    assert isinstance(settings.own, DataLearner.Settings)
    own = settings.own.model_copy(update={"episodes": count, "directory": str(output / "data")})
    settings = settings.model_copy(update={"own": own, "steps": steps or settings.steps, "selection": None})
    with Training(settings, output / f"{task}-{method}-{count}" / f"seed-{seed}", quiet=True) as training:
        path = training.run()
    result = rollout({"kind": "trained", "path": str(path)}, task, seeds=RANGES["held_out"][:episodes])
    print(f"{task}, {method}, {count} demonstrations, seed {seed}: {cell([result])}", flush=True)
    return result


def cell(runs: Sequence[Outcomes]) -> str:
    """Return success with its interval, that of each training, and the median time of successes."""
    success = np.stack([run.success for run in runs]).astype(np.float64)
    spread = success_interval(success, LEVEL, RESAMPLES)
    times = np.concatenate([outcomes.time_to_goal for outcomes in runs])
    rates = ", ".join(f"{100 * rate:.0f}" for rate in success.mean(axis=1))
    return common.outcome(success, times, 1, spread, f"; {rates}")


def main() -> None:
    """Record, train, evaluate and print; with ``--keep`` write the table of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--tasks", nargs="+", choices=list(METHODS), default=list(METHODS))
    parser.add_argument("--methods", nargs="+", choices=list(METHODS["Push"]), default=list(METHODS["Push"]))
    parser.add_argument("--counts", nargs="+", type=int, help="numbers of demonstrations; default: those of the method")
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each")
    parser.add_argument("--steps", type=int, help="updates of a training, instead of those of the file")
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--processes", type=int, default=1)
    parser.add_argument("--output", type=Path, default=Path("runs/demonstrations"))
    asked = parser.parse_args()
    for task in asked.tasks:
        lines = []
        recorded(task, asked.output / "data")
        cases = [
            (name, count)
            for name in METHODS[task]
            if name in asked.methods
            for count in asked.counts or METHODS[task][name].counts
        ]
        calls = [
            (task, *case, seed, asked.steps, asked.episodes, asked.output)
            for case in cases
            for seed in range(asked.seeds)
        ]
        results = iter(parallel.run(learn, calls, workers=asked.processes))
        for name, count in cases:
            of_seeds = [next(results) for _ in range(asked.seeds)]
            lines.append([METHODS[task][name].title, f"{count}", cell(of_seeds)])
        policy = record.load_settings(RECORDINGS[task]).policy
        expert = rollout(policy, task, seeds=RANGES["held_out"][: asked.episodes])
        lines.append([f"`{policy['kind']}`, which gave the demonstrations", "", cell([expert])])
        heads = (f"{task}: policy", "demonstrations", "success; time to goal")
        show(f"demonstrations-{task.lower()}", heads, lines, asked.keep)


if __name__ == "__main__":
    main()
