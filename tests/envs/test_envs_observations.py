"""Observations ``"state"``, ``"goal"`` and ``"image"`` against the simulator's state."""

import math

import numpy as np
import pytest

from tests.envs.helpers import PIXEL, TASKS, WALLS, batch, feature, goal, pixel, put, single, still
from vibgym.physics.contacts.hulls import all_gaps

SIZE, WIDTH, HEIGHT, SPEED = 0.026, 0.832, 0.208, 2.7e-3 * 2 * math.pi * 25.0
DISC = {"shape": "disc", "radius": 0.02, "friction": 0.6, "name": "disc"}
SQUARE = {"shape": "rectangle", "length": 0.04, "width": 0.04, "friction": 0.5, "name": "square"}
ELL = {
    "shape": "polygon", "vertices_mm": [[0, 0], [50, 0], [50, 20], [20, 20], [20, 40], [0, 40]], "friction": 0.5, "name": "ell",
}  # fmt: skip
SEVERAL = ["steel_block", DISC, SQUARE, "steel_block", DISC]
KINDS, SYMMETRY = [0, 1, 2, 0, 1], [2, 0, 4, 2, 0]
ZONES = [[0, 0, 6 * SIZE, HEIGHT], [26 * SIZE, 0, WIDTH, HEIGHT], [13 * SIZE, 0, 19 * SIZE, HEIGHT]]


OF_ONE = "element heading position way way_coarse way_fine turn turn_coarse turn_fine velocity spin".split()
OF_SEVERAL = "present kind element heading position way way_coarse velocity spin gap neighbour".split()


def block(names, symmetry, pose, moved, displacement, heading_error=0.0, kind=0, gap=math.inf, neighbour=(0.0, 0.0)):
    """Return the documented numbers of a part, in this order, for the default surface."""
    place, heading, displacement = np.array(pose[:2]), symmetry * pose[2], np.array(displacement)
    values = {
        "present": [1.0],
        "kind": np.eye(3)[kind],
        "element": 2.0 * (place / SIZE % 1.0) - 1.0,
        "heading": [math.cos(heading), math.sin(heading)],
        "position": 2.0 * place / [WIDTH, HEIGHT] - 1.0,
        "way": displacement / WIDTH,
        "way_coarse": np.tanh(displacement / 0.050),
        "way_fine": np.tanh(displacement / 0.005),
        "turn": [heading_error / (2 * math.pi)],
        "turn_coarse": [math.tanh(heading_error / 0.5)],
        "turn_fine": [math.tanh(heading_error / 0.05)],
        "velocity": moved[:2] / SPEED,
        "spin": [moved[2] / 10.0],
        "gap": [math.tanh(gap / (math.sqrt(2) * SIZE))],
        "neighbour": neighbour,
    }
    return np.clip(np.concatenate([values[name] for name in names]), -1.0, 1.0)


def wrapped(angle, period):
    return (angle + period / 2) % period - period / 2


