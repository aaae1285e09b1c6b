"""Snapshots of environments: bitwise continuation, and refusal of other environments' snapshots."""

import copy

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.envs import VibgymEnv


@pytest.mark.parametrize("settings, named", [
    ({"action": "patch"}, "action='field'"), ({"observation": "image"}, "observation='state'"),
    ({"parts": ["steel_block"]}, "parts="), ({"surface": {"rows": 9}}, "surface="),
    ({"periods_per_step": 2}, "periods_per_step=1"),
])  # fmt: skip
def test_states_of_other_environments_are_refused_and_nothing_changes(settings, named):
    env = single("Align", action="field").unwrapped
    other = single("Align", **{"action": "field", **settings}).unwrapped
    env.reset(seed=1), other.reset(seed=1)
    before = env.get_state()
    with pytest.raises(ValueError, match=r"state\['environment'\]"):
        env.set_state(other.get_state())
    assert_same(env.get_state(), before)


def test_states_of_another_number_of_worlds_are_refused():
    env, other = batch("Align", 2), batch("Align", 3)
    env.reset(seed=1), other.reset(seed=1)
    with pytest.raises(ValueError, match=r"state\['steps'\]"):
        env.set_state(other.get_state())
    one = single("Align").unwrapped
    one.reset(seed=1)
    with pytest.raises(ValueError, match="state"):
        env.set_state(one.get_state())


DAMAGE = {
    "nothing": lambda state: None,
    "a key is missing": lambda state: {key: value for key, value in state.items() if key != "episode"},
    "a key too many": lambda state: {**state, "colour": 1},
    "not a flag": lambda state: {**state, "began": 1},
    "negative steps": lambda state: {**state, "steps": -1},
    "no generator": lambda state: {**state, "generator": {"bit_generator": "PCG64"}},
    "not finite": lambda state: {**state, "episode": {**state["episode"], "number": np.full((1, 8), np.nan)}},
    "wrong shape": lambda state: {**state, "episode": {**state["episode"], "goal": np.zeros((2, 1, 3))}},
    "simulator": lambda state: {**state, "simulator": {**state["simulator"], "pose": np.full((1, 1, 3), np.inf)}},
    "sensor": lambda state: {**state, "sensor": {"noise": np.zeros(3)}},
    "actuators": lambda state: {**state, "actuators": None},
}


@pytest.mark.parametrize("damage", DAMAGE.values(), ids=DAMAGE)
def test_damaged_states_are_refused_and_nothing_changes(damage):
    env = single("Align", action="field").unwrapped
    env.reset(seed=1)
    env.step(np.ones(6, dtype=np.float32))
    before = env.get_state()
    with pytest.raises(ValueError, match="state"):
        env.set_state(damage(copy.deepcopy(before)))
    assert_same(env.get_state(), before)


# -- starts that a caller sets -----------------------------------------------------------------------------------------


def test_pose_and_goal_of_a_start():
    env = single("Align", action="field").unwrapped
    env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5], "goal": [0.6, 0.05, -1.0]})
    truth = env.truth
    assert truth.pose[0, 0].tolist() == [0.2, 0.1, 0.5] and truth.goal[0, 0].tolist() == [0.6, 0.05, -1.0]
    drawn = single("Align", action="field").unwrapped
    drawn.reset(seed=3)
    env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5]})  # the rest is drawn as before
    assert (env.truth.goal == drawn.truth.goal).all()
    assert_same(env.reset(), drawn.reset())


def test_transport_accepts_a_position_as_goal():
    env = single("Transport", action="field").unwrapped
    env.reset(seed=3, options={"goal": [0.6, 0.05]})
    assert env.truth.goal[0, 0, :2].tolist() == [0.6, 0.05]


def test_rotate_turns_in_place_at_any_start():
    env, drawn = (single("Rotate", action="field").unwrapped for _ in range(2))
    drawn.reset(seed=3)
    _, info = env.reset(seed=3, options={"pose": [0.2, 0.1, 0.5]})
    assert info["position_error"] == 0.0
    assert info["heading_error"] == pytest.approx(abs((drawn.truth.goal - drawn.truth.pose)[0, 0, 2]), abs=1e-12)


