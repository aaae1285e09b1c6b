"""Lanes both ways: velocities that fit to one another, and parts that pass one another in time."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from vibgym.policies.classical.lanes import CrossingPolicy, Crowd, Rules, choose_velocities, time_to_meet
from vibgym.policies.measures import Measures
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.scene.hulls import hulls_of
from vibgym.scene.parts import shipped_part

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
    """What two straight blocks at rest choose."""
    centre, wanted = (np.array([each], dtype=float) for each in (centre, wanted))
    pose = np.concatenate([centre, np.zeros((1, 2, 1))], axis=-1)
    reach = np.tile([0.025, 0.020], (1, 2, 1))
    crowd = Crowd(np.ones((1, 2), dtype=bool), centre, reach, wanted, np.array([order]), pose)
    velocity = np.zeros((1, 2, 2))
    choose_velocities(0, 1, RULES, hulls_of(BLOCKS), crowd, velocity)
    return velocity[0]


def test_parts_that_are_alone_get_what_they_want():
    wanted = [[TOP, 0.0], [-0.1, 0.2]]
    assert chosen([[0.2, 0.1], [0.6, 0.1]], wanted) == pytest.approx(np.array(wanted))


def test_who_has_right_of_way_goes_and_the_other_makes_room():
    first, second = chosen([[0.2, 0.1], [0.27, 0.1]], [[TOP, 0.0], [0.0, 0.0]])
    assert first[0] >= 0.0 and np.hypot(*second) > 0.0 and second[0] >= 0.0
    first, second = chosen([[0.2, 0.1], [0.27, 0.1]], [[TOP, 0.0], [0.0, 0.0]], order=(1, 0))
    assert np.hypot(*second) == 0.0 and first[0] < 0.5 * TOP


def test_nobody_chooses_to_go_over_the_border():
    _, second = chosen([[0.2, 0.066], [0.2, 0.021]], [[0.0, -TOP], [0.0, -TOP]])
    assert second[1] > -8.0 * 0.005 - 1e-9
    first, _ = chosen([[0.812, 0.1], [0.2, 0.1]], [[TOP, 0.0], [0.0, 0.0]])
    assert first[0] <= 0.0


@pytest.mark.parametrize("task, most, hardware", [
    ("Swap", 4.5, {}), ("SwapCrowded", 6.5, {}),
    ("Swap", 5.5, {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}),
])  # fmt: skip
def test_parts_pass_one_another(task, most, hardware):
    found = rollout("lanes", f"vibgym/{task}-v0", seeds=range(50, 58), keep=Measures, **hardware)
    assert found.success.mean() >= 0.875 and np.nanmedian(found.time_to_goal) < most and found.collisions.mean() < 5.0


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="ahead"):
        CrossingPolicy(TaskInfo.of(batch("Swap", 1)), ahead=0)