@pytest.mark.parametrize("part, symmetry", [("aluminium_block", 2), (DISC, 0), (SQUARE, 4), (ELL, 1)])
@pytest.mark.parametrize("task", TASKS)
def test_state_table(task, part, symmetry):
    worlds = 20
    env = batch(task, worlds, action="patch", parts=[part])
    seen, info = env.reset(seed=1)
    assert not feature(env, seen, "velocity").any() and not feature(env, seen, "spin").any()
    assert not any(terms.any() for name, terms in info["reward_terms"].items() if name[0] != "_")
    generator = np.random.default_rng(2)
    pose = generator.uniform([0.08, 0.06, -9], [0.75, 0.15, 9], (worlds, 3))
    velocity = generator.uniform([-0.4, -0.4, -15], [0.4, 0.4, 15], (worlds, 3))
    for world in range(worlds):
        put(env, pose[world], velocity[world], world)
    env.action_space.seed(0)
    core = env.unwrapped.core
    for _ in range(4):
        seen, *_, info = env.step(env.action_space.sample())
        assert seen.dtype == np.float32 and ("heading_error" in info) == (task != "Transport")
        for world in range(worlds):
            pose, aim = core.simulator.pose[world, 0], core.episode.goal[world, 0]
            heading_error = 0.0 if task == "Transport" else aim[2] - pose[2]
            if task == "Align":
                heading_error = wrapped(heading_error, 2 * math.pi / symmetry) if symmetry else 0.0
            moved = core.simulator.mean_velocity[world, 0]
            # 1e-6: float32. Just at the edge of an element the first two numbers may jump from 1 to -1.
            expected = block(OF_ONE, symmetry, pose, moved, aim[:2] - pose[:2], heading_error)
            assert seen[world] == pytest.approx(expected, abs=2e-6), world
            assert info["position_error"][world] == pytest.approx(math.dist(pose[:2], aim[:2]), abs=1e-15)
            if task != "Transport":
                assert info["heading_error"][world] == pytest.approx(abs(heading_error), abs=1e-8)
    assert np.abs(feature(env, seen, "velocity")).max() > 0.2  # they did move


@pytest.mark.parametrize("slots", [None, 8])
@pytest.mark.parametrize("task", ["Sort", "Singulate"])
def test_state_table_of_several_parts(task, slots):
    worlds = 8
    env = batch(task, worlds, action="field", parts=SEVERAL, walls=WALLS, slots=slots, randomize={"parts": [1, 5]})
    assert env.single_observation_space.shape == ((slots or 5) * 20,)
    seen, _ = env.reset(seed=1)
    env.action_space.seed(0)
    core = env.unwrapped.core
    counts, fastest = set(), 0.0
    for _ in range(6):
        assert seen.dtype == np.float32 and env.observation_space.contains(seen)
        pose, moved = core.simulator.pose, core.simulator.mean_velocity
        present = ~core.simulator.fallen
        gaps = np.empty((worlds, 5, 5))
        all_gaps(core.simulator.hulls, pose, gaps)
        for world in range(worlds):
            rows = seen[world].reshape(-1, 20)
            for part in range(5):
                expected = np.zeros(20)
                if present[world, part]:
                    place, more = pose[world, part], {}
                    if others := [k for k in np.flatnonzero(present[world]) if k != part]:
                        nearest = min(others, key=lambda k: gaps[world, part, k])
                        apart = pose[world, nearest, :2] - place[:2]
                        more = {"gap": gaps[world, part, nearest], "neighbour": apart / np.hypot(*apart)}
                    zone = np.array(ZONES[KINDS[part]]).reshape(2, 2)
                    displacement = np.clip(place[:2], *zone) - place[:2] if task == "Sort" else np.zeros(2)
                    moving = moved[world, part]
                    expected = block(OF_SEVERAL, SYMMETRY[part], place, moving, displacement, kind=KINDS[part], **more)
                # Float32. Just at the edge of an element its numbers may jump from 1 to -1.
                assert rows[part] == pytest.approx(expected, abs=2e-6), (world, part)
            assert (rows[5:] == 0).all()
            counts.add(int(present[world].sum()))
        seen, *_ = env.step(env.action_space.sample())
        fastest = max(fastest, np.abs(feature(env, seen, "velocity")).max())
    assert counts == {1, 2, 3, 4, 5} and fastest > 0.2


