"""Lanes: through gates, and in opposite directions."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import measurement
from vibgym.policies.classical.lanes import Crowd, FeedingPolicy, Rules, choose_velocities, time_to_meet
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import shipped_part


@pytest.fixture(scope="module")
def info():
    return TaskInfo.of(batch("Feed", 1, parts=["steel_block", "aluminium_block"] * 2))


def at(info, centre, **values):
    return measurement(info, centre=centre, gap=1.0, **values)


def test_settings_of_patterns_are_refused_at_gates(info):
    assert make_policy({"kind": "lanes", "law": "local", "approach": 5.0}, info).law.approach == 5.0
    with pytest.raises(ValueError, match="'edge'.*gates"):
        make_policy({"kind": "lanes", "edge_mm": 20}, info)
    with pytest.raises(ValueError, match="'spare'.*both ways"):
        make_policy({"kind": "lanes", "spare_mm": 2}, TaskInfo.of(batch("Swap", 1)))


def test_parts_keep_the_spare_distance_and_change_lanes_no_faster_than_they_slip(info):
    there, absent = [True, False, True, False], [-0.8, -0.2]
    follows, across = [], []
    for spare, slip in ((1, 0.3), (4, 0.5)):
        policy = make_policy({"kind": "lanes", "spare_mm": spare, "slip": slip}, info)
        centre = [[0.7, 0.052], absent, [0.610, 0.052], absent]
        follows.append(policy.velocity(at(info, centre, present=there, velocity=[0.05, 0.0]))[0, 2, 0])
        across.append(
            policy.velocity(at(info, [[0.6, 0.156], absent, absent, absent], present=[True] + 3 * [False]))[0, 0]
        )
        assert np.hypot(*across[-1]) == pytest.approx(policy.top)
    assert follows[0] - follows[1] == pytest.approx(0.003 / 0.12)
    assert -across[0][1] / policy.top == pytest.approx(0.3) and -across[1][1] / policy.top == pytest.approx(0.5)


def test_single_parts_move_along_their_lanes_at_full_speed(info):
    policy = FeedingPolicy(info)
    velocity = policy.velocity(at(info, [[0.2, 0.052], [0.3, 0.156], [0.6, 0.156], [0.1, 0.104]]))[0]
    assert velocity[[0, 1]] == pytest.approx(np.array([[policy.top, 0.0]] * 2))
    assert velocity[2, 1] < 0.0 < velocity[2, 0] and velocity[3, 1] > 0.0  # to their half
    assert np.hypot(*velocity.T) == pytest.approx(policy.top)


def test_following_parts_keep_their_distance_and_absent_ones_are_ignored(info):
    policy, absent = FeedingPolicy(info), [-0.8, -0.2]
    there = [True, False, True, False]
    near, far = (
        policy.velocity(at(info, [[0.7, 0.052], absent, [0.7 - apart, 0.052], absent], present=there))[0, [0, 2], 0]
        for apart in (0.080, 0.140)
    )
    assert near[0] == far[0] == policy.top and near[1] == 0.0 and 0.0 < far[1] <= policy.top


def test_parts_in_touch_leave_the_inlet_together(info):
    policy, absent, there = FeedingPolicy(info), [-0.8, -0.2], [True, False, True, False]
    inlet, later = (
        policy.velocity(at(info, [[x + 0.050, 0.052], absent, [x, 0.052], absent], present=there, velocity=[0.1, 0.0]))[
            0, 2, 0
        ]
        for x in (0.10, 0.40)
    )
    assert inlet == pytest.approx(policy.top) and later < 0.1


def test_lane_changes_avoid_other_parts(info):
    policy = FeedingPolicy(info)
    beside = policy.velocity(at(info, [[0.2, 0.110], [0.21, 0.068], [0.6, 0.052], [0.7, 0.156]]))[0]
    assert beside[0, 1] > -0.02  # its lane is below, where another one is just ahead of it


@pytest.mark.parametrize("task, settings, least", [
    ("Feed", {}, 240.0), ("FeedHeaps", {}, 300.0),
    ("FeedHeaps", {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}, 290.0),
])  # fmt: skip
def test_good_parts_per_minute(task, settings, least):
    env = batch(task, 4, action="wrench", **settings)
    policy = make_policy({"kind": "lanes", "action": "wrench"}, env)
    state, info = None, {}
    observation, _ = env.reset(seed=20)
    for _ in range(1000):
        action, state = policy.predict(observation, state, None)
        observation, _, _, _, info = env.step(action)
    faulty = sum(info[f"{name}_per_minute"] for name in ("tilted", "close", "wrong", "lost"))
    assert info["good_per_minute"].mean() > least and faulty.mean() < 0.02 * least
    env.close()


TOP = 0.3
RULES = Rules(0.832, 0.208, TOP, 8.0)
BLOCKS = [shipped_part("steel_block")] * 2


@pytest.mark.parametrize("dx, dy, vx, vy, expected", [
    (1.0, 0.0, 1.0, 0.0, 0.8), (1.0, 0.0, -1.0, 0.0, np.inf), (1.0, 1.0, 1.0, 1.0, 0.9), (1.0, 1.0, 1.0, 0.5, np.inf),
    (0.1, 0.0, 0.0, 1.0, 0.0), (1.0, 0.3, 1.0, 0.0, np.inf), (0.0, 0.5, 0.0, 2.0, 0.2),
])  # fmt: skip
def test_when_rectangles_meet(dx, dy, vx, vy, expected):
    assert time_to_meet(dx, dy, 0.2, 0.1, vx, vy) == pytest.approx(expected)


def chosen(centre, wanted, order=(0, 1)):
    """Return the choice of two straight blocks at rest."""
    centre, wanted = (np.array([place], dtype=float) for place in (centre, wanted))
    pose = np.concatenate([centre, np.zeros((1, 2, 1))], axis=-1)
    reach = np.tile([0.025, 0.020], (1, 2, 1))
    crowd = Crowd(np.ones((1, 2), dtype=bool), centre, reach, wanted, np.array([order]), pose)
    velocity = np.zeros((1, 2, 2))
    choose_velocities(0, 1, RULES, hulls_of(BLOCKS), crowd, velocity)
    return velocity[0]


def test_single_parts_choose_their_preference():
    wanted = [[TOP, 0.0], [-0.1, 0.2]]
    assert chosen([[0.2, 0.1], [0.6, 0.1]], wanted) == pytest.approx(np.array(wanted))


def test_the_part_without_right_of_way_yields():
    first, second = chosen([[0.2, 0.1], [0.27, 0.1]], [[TOP, 0.0], [0.0, 0.0]])
    assert first[0] >= 0.0 and np.hypot(*second) > 0.0 and second[0] >= 0.0
    first, second = chosen([[0.2, 0.1], [0.27, 0.1]], [[TOP, 0.0], [0.0, 0.0]], order=(1, 0))
    assert np.hypot(*second) == 0.0 and first[0] < 0.5 * TOP


def test_choices_stay_on_the_surface():
    _, second = chosen([[0.2, 0.066], [0.2, 0.021]], [[0.0, -TOP], [0.0, -TOP]])
    assert second[1] > -8.0 * 0.005 - 1e-9
    first, _ = chosen([[0.812, 0.1], [0.2, 0.1]], [[TOP, 0.0], [0.0, 0.0]])
    assert first[0] <= 0.0
