"""PPO with a limit on costs: the multiplier, refusals, and the actor that is kept."""

import numpy as np
import pytest

from agents.learning_curve import rank
from agents.ppo import PPO
from agents.training_file import settings_from

PAIR = [{"shape": "disc", "radius_mm": 20, "friction": 0.6, "name": "disc"}] * 2
RUN = {
    "task": "Sort", "steps": 10_000, "worlds": 4,
    "environment": {"action": "velocity", "parts": PAIR, "costs": {"effort": 1.0}, "max_episode_steps": 8},
}  # fmt: skip


def learner(limit, **ppo):
    own = {"n_steps": 8, "batch_size": 64, "cost_limit": limit, "multiplier_rate": 0.5, **ppo}
    return PPO(settings_from({**RUN, "ppo": own}))


@pytest.mark.parametrize(("limit", "grows"), [(1e-4, True), (1e4, False)])
def test_the_multiplier_follows_the_excess(limit, grows):
    found = learner(limit)
    found.learn(96, lambda metrics: None)  # three updates; episodes end after eight steps
    assert found.multiplier == pytest.approx(1.5 if grows else 0.0)
    assert found.env.part_cost.shape == (4, 2)
    again = learner(limit)
    again.set_state(found.get_state())
    assert again.multiplier == found.multiplier
    for each in (found, again):
        each.env.close()


def test_costs_are_subtracted_from_the_rewards_with_the_multiplier():
    plain, costly = learner(None), learner(1e-4)
    costly.multiplier = 3.0
    for each in (plain, costly):
        each.env.seed(5)
        each.worlds.observation = each.env.reset()
    plain.collect()
    costly.collect()
    difference = plain.rollout.reward[0] - costly.rollout.reward[0]
    assert (difference > 0.0).all()  # elements move in the first step
    for each in (plain, costly):
        each.env.close()


@pytest.mark.parametrize(("changes", "named"), [
    ({"environment": {**RUN["environment"], "costs": None}}, "requires environment.costs"),
    ({"environment": {**RUN["environment"], "costs": {"clearance": {"weight": 1.0, "below": 5.0}}}}, "all elements rest"),
])  # fmt: skip
def test_limits_that_cannot_be_kept_are_refused(changes, named):
    with pytest.raises(ValueError, match=named):
        PPO(settings_from({**RUN, **changes, "ppo": {"cost_limit": 0.5}}))


def test_actors_within_the_limit_rank_before_others():
    rows = [
        {"success": 0.5, "speed": 0.2, "time_to_goal": 3.0, "cost": 0.2},
        {"success": 1.0, "speed": 0.4, "time_to_goal": 2.0, "cost": 0.21},
        {"success": 1.0, "speed": 0.5, "time_to_goal": 2.0, "cost": 0.9},
    ]
    assert sorted(rows, key=lambda row: rank(row, "speed", 0.2)) == rows
    assert np.argmin([rank(row, "speed")[2] for row in rows]) == 2
