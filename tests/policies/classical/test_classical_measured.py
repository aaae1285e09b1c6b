"""What controllers read from the state observation, and what they remember."""

import math
from typing import NamedTuple

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import ARRANGED_TASKS, POSE_TASKS, info_of
from vibgym.policies.classical.measured import Measured, recall, wrap
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

OTHER_PARTS = (["steel_block"], [{"shape": "disc", "radius": 0.03, "friction": 0.4}])
SCENES = [
    *((task, {"parts": parts}) for task in POSE_TASKS for parts in OTHER_PARTS),
    *((task, {"slots": 7, "randomize": {"parts": [3, 6]}}) for task in ARRANGED_TASKS),
    ("Align", {"periods_per_step": 3}),
]


@pytest.mark.parametrize("task, settings", SCENES)
def test_it_is_the_true_state(task, settings):
    """With the ideal sensor."""
    env = batch(task, 8, action="patch", **settings)
    env.reset(seed=3)
    env.action_space.seed(3)
    info = TaskInfo.of(env)
    symmetry = np.array([part.symmetry for part in info.parts])
    for _ in range(5):
        rows, *_ = env.step(env.action_space.sample())
        measured, truth = Measured.of(rows, info), env.unwrapped.truth
        there, pose = truth.present, truth.pose
        assert (measured.present == there).all() and there.all() == (len(info.parts) == 1)
        assert measured.centre[there] == pytest.approx(pose[there][:, :2], abs=1e-6)
        assert measured.way[there] == pytest.approx(truth.error[there][:, :2], abs=1e-6)
        assert measured.velocity[there] == pytest.approx(truth.mean_velocity[there][:, :2], abs=1e-6)
        assert measured.spin[there] == pytest.approx(np.clip(truth.mean_velocity[there][:, 2], -10, 10), abs=1e-5)
        turned = wrap(measured.heading - pose[..., 2], symmetry)
        assert turned[there & (symmetry > 0)] == pytest.approx(0.0, abs=1e-6)
        assert (measured.heading[:, symmetry == 0] == 0.0).all()
        turn = np.clip(truth.error[..., 2], -2 * math.pi, 2 * math.pi)
        assert measured.turn[there] == pytest.approx(turn[there], abs=1e-5)
        near = there & (truth.gap < 0.1)
        if len(info.parts) > 1:
            assert measured.gap[near] == pytest.approx(truth.gap[near], abs=1e-4)
        else:
            assert (measured.gap == math.inf).all()
        assert not measured.single
        one = Measured.of(rows[2], info)
        assert one.single and all(
            (getattr(one, name) == getattr(measured, name)[2:3]).all() for name in ("centre", "gap")
        )


@pytest.mark.parametrize("task, names, size, shapes", [
    ("Align", ["zero", "random", "open_loop", "local_field"], 18, [(17,), (3, 19), (), (0,), (2, 2, 18)]),
    ("Sort", ["zero", "random", "local_field", "planner"], 120, [(18,), (3, 119), (), (0,)]),
])  # fmt: skip
def test_observations_of_another_shape_are_refused(task, names, size, shapes):
    for name in names:
        for seen in [*map(np.zeros, shapes), *(["seen"] if task == "Align" else [])]:
            with pytest.raises(ValueError, match="observation"):
                make_policy(name, info_of(task)).predict(seen)


def test_wrap():
    assert wrap(np.array([3.0, 3.0, -7.0]), np.array([2, 1, 1])) == pytest.approx([3 - math.pi, 3.0, 2 * math.pi - 7])


def test_an_episode_begins_without_memory_or_where_it_is_marked():
    class Kept(NamedTuple):
        value: np.ndarray

    def begun(state, episode_start):
        return recall(state, episode_start, Kept(np.zeros((2, 1))), 2)[1].tolist()

    state = Kept(np.ones((2, 1)))
    assert begun(None, None) == begun(None, np.array([False, False])) == [True, True]
    assert begun(state, None) == [False, False] and begun(state, np.array([True, False])) == [True, False]


