"""Follow as an environment: observed, with paths of a reset, and drawn."""

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import paths as route

THREE = ["steel_block", "aluminium_block", "steel_block"]
SHORT = [{"shape": "polyline", "points_mm": [[x, 80], [x, 95]]} for x in (100, 300)]
CIRCLE = {"shape": "circle", "centre_mm": [400, 104], "radius_mm": 60}
LINE = {"shape": "polyline", "points_mm": [[300, 60], [380, 60], [380, 140]], "speed": 0.1}
OTHER = {"shape": "circle", "centre_mm": [150, 100], "radius_mm": 50}
ALONG = {**LINE, "heading": "along"}


def paths_of(env, world=0):
    return env.unwrapped.core.scoring.custom_state()["paths"][world]


@pytest.mark.parametrize("settings", [{}, {"parts": THREE}, {"paths": {"heading": "along", "speed": 0.06}}], ids=str)
def test_observations_contain_present_and_future_goals(settings):
    env = batch("Follow", 4, action="field", autoreset_mode="Disabled", **settings)
    info, period = TaskInfo.of(env), env.surface.period
    env.reset(seed=2)
    for clock in range(1, 12):
        seen = env.step(np.zeros(env.action_space.shape, dtype=np.float32))[0]
        measured, truth = Measured.of(seen, info), env.truth
        for w, k in np.ndindex(truth.goal.shape[:2]):
            motion = route.sample(paths_of(env, w)[k], period * (clock + np.arange(5)))
            assert measured.goal_velocity[w, k] == pytest.approx(motion[0, 3:6], abs=1e-5)
            assert measured.goal_ahead[w, k] == pytest.approx(motion[1:, :3] - motion[0, :3], abs=1e-5)
            assert measured.displacement[w, k] == pytest.approx(motion[0, :2] - truth.pose[w, k, :2], abs=1e-6)
    assert info.goal_moves and info.has_goal


def test_goals_at_rest_have_no_motion():
    env = single("Align")
    info = TaskInfo.of(env)
    measured = Measured.of(env.reset(seed=0)[0], info)
    assert not info.goal_moves and not measured.goal_velocity.any() and not measured.goal_ahead.any()
    assert measured.goal_ahead.shape == (1, 1, 4, 3) and env.unwrapped.paths() == []


def test_poses_and_parts_of_a_reset():
    env = single("Follow", parts=THREE[:2], paths=SHORT, action="field")
    begin = [[0.1, 0.08, 0.3], [0.303, 0.08, -0.4]]
    _, info = env.reset(seed=0, options={"pose": begin})
    truth = env.unwrapped.truth
    assert truth.pose[0] == pytest.approx(np.array(begin)) and info["position_error"] == pytest.approx(0.003)
    assert truth.goal[0, :, 2] == pytest.approx([0.3, -0.4])
    env.reset(options={"parts": [1]})
    assert env.unwrapped.truth.present.tolist() == [[False, True]]
    for _ in range(3):
        _, _, terminated, _, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert not terminated and info["path_error"] > 0.0


@pytest.mark.parametrize("paths", [[LINE], [OTHER], [ALONG]], ids=["line", "circle", "along"])
def test_paths_of_a_reset_are_those_of_an_environment_with_these_paths(paths):
    drawn, fixed = single("Follow"), single("Follow", paths=paths)
    drawn.reset(seed=1)
    default, heading = paths_of(drawn).copy(), drawn.unwrapped.truth.pose[0, 0, 2]
    drawn.reset(seed=1, options={"paths": paths})
    fixed.reset(seed=1)
    truth, times = drawn.unwrapped.truth, np.linspace(0.0, 6.0, 200)
    assert (truth.pose == truth.goal).all() and (paths == [ALONG] or truth.pose[0, 0, 2] == heading)  # still drawn
    one, other = (route.sample(paths_of(env)[0], times) for env in (drawn, fixed))
    assert one[:, [0, 1, 3, 4, 5]] == pytest.approx(other[:, [0, 1, 3, 4, 5]], abs=1e-15)
    if paths == [ALONG]:
        assert one[:, 2] == pytest.approx(other[:, 2], abs=1e-12)
    drawn.reset(seed=1)
    assert (paths_of(drawn) == default).all()  # of that episode alone
    if paths == [ALONG]:
        return
    place = truth.pose[0, 0] + [0.001, 0.0, 0.5]
    drawn.reset(seed=1, options={"paths": paths, "pose": place})
    assert drawn.unwrapped.truth.goal[0, 0] == pytest.approx(place - [0.001, 0.0, 0.0])


def test_paths_of_a_reset_in_the_worlds_of_the_mask():
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


def test_pictures_show_paths_and_moving_goals():
    pytest.importorskip("pygame")
    env = single("Follow", paths=SHORT[:1], action="field", render_mode="rgb_array")
    env.reset(seed=0)
    first, lines = env.render(), env.unwrapped.paths()
    assert lines[0][0] == pytest.approx([0.1, 0.08]) and lines[0][-1] == pytest.approx([0.1, 0.095])
    for _ in range(5):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert (env.render() != first).any()
