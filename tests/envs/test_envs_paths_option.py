"""``reset(options={"paths": ...})``: an episode on given paths."""

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.tasks import paths as route

LINE = {"shape": "polyline", "points_mm": [[300, 60], [380, 60], [380, 140]], "speed": 0.1}
OTHER = {"shape": "circle", "centre_mm": [150, 100], "radius_mm": 50}
ALONG = {**LINE, "heading": "along"}


def paths_of(env, world=0):
    return env.unwrapped.core.scoring.custom_state()["paths"][world]


@pytest.mark.parametrize("paths", [[LINE], [OTHER], [ALONG]], ids=["line", "circle", "along"])
def test_it_is_the_episode_of_an_environment_with_these_paths(paths):
    drawn, given = single("Follow"), single("Follow", paths=paths)
    drawn.reset(seed=1, options={"paths": paths})
    given.reset(seed=1)
    for env in (drawn, given):
        truth = env.unwrapped.truth
        assert (truth.pose == truth.goal).all()
    times = np.linspace(0.0, 6.0, 200)
    one, other = (route.sample(paths_of(env)[0], times) for env in (drawn, given))
    assert one[:, [0, 1, 3, 4, 5]] == pytest.approx(other[:, [0, 1, 3, 4, 5]], abs=1e-15)
    if paths == [ALONG]:
        assert one[:, 2] == pytest.approx(other[:, 2], abs=1e-12)
    drawn.reset(seed=1)
    default = paths_of(drawn).copy()
    drawn.reset(seed=1, options={"paths": paths})
    drawn.reset(seed=1)
    assert (paths_of(drawn) == default).all()  # of this episode alone


def test_headings_are_still_drawn_and_poses_can_be_set():
    env = single("Follow")
    env.reset(seed=3)
    heading = env.unwrapped.truth.pose[0, 0, 2]
    env.reset(seed=3, options={"paths": [LINE]})
    assert env.unwrapped.truth.pose[0, 0].tolist() == [0.3, 0.06, heading]
    env.reset(seed=3, options={"paths": [LINE], "pose": [0.301, 0.06, 0.5]})
    assert env.unwrapped.truth.goal[0, 0] == pytest.approx([0.3, 0.06, 0.5])


def test_a_batch_has_the_same_bits_in_the_worlds_of_the_mask():
    env, one = batch("Follow", 3, action="field", autoreset_mode="Disabled"), single("Follow", action="field")
    env.reset(seed=5)
    left = paths_of(env, 0).copy()
    seen, _ = env.reset(seed=[0, 8, 9], options={"paths": [OTHER], "reset_mask": np.array([False, True, True])})
    alone, _ = one.reset(seed=9, options={"paths": [OTHER]})
    assert (paths_of(env, 0) == left).all() and (paths_of(env, 2) == paths_of(one)).all()
    action = np.full((3, *one.action_space.shape), 0.3, dtype=np.float32)
    for _ in range(5):
        assert_same(seen[2], alone)
        seen, alone = env.step(action)[0], one.step(action[0])[0]


MANY = [[100 + 20 * k, 60 + 30 * (k % 2)] for k in range(20)]


@pytest.mark.parametrize("task, paths, named", [
    ("Follow", [{**OTHER, "radius_mm": 200}], r"options\['paths'\]\[0\].radius"),
    ("Follow", [{**LINE, "speed": 0.5}], r"options\['paths'\]\[0\]\.speed"),
    ("Follow", [LINE, OTHER], r"options\['paths'\]"),
    ("Follow", {"shapes": ["circle"]}, r"options\['paths'\]"),
    ("Follow", [{"shape": "polyline", "points_mm": MANY, "speed": 0.05}], r"options\['paths'\]"),
    ("Follow", [{**OTHER, "laps": 10}], r"options\['paths'\]"),
    ("Align", [LINE], r"options\['paths'\]"),
])  # fmt: skip
def test_bad_paths_are_refused_and_change_nothing(task, paths, named):
    env = single(task)
    env.reset(seed=1)
    before = env.unwrapped.get_state()
    with pytest.raises(ValueError, match=named):
        env.reset(options={"paths": paths})
    assert_same(env.unwrapped.get_state(), before)
