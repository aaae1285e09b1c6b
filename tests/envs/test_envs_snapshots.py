"""Refused snapshots, methods of vector environments, and limits of episodes. Bitwise continuation: see ``tests/contracts``."""

import copy

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.envs import VibgymEnv


def other(task="Align", worlds=None, **settings):
    """Return a state of another environment; the one before is ignored."""

    def state(_):
        env = single(task, **settings).unwrapped if worlds is None else batch(task, worlds, **settings)
        env.reset(seed=1)
        return env.get_state()

    return state


DAMAGE = {
    "another action": other(action="patch"),
    "another observation": other(action="field", observation="image"),
    "other parts": other(action="field", parts=["steel_block"]),
    "another surface": other(action="field", surface={"rows": 9}),
    "longer steps": other(action="field", periods_per_step=2),
    "several worlds": other(action="field", worlds=3),
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
def test_other_and_damaged_states_are_refused_and_nothing_changes(damage):
    env = single("Align", action="field").unwrapped
    env.reset(seed=1)
    env.step(np.ones(6, dtype=np.float32))
    before = env.get_state()
    with pytest.raises(ValueError, match="state"):
        env.set_state(damage(copy.deepcopy(before)))
    assert_same(env.get_state(), before)


def test_states_of_another_number_of_worlds_are_refused():
    env = batch("Align", 2)
    env.reset(seed=1)
    for worlds in (3, None):
        with pytest.raises(ValueError, match="state"):
            env.set_state(other(worlds=worlds)(None))


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


def test_rendering_without_a_mode_warns():
    for env in (single("Align").unwrapped, batch("Align", 2)):
        env.reset(seed=0)
        with pytest.warns(UserWarning, match="render_mode"):
            assert env.render() is None


@pytest.mark.parametrize(
    "settings, rate", [({}, 25), ({"periods_per_step": 5}, 5), ({"surface": {"frequency": 50.0}}, 50)]
)
def test_frames_per_second_follow_the_step(settings, rate):
    assert single("Align", **settings).unwrapped.metadata["render_fps"] == rate
    assert batch("Align", 2, **settings).metadata["render_fps"] == rate


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
