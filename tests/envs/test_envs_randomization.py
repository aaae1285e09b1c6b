"""Randomisation per episode: ranges, effect on the motion, independence of observations, and disturbances."""

import math

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single, still
from vibgym.envs import VibgymVectorEnv
from vibgym.envs.randomization import EFFECTS
from vibgym.physics.planar.impulse import SPEED, SPIN
from vibgym.tasks import TASKS

ALL = {"friction": [0.5, 1.5], "mass": [0.25, 4.0], "incline": [0.01, 0.03], "patches": [0.7, 1.2]}


def test_uniform_draws_per_part_and_episode():
    env = batch("Sort", 400, action="field", randomize=ALL, max_episode_steps=2, autoreset_mode="SameStep")
    _, info = env.reset(seed=0)
    for name, (low, high) in (("friction", (0.5, 1.5)), ("mass", (0.25, 4.0)), ("patches", (0.7, 1.2))):
        values = info["drawn"][name]
        assert values.shape == ((400, 8, 32) if name == "patches" else (400, 6))
        values = values[:, 3, 4:10] if name == "patches" else values
        assert values.min() >= low and values.max() <= high
        share = np.sort((values.ravel() - low) / (high - low))
        assert np.abs(share - np.linspace(0.0, 1.0, share.size)).max() < 1.6 / math.sqrt(share.size)  # Kolmogorov, 99 %
        assert abs(np.corrcoef(values[:, 0], values[:, 1])[0, 1]) < 0.2
    incline = info["drawn"]["incline"]
    size, turn = np.hypot(*incline.T), np.arctan2(incline[:, 1], incline[:, 0])
    angle = np.sort((np.arcsin(size / 9.81) - 0.01) / 0.02)
    for share in (angle, np.sort(turn / (2.0 * math.pi) + 0.5)):
        assert np.abs(share - np.linspace(0.0, 1.0, 400)).max() < 1.6 / math.sqrt(400)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    assert_same(env.step(action)[4]["drawn"], info["drawn"])  # all through the episode
    last = env.step(action)[4]
    assert_same(last["final_info"]["drawn"], info["drawn"])
    assert not (last["drawn"]["friction"] == info["drawn"]["friction"]).any()  # and another one in the next


@pytest.mark.parametrize("task", TASKS)
def test_every_task_passes_conditions_to_the_simulator(task):
    env = single(task, randomize=ALL)
    _, info = env.reset(seed=3)
    simulator, parts = env.unwrapped.core.simulator, len(env.unwrapped.parts)
    assert {name: values.shape for name, values in info["drawn"].items()} == {
        "friction": (parts,), "mass": (parts,), "incline": (2,), "patches": (8, 32),
    }  # fmt: skip
    for name, values in info["drawn"].items():
        assert getattr(simulator, name)[0].tobytes() == values.tobytes()
    info["drawn"]["friction"][:] = 7.0  # a copy
    assert simulator.friction.max() < 2.0


def test_observations_do_not_show_it():
    """Start and first observation equal those without randomisation, or with drawn parts alone."""
    assert "drawn" not in single("Sort", randomize={"parts": [2, 4]}).reset(seed=0)[1]
    for observation in ("state", "image"):
        plain, random = (single("Sort", observation=observation, randomize=drawn) for drawn in (None, ALL))
        (seen, info), (other, drawn) = plain.reset(seed=8), random.reset(seed=8)
        assert_same(seen, other)
        assert "drawn" not in info and info.keys() | {"drawn"} == drawn.keys()


def test_parts_start_sliding_in_place_at_any_friction():
    """Each on its own circle: no period moves its mean."""
    env = batch("Align", 20, action="phasor", randomize={"friction": [0.3, 3.0]})
    env.reset(seed=1)
    start = env.unwrapped.truth.pose
    for _ in range(5):
        env.step(still(env))
    assert np.abs(env.unwrapped.truth.pose - start).max() < 1e-5
    assert np.ptp(env.unwrapped.truth.velocity[:, 0, 0]) > 0.02