class Two(NamedTuple):
    """A memory of two arrays."""

    place: np.ndarray
    count: np.ndarray


def test_memories_begin_anew_where_episodes_do():
    initial, state = Two(np.zeros((2, 3)), np.full(2, 7)), Two(np.ones((2, 3)), np.array([1, 2]))
    first, new = recall(None, None, initial, 2)
    assert isinstance(first, Two) and new.tolist() == [True, True]
    assert all((a == b).all() and a is not b for a, b in zip(first, initial, strict=True))
    kept, new = recall(state, np.array([False, True]), initial, 2)
    assert isinstance(kept, Two) and new.tolist() == [False, True]
    assert kept.place.tolist() == [[1, 1, 1], [0, 0, 0]] and kept.count.tolist() == [1, 7]
    kept.place[:], kept.count[:] = 5.0, 5  # a copy of its own
    assert (state.place == 1).all() and state.count.tolist() == [1, 2]


def test_of_parts_that_have_arrived_nothing_is_remembered():
    initial, state = Two(np.zeros((1, 2, 3)), np.full((1, 2), 7)), Two(np.ones((2, 2, 3)), np.array([[1, 2], [3, 4]]))
    arrived = np.array([[False, True], [False, False]])
    kept, _ = recall(state, np.array([False, True]), initial, 2, arrived)
    assert kept.place[..., 0].tolist() == [[1, 0], [0, 0]] and kept.count.tolist() == [[1, 7], [7, 7]]
    assert (state.place == 1).all()


@pytest.mark.parametrize("kind", ["lanes", "planner", "local_field"])
def test_controllers_forget_slots_in_which_a_part_has_arrived(kind):
    """Whatever the one before did there."""
    env = batch("Feed", 2, parts=["steel_block", "aluminium_block"] * 2, action="wrench")
    info, memory, found = TaskInfo.of(env), None, 0
    policy = make_policy({"kind": kind, "law": "pid"}, env)
    seen, _ = env.reset(seed=0)
    for step in range(120):
        new, arrived = np.full(2, step == 0), Measured.of(seen, info).arrived
        action, after = policy.predict(seen, memory, new)
        if step and arrived.any():
            assert (policy.predict(seen, spoilt(memory, arrived), new)[0] == action).all()
            assert (policy.predict(seen, spoilt(memory, ~arrived), new)[0] != action).any()
            found += 1
        seen, memory = env.step(action)[0], after
    assert found


def spoilt(memory, parts):
    """Other numbers in the rows of some parts, (batch, parts) bool."""
    if isinstance(memory, np.ndarray):
        return np.where(parts.reshape(parts.shape + (1,) * (memory.ndim - 2)), memory + 1, memory).astype(memory.dtype)
    return type(memory)(*(spoilt(each, parts) for each in memory)) if memory else memory


@pytest.mark.parametrize(
    "state", [np.zeros(2), Two(np.zeros((3, 3)), np.zeros(3)), (np.zeros((2, 3)), np.zeros(2)), ()]
)
def test_memories_of_others_are_refused(state):
    with pytest.raises(ValueError, match="state"):
        recall(state, None, Two(np.zeros((2, 3)), np.zeros(2)), 2)


@pytest.mark.parametrize("name, task", [("open_loop", "Align"), ("planner", "Sort")])
def test_controllers_start_from_their_initial_memory(name, task):
    policy, env = make_policy(name, info_of(task)), batch(task, 3, action="phasor")
    seen, _ = env.reset(seed=0)
    initial = policy.initial(3)
    assert all(array.shape[0] == 3 for array in initial if isinstance(array, np.ndarray))
    without, state = policy.predict(seen)
    given, again = policy.predict(seen, initial, np.ones(3, dtype=bool))
    assert type(state) is type(again) is type(initial)
    assert (without == given).all() and repr(state) == repr(again)
