"""Push: goals, driven parts, coverage, and bad input."""

import math

import numpy as np
import pytest

from tests.envs.helpers import batch
from vibgym.registration import TEE
from vibgym.scene.hulls import gaps_between, hulls_of
from vibgym.scene.parts import Part, part_from
from vibgym.tasks.push import goal_coverage

TEE_PART = part_from(TEE, "tee")
EVERYWHERE = {"near_mm": 150.0, "near_deg": 60.0}


@pytest.mark.parametrize("name, near, turn", [("Push", 0.150, math.radians(60)), ("PushAny", 1.0, math.pi)])
def test_goals_are_near_or_anywhere_and_parts_start_apart(name, near, turn):
    env = batch(name, 400)
    env.reset(seed=0)
    truth, task = env.unwrapped.truth, env.unwrapped.task
    assert task.driven.tolist() == [True, True, False] and task.scored.tolist() == [False, False, True]
    away = np.hypot(*(truth.goal - truth.pose)[:, 2, :2].T)
    turned = np.abs(truth.goal - truth.pose)[:, 2, 2]
    assert away.max() <= near + 1e-12 and turned.max() <= turn + 1e-12
    assert away.max() > min(0.9 * near, 0.5) and turned.max() > 0.9 * turn and np.ptp(truth.pose[:, 2, 2]) > 6.0
    assert gaps_between(env.unwrapped.parts, truth.pose).min() >= 0.002 - 1e-12
    for places in (truth.pose[:, 2], truth.goal[:, 2]):
        edge = np.minimum(places[:, :2], [0.832, 0.208] - places[:, :2]).min()
        assert edge >= TEE_PART.radius + 0.025 - 1e-12
    assert not truth.goal[:, :2].any() and not truth.error[:, :2].any() and truth.done[:, :2].all()


def test_elements_do_not_drive_the_pushed_part():
    env = batch("Push", 1, action="wrench")
    env.reset(seed=1)
    action = np.zeros((1, 3, 3), dtype=np.float32)
    action[0, 2] = 1.0
    env.step(action)
    assert not env.unwrapped.phasors().any()
    action[0, 0, 0] = 1.0
    info = env.step(action)[4]
    assert env.unwrapped.phasors().any() and info["commanded"]["unserved"].tolist() == [[0, 0, 1]]


def test_pushers_are_rewarded_for_their_way_to_the_part():
    env = batch("Push", 8, action="velocity", task_settings={"weights": {"reach": 0.7}})
    env.reset(seed=5)
    core, rng = env.unwrapped, np.random.default_rng(5)

    def reach():
        centre = core.truth.pose[..., :2]
        return np.hypot(*np.moveaxis(centre[:, :2] - centre[:, 2:], -1, 0))

    before, of_parts, of_worlds = reach(), np.zeros((8, 3)), np.zeros(8)
    for _ in range(30):
        info = env.step(rng.uniform(-1.0, 1.0, env.action_space.shape).astype(np.float32))[4]
        of_parts += info["parts"]["reward_terms"]["reach"]
        of_worlds += info["reward_terms"]["reach"]
    expected = 0.7 * (before - reach()) / 0.1  # a sum of changes is the change
    np.testing.assert_allclose(of_worlds, expected.mean(axis=1), atol=1e-12)
    np.testing.assert_allclose(of_parts[:, :2], 1.5 * expected, atol=1e-12)  # so that three parts have that mean
    np.testing.assert_allclose(of_parts.mean(axis=1), of_worlds, atol=1e-12)
    assert not of_parts[:, 2].any() and np.abs(expected).max() > 0.1


def test_coverage_is_the_area_of_the_intersection():
    block = Part.rectangle(0.04, 0.02, friction=0.5)
    pose, goal, coverage = np.zeros((4, 1, 3)), np.zeros((4, 1, 3)), np.zeros(4)
    goal[1, 0, 0] = 0.01  # three quarters of its length
    goal[2, 0, 2] = math.pi / 2  # a cross of 20 mm
    goal[3, 0, 1] = 0.03
    goal_coverage(hulls_of([block]), 0, pose, goal, coverage, np.arange(4))
    assert coverage == pytest.approx([1.0, 0.75, 0.5, 0.0])


@pytest.mark.parametrize(
    "share, expected", [(0.0, 1.0), (1.0, 2.0 / 3.0 - math.sqrt(3.0) / (2.0 * math.pi)), (2.0, 0.0), (3.0, 0.0)]
)
def test_coverage_of_a_disc_is_that_of_two_circles(share, expected):
    disc = Part.disc(0.02, friction=0.2)
    pose, goal, coverage = np.full((1, 1, 3), 0.1), np.full((1, 1, 3), 0.1), np.zeros(1)
    goal[0, 0, 1] += share * 0.02
    goal_coverage(hulls_of([disc]), 0, pose, goal, coverage, np.arange(1))
    assert coverage[0] == pytest.approx(expected, abs=1e-7)


def test_coverage_of_a_tee_agrees_with_counting_points():
    rng = np.random.default_rng(3)
    pose, goal, coverage = np.zeros((5, 1, 3)), np.zeros((5, 1, 3)), np.zeros(5)
    goal[:, 0] = rng.uniform(-1, 1, (5, 3)) * [0.02, 0.02, 1.5]
    goal_coverage(hulls_of([TEE_PART]), 0, pose, goal, coverage, np.arange(5))
    bar, stem = np.array(TEE["vertices"])[[6, 4]], np.array(TEE["vertices"])[[0, 2]]
    middle = (np.mean(bar, axis=0) * 1728 + np.mean(stem, axis=0) * 1152) / 2880  # by area
    points = rng.uniform(-0.07, 0.07, (200_000, 2))

    def inside(at):
        there = at + middle
        return ((there >= np.minimum(*bar)) & (there <= np.maximum(*bar))).all(axis=1) | (
            (there >= np.minimum(*stem)) & (there <= np.maximum(*stem))
        ).all(axis=1)

    for k in range(5):
        x, y, turn = goal[k, 0]
        back = np.array([[math.cos(turn), -math.sin(turn)], [math.sin(turn), math.cos(turn)]])
        both = inside(points) & inside((points - [x, y]) @ back)
        assert coverage[k] == pytest.approx(both.sum() / inside(points).sum(), abs=0.02)
