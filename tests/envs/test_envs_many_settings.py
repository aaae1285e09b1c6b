"""Environments with several parts: saved specifications, bad settings, pictures."""

import json

import gymnasium as gym
import pytest
from gymnasium.envs.registration import EnvSpec

from tests.envs.helpers import assert_same, batch, single

FULL = {
    "surface": {"rows": 8, "columns": 20, "element_size_mm": 30.0, "max_amplitude": 3e-4},
    "parts": ["steel_block", {"shape": "disc", "radius_mm": 20, "friction": 0.5, "name": "coin"}, "steel_block"],
    "model": "planar",
    "action": "patch",
    "observation": "state",
    "randomize": {"parts": [2, 3]},
    "start": "crowded",
    "zones": {"steel_block": [0.0, 0.0, 0.2, 0.24], "coin": [0.4, 0.0, 0.6, 0.24]},
    "slots": 4,
    "walls": ["left", "right"],
    "periods_per_step": 2,
    "render_mode": "rgb_array",
}


def test_a_specification_survives_json():
    env = single("Sort", **FULL)
    before = json.dumps(FULL)
    spec = EnvSpec.from_json(env.spec.to_json())
    assert spec == env.spec
    runs = []
    for each in (env, gym.make(spec)):
        each.action_space.seed(3)
        runs.append([each.reset(seed=3), *[each.step(each.action_space.sample()) for _ in range(4)], each.render()])
    assert_same(*runs)
    assert json.dumps(FULL) == before
    assert env.observation_space.shape == (80,)


BAD = [
    ({"parts": "steel_block"}, "parts"),
    ({"parts": []}, "parts"),
    ({"parts": ["steel_block", "gold_block"]}, r"parts\[1\]"),
    ({"parts": ["steel_block", {"shape": "disc", "friction": 0.5}]}, r"parts\[1\]\.radius"),
    ({"surface": {"rows": 2, "columns": 2}}, "parts"),
    ({"surface": {"columns": 8}}, "zones"),
    ({"zones": {"steel_block": [0, 0, 0.1, 0.1]}}, "zones"),
    ({"start": "stacked"}, "start"),
    ({"slots": 2}, "slots"),
    ({"walls": "left"}, "walls"),
    ({"walls": ["left", "left"]}, "walls"),
    ({"walls": ["north"]}, "walls"),
    ({"randomize": {"parts": [0, 3]}}, r"randomize\['parts'\]\[0\]"),
    ({"observation": "goal"}, "observation"),
    ({"observation": "sound"}, "observation"),
    ({"action": "swing"}, "action"),
    ({"model": "averaged"}, "model"),
    ({"colour": "red"}, r"keyword arguments"),
]


@pytest.mark.parametrize("settings, name", BAD, ids=lambda each: str(each)[:50])
def test_bad_settings_are_one_error_that_names_them(settings, name):
    for make in (lambda: single("Sort", **settings), lambda: batch("Sort", 2, **settings)):
        with pytest.raises(ValueError, match=f"^{name}: got .*; allowed: ") as error:
            make()
        assert "\n" not in str(error.value)


@pytest.mark.parametrize("task, settings", [
    ("Align", {"walls": ["left"]}), ("Align", {"slots": 3}), ("Align", {"start": "crowded"}), ("Align", {"zones": {}}),
    ("Singulate", {"start": "crowded"}), ("Singulate", {"zones": {}}),
])  # fmt: skip
def test_settings_of_other_tasks_are_refused(task, settings):
    with pytest.raises(ValueError, match=rf"^{next(iter(settings))}: got .*; allowed: nothing for {task}"):
        single(task, **settings)


def test_no_goal_reward():
    assert not hasattr(single("Sort").unwrapped, "compute_reward")
    assert not hasattr(batch("Sort", 2).unwrapped, "compute_reward")


def test_pictures_show_zones_and_only_parts_that_are_there():
    pictures = {}
    for count in (1, 6):
        env = single("Sort", action="field", render_mode="rgb_array", randomize={"parts": [count, count]})
        env.reset(seed=0)
        env.action_space.seed(0)
        for _ in range(3):
            env.step(env.action_space.sample())
        scenery = env.unwrapped._viewer.scenery
        assert env.unwrapped.truth.present[0].sum() == count
        pictures[count] = env.render()
    assert [(zone.kind, zone.label) for zone in scenery.zones] == [(0, "steel block"), (1, "aluminium block")]
    assert scenery.zones[1].low == pytest.approx((0.676, 0.0)) and scenery.zones[1].high == pytest.approx(
        (0.832, 0.208)
    )
    assert (pictures[1] != pictures[6]).any()
    dark = [(picture.sum(axis=2) < 250).sum() for picture in pictures.values()]
    assert dark[1] > 1.5 * dark[0]  # six parts cover more than one
