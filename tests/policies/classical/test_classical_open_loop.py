"""Fields planned once: what is looked at, and when they act."""

import dataclasses

import numpy as np
import pytest

from tests.envs.helpers import single
from tests.policies.classical.test_classical_protocol import observations
from tests.policies.helpers import POSE_TASKS, episodes, info_of
from vibgym.policies.registry import make_policy


@pytest.mark.parametrize("task", POSE_TASKS)
def test_it_looks_once_an_episode(task):
    """After its first observation nothing that it sees changes what it does, until an episode starts."""
    policy = make_policy("open_loop", info_of(task))
    seen = observations(task, worlds=2, steps=6)
    other = observations(task, worlds=2, steps=6, seed=5)
    off = np.zeros(2, dtype=bool)
    _, state = policy.predict(seen[0], None, ~off)
    _, blind = policy.predict(seen[0], None, None)  # no state: episodes have just begun
    for step in range(1, 6):
        action, state = policy.predict(seen[step], state, off)
        same, blind = policy.predict(other[step], blind, off if step % 2 else None)
        assert (action == same).all()
    # World 1 starts anew: it takes up what it sees now, world 0 goes on.
    restarted, _ = policy.predict(other[0], state, np.array([False, True]))
    going_on, _ = policy.predict(seen[0], state, off)
    fresh, _ = policy.predict(other[0], None, ~off)
    assert (restarted[0] == going_on[0]).all()
    assert (restarted[1] == fresh[1]).all() and (restarted[1] != going_on[1]).any()


def test_it_leaves_the_state_it_is_given():
    policy = make_policy("open_loop", info_of("Rotate"))
    seen = observations("Rotate", steps=2)
    _, state = policy.predict(seen[0])
    before = [array.copy() for array in state]
    policy.predict(seen[1], state, np.ones(6, dtype=bool))
    assert all((array == copy).all() for array, copy in zip(state, before, strict=True))


def strengths(turn, periods, steps):
    """Largest amplitude in each step of a turn (rad) in place at 10 rad/s."""
    policy = make_policy({"kind": "open_loop", "turn_rate": 10.0}, info_of("Rotate", periods_per_step=periods))
    env = single("Rotate", action="phasor", periods_per_step=periods)
    seen, _ = env.reset(seed=0, options={"pose": [0.416, 0.104, 0.0], "goal": [0.416, 0.104, turn]})
    state, amplitude = None, []
    for _ in range(steps):
        action, state = policy.predict(seen, state)
        amplitude.append(np.hypot(action[::2], action[1::2]).max())
    return np.array(amplitude)


def test_it_turns_and_then_stops():
    acting = strengths(2.0, 1, 10)  # 2 rad at 10 rad/s last 5 periods of 40 ms
    assert acting == pytest.approx([1.0] * 5 + [0.0] * 5, abs=1e-5)


@pytest.mark.parametrize("turn, periods", [(1.0, 1), (2.0, 4), (-1.9, 3), (0.3, 4)])
def test_its_fields_act_for_their_time_whatever_a_step_lasts(turn, periods):
    """The last step acts by its share: strengths times step time add up to the turn over its rate."""
    acting = strengths(turn, periods, 12)
    assert acting.sum() * 0.04 * periods == pytest.approx(abs(turn) / 10.0, rel=1e-4)


def test_it_transports_without_looking():
    assert episodes(make_policy("open_loop", info_of("Transport")), "Transport").success >= 95


@pytest.mark.parametrize("periods", [1, 4])
def test_it_turns_as_far_as_it_should_whatever_a_step_lasts(periods):
    """With four periods a step it had turned four times as far as it was asked to, and none of 500 episodes succeeded."""
    info = info_of("Rotate", periods_per_step=periods)
    assert episodes(make_policy("open_loop", info), "Rotate", 200, periods_per_step=periods).success >= 14


def test_headings_that_are_not_wrapped_are_turned_to_whatever_the_task_is_called():
    """It goes by the task's properties, not by its name."""
    seen = observations("Rotate", steps=1)[0]
    policy = make_policy("open_loop", info_of("Rotate"))
    renamed = make_policy("open_loop", dataclasses.replace(policy.info, name="Mine"))
    assert (policy.predict(seen)[0] == renamed.predict(seen)[0]).all()