# -- goal --------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("task", TASKS)
def test_goal_dictionary(task):
    n = 2 if task == "Transport" else 3
    env = single(task, action="field", observation="goal")
    seen, _ = env.reset(seed=4)
    flat, _ = single(task, action="field").reset(seed=4)
    core = env.unwrapped.core
    assert set(seen) == {"observation", "achieved_goal", "desired_goal"} and (seen["observation"] == flat).all()
    assert seen["achieved_goal"] == pytest.approx(core.simulator.pose[0, 0, :n], abs=1e-6)
    assert seen["desired_goal"] == pytest.approx(core.episode.goal[0, 0, :n], abs=1e-6)
    put(env, [0.4, 0.1, 100.0])
    seen, *_ = env.step(np.zeros(6))
    assert env.observation_space.contains(seen)  # at any heading


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
            achieved.append(here["achieved_goal"])
            desired.append(here["desired_goal"])
            infos.append({"fallen": bool(done[world] and info["final_info"]["fallen"][world])})
            rewards.append(reward[world])
    achieved, desired, rewards = np.array(achieved), np.array(desired), np.array(rewards)
    assert set(rewards) == {0.0, -1.0, -50.0}
    together = {"fallen": np.array([info["fallen"] for info in infos])}
    for form in (infos, np.array(infos), together):  # the first two as in HerReplayBuffer
        assert (reward_of(achieved, desired, form) == rewards).all()
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
    for env in (single("Rotate"), single("Rotate", observation="image"), single("Sort"), batch("Sort", 2)):
        assert not hasattr(env.unwrapped, "compute_reward")
    env = single("Align", observation="goal").unwrapped
    with pytest.raises(ValueError, match="achieved_goal"):
        env.compute_reward(np.zeros(2), np.zeros(3), {})
    with pytest.raises(ValueError, match="desired_goal"):
        env.compute_reward(np.zeros(3), 0.0, {})


def test_hindsight_replay_of_stable_baselines():
    sb3 = pytest.importorskip("stable_baselines3")
    env = single("Align", action="field", observation="goal", max_episode_steps=10)
    model = sb3.SAC(
        "MultiInputPolicy", env, replay_buffer_class=sb3.HerReplayBuffer, learning_starts=20, batch_size=16, seed=0,
        replay_buffer_kwargs={"copy_info_dict": True}, policy_kwargs={"net_arch": [8]}, buffer_size=100,
    )  # fmt: skip
    model.learn(25)
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
    core.episode.goal[0, 0] = [0.6, 0.05, math.pi / 2]
    put(env, [0.2, 0.15, 0.0])
    image, *_ = env.step(still(env))
    part, goal, marked = image[..., 0] == 255, image[..., 1] > 0, image[..., 2] == 255
    assert part[pixel(0.2 + 0.022, 0.15)] and not part[pixel(0.2, 0.15 + 0.022)]  # they follow the headings
    assert goal[pixel(0.6, 0.05 + 0.022)] and not goal[pixel(0.6 + 0.022, 0.05)]
    assert marked[pixel(0.2 + 0.018, 0.15)] and not marked[pixel(0.2 - 0.018, 0.15)]  # points along the part's own x


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


def test_image_of_several_parts_and_zones():
    env = single("SortThreeKinds", action="phasor", observation="image")
    env.reset(seed=0)
    xs = [0.30, 0.60, 0.10, 0.22, 0.72, 0.42]
    put(env, [[x, 0.104, 0.0] for x in xs])
    image, *_ = env.step(still(env))
    assert [int(image[(*pixel(x, 0.104), 0)]) for x in xs] == [255, 170, 85] * 2
    assert set(np.unique(image[..., 0])) == {0, 85, 170, 255}
    zones = image[..., 1]
    assert (zones[:, :36] == 255).all() and (zones[:, 26 * 6 :] == 170).all() and (zones[:, 78 : 19 * 6] == 85).all()
    assert (zones[:, 36:78] == 0).all() and (zones[:, 19 * 6 : 26 * 6] == 0).all()
    image, _ = single("Singulate", observation="image").reset(seed=0)
    assert not image[..., 1].any()
    areas = []
    for count in (1, 6):
        image, _ = single("Sort", observation="image", randomize={"parts": [count, count]}).reset(seed=0)
        areas.append((image[..., 0] > 0).sum())
    assert 5.0 < areas[1] / areas[0] < 7.2  # absent parts are not shown
