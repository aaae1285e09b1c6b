"""Environments whose parts have shapes drawn from a split for each episode."""

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same
from vibgym.envs.drawn import drawn_shapes, fixed_scenes
from vibgym.envs.viewer import scenery_of
from vibgym.policies import make_policy, rollout
from vibgym.policies.measures import Measures
from vibgym.scene.library import shapes

IDS = ("AlignShapes", "SortShapes", "PackShapes", "PushShapes")
DRAWN = [{"shape": "drawn"}]


def made(name="AlignShapes", **settings):
    return gym.make(f"vibgym/{name}-v0", **{"action": "velocity", "split": "test", **settings})


@pytest.mark.parametrize("name", IDS)
@pytest.mark.parametrize("split", ["test", "held_out"])
def test_resets_draw_parts_of_the_split(name, split):
    env, library = made(name, split=split), {part.name for part in shapes(split)}
    names = set()
    for seed in range(12):
        env.reset(seed=seed)
        drawn = {part.name for part in env.unwrapped.parts if part.name != "pusher"}
        assert drawn <= library and len(drawn) == (2 if name == "SortShapes" else 1)
        names |= drawn
    assert len(names) > 6
    drawn = drawn_shapes(f"vibgym/{name}-v0", {"split": split})
    scenes = [tuple(scene["shapes"]) for scene in fixed_scenes(drawn)]  # cover the split
    assert [scene[0] for scene in scenes] == list(range(len(library)))
    assert all(len(set(scene)) == len(scene) == drawn.draws for scene in scenes)


def test_every_part_of_a_split_is_drawn_about_equally_often():
    drawn = drawn_shapes("vibgym/AlignShapes-v0", {"split": "validation"})
    counts = np.bincount(drawn.draw(np.random.default_rng(0).random((1400, 1)))[:, 0], minlength=14)
    assert len(counts) == 14 and counts.min() > 60 and counts.max() < 145


@pytest.mark.parametrize("name", ["AlignShapes", "SortShapes"])
def test_an_episode_is_that_of_an_environment_with_this_shape(name):
    """Also of a batch with fixed shapes."""
    env, names = made(name), [part.name for part in shapes("test")]
    for seed in range(3):
        first, _ = env.reset(seed=seed)
        indices = [names.index(part) for part in dict.fromkeys(part.name for part in env.unwrapped.parts)]
        alone, batch = (
            made(name, shapes=indices),
            gym.make_vec(f"vibgym/{name}-v0", num_envs=2, action="velocity", split="test", shapes=indices),
        )
        np.testing.assert_array_equal(alone.reset(seed=seed)[0], first)
        np.testing.assert_array_equal(batch.reset(seed=[9, seed])[0][1], first)
        assert [part.name for part in batch.unwrapped.parts] == [part.name for part in env.unwrapped.parts]
        draw = np.random.default_rng(seed)
        for _ in range(5):
            action = draw.uniform(-1, 1, env.action_space.shape)
            assert_same(alone.step(action), env.step(action))


def test_pictures_show_the_drawn_part():
    env, frames = made(render_mode="rgb_array"), set()
    for seed in range(3):
        env.reset(seed=seed, options={"pose": [0.4, 0.1, 0.0], "goal": [0.4, 0.1, 0.0]})
        frames.add(env.render().tobytes())
    assert len(frames) == 3
    env = made("SortShapes", render_mode="rgb_array")
    for seed in range(3):
        env.reset(seed=seed)
        labels = [zone.label for zone in scenery_of(env.unwrapped).zones]
        assert labels == list(dict.fromkeys(part.name for part in env.unwrapped.parts))


def test_rollouts_have_a_policy_for_each_shape_and_the_order_of_the_seeds():
    seeds = [11, 3, 7, 3]
    law = {"kind": "pose", "action": "velocity"}
    result = rollout(law, "vibgym/AlignShapes-v0", seeds=seeds, split="test", keep=Measures)
    assert result.seeds == tuple(seeds) and result.success.all()
    assert result.steps[1] == result.steps[3] and np.isfinite(result.bound).all()
    for seed, steps in zip(seeds, result.steps.tolist()):
        env = made()
        observation, _ = env.reset(seed=seed)
        policy, state, done, count = make_policy(law, env), None, False, 0
        while not done:
            action, state = policy.predict(observation, state)
            observation, _, terminated, truncated, _ = env.step(action)
            done, count = terminated or truncated, count + 1
        assert count == steps


def test_a_refused_call_changes_nothing():
    env = gym.make_vec("vibgym/AlignShapes-v0", num_envs=3, action="velocity", split="test")
    env.reset(seed=3)
    env.step(np.zeros((3, 3)))
    before = env.unwrapped.get_state()
    wrong = {}, dict(before, kinds=before["kinds"][:2]), dict(before, kinds=before["kinds"] + 99)
    calls = [
        lambda: env.reset(seed=9, options={"pose": [0.025, 0.025, np.nan]}),
        *(lambda state=state: env.unwrapped.set_state(state) for state in wrong),
    ]
    for call in calls:
        with pytest.raises(ValueError):
            call()
        assert_same(env.unwrapped.get_state(), before)


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
    rows = {name: values[:2] for name, values in observation.items()} if law == "learned" else observation[:2]
    with pytest.raises(ValueError, match="6 worlds"):
        policy.predict(rows)
