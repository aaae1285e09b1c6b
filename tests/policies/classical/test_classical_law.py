"""Controllers: set velocities and headings, predictions over long steps, targets, and velocities from leads."""

import dataclasses

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import SURFACE, info_of
from vibgym.policies.classical.law import laws
from vibgym.policies.classical.measured import Measured
from vibgym.policies.classical.steering import LocalFieldPolicy, Steering
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.simulation.plant import TOP_SLIP


def steering(name="Sort", periods=1, **arguments):
    return Steering(info_of(name, periods_per_step=periods), Steering.Settings(**arguments))


def still(policy, worlds=1):
    """Return straight parts at rest at their goals, in the middle of the table."""
    shape = (worlds, len(policy.info.parts))
    rows = np.zeros((worlds, policy.info.layout.size))
    none = np.zeros((*shape, 2))
    return dataclasses.replace(
        Measured.of(rows, policy.info),
        present=np.ones(shape, dtype=bool), heading=np.zeros(shape), displacement=none, gap=np.full(shape, 0.1),
    )  # fmt: skip


def test_parts_can_stop_from_the_set_speed():
    law = steering(approach=1e3).law
    distance = np.linspace(0.001, 0.02, 6)
    speed = law.stopping_rate(distance, law.plant.push)
    assert speed**2 / (2.0 * law.plant.push) == pytest.approx(law.braking * distance)  # v^2 = 2 a d
    near = steering(approach=2.0).law.stopping_rate(np.full(6, 0.001), law.plant.push)
    assert near == pytest.approx(0.002)


def wanted(policy, measured, displacement):
    """Return the controller's accelerations for displacements (parts, 2) to the goal, in one world."""
    heading_error = policy._heading_error(measured)
    return policy.law.wanted(measured, np.tile(displacement, (1, len(policy.info.parts), 1)), heading_error, ())[0]


def test_set_velocities_are_within_the_top_speed():
    policy = steering()
    change = wanted(policy, still(policy), np.array([3.0, -4.0])) * policy.law.response[:, None]
    assert np.hypot(change[..., 0], change[..., 1]) == pytest.approx(TOP_SLIP * SURFACE.table_speed)
    assert change[..., 1] == pytest.approx(-4.0 / 3.0 * change[..., 0])


@pytest.mark.parametrize("task, turned", [("Sort", True), ("Transport", False), ("Align", True)])
def test_headings_are_controlled_and_several_parts_are_aligned(task, turned):
    policy = steering(task)
    rest = still(policy)
    skew = dataclasses.replace(rest, heading=rest.heading + 0.3)
    if task == "Align":
        skew = dataclasses.replace(skew, heading_error=np.full_like(rest.heading, -0.3))
    torque = wanted(policy, skew, np.zeros(2))[..., 2]
    assert (torque < 0.0).all() if turned else (torque == 0.0).all()


def test_touching_parts_do_not_turn():
    policy = steering()
    skew = dataclasses.replace(still(policy), heading=np.full((1, 6), 0.3))
    for gap, turns in ((0.1, True), (0.0, False)):
        action, _ = policy.steer(
            dataclasses.replace(skew, gap=np.full((1, 6), gap)), np.zeros((1, 6, 2)), policy.initial(1)
        )
        assert (np.abs(action) > 1e-9).any() == turns


@pytest.mark.parametrize("periods", [1, 2, 4, 8])
def test_the_velocity_does_not_overshoot_in_a_step(periods):
    """By first-order averages, a part from rest is not faster than the set velocity after a step."""
    policy = steering("Transport", periods)
    target = 0.05
    push = wanted(policy, still(policy), np.array([policy.law.lead * target, 0.0]))[0, 0, 0]
    drag = policy.law.plant.drag
    reached = push / drag * -np.expm1(-drag * 0.04 * periods)
    assert 0.5 * target < reached <= target * (1.0 + 1e-9)
    assert policy.ahead == pytest.approx(0.02 * (periods - 1))


def test_one_period_a_step_leaves_the_measurement_as_it_is():
    env = batch("Align", 4, action="field", periods_per_step=4)
    seen, _ = env.reset(seed=1)
    env.action_space.seed(1)
    seen, *_ = env.step(env.action_space.sample())
    measured = Measured.of(seen, TaskInfo.of(env))
    one, four = steering("Align"), steering("Align", 4)
    same, ahead = one.expected(measured, one.initial(4)), four.expected(measured, four.initial(4))
    assert (same.centre == measured.centre).all() and (same.heading_error == measured.heading_error).all()
    assert ahead.centre == pytest.approx(measured.centre + 0.06 * measured.velocity)
    assert ahead.centre + ahead.displacement == pytest.approx(measured.centre + measured.displacement)
    assert ahead.heading + ahead.heading_error == pytest.approx(measured.heading + measured.heading_error)


# -- targets -----------------------------------------------------------------------------------------------------------


def test_targets_are_goals_positions_in_zones_or_away_from_others():
    for name in ("Transport", "Sort", "Singulate"):
        env = batch(name, 5, action="field")
        seen, _ = env.reset(seed=2)
        policy = LocalFieldPolicy(TaskInfo.of(env))
        measured, truth = Measured.of(seen, policy.info), env.unwrapped.truth
        target = policy.targets(measured)
        if name == "Transport":
            assert target == pytest.approx(truth.goal[..., :2], abs=1e-6)
        elif name == "Sort":
            zone = policy.info.zones[list(policy.info.kind)]
            assert (target >= zone[:, :2] + 0.03 - 1e-9).all() and (target <= zone[:, 2:] - 0.03 + 1e-9).all()
        else:
            spread = lambda places: np.linalg.norm(places - places.mean(axis=1, keepdims=True), axis=-1).mean()  # noqa: E731
            assert spread(target) > 1.2 * spread(truth.pose[..., :2])


# -- what it achieves --------------------------------------------------------------------------------------------------


def test_controllers_realise_the_velocities_of_planners():
    """A target ``lead v`` ahead of a part with velocity v needs no change of velocity."""
    for name in laws():
        policy = make_policy({"kind": "local_field", "law": name}, info_of("Transport"))
        if name in ("pid"):
            continue  # it observes positions only, and needs steps to estimate a velocity
        rest = Measured.of(np.zeros((1, policy.info.layout.size)), policy.info)
        velocity = np.array([[[0.05, -0.02]]])
        moving = dataclasses.replace(rest, velocity=velocity, present=np.ones((1, 1), dtype=bool))
        memory = policy.law.initial(1)
        wanted, _ = policy.law.wanted(moving, policy.law.lead * velocity, np.zeros((1, 1)), memory)
        assert np.abs(wanted).max() < 0.02 * 9.81 * 0.05, name
