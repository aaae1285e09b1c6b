"""Observations of several parts against the simulator's state, index by index."""

import math

import numpy as np
import pytest

from tests.envs.helpers import WALLS, batch, feature, pixel, put, single, sorted_pose, still
from vibgym.physics.contacts.hulls import all_gaps

SIZE, WIDTH, HEIGHT, SPEED = 0.026, 0.832, 0.208, 2.7e-3 * 2 * math.pi * 25.0
DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "disc"}
SQUARE = {"shape": "rectangle", "length": 0.04, "width": 0.04, "friction": 0.5, "name": "square"}
PARTS = ["steel_block", DISC, SQUARE, "steel_block", DISC]
KINDS, SYMMETRY = [0, 1, 2, 0, 1], [2, 0, 4, 2, 0]
ZONES = [[0, 0, 6 * SIZE, HEIGHT], [26 * SIZE, 0, WIDTH, HEIGHT], [13 * SIZE, 0, 19 * SIZE, HEIGHT]]


def clip(value):
    return min(max(value, -1.0), 1.0)


def block(part, pose, moved, gaps, present, zones):
    """The documented table, index by index, for the default surface."""
    if not present[part]:
        return [0.0] * 20
    x, y, heading = pose[part]
    others = [k for k in range(len(pose)) if k != part and present[k]]
    wx = wy = 0.0
    if zones:
        low_x, low_y, high_x, high_y = ZONES[KINDS[part]]
        wx, wy = min(max(x, low_x), high_x) - x, min(max(y, low_y), high_y) - y
    near, direction = 1.0, (0.0, 0.0)
    if others:
        other = min(others, key=lambda k: gaps[part, k])
        near = math.tanh(gaps[part, other] / (math.sqrt(2) * SIZE))
        apart = math.dist(pose[part, :2], pose[other, :2])
        direction = ((pose[other, 0] - x) / apart, (pose[other, 1] - y) / apart)
    return [
        1.0,
        *(1.0 if KINDS[part] == kind else 0.0 for kind in range(3)),
        2 * ((x / SIZE) % 1.0) - 1,
        2 * ((y / SIZE) % 1.0) - 1,
        math.cos(SYMMETRY[part] * heading),
        math.sin(SYMMETRY[part] * heading),
        clip(2 * x / WIDTH - 1),
        clip(2 * y / HEIGHT - 1),
        clip(wx / WIDTH),
        clip(wy / WIDTH),
        math.tanh(wx / 0.050),
        math.tanh(wy / 0.050),
        clip(moved[part, 0] / SPEED),
        clip(moved[part, 1] / SPEED),
        clip(moved[part, 2] / 10.0),
        near,
        *direction,
    ]


@pytest.mark.parametrize("slots", [None, 8])
@pytest.mark.parametrize("task", ["Sort", "Singulate"])
def test_state_table(task, slots):
    worlds = 12
    env = batch(task, worlds, action="field", parts=PARTS, walls=WALLS, slots=slots, randomize={"parts": [1, 5]})
    assert env.single_observation_space.shape == ((slots or 5) * 20,)
    seen, _ = env.reset(seed=1)
    env.action_space.seed(0)
    core = env.unwrapped.core
    counts, fastest = set(), 0.0
    for step in range(8):
        if step > 0:
            seen, *_ = env.step(env.action_space.sample())
        assert seen.dtype == np.float32 and env.observation_space.contains(seen)
        pose, moved = core.simulator.pose, core.simulator.mean_velocity
        present = ~core.simulator.fallen
        gaps = np.empty((worlds, 5, 5))
        all_gaps(core.simulator.hulls, pose, gaps)
        for world in range(worlds):
            rows = seen[world].reshape(-1, 20)
            for part in range(5):
                expected = block(part, pose[world], moved[world], gaps[world], present[world], task == "Sort")
                # Float32. Just at the edge of an element its numbers may jump from 1 to -1.
                assert rows[part] == pytest.approx(expected, abs=2e-6), (world, part)
            assert (rows[5:] == 0).all()
            counts.add(int(present[world].sum()))
        fastest = max(fastest, np.abs(feature(env, seen, "velocity")).max())
    assert counts == {1, 2, 3, 4, 5} and fastest > 0.2


def test_ways_outside_and_inside():
    env = single("Sort", action="phasor")
    env.reset(seed=0)
    pose = sorted_pose()
    pose[0, 0], pose[1, 0] = 0.4, 0.3
    put(env, pose)
    seen, *_ = env.step(still(env))
    far, near = feature(env, seen, "way"), feature(env, seen, "way_coarse")
    # The difference between pose and observation, a circle of 0.2 mm, is 2.4e-4 of the table's width.
    assert far[:2, 0] == pytest.approx([(0.156 - 0.4) / WIDTH, (0.676 - 0.3) / WIDTH], abs=1e-3)
    assert near[0, 0] < -0.99 and near[1, 0] > 0.99
    assert not far[2:].any() and not near[2:].any() and not far[:, 1].any() and not near[:, 1].any()


def test_state_does_not_depend_on_further_slots():
    few, _ = single("SortCrowded").reset(seed=5)
    many, _ = single("SortCrowded", slots=12).reset(seed=5)
    assert many.shape == (240,) and (many[:120] == few).all() and (many[120:] == 0).all()


def test_image():
    env = single("SortThreeKinds", action="phasor", observation="image")
    env.reset(seed=0)
    xs = [0.30, 0.60, 0.10, 0.22, 0.72, 0.42]
    put(env, [[x, 0.104, 0.0] for x in xs])
    image, *_ = env.step(still(env))
    assert image.shape == (48, 192, 3) and image.dtype == np.uint8
    assert [int(image[(*pixel(x, 0.104), 0)]) for x in xs] == [255, 170, 85] * 2
    assert set(np.unique(image[..., 0])) == {0, 85, 170, 255}
    zones = image[..., 1]
    assert (zones[:, :36] == 255).all() and (zones[:, 26 * 6 :] == 170).all() and (zones[:, 78 : 19 * 6] == 85).all()
    assert (zones[:, 36:78] == 0).all() and (zones[:, 19 * 6 : 26 * 6] == 0).all()
    assert set(np.unique(image[..., 2])) == {64, 128, 255}
    assert image[(*pixel(0.30 + 0.018, 0.104), 2)] == 255 and image[(*pixel(0.30 - 0.018, 0.104), 2)] != 255


def test_images_without_zones_and_of_absent_parts():
    image, _ = single("Singulate", observation="image").reset(seed=0)
    assert (image[..., 1] == 0).all() and (image[..., 0] > 0).any()
    areas = []
    for count in (1, 6):
        image, _ = single("Sort", observation="image", randomize={"parts": [count, count]}).reset(seed=0)
        areas.append((image[..., 0] > 0).sum())
    assert 5.0 < areas[1] / areas[0] < 7.2