def test_parts_of_a_start():
    env = single("Sort", action="field").unwrapped
    env.reset(seed=3, options={"parts": [1, 4]})
    assert env.truth.present[0].tolist() == [False, True, False, False, True, False]
    pose = env.truth.pose[0, [1, 4]]
    assert (pose[:, :2] > 0.0).all() and (pose[:, :2] < [0.832, 0.208]).all()
    poses = [[0.1 + 0.1 * k, 0.1, 0.3] for k in range(6)]
    env.reset(seed=3, options={"parts": [0, 5], "pose": poses})
    assert env.truth.pose[0, [0, 5]].tolist() == [poses[0], poses[5]] and env.truth.present[0].sum() == 2


def test_starts_of_a_batch():
    env = batch("Align", 3, action="field", autoreset_mode="Disabled")
    pose = np.array([[[0.1, 0.1, 0.0]], [[0.2, 0.1, 0.0]], [[0.3, 0.1, 0.0]]])
    env.reset(seed=1, options={"pose": pose})
    assert (env.truth.pose == pose).all()
    env.reset(options={"reset_mask": np.array([False, True, False]), "pose": [0.5, 0.1, 0.0]})
    assert env.truth.pose[:, 0, 0].tolist() == [0.1, 0.5, 0.3]
    many = batch("Sort", 2, action="field")
    many.reset(seed=1, options={"parts": np.array([[True] * 6, [True, False] * 3])})
    assert many.truth.present.sum(axis=1).tolist() == [6, 3]


BAD_OPTIONS = [
    ("Align", {"reset_maks": [True]}, "options"),
    ("Align", {"reset_mask": [True]}, "options"),  # of batches only
    ("Align", "pose", "options"),
    ("Align", {"pose": [0.2, 0.1, np.nan]}, r"options\['pose'\]"),
    ("Align", {"pose": [2.0, 0.1, 0.0]}, r"options\['pose'\]"),
    ("Align", {"goal": [0.2, -0.1, 0.0]}, r"options\['goal'\]"),
    ("Align", {"goal": [0.2, 0.1]}, r"options\['goal'\]"),
    ("Sort", {"goal": [0.2, 0.1, 0.0]}, r"options\['goal'\]"),
    ("Sort", {"pose": [0.2, 0.1, 0.0]}, r"options\['pose'\]"),  # all six in one place
    ("Sort", {"parts": []}, r"options\['parts'\]"),
    ("Sort", {"parts": [0, 0]}, r"options\['parts'\]"),
    ("Sort", {"parts": [6]}, r"options\['parts'\]"),
    ("Sort", {"parts": [False] * 6}, r"options\['parts'\]"),
]


@pytest.mark.parametrize("task, options, named", BAD_OPTIONS, ids=lambda each: str(each)[:40])
def test_bad_options_are_refused_and_nothing_changes(task, options, named):
    env = single(task, action="field").unwrapped
    env.reset(seed=1)
    before = env.get_state()
    with pytest.raises(ValueError, match=f"{named}"):
        env.reset(seed=2, options=options)
    assert_same(env.get_state(), before)
    if options == {"reset_mask": [True]}:
        return
    many = batch(task, 2, action="field")
    many.reset(seed=1)
    before = many.get_state()
    with pytest.raises(ValueError, match=f"{named}"):
        many.reset(seed=2, options=options)
    assert_same(many.get_state(), before)


# -- what Gymnasium's vector environments have -------------------------------------------------------------------------


def test_call_get_attr_and_set_attr():
    env = batch("Align", 3, action="field", render_mode="rgb_array")
    env.reset(seed=1)
    assert env.get_attr("step_time") == (0.04,) * 3 and env.call("step_time") == (0.04,) * 3
    assert env.get_attr("task") == (env.task,) * 3
    frames = env.call("render")
    assert len(frames) == 3 and frames[0].shape == env.render()[0].shape
    assert env.call("caption", 1) == (env.caption(1),) * 3
    env.set_attr("max_episode_steps", 5)
    assert env.max_episode_steps == 5
    env.set_attr("max_episode_steps", [7, 7, 7])
    assert env.max_episode_steps == 7
    for call, named in [
        (lambda: env.call("juggle"), "name"), (lambda: env.get_attr("_steps"), "name"),
        (lambda: env.get_attr(3), "name"),
        (lambda: env.set_attr("colour", 1), "name"), (lambda: env.set_attr("step", 1), "name"),
        (lambda: env.set_attr("task", 1), "name"), (lambda: env.set_attr("max_episode_steps", [5, 6, 7]), "values"),
        (lambda: env.set_attr("max_episode_steps", [5]), "values"),
        (lambda: env.set_attr("metadata", [np.arange(2), np.arange(2), np.arange(3)]), "values"),
    ]:  # fmt: skip
        with pytest.raises(ValueError, match=f"{named}"):
            call()


