"""Value of memory without an estimator: ``python -m studies.benchmarks.memory [--processes 2]``, half an hour on one idle core.

Agents learn Align with ``field`` from scratch where measurements are late or missing, and no estimator predicts the state. They
differ in what their rows contain of earlier steps. The forces of ``field`` do not depend on the measured velocity: apart from
their aim, the last measurement and the actions since determine the state. (``velocity`` closes a control loop on the measured
velocity inside the environment, which oscillates with a delay.)

The number of steps n is not tuned. With a delay of d periods, d actions have been applied since the sample; one more because a
measured velocity is a mean over the period before. With dropouts the last reading is older: as many more steps as samples in a
row are missed with a probability of at most 1 %.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from agents import parallel
from agents.evaluation.statistics import quartiles, success_interval
from agents.evaluation.table import quantity
from agents.ppo import PPO
from agents.training_file import settings_from
from studies import common
from studies.common import LEVEL, RESAMPLES
from studies.kept import show
from vibgym.policies import rollout
from vibgym.policies.rollout import Outcomes
from vibgym.seeds import RANGES

TASK, WORLDS, FIRST_TRAINING = "Align", 128, 10
MISSED = 0.01
ACTION = {"action": "field"}
LEARNING = {
    "n_steps": 32, "batch_size": 1024, "n_epochs": 4, "learning_rate": 5e-4, "final_learning_rate": 1e-4, "gamma": 0.99,
    "target_kl": 0.02, "log_std_init": -1.0, "activation": "relu", "turned": True, "dropped_columns": ["position"],
}  # fmt: skip
RECALLED = ["way_fine", "turn_fine", "velocity", "spin"]


class Condition(NamedTuple):
    """Errors of the sensor."""

    delay: int = 0  # periods
    dropout: float = 0.0  # probability that a sample misses the part

    def __str__(self) -> str:
        words = [f"delay {self.delay}"] * (self.delay > 0) + [f"dropout {100 * self.dropout:.0f} %"] * (
            self.dropout > 0
        )
        return ", ".join(words) or "ideal"

    @property
    def steps(self) -> int:
        """Earlier steps of which the actions determine the state; longer series of misses are less likely than ``MISSED``."""
        missed = math.ceil(math.log(MISSED) / math.log(self.dropout) - 1e-9) if self.dropout else 0
        return self.delay + 1 + missed

    def sensor(self, estimator: str = "none") -> dict[str, Any]:
        """Return the environment's ``sensor``; without an estimator, agents get the age of readings that may be missing."""
        report = ["age"] if self.dropout and estimator == "none" else []
        return {"kind": "ideal", "delay": self.delay, "dropout": self.dropout, "report": report, "estimator": estimator}


IDEAL = Condition()
CONDITIONS = (
    IDEAL, Condition(1), Condition(2), Condition(4),
    Condition(0, 0.1), Condition(0, 0.3), Condition(0, 0.5), Condition(2, 0.3),
)  # fmt: skip
HARDEST = (Condition(4), Condition(0, 0.5), Condition(2, 0.3))
"""In these, agents are also trained with earlier measurements."""

MEMORIES = ("no memory", "last action", "n actions", "n actions and measurements")
CONTROLLER = "pose"
ESTIMATORS = ("none", "kalman", "model")


def trained(name: str, condition: Condition) -> bool:
    """Return whether agents with this memory are trained in a condition."""
    if name == MEMORIES[0]:
        return True
    return condition in HARDEST if name == MEMORIES[-1] else condition != IDEAL


def memory(name: str, condition: Condition) -> dict[str, Any]:
    """Return the settings of a network's rows."""
    steps = {"no memory": 0, "last action": 1}.get(name, condition.steps)
    age = ["age"] if condition.dropout else []
    return {"history": steps, "history_columns": [*RECALLED, *age] if name.endswith("measurements") else []}


def play(policy: Any, condition: Condition, estimator: str, episodes: int) -> Outcomes:
    """Run a policy on new seeds."""
    seeds = RANGES["held_out"][:episodes]
    environment = ACTION if policy != CONTROLLER else {}
    return rollout(policy, TASK, seeds=seeds, sensor=condition.sensor(estimator), **environment)


def learn(
    condition: Condition, name: str, seed: int, steps: int, episodes: int
) -> dict[tuple[Condition, str], Outcomes]:
    """Train an agent; return its outcomes by condition and estimator.

    The agent without memory of the ideal condition is also run in all others with the estimator of the model.
    """
    own = {"environment": {**ACTION, "sensor": condition.sensor()}, "ppo": {**LEARNING, **memory(name, condition)}}
    learner = PPO(settings_from({"task": TASK, "worlds": WORLDS, "steps": steps, "seed": seed, **own}))
    try:
        learner.learn(steps, lambda metrics: None)
        policy = learner.acting()
    finally:
        learner.close()
    cases = [(condition, "none")]
    if (condition, name) == (IDEAL, MEMORIES[0]):
        cases += [(other, "model") for other in CONDITIONS[1:]]
    played = {case: play(policy, *case, episodes) for case in cases}
    print(f"{condition}; {name}, training {seed}: {cell([played[cases[0]]])}", flush=True)
    return played


def cell(runs: Sequence[Outcomes]) -> str:
    """Format outcomes of several trainings on the same seeds: success with interval, median time, position error."""
    success = np.array([run.success for run in runs])
    spread = success_interval(success, LEVEL, RESAMPLES)
    times, errors = (
        np.concatenate([getattr(run, name) for run in runs]) for name in ("time_to_goal", "position_error")
    )
    return f"{common.outcome(success, times, 1, spread)}, {quantity(quartiles(errors).median, 1e3, 1, 'mm')}"


def main() -> None:
    """Train, evaluate and print; with ``--keep`` write the tables of the documentation."""
    parser = common.parser(__doc__)
    parser.add_argument("--episodes", type=int, default=200)
    parser.add_argument("--steps", type=int, default=300_000, help="of a training")
    parser.add_argument("--seeds", type=int, default=3, help="trainings of each agent")
    parser.add_argument("--processes", type=int, default=1)
    asked = parser.parse_args()
    seeds = range(FIRST_TRAINING, FIRST_TRAINING + asked.seeds)
    cases = [(condition, name) for condition in CONDITIONS for name in MEMORIES if trained(name, condition)]
    items = [(*case, seed, asked.steps, asked.episodes) for case in cases for seed in seeds]
    results = parallel.run(learn, items, workers=asked.processes)
    cells = dict.fromkeys(product(CONDITIONS, MEMORIES), "–")
    for k, case in enumerate(cases):
        cells[case] = cell([result[case[0], "none"] for result in results[k * asked.seeds : (k + 1) * asked.seeds]])
    lines = [
        [str(condition), str(condition.steps), *(cells[condition, name] for name in MEMORIES)]
        for condition in CONDITIONS
    ]
    show("memory", ("hardware", "n", *MEMORIES), lines, asked.keep)
    lines = []
    for condition in CONDITIONS[1:]:
        controller = (cell([play(CONTROLLER, condition, estimator, asked.episodes)]) for estimator in ESTIMATORS)
        lines.append(
            [str(condition), *controller, cell([usual[condition, "model"] for usual in results[: asked.seeds]])]
        )
    heads = ("hardware", *(f"`{CONTROLLER}`, estimator `{estimator}`" for estimator in ESTIMATORS))
    show("memory-estimators", (*heads, "no memory, estimator `model`"), lines, asked.keep)


if __name__ == "__main__":
    main()