def test_an_incline_makes_parts_drift_downhill():
    """With 2 b V / (mu g) in the end, to the first order of the average."""
    env = batch("Align", 8, action="phasor", randomize={"incline": [0.02, 0.02]}, max_episode_steps=300)
    _, info = env.reset(seed=2, options={"pose": [0.416, 0.104, 0.0]})
    for _ in range(12):
        env.step(still(env))
    moved = env.unwrapped.truth.pose[:, 0, :2] - [0.416, 0.104]
    downhill = info["drawn"]["incline"] / 9.81 / math.sin(0.02)
    assert np.hypot(*downhill.T) == pytest.approx(1.0)
    assert ((moved * downhill).sum(1) > 0.9 * np.hypot(*moved.T)).all() and (np.hypot(*moved.T) > 3e-3).all()


def test_every_effect_takes_the_ends_of_its_range():
    ends = {"friction": [0.5, 0.5], "mass": [2.0, 2.0], "incline": 0.0, "patches": [0.9, 0.9]}
    assert ends.keys() == set(EFFECTS)
    _, info = single("Rotate", randomize=ends).reset(seed=0)
    assert {name: values.tolist() for name, values in info["drawn"].items()} == {
        "friction": [0.5], "mass": [2.0], "incline": [0.0, 0.0], "patches": np.full((8, 32), 0.9).tolist(),
    }  # fmt: skip


# -- disturbances --------------------------------------------------------------------------------------------------------


def disturbed_batch(worlds, rate, tilt, model="planar"):
    """Return environments with disturbances of ``tilt`` degrees, after a reset."""
    randomize = {"disturbance": {"rate": rate, "tilt_deg": tilt}}
    env = VibgymVectorEnv("Align", num_envs=worlds, model=model, action="wrench", randomize=randomize)
    env.reset(seed=4)
    return env


@pytest.mark.parametrize("model", ["planar", "tilting"])
def test_info_reports_disturbances(model):
    env, tilting, disturbed = disturbed_batch(64, 5.0, [1, 3], model), model == "tilting", []
    for _ in range(50):
        of_parts = env.step(np.zeros((64, 3), np.float32))[4]["parts"]
        disturbed.append(of_parts["disturbed"].copy())
        assert ("toppled" in of_parts) == tilting
        assert not tilting or env.core.simulator.time_tilted[disturbed[-1] > 0.0].min(initial=1.0) > 0.0
    disturbed = np.array(disturbed)
    assert ((disturbed == 0.0) | ((disturbed >= math.radians(1)) & (disturbed <= math.radians(3)))).all()
    seconds = 50 * 0.04 * 64
    assert (disturbed > 0.0).sum() == pytest.approx(5.0 * seconds, rel=0.15)  # some twice in a step, or after their end


def test_disturbed_parts_get_a_kick_in_planar_models():
    """Kicks are normal with the fitted deviations per root of a degree; other parts do not move."""
    env = disturbed_batch(4000, 50.0, 2)
    core = env.core
    before = core.simulator.velocity
    core.disturbances.disturb(core.episode.present)
    impulse, disturbed = core.simulator.velocity - before, core.disturbances.disturbed > 0.0
    assert 0.8 < disturbed.mean() < 0.92 and not impulse[~disturbed].any()  # 1 - exp(-2)
    deviation = impulse[disturbed].std(axis=0) / math.sqrt(2.0)
    assert deviation == pytest.approx([SPEED, SPEED, SPIN], rel=0.06)


def test_starts_do_not_change_and_nothing_else_is_reported():
    seen = disturbed_batch(2, 5.0, 2).reset(seed=3)[0]
    plain, info = VibgymVectorEnv("Align", num_envs=2).reset(seed=3)
    assert np.array_equal(seen, plain) and "disturbed" not in info["parts"]


def test_a_toppled_part_ends_the_episode_as_a_fallen_one():
    tall = {"shape": "rectangle", "length": 0.02, "width": 0.02, "friction": 0.6, "height": 0.05}
    env = VibgymVectorEnv("Align", num_envs=8, model="tilting", parts=[tall], action="field")
    env.reset(seed=0)
    for _ in range(200):
        info = env.step(np.ones((8, 6), np.float32))[4]
        toppled = info["parts"]["toppled"]
        if toppled.any():
            break
    assert toppled.any() and info["fallen"][toppled[:, 0]].all()
