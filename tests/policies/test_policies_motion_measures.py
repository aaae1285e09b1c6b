"""Costs, smoothness of commands, and corrective movements of episodes."""

import gymnasium as gym
import numpy as np
import pytest

from vibgym.policies import rollout
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import Episodes

COSTS = {"impulse": 1.0, "clearance": 0.1}


class Scripted:
    """Velocity along x by a table of values."""

    action, observation = "velocity", "state"

    def __init__(self, values):
        self.values = values

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        step = 0 if state is None else state
        action = np.zeros((len(observation), 3), dtype=np.float32)
        action[:, 0] = self.values[min(step, len(self.values) - 1)]
        return action, step + 1


def test_costs_and_changes_are_those_of_the_steps():
    found = rollout({"kind": "planner", "law": "pose"}, "SortCrowded", seeds=[3, 4], keep=Measures, costs=COSTS)
    for k, seed in enumerate((3, 4)):
        env = gym.make("vibgym/SortCrowded-v0", costs=COSTS, action="phasor")
        again = rollout({"kind": "planner", "law": "pose"}, "SortCrowded", seeds=[seed], keep=Measures, costs=COSTS)
        assert again.cost[0] == found.cost[k] > 0.0 and again.action_change[0] == found.action_change[k] > 0.0
        assert env.unwrapped.core.costs is not None
    assert np.isnan(found.overshoots).all() and np.isnan(found.corrections).all()
    assert np.isnan(rollout("pose", "Align", seeds=[1], keep=Measures).cost).all()


def test_a_law_without_detours_has_no_corrections():
    found = rollout({"kind": "pose", "action": "velocity"}, "Transport", seeds=range(20), keep=Measures)
    assert found.success.all() and (found.overshoots == 0).all() and np.median(found.corrections) == 0
    assert (found.collisions == 0).all() or np.isnan(found.collisions).all()


@pytest.mark.parametrize(("values", "overshoots", "corrections"), [
    ([0.5] * 30 + [0.0] * 30, 1, 0),  # over the goal and away
    ([0.5] * 30 + [-0.5] * 25 + [0.0] * 10, 2, 1),  # and back over it
    ([-0.5] * 8 + [0.5] * 8 + [-0.5] * 8 + [0.5] * 8 + [0.0] * 9, 0, 2),  # to and fro before the goal
])  # fmt: skip
def test_corrective_movements_are_counted(values, overshoots, corrections):
    env = gym.make_vec(
        "vibgym/Transport-v0", num_envs=1, action="velocity", autoreset_mode="Disabled", max_episode_steps=len(values)
    )
    start = {"pose": [[0.3, 0.104, 0.0]], "goal": [[0.34, 0.104, 0.0]]}
    kept = []
    episodes = Episodes(
        Scripted(values),
        env,
        [0],
        lambda _, __, info: kept.append(Measures(env.unwrapped, info, [0])),
        options=start,
    )
    for step in episodes:
        kept[0].add(step)
    found = kept[0].result("Transport", episodes.timing)
    assert found.overshoots[0] == overshoots and found.corrections[0] == corrections
    changes = np.abs(np.diff(np.float32(values).astype(float))).sum() / (len(values) - 1) / 3
    assert found.action_change[0] == pytest.approx(changes)
