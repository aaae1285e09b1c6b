"""Observations against the simulator's state."""

import math

import numpy as np
import pytest

from tests.envs.helpers import PIXEL, TASKS, batch, feature, goal, pixel, put, single, still

PARTS = [
    pytest.param("aluminium_block", 2, id="block"),
    pytest.param({"shape": "disc", "radius": 0.02, "friction": 0.5}, 0, id="disc"),
    pytest.param({"shape": "rectangle", "length": 0.04, "width": 0.04, "friction": 0.5}, 4, id="square"),
    pytest.param(
        {"shape": "polygon", "vertices_mm": [[0, 0], [50, 0], [50, 20], [20, 20], [20, 40], [0, 40]], "friction": 0.5},
        1,
        id="L",
    ),
]


def wrapped(angle, period):
    return (angle + period / 2) % period - period / 2


def table(task, symmetry, pose, mean_velocity, aim):
    """The documented table, index by index, for the default surface."""
    x, y, heading = pose
    size, width, height, speed = 0.026, 0.832, 0.208, 2.7e-3 * 2 * math.pi * 25.0
    clip = lambda value: min(max(value, -1.0), 1.0)  # noqa: E731
    ex, ey = aim[0] - x, aim[1] - y
    heading_error = aim[2] - heading
    if task == "Transport" or (task == "Align" and symmetry == 0):
        heading_error = 0.0
    elif task == "Align":
        heading_error = wrapped(heading_error, 2 * math.pi / symmetry)
    return [
        2 * ((x / size) % 1.0) - 1,
        2 * ((y / size) % 1.0) - 1,
        math.cos(symmetry * heading),
        math.sin(symmetry * heading),
        clip(2 * x / width - 1),
        clip(2 * y / height - 1),
        clip(ex / width),
        clip(ey / width),
        math.tanh(ex / 0.050),
        math.tanh(ey / 0.050),
        math.tanh(ex / 0.005),
        math.tanh(ey / 0.005),
        clip(heading_error / (2 * math.pi)),
        math.tanh(heading_error / 0.5),
        math.tanh(heading_error / 0.05),
        clip(mean_velocity[0] / speed),
        clip(mean_velocity[1] / speed),
        clip(mean_velocity[2] / 10.0),
    ]


@pytest.mark.parametrize("part, symmetry", PARTS)
@pytest.mark.parametrize("task", TASKS)
def test_state_table(task, part, symmetry):
    worlds = 20
    env = batch(task, worlds, action="patch", parts=[part])
    env.reset(seed=1)
    generator = np.random.default_rng(2)
    pose = generator.uniform([0.08, 0.06, -9], [0.75, 0.15, 9], (worlds, 3))
    velocity = generator.uniform([-0.4, -0.4, -15], [0.4, 0.4, 15], (worlds, 3))
    for world in range(worlds):
        put(env, pose[world], velocity[world], world)
    env.action_space.seed(0)
    core = env.unwrapped.core
    for _ in range(4):
        seen, *_, info = env.step(env.action_space.sample())
        assert seen.dtype == np.float32
        here, moved = core.simulator.pose[:, 0], core.simulator.mean_velocity[:, 0]
        for world in range(worlds):
            expected = table(task, symmetry, here[world], moved[world], core.episode.goal[world, 0])
            # 1e-6: float32. Just at the edge of an element the first two numbers may jump from 1 to -1.
            assert seen[world] == pytest.approx(expected, abs=2e-6), world
            assert info["position_error"][world] == pytest.approx(
                math.dist(here[world, :2], core.episode.goal[world, 0, :2]), abs=1e-15
            )
            if task == "Transport":
                assert "heading_error" not in info
                continue
            heading_error = core.episode.goal[world, 0, 2] - here[world, 2]
            if task == "Align":
                heading_error = wrapped(heading_error, 2 * math.pi / symmetry) if symmetry else 0.0
            assert info["heading_error"][world] == pytest.approx(abs(heading_error), abs=1e-8)
    assert np.abs(feature(env, seen, "velocity")).max() > 0.2  # they did move


def test_first_observation_has_no_velocity():
    for task in TASKS:
        env = single(task)
        seen, info = env.reset(seed=0)
        assert not feature(env, seen, "velocity").any() and not feature(env, seen, "spin").any()
        assert set(info["reward_terms"].values()) == {0.0} and info["is_success"] is False


