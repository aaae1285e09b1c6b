"""Randomisation per episode: ranges, effect on the motion, independence of observations, and reproducibility."""

import math

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single, still
from vibgym.envs.randomization import EFFECTS
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


@pytest.mark.parametrize("task", list(TASKS))
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
    """Start and first observation equal those without randomisation."""
    for observation in ("state", "image"):
        plain, random = (single("Sort", observation=observation, randomize=each) for each in (None, ALL))
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


def test_randomised_parts_alone_draw_no_conditions():
    for randomize in (None, {}, {"parts": [2, 4]}):
        env = single("Sort", randomize=randomize)
        assert env.unwrapped.core.randomization.draws == 0 and "drawn" not in env.reset(seed=0)[1]


STEEL, LIGHT = "steel_block", {"shape": "disc", "radius": 0.02, "friction": 0.5, "mass": 1e-4}
TALL = {"shape": "rectangle", "length": 0.02, "width": 0.02, "friction": 0.2, "height": 0.09}

BAD = [
    ("Align", {"randomize": {"gravity": [1, 2]}}, r"randomize"),
    ("Align", {"randomize": {"friction": [1.5, 0.5]}}, r"randomize: friction"),
    ("Align", {"randomize": {"patches": [1, 6]}, "model": "averaged"}, r"randomize\['patches'\]"),
    ("Align", {"randomize": {"disturbance": 0.3}}, r"randomize\.disturbance"),
    ("Align", {"randomize": {"disturbance": {"rate": 1.0, "tilt_deg": [3, 1]}}}, r"randomize\.disturbance: tilt"),
    ("Align", {"randomize": {"disturbance": {"rate": 1, "tilt_deg": [1, 30]}}, "model": "tilting", "parts": [TALL]},
     r"randomize\.disturbance\.tilt"),
    ("Align", {"randomize": {"friction": [1, 6]}, "model": "averaged"}, r"randomize\['friction'\]"),
    ("Sort", {"randomize": {"mass": [0.1, 1]}, "parts": [STEEL, LIGHT]}, r"randomize\['mass'\]"),
]  # fmt: skip


@pytest.mark.parametrize("task, settings, message", BAD, ids=lambda each: str(each)[:50])
def test_bad_settings_are_one_error_that_names_them(task, settings, message):
    for make in (lambda: single(task, **settings), lambda: batch(task, 2, **settings)):
        with pytest.raises(ValueError, match=message) as error:
            make()
        assert "\n" not in str(error.value)


def test_every_effect_takes_the_ends_of_its_range():
    ends = {"friction": [0.5, 0.5], "mass": [2.0, 2.0], "incline": 0.0, "patches": [0.9, 0.9]}
    assert ends.keys() == set(EFFECTS)
    _, info = single("Rotate", randomize=ends).reset(seed=0)
    assert {name: values.tolist() for name, values in info["drawn"].items()} == {
        "friction": [0.5], "mass": [2.0], "incline": [0.0, 0.0], "patches": np.full((8, 32), 0.9).tolist(),
    }  # fmt: skip
