"""Laws by name: where each one stands in the chain, and what it reaches."""

import dataclasses

import numpy as np
import pytest

from tests.policies.helpers import POSE_TASKS, episodes, info_of
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.steering import LAWS, LocalFieldPolicy
from vibgym.policies.registry import make_policy

HARDWARE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}
NAMED = ("pose", "lqr", "pid")


@pytest.mark.parametrize("name", NAMED)
def test_one_part_goes_straight_and_several_are_planned(name):
    alone, several = make_policy(name, info_of("Align")), make_policy(name, info_of("Sort"))
    assert type(alone) is LocalFieldPolicy and type(several) is PlannerPolicy
    assert type(alone.law) is type(several.law) is type(LAWS.choose("law", name)(info_of("Align")))
    with pytest.raises(ValueError, match=f"policy '{name}'.*'law'"):
        make_policy({"kind": name, "law": "local"}, info_of("Align"))
    with pytest.raises(ValueError, match=f"law '{name}'.*colour"):
        make_policy({"kind": name, "colour": 1}, info_of("Align"))


def test_planners_ask_laws_for_the_velocities_that_they_set():
    """A place ``lead v`` ahead of a part that moves with v is as good as nothing to do."""
    for name in LAWS:
        policy = make_policy({"kind": "local_field", "law": name}, info_of("Transport"))
        if name in ("pid"):
            continue  # it sees positions only, and needs steps to know a velocity
        rest = Measured.of(np.zeros((1, policy.info.layout.size)), policy.info)
        velocity = np.array([[[0.05, -0.02]]])
        moving = dataclasses.replace(rest, velocity=velocity, present=np.ones((1, 1), dtype=bool))
        memory = policy.law.initial(1)
        wanted, _ = policy.law.wanted(moving, policy.law.lead * velocity, np.zeros((1, 1)), memory)
        assert np.abs(wanted).max() < 0.02 * 9.81 * 0.05, name


@pytest.mark.parametrize("task", POSE_TASKS)
@pytest.mark.parametrize("hardware", [{}, HARDWARE], ids=["ideal", "prototype"])
@pytest.mark.parametrize("name, most", [("pose", 1.6), ("lqr", 1.7)])
def test_they_reach_the_goal(name, most, hardware, task):
    outcome = episodes(make_policy(name, info_of(task, **hardware)), task, 60, **hardware)
    assert outcome.success == 60 and outcome.time < most


def test_pid_reaches_goals_with_anti_windup_by_default():
    for task in ("Transport", "Align"):
        assert episodes(make_policy("pid", info_of(task)), task, 30).success == 30
    without = make_policy({"kind": "pid", "anti_windup": False}, info_of("Transport"))
    assert episodes(without, "Transport", 30).success < 28


@pytest.mark.parametrize("name", ["pose", "lqr"])
def test_they_sort_under_the_planner_on_the_prototype(name):
    outcome = episodes(make_policy(name, info_of("Sort", **HARDWARE)), "Sort", 12, **HARDWARE)
    assert outcome.success == 12
