"""Times to goal as multiples of the lower bound, and no episode below it."""

import gymnasium as gym
import numpy as np
import pytest

from tests.policies.helpers import FRESH, POSE_TASKS
from vibgym import Surface
from vibgym.policies.measures import Measures, least_times
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo

PROTOTYPE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}


@pytest.mark.parametrize("task", POSE_TASKS)
@pytest.mark.parametrize(("content", "settings"), [
    ("local_field", {}),
    ("local_field", PROTOTYPE),
    ("vibgym/policies/trained/shipped/{}.json", {}),
    ("vibgym/policies/trained/shipped/{}-prototype.json", PROTOTYPE),
])  # fmt: skip
def test_no_policy_beats_the_bound(task, content, settings):
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=1, **settings)
    policy = make_policy(content.format(task.lower()), TaskInfo.of(env, task))
    result = rollout(policy, task, seeds=range(FRESH + 5000, FRESH + 5040), keep=Measures, **settings)
    assert result.success.mean() > 0.95
    multiple = result.time_over_bound[result.success]
    assert (multiple > 1.0 - 1e-9).all()
    assert np.median(multiple) < {"Transport": 1.1, "Align": 1.15, "Rotate": 1.5}[task]  # else it would say little


@pytest.mark.parametrize(("task", "settings"), [
    ("Sort", {}),
    ("Transport", {"model": "averaged"}),
    ("Transport", {"randomize": {"friction": [0.8, 1.2]}}),
    ("Transport", {"randomize": {"incline": 0.01}}),
    ("Transport", {"surface": Surface(horizontal_amplitude=3e-4)}),
])  # fmt: skip
def test_where_no_bound_is_known(task, settings):
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=3, **settings)
    env.reset(seed=0)
    assert np.isnan(least_times(env.unwrapped)).all()


@pytest.mark.parametrize(("actuators", "drawn", "amplitude", "latency"), [
    ({}, None, 0.25e-3, 1),
    ({"gain_spread": 0.0}, None, 0.2e-3, 1),
    ({"gain_spread": 0.0, "latency": 4}, None, 0.2e-3, 4),
    ({"gain_spread": 0.0, "stuck": 0.1}, None, 0.25e-3, 0),
    ({"gain_spread": 0.0, "stuck": [[0, 0, 1e-4, 0.0]]}, None, 0.25e-3, 0),
    # Of what is drawn, that which helps most counts.
    ({"gain_spread": 0.0}, {"limit": [0.15e-3, 0.22e-3], "latency": [2, 3]}, 0.22e-3, 2),
])  # fmt: skip
def test_what_hardware_can_do_at_most(actuators, drawn, amplitude, latency):
    made, surface = {"kind": "prototype", "limit": 0.2e-3, **actuators}, Surface(max_amplitude=0.25e-3)
    env = gym.make_vec("vibgym/Transport-v0", num_envs=2, surface=surface, actuators=made, randomize=drawn)
    limits = env.unwrapped.core.actuators
    assert (limits.most_amplitude, limits.least_latency) == (amplitude, latency)
