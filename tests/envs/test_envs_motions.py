"""Actions that command motions: what parts reach, where they stop, parts without allocation, and the inverse map."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.envs.helpers import batch, single
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.envs import ACTIONS, Velocity, Wrench
from vibgym.envs.motions import BESIDE, GONE, LEFT_OUT, MOTIONS, REASONS, SERVED
from vibgym.policies import rollout
from vibgym.scene.parts import shipped_part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers

PART = shipped_part("aluminium_block")
MACHINE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}


def commanded(env, action):
    """Return the velocities of an action, by the documented map."""
    return np.sign(action) * action**2 * env.unwrapped.core.action.top


def action_to(env, pose, target):
    """Return the action that commands target poses (worlds, parts, 3)."""
    offset = np.clip((target - pose) / env.core.action.reach, -1.0, 1.0)
    return (np.sign(offset) * np.sqrt(np.abs(offset))).astype(np.float32)


def go_to(env, target, steps):
    """Step a single environment towards target poses (parts, 3)."""
    for _ in range(steps):
        env.step(action_to(env, env.truth.pose[0], np.asarray(target)))


@pytest.mark.parametrize("periods, error", [(1, 0.004), (2, 0.012)])
def test_parts_reach_the_commanded_velocity(periods, error):
    """The mean velocity over the last period of a step, from rest, within two steps."""
    env = batch("Align", 64, action="velocity", periods_per_step=periods)
    env.reset(seed=1)
    action = np.random.default_rng(1).uniform(-0.5, 0.5, (64, 1, 3)).astype(np.float32)
    for _ in range(3):
        env.step(action)
    velocity = env.unwrapped.truth.mean_velocity
    off = (velocity - commanded(env, action)) / env.unwrapped.core.action.top
    assert np.median(np.abs(off)) < error and np.abs(off).max() < 0.1
    assert np.hypot(velocity[..., 0], velocity[..., 1]).max() > 0.06


def test_zero_stops_a_part():
    env = single("Transport", action="velocity")
    env.reset(seed=2, options={"pose": [0.2, 0.1, 0.0], "goal": [0.7, 0.1, 0.0]})
    for _ in range(12):
        env.step(np.array([1.0, 0.0, 0.0], dtype=np.float32))
    fast = env.unwrapped.truth.mean_velocity[0, 0, 0]
    assert fast == pytest.approx(0.30, abs=0.01)  # the top speed, below that of an action of 1
    for _ in range(6):
        env.step(np.zeros(3, dtype=np.float32))
    assert np.abs(env.unwrapped.truth.mean_velocity[0, 0, :2]).max() < 1e-3


@pytest.mark.parametrize("start, target, periods", [
    ([0.30, 0.10, 0.3], [0.36, 0.13, 0.9], 2), ([0.30, 0.10, 0.0], [0.30, 0.10, -1.0], 1),
    ([0.20, 0.10, 0.0], [0.60, 0.12, 0.4], 1),
])  # fmt: skip
def test_a_part_goes_to_a_fixed_target_without_overshoot(start, target, periods):
    env = single("Transport", action="target", periods_per_step=periods).unwrapped
    env.reset(seed=4, options={"pose": start, "goal": [0.7, 0.05, 0.0]})
    way = []
    for _ in range(100 // periods):
        go_to(env, [target], 1)
        way.append(env.truth.pose[0, 0])
    off = np.abs(way[-1] - target)
    assert off[:2].max() < 1e-4 and off[2] < math.radians(0.2)
    forward = (np.array(way) - start) @ np.where([True, True, False], np.subtract(target, start), 0.0)
    whole = np.square(np.subtract(target, start)[:2]).sum()
    assert (forward <= 1.02 * whole + 1e-4).all()


def test_targets_beyond_a_border_are_inside():
    env = single("Transport", action="target").unwrapped
    env.reset(seed=5, options={"pose": [0.4, 0.15, 0.0], "goal": [0.7, 0.05, 0.0]})
    border, moved, wanted = env.surface.depth - env.core.action.margin, [], []
    for _ in range(40):
        wanted.append(env.truth.pose[0, 0, 1] + 0.12)
        *_, info = env.step(np.array([0.0, 1.0, 0.0], dtype=np.float32))
        moved.append(info["commanded"]["moved"][0])
    assert not env.truth.fallen.any() and env.truth.pose[0, 0, 1] == pytest.approx(border, abs=5e-4)
    np.testing.assert_allclose(
        moved, np.stack([np.zeros(40), np.minimum(border - np.array(wanted), 0.0)], axis=1), atol=1e-9
    )
    *_, info = env.step(np.array([0.3, -0.3, 1.0], dtype=np.float32))
    assert not info["commanded"]["moved"].any()


SHARES = st.lists(st.floats(-0.9, 0.9), min_size=3, max_size=3)


@pytest.mark.parametrize("name", ["wrench", "velocity", "target"])
@given(values=SHARES, velocity=SHARES, periods=st.integers(1, 4))
def test_controllers_find_the_action_of_an_acceleration(name, values, velocity, periods):
    """``acceleration(values(a)) == a`` wherever an action has this acceleration."""
    surface = Surface()
    action = ACTIONS[name](surface, [PART])
    action.step_time = periods * surface.period
    sheet = batch("Align", 1).unwrapped.data_sheet
    action.resolve_limits(sheet, 1)
    pose = np.array([[[0.4, 0.1, 0.0]]])
    velocity = 0.2 * np.array(velocity).reshape(1, 1, 3)
    wanted = action.acceleration(np.array(values).reshape(1, 1, 3) * [0.6, 0.6, 1.0], velocity, pose)
    again = action.acceleration(np.clip(action.values(wanted, velocity), -1.0, 1.0), velocity, pose)
    np.testing.assert_allclose(again, wanted, rtol=1e-3, atol=2e-2 * np.abs(action.scale).max())


@pytest.mark.parametrize("name", ["velocity", "target"])
def test_a_controller_acts_the_same_in_motions_as_in_phasors(name):
    """It commands the same pushes by another action, so its times differ by steps at most."""
    planners = [{"kind": "planner", "action": action} for action in ("phasor", name)]
    times = [rollout(planner, "Sort", seeds=range(8)).time_to_goal for planner in planners]
    assert np.abs(times[1] - times[0]).max() <= 0.12 and np.isfinite(times).all()


@pytest.mark.parametrize("model", ["averaged", "tilting"])
def test_motions_in_other_models(model):
    """Of a rigid part, too, whose pressure is not the one that the inverse of friction assumes."""
    start = {"options": {"pose": [0.3, 0.1, 0.3], "goal": [0.7, 0.1, 0.0]}, "seed": 1}
    env = single("Transport", action="target", model=model).unwrapped
    env.reset(**start)
    go_to(env, [[0.36, 0.13, 0.9]], 60)
    np.testing.assert_allclose(env.truth.pose[0], [[0.36, 0.13, 0.9]], atol=1e-4)
    env = single("Transport", action="velocity", model=model).unwrapped
    env.reset(**start)
    action, velocities = np.array([0.6, 0.2, 0.3]), []
    for _ in range(12):
        env.step(action.astype(np.float32))
        velocities.append(env.truth.mean_velocity[0, 0])
    off = (np.mean(velocities[4:], axis=0) - commanded(env, action)) / env.core.action.top
    assert np.abs(off).max() < 0.02


def test_parts_that_share_elements():
    """Two parts 7 mm apart, under both of which lie the same elements, move apart and turn against each other."""
    env = single("Singulate", action="velocity", parts=["aluminium_block"] * 2).unwrapped
    env.reset(seed=1, options={"pose": [[0.38, 0.100, 0.0], [0.437, 0.104, 0.2]]})
    action = np.array([[-0.4, 0.2, 0.2], [0.4, 0.1, -0.2]])
    for _ in range(3):
        env.step(action.astype(np.float32))
    off = (env.truth.mean_velocity[0] - commanded(env, action)) / env.core.action.top
    assert np.abs(off).max() < 0.01


def test_measured_targets_are_reached_on_the_prototype():
    """With latency, dead zone, gain and phase errors, and an estimator: to the precision of the measurement."""
    env = batch("Align", 32, action="target", **MACHINE).unwrapped
    env.reset(seed=3)
    side = np.where(np.arange(32) % 2, 1.0, -1.0)[:, None, None]
    target = env.truth.pose + side * [0.05, 0.0, 0.3]
    target[..., :2] = np.clip(target[..., :2], 0.03, [0.80, 0.17])
    for _ in range(80):
        env.step(action_to(env, env.core.sensing.measurement.pose, target))
    off = np.abs(env.truth.pose - target)
    assert not env.truth.fallen.any() and off[..., :2].max() < 1e-3 and off[..., 2].max() < math.radians(1.5)


def accelerated(env, wanted):
    """Return mean velocities (3, worlds, parts, 3) of three steps under the same wrenches, and the last ``info``."""
    velocity = []
    for _ in range(3):
        *_, info = env.step(wanted.astype(np.float32))
        velocity.append(env.unwrapped.truth.mean_velocity)
    return np.array(velocity), info


def test_parts_get_the_commanded_acceleration():
    """By the planar model, from rest to 0.13 m/s, before parts come upon other elements."""
    env = batch("Align", 64, action="wrench")
    env.reset(seed=1)
    wanted = np.random.default_rng(1).uniform(-0.35, 0.35, (64, 1, 3))
    velocity, _ = accelerated(env, wanted)
    push = 0.5 * PART.friction * 9.81
    scale = [push, push, push / math.sqrt(PART.gyration)]
    assert env.unwrapped.core.action.scale[0, 0] == pytest.approx(scale)  # as documented
    off = np.abs((velocity[2] - velocity[0]) / (2 * 0.04) / scale - wanted)
    assert off.max() < 0.04 and np.median(off) < 0.01
    assert np.hypot(velocity[2][..., 0], velocity[2][..., 1]).max() > 0.12


def test_several_parts_get_their_accelerations():
    env = batch("Sort", 16, action="wrench")
    env.reset(seed=3)
    wanted = np.random.default_rng(3).uniform(-0.2, 0.2, (16, 6, 3))
    velocity, info = accelerated(env, wanted)
    made = (velocity[2] - velocity[1]) / 0.04 / env.unwrapped.core.action.scale
    assert np.median(np.abs(made - wanted)) < 0.03
    assert (info["commanded"]["unserved"] == SERVED).all()


def test_commands_pass_a_dead_zone():
    """Also small ones, by elements in opposite directions."""
    env = single("Align", action="wrench", actuators={"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0})
    env.reset(seed=4)
    least = env.unwrapped.data_sheet.dead_zone / env.unwrapped.surface.max_amplitude
    env.step(np.array([0.02, 0.0, 0.0], dtype=np.float32))
    env.step(np.zeros(3, dtype=np.float32))
    length = np.hypot(*env.unwrapped.phasors().reshape(-1, 2).T)
    assert (length > 0.0).sum() >= 2 and length[length > 0.0].min() >= least * (1.0 - 1e-6)


def test_reasons_for_resting_elements_are_reported():
    env = single("Align", action="wrench", surface={"rows": 4, "columns": 4})
    env.reset(seed=5)
    done = False
    while not done:
        _, _, done, _, info = env.step(np.array([1.0, 0.0, 0.0], dtype=np.float32))
    assert info["fallen"] and info["commanded"]["unserved"].tolist() in ([SERVED], [BESIDE], [GONE])
    many = batch("Sort", 2, action="wrench", slots=7, randomize={"parts": [2, 3]})
    many.reset(seed=6)
    _, _, _, _, info = many.step(np.ones((2, 6, 3), dtype=np.float32))
    there = many.unwrapped.truth.present
    assert (info["commanded"]["unserved"] == np.where(there, SERVED, GONE)).all() and not there.all()
    assert len(REASONS) == LEFT_OUT + 1


@pytest.mark.parametrize("name", MOTIONS)
@pytest.mark.parametrize("form", ["ideal", "hard", "soft", "cubic"])
def test_the_kernel_composes_decoding_inverse_and_allocation(name, form, monkeypatch):
    """On any number of threads; values beyond 1 are clipped."""
    monkeypatch.setattr(workers, "WORTH", 1.0)
    hardware = "ideal" if form == "ideal" else {"kind": "prototype", "dead_zone_form": form, "limit": 3e-4}
    random, drives = np.random.default_rng(1), []
    values = random.uniform(-1.2, 1.2, (40, 18)).astype(np.float32)
    for threads in (1, 2, 5):
        monkeypatch.setattr(workers, "available_threads", lambda threads=threads: threads)
        env = batch("SortCrowded", 40, action=name, actuators=hardware).unwrapped
        env.reset(seed=1)
        action, state = env.core.action, env.core.simulator.state
        state.mean_velocity[...] = np.random.default_rng(2).uniform(-0.1, 0.1, state.pose.shape)
        state.fallen[::7, 2], state.pose[5, 1, 1] = True, -1e-3
        measured = env.core.pipeline.measurement
        drives.append(action.command(values, measured).values.copy())
    wanted = action.acceleration(np.clip(values, -1.0, 1.0).reshape(40, 6, 3), measured.mean_velocity, measured.pose)
    half, limit = 0.5 * env.surface.period, env.data_sheet.limit
    process = FrictionalInverse(env.surface, env.parts, limit=limit, ahead=half)
    push, acceleration, holds = process.push(measured.mean_velocity, wanted)
    served = holds & ~measured.gone
    served[5, 1] = False
    assert (action.live()["given"] == np.where(served[..., None], acceleration, 0.0)).all()
    assert (action.allocator.actions(measured.pose, served, push) == drives).all() and drives[0].any()


class Halved(Velocity):
    """Accelerate half as much, in Python."""

    def acceleration(self, values, velocity, pose):
        return 0.5 * super().acceleration(values, velocity, pose)


def test_a_subclass_overrides_the_acceleration(monkeypatch):
    monkeypatch.setitem(ACTIONS._items, "halved", Halved)
    given = []
    for action in ("velocity", "halved"):
        env = single("Align", action=action).unwrapped
        env.reset(seed=1)
        env.step(np.full(3, 0.1, dtype=np.float32))
        given.append(env.core.action.live()["given"])
    np.testing.assert_allclose(given[1], 0.5 * given[0], rtol=1e-3)


class Spared(Wrench):
    """Exclude the second part."""

    def left_out(self, measurement):
        return np.broadcast_to([False, True], measurement.gone.shape)


def test_a_subclass_excludes_parts(monkeypatch):
    monkeypatch.setitem(ACTIONS._items, "spared", Spared)
    pose, moved = [[0.2, 0.1, 0.0], [0.6, 0.1, 0.0]], {}
    for action in ("wrench", "spared"):
        env = single("Singulate", action=action, parts=["aluminium_block"] * 2)
        env.reset(seed=1, options={"pose": pose})
        for _ in range(5):
            *_, info = env.step(np.full((2, 3), 0.3, dtype=np.float32))
        moved[action] = env.unwrapped.truth.pose[0] - pose
        assert info["commanded"]["unserved"].tolist() == [SERVED, LEFT_OUT if action == "spared" else SERVED]
    assert (moved["spared"][0] == moved["wrench"][0]).all() and abs(moved["wrench"][1, 0]) > 5e-3
    assert abs(moved["spared"][1, 0]) < 5e-4 and "left out" in REASONS[LEFT_OUT]
