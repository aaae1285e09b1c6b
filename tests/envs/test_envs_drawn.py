"""Environments whose parts have shapes drawn from a split for each episode."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.envs.drawn import drawn_shapes, fixed_scenes, seeds_by_shapes
from vibgym.policies import make_policy, rollout
from vibgym.policies.measures import Measures
from vibgym.scene.library import shapes

IDS = ("AlignShapes", "SortShapes", "PackShapes", "PushShapes")
DRAWN = [{"shape": "drawn"}]


def made(name="AlignShapes", **settings):
    return gym.make(f"vibgym/{name}-v0", **{"action": "velocity", "split": "test", **settings})


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
    groups = seeds_by_shapes(drawn, range(1400))
    assert sorted(groups) == [(k,) for k in range(14)]
    assert all(60 < len(which) < 145 for which in groups.values())
    assert sorted(k for which in groups.values() for k in which) == list(range(1400))


def test_an_episode_is_that_of_an_environment_with_this_shape():
    env = made("SortShapes")
    for seed in range(3):
        first, _ = env.reset(seed=seed)
        own = made("SortShapes", shapes=env.unwrapped.core.options.shapes)
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
    with pytest.raises(ValueError, match="shapes"):
        env.unwrapped.set_state({**before[1], "shapes": [99]})
    assert env.unwrapped.parts is before[0]
    after = env.unwrapped.get_state()
    assert after["generator"] == before[1]["generator"] and after["shapes"] == before[1]["shapes"]


def test_few_scenes_are_kept(monkeypatch):
    monkeypatch.setattr("vibgym.envs.single.MOST_CORES", 3)
    env, other = made("SortShapes").unwrapped, made("SortShapes").unwrapped
    for seed in [*range(6), 0]:
        seen = env.reset(seed=seed)[0]
        assert len(env._cores) <= 3 and env.core in env._cores.values()
    np.testing.assert_array_equal(seen, other.reset(seed=0)[0])


def test_pictures_show_the_drawn_part():
    env = made(render_mode="rgb_array")
    frames = []
    for seed in range(3):
        env.reset(seed=seed, options={"pose": [0.4, 0.1, 0.0], "goal": [0.4, 0.1, 0.0]})
        frames.append(env.render())
    assert len({frame.tobytes() for frame in frames}) == 3


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


def test_results_of_an_unknown_kind_are_not_joined():
    class Keep:
        def __init__(self, env, info, seeds):
            pass

        def add(self, step):
            pass

        def result(self, task, timing):
            return 1

    with pytest.raises(ValueError, match="dataclass"):
        rollout("pose", "vibgym/AlignShapes-v0", seeds=[0, 1], keep=Keep, max_episode_steps=3)


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
    ({"action": "patch"}, "patch"),
])  # fmt: skip
def test_bad_settings_are_one_error(settings, named):
    with pytest.raises(ValueError, match=named) as error:
        made(**settings)
    assert "\n" not in str(error.value)


def test_a_batch_refuses_bad_calls_before_anything_changes():
    env = gym.make_vec("vibgym/AlignShapes-v0", num_envs=3, action="velocity", split="test")
    env.reset(seed=3)
    env.step(np.zeros((3, 3)))
    before = env.unwrapped.get_state()
    corner = [0.025, 0.025, 0.0]
    wrong = dict(before, envs=before["envs"][:2]), dict(before, envs=[*before["envs"][:2], {}]), {}
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


def test_a_native_batch_without_shapes_is_one_error():
    from vibgym.envs import VibgymVectorEnv

    with pytest.raises(ValueError, match="shapes="):
        VibgymVectorEnv("Align", 2, parts=DRAWN, split="train")


def test_batches_with_drawn_shapes_are_one_error_where_worlds_need_one_scene():
    from vibgym.policies.rollout import worlds_of

    with pytest.raises(ValueError, match="one scene"):
        worlds_of("vibgym/AlignShapes-v0", 2)
