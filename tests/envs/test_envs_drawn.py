"""Environments whose parts have shapes drawn from a split for each episode."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.envs import VibgymEnv
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.viewer import scenery_of
from vibgym.policies import make_policy, rollout
from vibgym.policies.measures import Measures
from vibgym.scene.library import shapes

IDS = ("AlignShapes", "SortShapes", "PackShapes", "PushShapes")
DRAWN = [{"shape": "drawn"}]


def made(name="AlignShapes", **settings):
    return gym.make(f"vibgym/{name}-v0", **{"action": "velocity", "split": "test", **settings})


def shapes_of(env, split="test"):
    names = [part.name for part in shapes(split)]
    return [names.index(name) for name in dict.fromkeys(part.name for part in env.unwrapped.parts)]


def played(env, steps, seed):
    draw, seen = np.random.default_rng(seed), []
    for _ in range(steps):
        observation, reward, terminated, truncated, _ = env.step(draw.uniform(-1, 1, env.action_space.shape))
        seen.append((observation, reward, terminated, truncated))
        if terminated or truncated:
            break
    return seen


def same(one, other):
    assert len(one) == len(other)
    for (a, *b), (c, *d) in zip(one, other):
        np.testing.assert_array_equal(a, c)
        assert b == d


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("split", ["test", "held_out"])
def test_resets_draw_parts_of_the_split(name, split):
    env, library = made(name, split=split), shapes(split)
    names = set()
    for seed in range(12):
        env.reset(seed=seed)
        drawn = {part.name for part in env.unwrapped.parts if part.name != "pusher"}
        assert drawn <= {part.name for part in library} and len(drawn) == (2 if name == "SortShapes" else 1)
        names |= drawn
    assert len(names) > 6


def test_every_part_of_a_split_is_drawn_about_equally_often():
    drawn = drawn_shapes("vibgym/AlignShapes-v0", {"split": "validation"})
    counts = np.bincount(drawn.draw(np.random.default_rng(0).random((1400, 1)))[:, 0], minlength=14)
    assert len(counts) == 14 and counts.min() > 60 and counts.max() < 145


def test_an_episode_is_that_of_an_environment_with_this_shape():
    env = made("SortShapes")
    for seed in range(3):
        first, _ = env.reset(seed=seed)
        own = made("SortShapes", shapes=shapes_of(env))
        same([(own.reset(seed=seed)[0],)], [(first,)])
        same(played(own, 5, seed), played(env, 5, seed))


def test_a_native_batch_has_one_shape_and_the_starts_of_single_environments():
    env = gym.make_vec("vibgym/AlignShapes-v0", num_envs=2, action="velocity", split="test", shapes=[3])
    single = made(shapes=[3])
    first = env.reset(seed=8)[0]
    np.testing.assert_array_equal(first[1], single.reset(seed=9)[0])
    assert env.unwrapped.parts[0].name == shapes("test")[3].name


def test_a_reset_that_is_refused_changes_nothing():
    env = made()
    env.reset(seed=1)
    before = env.unwrapped.parts, env.unwrapped.get_state()
    with pytest.raises(ValueError, match="pose"):
        env.reset(seed=2, options={"pose": [5.0, 5.0, 0.0]})
    with pytest.raises(ValueError, match="kinds"):
        env.unwrapped.set_state({**before[1], "kinds": [[99]]})
    assert env.unwrapped.parts == before[0]
    assert_same(env.unwrapped.get_state(), before[1])


def test_pictures_show_the_drawn_part():
    env = made(render_mode="rgb_array")
    frames = []
    for seed in range(3):
        env.reset(seed=seed, options={"pose": [0.4, 0.1, 0.0], "goal": [0.4, 0.1, 0.0]})
        frames.append(env.render())
    assert len({frame.tobytes() for frame in frames}) == 3


def test_zones_are_labelled_by_the_drawn_parts():
    env = made("SortShapes", render_mode="rgb_array")
    for seed in range(3):
        env.reset(seed=seed)
        labels = [zone.label for zone in scenery_of(env.unwrapped).zones]
        assert labels == list(dict.fromkeys(part.name for part in env.unwrapped.parts))


def test_rollouts_have_a_policy_for_each_shape_and_the_order_of_the_seeds():
    seeds = [11, 3, 7, 3]
    law = {"kind": "pose", "action": "velocity"}
    found = rollout(law, "vibgym/AlignShapes-v0", seeds=seeds, split="test", keep=Measures)
    assert found.seeds == tuple(seeds) and found.success.all()
    assert found.steps[1] == found.steps[3] and np.isfinite(found.bound).all()
    for seed, steps in zip(seeds, found.steps.tolist()):
        env = made()
        observation, _ = env.reset(seed=seed)
        policy, state, done, count = make_policy(law, env), None, False, 0
        while not done:
            action, state = policy.predict(observation, state)
            observation, _, terminated, truncated, _ = env.step(action)
            done, count = terminated or truncated, count + 1
        assert count == steps


def test_scenes_with_fixed_shapes_cover_a_split():
    for name in IDS:
        drawn = drawn_shapes(f"vibgym/{name}-v0", {"split": "held_out"})
        scenes = [tuple(scene["shapes"]) for scene in fixed_scenes(drawn)]
        assert [scene[0] for scene in scenes] == list(range(16))
        assert all(len(set(scene)) == len(scene) == drawn.draws for scene in scenes)


@pytest.mark.parametrize(("settings", "named"), [
    ({"split": "tests"}, "did you mean 'test'"),
    ({"split": None}, "drawn"),
    ({"split": None, "parts": None, "shapes": [1]}, "shapes require split"),
    ({"shapes": [28]}, r"shapes\[0\]"),
    ({"shapes": [1, 2]}, "1 different"),
    ({"shapes": 3}, "shapes"),
    ({"parts": ["aluminium_block"]}, "drawn shape"),
    ({"parts": [{"shape": "drawn", "which": 1}]}, "without gaps"),
    ({"task": "Feed"}, "arrive and leave"),
])  # fmt: skip
def test_bad_settings_are_one_error(settings, named):
    with pytest.raises(ValueError, match=named) as error:
        VibgymEnv(**{"task": "Align", "action": "velocity", "split": "test", "parts": DRAWN, **settings})
    assert "\n" not in str(error.value)


def test_a_batch_refuses_bad_calls_before_anything_changes():
    env = gym.make_vec("vibgym/AlignShapes-v0", num_envs=3, action="velocity", split="test")
    env.reset(seed=3)
    env.step(np.zeros((3, 3)))
    before = env.unwrapped.get_state()
    corner = [0.025, 0.025, 0.0]
    wrong = dict(before, kinds=before["kinds"][:2]), dict(before, kinds=before["kinds"] + 99), {}
    calls = [
        lambda: env.step(np.full((3, 3), np.nan)),
        lambda: env.step(np.zeros((2, 3))),
        lambda: env.reset(seed=9, options={"pose": [*corner[:2], np.nan]}),
        *(lambda state=state: env.unwrapped.set_state(state) for state in wrong),
    ]
    for call in calls:
        with pytest.raises(ValueError):
            call()
        assert_same(env.unwrapped.get_state(), before)


@pytest.mark.parametrize(("name", "settings"), [
    ("AlignShapes", {"action": "velocity"}),
    ("AlignShapes", {"action": "target", "observation": "image"}),
    ("AlignShapes", {"action": "patch", "sensor": {"kind": "pose", "noise": {"position_mm": 0.5}, "estimator": "model"}}),
    ("AlignShapes", {"action": "wrench", "randomize": {"disturbance": {"rate": 5.0, "tilt_deg": 3.0}}}),
    ("AlignShapes", {"action": "field", "sensor": {"kind": "camera", "statistical": True}, "observation": "parts"}),
    ("AlignShapes", {"action": "velocity", "model": "averaged", "observation": "goal"}),
    ("SortShapes", {"action": "field", "randomize": {"friction": [0.9, 1.1], "mass": [0.5, 2.0]}, "observation": "parts"}),
    ("SortShapes", {"action": "velocity", "model": {"kind": "planar", "contacts": "fast"}}),
    ("PackShapes", {"action": "velocity", "model": {"kind": "planar", "contacts": "pymunk"}}),
    ("PushShapes", {"action": "velocity", "costs": {"impulse": 1.0}, "sensor": {"kind": "pose", "estimator": "kalman"}}),
])  # fmt: skip
def test_a_batch_has_the_bits_of_single_environments(name, settings):
    """Worlds with different parts, through the ends of episodes and a restored snapshot."""
    worlds, draw = 5, np.random.default_rng(3)
    options = {**settings, "split": "train", "max_episode_periods": 12, "task_settings": {"hold": 5}}
    many = gym.make_vec(f"vibgym/{name}-v0", num_envs=worlds, **options)
    singles = [gym.make(f"vibgym/{name}-v0", disable_env_checker=True, **options) for _ in range(worlds)]
    compared(many.reset(seed=4)[0], [env.reset(seed=4 + k)[0] for k, env in enumerate(singles)])
    assert len({env.unwrapped.parts[-1].name for env in singles}) > 2
    ended = np.zeros(worlds, dtype=bool)
    for step in range(20):
        actions = draw.uniform(-1.0, 1.0, many.action_space.shape).astype(np.float32)
        if step == 7:
            state = many.unwrapped.get_state()
            many.step(actions)
            many.unwrapped.set_state(state)
        seen, reward, terminated, truncated, _ = many.step(actions)
        expected = []
        for k, env in enumerate(singles):
            if ended[k]:
                expected.append(env.reset()[0])
                assert reward[k] == 0.0
            else:
                observation, earned, *ends, _ = env.step(actions[k])
                expected.append(observation)
                assert (reward[k], terminated[k], truncated[k]) == (earned, *ends)
        compared(seen, expected)
        ended = terminated | truncated
    assert many.unwrapped.core.kinds.kind.shape == (worlds, len(many.unwrapped.parts))


def compared(batch, singles):
    for key in batch if isinstance(batch, dict) else [None]:
        many = batch if key is None else batch[key]
        np.testing.assert_array_equal(many, [each if key is None else each[key] for each in singles])


@pytest.mark.parametrize("law", ["pose", "pid", "learned"])
def test_a_controller_acts_by_the_parts_of_each_world(law):
    env = gym.make_vec(
        "vibgym/AlignShapes-v0", num_envs=6, action="velocity", observation="parts" if law == "learned" else "state"
    )
    policy, singles = make_policy(law, env), []
    observation, _ = env.reset(seed=0)
    many, state = policy.predict(observation)
    for k in range(6):
        single = gym.make("vibgym/AlignShapes-v0", action="velocity", observation=policy.observation)
        seen, _ = single.reset(seed=k)
        singles.append(make_policy(law, single).predict(seen)[0])
    np.testing.assert_array_equal(many, singles)
    with pytest.raises(ValueError, match="6 worlds"):
        policy.predict(
            {name: values[:2] for name, values in observation.items()} if law == "learned" else observation[:2]
        )