def test_stepping_after_close_raises():
    one, many = single("Align", action="field"), batch("Align", 2, action="field")
    for env in (one, many):
        env.reset(seed=0)
        env.close()
        with pytest.raises(gym.error.ClosedEnvironmentError, match="closed"):
            env.step(env.action_space.sample())
        env.reset(seed=0)
        env.step(env.action_space.sample())


def test_rendering_without_a_mode_warns():
    for env in (single("Align").unwrapped, batch("Align", 2)):
        env.reset(seed=0)
        with pytest.warns(UserWarning, match="render_mode"):
            assert env.render() is None


def test_frames_per_second_follow_the_step():
    for settings, expected in [({}, 25), ({"periods_per_step": 5}, 5), ({"surface": {"frequency": 50.0}}, 50)]:
        assert single("Align", **settings).unwrapped.metadata["render_fps"] == expected
        assert batch("Align", 2, **settings).metadata["render_fps"] == expected


LIMITS = [
    ({}, 250), ({"max_episode_steps": None}, 250), ({"max_episode_steps": -1}, None), ({"max_episode_steps": 400}, 400),
    ({"max_episode_periods": 100}, 100), ({"periods_per_step": 8}, 32), ({"periods_per_step": 8, "max_episode_steps": 3}, 3),
    ({"periods_per_step": 8, "max_episode_steps": 50}, 50), ({"periods_per_step": 8, "max_episode_steps": -1}, None),
    ({"periods_per_step": 8, "max_episode_periods": 16}, 2),
]  # fmt: skip


@pytest.mark.parametrize("settings, limit", LIMITS)
@pytest.mark.parametrize("made", ["single", "batch", "sync", "drawn", "sb3", "respecified"])
def test_the_limit_is_the_same_however_an_environment_is_made(made, settings, limit):
    """A registered limit counts periods; ``max_episode_steps`` replaces it, and the specification has the result."""
    settings = {"action": "velocity", **settings}
    if made == "sb3":
        worlds = pytest.importorskip("vibgym.adapters.sb3").VecEnv("vibgym/Align-v0", num_envs=2, **settings)
        env, reset, step = worlds.envs[0], worlds.reset, lambda: worlds.step(np.zeros((2, 3)))[2]
    else:
        more = {"vectorization_mode": "sync"} if made == "sync" else {}
        many = made not in ("single", "respecified")
        name = "AlignShapes" if made == "drawn" else "Align"
        env = batch(name, 2, **settings, **more) if many else single(name, **settings)
        env = gym.make(env.spec) if made == "respecified" else env
        reset, step = lambda: env.reset(seed=7), lambda: env.step(np.zeros(env.action_space.shape))[3]
    reset()
    ends = [np.all(step()) for _ in range(limit or 260)]
    assert np.flatnonzero(ends).tolist() == ([] if limit is None else [limit - 1])
    assert (env.envs[0] if made == "sync" else env).spec.max_episode_steps == limit
    with pytest.raises(ValueError, match="max_episode_periods"):
        single("Align", max_episode_periods=0)


@pytest.mark.parametrize("taken", [None, 2, 8])
@pytest.mark.parametrize("registered", [True, False])
def test_a_restored_episode_ends_at_its_own_step(taken, registered):
    def made():
        if not registered:
            return gym.wrappers.TimeLimit(VibgymEnv("Align", action="field"), 10)
        return gym.wrappers.ClipAction(single("Align", action="field", max_episode_steps=10))

    env, other = made(), made()
    env.reset(seed=1)
    rest = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(4):
        env.step(rest)
    if taken is not None:
        other.reset(seed=2)
        for _ in range(taken):
            other.step(rest)
    other.unwrapped.set_state(env.unwrapped.get_state())
    assert [other.step(rest)[3] for _ in range(6)] == [False] * 5 + [True]
    other.reset()
    assert [other.step(rest)[3] for _ in range(10)] == [False] * 9 + [True]
