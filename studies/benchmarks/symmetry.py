"""Effect of symmetries on imitation with few samples: ``python -m studies.benchmarks.symmetry``.

A network imitates the law ``pose`` in Align: with or without the position on the table as an input (shifts by whole elements),
and with or without rotations by quarter turns (``policies/trained/symmetry.py``). Output over several seeds: error of actions
on new steps of the law, success in new episodes, and their median time.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import torch

from agents.evaluation.table import quantity
from agents.imitation import Demonstrations, Imitation, ImitationSettings, experts
from agents.ppo import PPO
from agents.training_settings import TrainSettings
from studies import common
from studies.kept import show
from vibgym.policies.rollout import rollout

VARIANTS: dict[str, dict[str, Any]] = {
    "none": {},
    "whole elements": {"dropped_columns": ["position"]},
    "quarter turns": {"turned": True},
    "both": {"dropped_columns": ["position"], "turned": True},
}
EXPERT = {"kind": "pose", "action": "wrench"}
TESTED = 40
"""Steps of each world on which the error of actions is measured."""


def learn(variant: dict[str, Any], worlds: int, steps: int, seed: int) -> tuple[float, float, float]:
    """Train; return the error on new steps, the success rate, and the median time to goal (s)."""
    settings = TrainSettings(
        task="Align",
        environment={"action": "wrench"},
        worlds=worlds,
        steps=1,
        seed=seed,
        imitation=ImitationSettings(expert=EXPERT, rounds=1, steps=steps, epochs=100, noise=0.1, batch_size=512),
        own=PPO.Settings(activation="relu", history=True, **variant),
    )
    assert settings.imitation is not None
    learner = PPO(settings)
    teachers = experts(settings.imitation, settings.action, settings.seed, learner.env)
    imitation = Imitation(learner.policy, teachers, settings.imitation, seed)
    for _ in imitation.rounds():
        pass
    scene = imitation.scenes[0]
    scene.begin(10**6 + seed)
    samples, coding = TESTED * worlds, learner.policy.coding
    fresh = Demonstrations(
        np.empty((samples, 1, coding.shape.columns), dtype=coding.dtype),
        np.empty((samples, 1), dtype=np.float32),
        np.empty((samples, 1, coding.shape.action), dtype=np.float32),
    )
    scene.collect(learner.policy, fresh, 0.1, 0.0)
    with torch.no_grad():
        mean, _ = learner.policy.actor(torch.from_numpy(fresh.rows))
    error = float(np.sqrt(((mean.numpy() - fresh.action) ** 2).mean()))
    result = rollout(learner.acting(), "Align", seeds=range(700_000, 700_100))
    time = float(np.nanmedian(result.time_to_goal)) if result.success.any() else np.nan
    return error, float(result.success.mean()), time


HEADS = ("samples", "symmetry", "error of actions", "success", "of each seed", "time to goal")


def main() -> None:
    """Train, evaluate and print."""
    parser = common.parser(__doc__)
    parser.add_argument("--worlds", type=int, nargs="+", default=[16, 64], help="worlds of the expert's episodes")
    parser.add_argument("--steps", type=int, default=60, help="per world")
    parser.add_argument("--seeds", type=int, default=3)
    asked = parser.parse_args()
    lines = []
    for worlds in asked.worlds:
        for name, variant in VARIANTS.items():
            values = np.array([learn(variant, worlds, asked.steps, seed) for seed in range(asked.seeds)])
            error, success, time = values.mean(axis=0)
            lines.append([
                str(worlds * asked.steps),
                name,
                f"{error:.3f}",
                quantity(success, 100.0, 1, "%"),
                ", ".join(f"{100 * value:.0f}" for value in values[:, 1]) + " %",
                quantity(time, 1.0, 2, "s"),
            ])  # fmt: skip
    show("symmetry", HEADS, lines, asked.keep)


if __name__ == "__main__":
    main()
