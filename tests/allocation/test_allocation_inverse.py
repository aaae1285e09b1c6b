"""Wanted acceleration to phasors: round trips, limits, and the planar model as judge."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from vibgym import Part, Simulator, Surface
from vibgym.allocation import mean_acceleration, mean_state, phasors_for
from vibgym.scene.parts import shipped_part

SURFACE = Surface()
BLOCK = shipped_part("aluminium_block")
ONE = Surface(rows=1, columns=1, element_size=8.0)
G = 9.81


def draws(worlds, seed=0):
    rng = np.random.default_rng(seed)
    pose = rng.uniform([0.06, 0.06, -3], [0.77, 0.15, 3], (worlds, 3))
    velocity = rng.uniform([-0.12, -0.12, -2], [0.12, 0.12, 2], (worlds, 3))
    return pose, velocity, rng.uniform(-1, 1, (worlds, 3)) * [0.3, 0.3, 8.0]


@pytest.mark.parametrize("order", [1, 2])
def test_round_trip_on_many_elements(order):
    pose, velocity, wrench = draws(100)
    found = phasors_for(SURFACE, BLOCK, pose, velocity, wrench, order=order)
    assert found.reachable.mean() > 0.9
    back = mean_acceleration(SURFACE, BLOCK, pose, velocity, found.amplitude, found.phase, order=order)
    assert np.abs(back - found.achieved).max() < 1e-10
    assert np.abs(back - wrench)[found.reachable].max() < 1e-10
    assert (np.abs(back - wrench)[~found.reachable].max(axis=1) > 1e-9).all()
    assert (found.amplitude <= SURFACE.max_amplitude).all() and (found.amplitude >= 0).all()
    assert 4 <= (found.amplitude > 0).sum(axis=(1, 2)).max() <= 16  # only elements under the part


@settings(max_examples=40)
@given(
    x=st.floats(0.0, 0.832), y=st.floats(0.0, 0.208), heading=st.floats(-4, 4),
    vx=st.floats(-0.5, 0.5), vy=st.floats(-0.5, 0.5), spin=st.floats(-6, 6),
    ax=st.floats(-4, 4), ay=st.floats(-4, 4), turn=st.floats(-100, 100), order=st.sampled_from([1, 2]),
)  # fmt: skip
def test_whatever_is_asked_for_what_is_achieved_is_true(x, y, heading, vx, vy, spin, ax, ay, turn, order):
    pose, velocity, wrench = [x, y, heading], [vx, vy, spin], np.array([[ax, ay, turn]])
    found = phasors_for(SURFACE, BLOCK, pose, velocity, wrench, order=order)
    assert np.isfinite(found.amplitude).all() and np.isfinite(found.phase).all()
    assert (found.amplitude <= SURFACE.max_amplitude).all() and (found.amplitude >= 0.0).all()
    back = mean_acceleration(SURFACE, BLOCK, pose, velocity, found.amplitude, found.phase, order=order)
    assert np.abs(back - found.achieved).max() < 1e-9
    assert found.reachable[0] == (np.abs((back - wrench) * [1, 1, math.sqrt(BLOCK.gyration)]).max() < 1e-9)


def test_one_element_near_rest_is_the_known_solve():
    """Mean acceleration -(mu / 2) (S, C) to first order."""
    wanted = np.array([[0.8, -0.5, 0.0], [-1.5, 1.0, 0.0]])
    found = phasors_for(ONE, BLOCK, [4.0, 4.0, 0.3], 0.0, wanted, order=1)
    assert found.reachable.all()
    normal = found.amplitude[:, 0, 0] * ONE.angular_frequency**2
    c, s = normal * np.cos(found.phase[:, 0, 0]), normal * np.sin(found.phase[:, 0, 0])
    assert -0.5 * BLOCK.friction * np.stack([s, c], axis=1) == pytest.approx(wanted[:, :2], rel=1e-7)


@pytest.mark.parametrize("order", [1, 2])
def test_round_trip_on_one_element(order):
    pose = np.tile([4.0, 4.0, 0.3], (50, 1))
    _, velocity, wrench = draws(50, 1)
    velocity[:, 2] = 0.0
    wrench[:, 2] = 0.0
    found = phasors_for(ONE, BLOCK, pose, velocity, wrench, order=order)
    assert found.reachable.all()
    back = mean_acceleration(ONE, BLOCK, pose, velocity, found.amplitude, found.phase, order=order)
    assert np.abs(back - wrench).max() < 1e-10
    # torque is out of its reach: said so, and the forces are still right
    wrench[:, 2] = 5.0
    found = phasors_for(ONE, BLOCK, pose, velocity, wrench, order=order)
    assert not found.reachable.any()
    assert np.abs(found.achieved[:, :2] - wrench[:, :2]).max() < 1e-8 and np.abs(found.achieved[:, 2]).max() < 1e-6


@pytest.mark.parametrize("order", [1, 2])
def test_too_much_is_scaled_down(order):
    """The change against elements at rest keeps its direction; one element is at the limit."""
    pose, velocity, _ = draws(40, 2)
    wrench = np.random.default_rng(3).uniform(-1, 1, (40, 3)) * [20.0, 20.0, 900.0]
    found = phasors_for(SURFACE, BLOCK, pose, velocity, wrench, order=order)
    assert not found.reachable.any()
    assert found.amplitude.max(axis=(1, 2)) == pytest.approx(SURFACE.max_amplitude, rel=1e-2)
    idle = mean_acceleration(SURFACE, BLOCK, pose, velocity, 0.0, 0.0, order=order)
    lever = [1, 1, math.sqrt(BLOCK.gyration)]
    asked, got = (wrench - idle) * lever, (found.achieved - idle) * lever
    part = (asked * got).sum(axis=1) / (asked * asked).sum(axis=1)
    assert (part > 0).all() and (part < 1).all()
    assert np.abs(got - part[:, None] * asked).max() < 1e-3 * np.abs(got).max()


def test_amplitude_limit_of_the_surface_holds():
    weak = Surface(max_amplitude=1e-5)
    found = phasors_for(weak, BLOCK, [0.4, 0.1, 0.2], 0.0, [1.0, 0.0, 0.0])
    assert not found.reachable[0] and found.amplitude.max() <= 1e-5 and 0 < found.achieved[0, 0] < 1.0
    still = Surface(max_amplitude=0.0)
    found = phasors_for(still, BLOCK, [0.4, 0.1, 0.2], 0.0, [1.0, 0.0, 0.0])
    assert not found.reachable[0] and not found.amplitude.any() and found.achieved == pytest.approx(0.0, abs=1e-12)


@pytest.mark.parametrize("friction", [0.15, 0.58])
def test_the_planar_model_does_what_was_wanted(friction):
    """End to end. Over one period the velocity itself changes friction, so the period is centred on the wanted state."""
    part = Part.rectangle(0.050, 0.035, friction=friction)
    worlds, period = 24, SURFACE.period
    rng = np.random.default_rng(4)
    pose = rng.uniform([0.1, 0.08, -3], [0.7, 0.13, 3], (worlds, 3))
    velocity = rng.uniform([-0.1, -0.1, 0], [0.1, 0.1, 0], (worlds, 3))
    wrench = rng.uniform(-1, 1, (worlds, 3)) * [0.3 * friction, 0.3 * friction, 10.0 * friction]
    error = {}
    for order in (1, 2):
        found = phasors_for(SURFACE, part, pose, velocity, wrench, order=order)
        good = found.reachable
        assert good.mean() > 0.8
        start_velocity = velocity - 0.5 * period * wrench
        start = pose - 0.5 * period * velocity + 0.125 * period**2 * wrench
        measured = (_slow_change(part, start, start_velocity, found.amplitude, found.phase) - start_velocity) / period
        difference = (measured - wrench)[good] * [1, 1, math.sqrt(part.gyration)]
        error[order] = np.abs(difference).max(axis=1).mean() / (friction * G)
    eps = friction * G / (SURFACE.horizontal_amplitude * SURFACE.angular_frequency**2)
    assert error[2] < 0.8 * eps**2 and error[2] < error[1] / 2.5, (error, eps)


def _slow_change(part, pose, velocity, amplitude, phase):
    """Mean velocity after a planar period that starts from a mean pose and velocity."""
    now, here = velocity.copy(), pose.copy()
    for _ in range(30):  # the instantaneous state that has this mean
        slow_pose, slow = mean_state(SURFACE, part, here, now, amplitude, phase)
        now, here = now + velocity - slow, here + pose - slow_pose
    exact = Simulator(SURFACE, part, worlds=len(pose), steps=64, substeps=2, pieces=4)
    exact.reset(here[:, None], now[:, None])
    exact.advance(amplitude, phase)
    assert not exact.fallen.any()
    return mean_state(SURFACE, part, exact.pose[:, 0], exact.velocity[:, 0], amplitude, phase)[1]


@pytest.mark.parametrize("name, bad", [
    ("pose", [[0.4, 0.1]]),
    ("pose", [0.4, math.nan, 0.0]),
    ("pose", [-0.1, 0.1, 0.0]),
    ("velocity", "fast"),
    ("wrench", [math.inf, 0, 0]),
    ("order", 3),
])  # fmt: skip
def test_bad_arguments_are_refused_by_name(name, bad):
    arguments = {"pose": [0.4, 0.1, 0.0], "velocity": 0.0, "wrench": 0.0, name: bad}
    with pytest.raises(ValueError, match=rf"^{name}: "):
        phasors_for(SURFACE, BLOCK, **arguments)


def test_a_pair_that_can_stick_is_refused():
    with pytest.raises(ValueError, match="always slide"):
        phasors_for(Surface(horizontal_amplitude=3e-4), BLOCK, [0.4, 0.1, 0.0], 0.0, 0.0)
