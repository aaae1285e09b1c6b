"""Environments with several parts: saved specifications, bad settings, pictures."""

import pytest

from tests.envs.helpers import batch, single

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