def test_rotate_counts_full_turns():
    env = single("Rotate", action="phasor")
    env.reset(seed=0)
    aim = goal(env)
    put(env, aim - [0, 0, 2 * math.pi])
    seen, *_, info = env.step(still(env))
    assert feature(env, seen, "turn").item() == pytest.approx(1.0, abs=1e-3)
    assert info["heading_error"] == pytest.approx(2 * math.pi, abs=1e-2)


# -- goal --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", TASKS)
def test_goal_dictionary(task):
    n = 2 if task == "Transport" else 3
    env = single(task, action="field", observation="goal")
    seen, _ = env.reset(seed=4)
    flat, _ = single(task, action="field").reset(seed=4)
    core = env.unwrapped.core
    assert set(seen) == {"observation", "achieved_goal", "desired_goal"}
    assert (seen["observation"] == flat).all()
    assert seen["achieved_goal"] == pytest.approx(core.simulator.pose[0, 0, :n], abs=1e-6)
    assert seen["desired_goal"] == pytest.approx(core.episode.goal[0, 0, :n], abs=1e-6)


@pytest.mark.parametrize("task", TASKS)
def test_batched_goal_reward_equals_the_step_reward(task):
    worlds = 4
    settings = {"action": "field", "observation": "goal", "surface": {"rows": 3, "columns": 4}}
    env = batch(task, worlds, **settings, autoreset_mode="SameStep", max_episode_steps=40)
    env.reset(seed=3)
    env.action_space.seed(3)
    reward_of = single(task, **settings).unwrapped.compute_reward
    achieved, desired, infos, rewards = [], [], [], []
    push = env.action_space.sample()
    for step in range(60):
        if step == 5:
            put(env, goal(env, 1), world=1)
        seen, reward, terminated, truncated, info = env.step(push)
        done = terminated | truncated
        for world in range(worlds):
            here = info["final_obs"][world] if done[world] else {key: value[world] for key, value in seen.items()}
            fallen = bool(info["final_info" if done[world] else "fallen"]["fallen"][world]) if done[world] else False
            achieved.append(here["achieved_goal"])
            desired.append(here["desired_goal"])
            infos.append({"fallen": fallen})
            rewards.append(reward[world])
    achieved, desired, rewards = np.array(achieved), np.array(desired), np.array(rewards)
    assert set(rewards) == {0.0, -1.0, -50.0}
    assert (reward_of(achieved, desired, infos) == rewards).all()  # as in HerReplayBuffer
    assert (reward_of(achieved, desired, np.array(infos)) == rewards).all()
    assert (reward_of(achieved, desired, {"fallen": np.array([each["fallen"] for each in infos])}) == rewards).all()
    for k in range(len(rewards)):
        one = reward_of(achieved[k], desired[k], infos[k])
        assert isinstance(one, float) and one == rewards[k]
    alive = rewards > -50
    assert (reward_of(achieved[alive], desired[alive], [{}] * alive.sum()) == rewards[alive]).all()
    assert (env.unwrapped.compute_reward(achieved, desired, infos) == rewards).all()


@pytest.mark.parametrize("task, moved, expected", [
    ("Transport", [0.0049, 0], 0.0), ("Transport", [0.0051, 0], -1.0), ("Transport", [0.0036, 0.0036], -1.0),
    ("Align", [0.0019, 0, 0], 0.0), ("Align", [0.0021, 0, 0], -1.0),
    ("Align", [0, 0, math.radians(2.9)], 0.0), ("Align", [0, 0, math.radians(3.1)], -1.0),
    ("Align", [0, 0, math.radians(182.9)], 0.0), ("Align", [0, 0, math.radians(90.0)], -1.0),
    ("Rotate", [0.0049, 0, 0], 0.0), ("Rotate", [0, 0.0051, 0], -1.0),
    ("Rotate", [0, 0, math.radians(1.9)], 0.0), ("Rotate", [0, 0, math.radians(2.1)], -1.0),
    ("Rotate", [0, 0, math.radians(360.0)], -1.0), ("Rotate", [0, 0, math.radians(180.0)], -1.0),
])  # fmt: skip
def test_tolerances_of_the_goal_reward(task, moved, expected):
    env = single(task, action="field", observation="goal").unwrapped
    desired = np.array([0.4, 0.1, 0.3][: len(moved)])
    assert env.compute_reward(desired + moved, desired, {}) == expected
    assert env.compute_reward(desired, desired, None) == 0.0


