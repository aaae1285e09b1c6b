"""Follow as an environment: alone and in a batch, restored, observed, drawn, and followed to the end."""

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.policies.classical.measured import Measured
from vibgym.policies.task_info import TaskInfo
from vibgym.tasks import paths as route

THREE = ["steel_block", "aluminium_block", "steel_block"]
SHORT = [{"shape": "polyline", "points_mm": [[x, 80], [x, 95]]} for x in (100, 300)]
CIRCLE = {"shape": "circle", "centre_mm": [400, 104], "radius_mm": 60}


@pytest.mark.parametrize("settings", [{}, {"parts": THREE}, {"paths": {"heading": "along", "speed": 0.06}}], ids=str)
def test_observations_contain_present_and_future_goals(settings):
    env = batch("Follow", 4, action="field", autoreset_mode="Disabled", **settings)
    info, period = TaskInfo.of(env), env.surface.period
    env.reset(seed=2)
    for clock in range(1, 12):
        seen = env.step(np.zeros(env.action_space.shape, dtype=np.float32))[0]
        measured, truth = Measured.of(seen, info), env.truth
        paths = env.core.scoring.custom_state()["paths"]
        for w, k in np.ndindex(truth.goal.shape[:2]):
            motion = route.sample(paths[w, k], period * (clock + np.arange(5)))
            assert measured.goal_velocity[w, k] == pytest.approx(motion[0, 3:6], abs=1e-5)
            assert measured.goal_ahead[w, k] == pytest.approx(motion[1:, :3] - motion[0, :3], abs=1e-5)
            assert measured.displacement[w, k] == pytest.approx(motion[0, :2] - truth.pose[w, k, :2], abs=1e-6)
    assert info.goal_moves and info.has_goal and not TaskInfo.of(single("Align")).goal_moves


def test_unused_features_are_zero():
    measured = Measured.of(*[(single("Align").reset(seed=0)[0]), TaskInfo.of(single("Align"))])
    assert (measured.goal_velocity == 0).all() and (measured.goal_ahead == 0).all()
    assert (measured.displacement[..., None, :] + measured.goal_ahead[..., :2]).shape == (1, 1, 4, 2)


def followed(worlds, seed=0, **settings):
    """Return the action of a controller that reaches the next goal with its velocity a period from now."""
    env = batch("Follow", worlds, action="wrench", autoreset_mode="Disabled", **settings)
    info = TaskInfo.of(env)
    scale, period = env.core.action.scale, info.step_time
    seen, _ = env.reset(seed=seed)
    last = np.zeros((worlds, len(info.parts), 3))
    alive, ends, gap = np.ones(worlds, dtype=bool), {}, np.inf
    for _ in range(400):
        m = Measured.of(seen, info)
        now = np.concatenate([m.velocity, m.spin[..., None]], axis=-1) + 0.5 * period * last
        left = (
            np.concatenate([m.displacement, m.heading_error[..., None]], axis=-1)
            + m.goal_ahead[..., 0, :]
            - period * now
        )
        wanted = 0.5 * left / period**2 + 0.6 * (m.goal_ahead[..., 1, :] / (2 * period) - now) / period
        action = np.clip(wanted / scale, -1.0, 1.0)
        last = scale * action
        seen, _, terminated, truncated, stated = env.step(action.reshape(worlds, -1).astype(np.float32))
        gap = min(gap, stated["clearance"][alive].min())
        for world in np.flatnonzero(alive & terminated):
            ends[world] = {name: stated[name][world] for name in ("is_success", "path_error", "largest_path_error")}
        alive &= ~terminated
        if not alive.any():
            return ends, gap
        if terminated.any() or truncated.any():
            seen, _ = env.reset(options={"reset_mask": terminated | truncated})
    raise AssertionError(f"worlds {np.flatnonzero(alive)} have not ended")


@pytest.mark.parametrize("settings", [
    {}, {"parts": THREE}, {"paths": {"heading": "along"}},
    {"paths": [{**CIRCLE, "laps": 2}]},
], ids=["drawn", "three", "along", "circle"])  # fmt: skip
def test_paths_can_be_followed_by_the_observation_alone(settings):
    ends, gap = followed(4, **settings)
    assert all(each["is_success"] for each in ends.values())
    assert max(each["path_error"] for each in ends.values()) < 1.5e-3
    assert all(each["path_error"] <= each["largest_path_error"] <= 0.005 for each in ends.values())
    assert gap > np.sqrt(2.0) * 0.026


def test_leaving_the_tolerance_prevents_success_but_not_the_episode():
    env = single("Follow", paths=SHORT[:1], action="field")
    env.reset(seed=0)
    for _ in range(60):  # the path takes less than that
        *_, terminated, truncated, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
        assert not terminated and not truncated
    assert not info["is_success"] and info["position_error"] == pytest.approx(0.015, abs=1e-3)
    assert info["largest_path_error"] == pytest.approx(info["position_error"], abs=1e-6)
    assert info["position_error"] > info["path_error"] > 0.005


def test_custom_starts():
    env = single("Follow", parts=THREE[:2], paths=SHORT, action="field")
    begin = [[0.1, 0.08, 0.3], [0.303, 0.08, -0.4]]
    _, info = env.reset(seed=0, options={"pose": begin})
    assert env.unwrapped.truth.pose[0] == pytest.approx(np.array(begin)) and info["position_error"] == pytest.approx(
        0.003
    )
    assert env.unwrapped.truth.goal[0, :, 2] == pytest.approx([0.3, -0.4])
    before = env.unwrapped.get_state()
    with pytest.raises(ValueError, match=r"options\['pose'\]"):
        env.reset(options={"pose": [[0.1, 0.09, 0.0], [0.3, 0.08, 0.0]]})
    with pytest.raises(ValueError, match=r"options\['goal'\]"):
        env.reset(options={"goal": [[0.1, 0.09, 0.0], [0.3, 0.08, 0.0]]})
    assert_same(env.unwrapped.get_state(), before)
    env.reset(options={"parts": [1]})
    assert env.unwrapped.truth.present.tolist() == [[False, True]]
    for _ in range(3):
        _, _, terminated, _, info = env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert not terminated and info["path_error"] > 0.0


@pytest.mark.parametrize("settings, message", [
    ({"paths": [{**CIRCLE, "speed": 0.3}]}, r"paths\[0\].speed"),
    ({"paths": [{**CIRCLE, "laps": 9}]}, "paths"),
    ({"paths": "circle"}, "paths"), ({"walls": ["left"]}, "walls"),
    ({"surface": {"horizontal_amplitude": 0.0}}, "parts"), ({"parts": THREE * 4}, "parts"),
])  # fmt: skip
def test_bad_settings(settings, message):
    for make in (lambda: single("Follow", **settings), lambda: batch("Follow", 2, **settings)):
        with pytest.raises(ValueError, match=f"^{message}"):
            make()


def test_pictures_show_paths_and_moving_goals():
    pytest.importorskip("pygame")
    env = single("Follow", paths=SHORT[:1], action="field", render_mode="rgb_array")
    env.reset(seed=0)
    first, lines = env.render(), env.unwrapped.paths()
    assert lines[0][0] == pytest.approx([0.1, 0.08]) and lines[0][-1] == pytest.approx([0.1, 0.095])
    for _ in range(5):
        env.step(np.zeros(env.action_space.shape, dtype=np.float32))
    assert (env.render() != first).any()
    assert env.unwrapped.caption().startswith("Follow   error ")
    assert single("Align").unwrapped.paths() == []