def test_only_goal_environments_have_a_goal_reward():
    assert not hasattr(single("Rotate").unwrapped, "compute_reward")
    assert not hasattr(single("Rotate", observation="image").unwrapped, "compute_reward")
    assert not hasattr(single("Sort").unwrapped, "compute_reward") and not hasattr(batch("Sort", 2), "compute_reward")
    assert callable(single("Rotate", observation="goal").unwrapped.compute_reward)


def test_goal_reward_refuses_wrong_shapes():
    env = single("Align", observation="goal").unwrapped
    with pytest.raises(ValueError, match="achieved_goal"):
        env.compute_reward(np.zeros(2), np.zeros(3), {})
    with pytest.raises(ValueError, match="desired_goal"):
        env.compute_reward(np.zeros(3), 0.0, {})


def test_goals_stay_in_their_space_at_any_heading():
    env = single("Rotate", action="phasor", observation="goal")
    env.reset(seed=0)
    put(env, [0.4, 0.1, 100.0])
    seen, *_ = env.step(still(env))
    assert env.observation_space.contains(seen)


@pytest.mark.parametrize("copy_info", [False, True])
def test_hindsight_replay_of_stable_baselines(copy_info):
    sb3 = pytest.importorskip("stable_baselines3")
    env = single("Align", action="field", observation="goal", max_episode_steps=10)
    model = sb3.SAC(
        "MultiInputPolicy", env, replay_buffer_class=sb3.HerReplayBuffer, learning_starts=20, batch_size=16, seed=0,
        replay_buffer_kwargs={"copy_info_dict": copy_info}, policy_kwargs={"net_arch": [8]}, buffer_size=100,
    )  # fmt: skip
    model.learn(30)
    rewards = model.replay_buffer.sample(64).rewards.numpy()
    assert set(np.unique(rewards)) <= {0.0, -1.0, -50.0}
    assert (rewards == 0.0).any()  # relabelled with goals that were reached


# -- image -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", TASKS)
def test_image_shows_part_and_goal(task):
    env = single(task, action="phasor", observation="image")
    for seed in range(5):
        image, _ = env.reset(seed=seed)
        assert image.shape == (48, 192, 3) and image.dtype == np.uint8
        core = env.unwrapped.core
        area = core.parts[0].area / PIXEL**2
        for channel, (x, y, _) in ((0, core.simulator.pose[0, 0]), (1, core.episode.goal[0, 0])):
            rows, columns = np.nonzero(image[..., channel])
            assert len(rows) == pytest.approx(area, rel=0.12)  # pixels along the border count whole or not at all
            assert (columns.mean() + 0.5) * PIXEL == pytest.approx(x, abs=PIXEL / 2)
            assert 0.208 - (rows.mean() + 0.5) * PIXEL == pytest.approx(y, abs=PIXEL / 2)
        assert set(np.unique(image[..., 2])) == {64, 128, 255}


def test_image_follows_part_heading_and_goal():
    env = single("Rotate", action="phasor", observation="image")
    env.reset(seed=0)
    env.unwrapped.core.episode.goal[0, 0] = [0.6, 0.05, math.pi / 2]
    put(env, [0.2, 0.15, 0.0])
    image, *_ = env.step(still(env))
    assert image[(*pixel(0.2, 0.15), 0)] == 255 and image[(*pixel(0.6, 0.05), 1)] > 0
    assert image[(*pixel(0.2 + 0.022, 0.15), 0)] == 255 and image[(*pixel(0.2, 0.15 + 0.022), 0)] == 0
    assert image[(*pixel(0.6 + 0.022, 0.05), 1)] == 0 and image[(*pixel(0.6, 0.05 + 0.022), 1)] > 0
    assert image[(*pixel(0.2 + 0.018, 0.15), 2)] == 255  # the mark points along the part's own x
    assert image[(*pixel(0.2 - 0.018, 0.15), 2)] != 255


def test_image_shows_the_remaining_turn():
    """A goal a full turn away has the outline of the present pose, but another brightness."""
    env = single("Rotate", action="phasor", observation="image")
    for seed, heading_error in enumerate([-2 * math.pi, -math.pi, 0.0, math.pi, 2 * math.pi]):
        env.reset(seed=seed)
        put(env, goal(env) - [0, 0, heading_error])
        image, *_ = env.step(still(env))
        level = image[..., 1].max()
        assert level == pytest.approx(128 + heading_error / (4 * math.pi) * 127, abs=1.0)
    for task in ("Transport", "Align"):
        image, _ = single(task, observation="image").reset(seed=0)
        assert image[..., 1].max() == 255
