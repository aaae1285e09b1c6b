"""Batched records against single environments, and what is recorded."""

import math

import gymnasium as gym
import numpy as np
import pytest

from agents.evaluation.films import WATCHED_AMONG, farthest_goal


def alone(policy, task, seed):
    """The same episode in an environment of its own."""
    env = gym.make(f"vibgym/{task}-v0", action=policy.action, observation=policy.observation)
    observation, info = env.reset(seed=seed)
    state, done, steps, total, length = None, False, 0, 0.0, 0.0
    positions = [env.unwrapped.truth.pose[0, 0]]
    while not done:
        action, state = policy.predict(observation[None], state, np.array([steps == 0]))
        observation, reward, terminated, truncated, info = env.step(action[0])
        done, steps, total = terminated or truncated, steps + 1, total + reward
        positions.append(env.unwrapped.truth.pose[0, 0])
        length += math.dist(positions[-1][:2], positions[-2][:2])
    return {**info, "steps": steps, "return": total, "path_length": length, "poses": np.array(positions)}


@pytest.mark.parametrize("name", ["pusher", "counting"])
@pytest.mark.parametrize("task", ["Transport", "Align"])
def test_same_numbers_as_single_environments(found, task, name):
    rollout = found.rollout(task, "ideal", name)
    policy = next(each.content for each in found.settings.entries() if each.name == name)
    for k, seed in enumerate(rollout.seeds[:4]):
        one = alone(policy, task, seed)
        assert rollout.steps[k] == one["steps"]
        assert rollout.success[k] == one["is_success"]
        assert rollout.fallen[k] == one["fallen"]
        assert rollout.returns[k] == pytest.approx(one["return"], rel=1e-12, abs=1e-12)
        assert rollout.position_error[k] == one["position_error"]
        assert rollout.path_length[k] == pytest.approx(one["path_length"], rel=1e-12)
        np.testing.assert_array_equal(rollout.poses[k, : one["steps"] + 1, 0], one["poses"].astype(np.float32))
        assert np.isnan(rollout.poses[k, one["steps"] + 1 :]).all()
        if task == "Align":
            assert rollout.heading_error[k] == one["heading_error"]
        else:
            assert np.isnan(rollout.heading_error[k])
    for each in (rollout.parts_done, rollout.throughput, rollout.collisions, rollout.clearance):
        assert np.isnan(each).all()


def test_times_and_outcomes(found):
    still, pusher = (
        found.rollout("Transport", "ideal", "still <&>"),
        found.rollout("Transport", "ideal", "pusher"),
    )
    assert pusher.step_time == pytest.approx(0.04)
    assert pusher.success.sum() >= 4  # else the tests above have shown little
    np.testing.assert_allclose(pusher.time_to_goal[pusher.success], 0.04 * pusher.steps[pusher.success])
    assert np.isnan(pusher.time_to_goal[~pusher.success]).all()
    assert (pusher.position_error[pusher.success] <= 0.005).all()
    efficiency = pusher.path_efficiency[np.isfinite(pusher.path_efficiency)]
    assert len(efficiency) and (efficiency > 0.2).all() and (efficiency < 1.05).all()
    assert not still.success.any()
    assert (still.steps == found.tasks["Transport"].step_limit).all()
    assert np.isnan(still.path_efficiency).all()


def test_all_policies_meet_the_same_starts_and_goals(found):
    for task in found.settings.tasks:
        first, *others = (rollout for (place, _), rollout in found.rollouts.items() if place.task == task)
        for other in others:
            np.testing.assert_array_equal(first.goals, other.goals)
            np.testing.assert_array_equal(first.poses[:, 0], other.poses[:, 0])
            assert first.film.seed == other.film.seed


def test_film_is_the_watched_episode(found):
    for rollout in found.rollouts.values():
        film = rollout.film
        world = rollout.seeds.index(film.seed)
        assert film.poses.shape == (rollout.steps[world] + 1, 1, 3)
        assert film.phasors.shape == (len(film.poses), 8, 32, 2)
        assert not film.phasors[0].any()
        assert film.success == rollout.success[world]
        np.testing.assert_array_equal(film.poses.astype(np.float32), rollout.poses[world, : len(film.poses)])
    assert found.rollout("Align", "ideal", "pusher").film.phasors[1].any()


def test_the_farthest_of_the_first_worlds_is_watched():
    env = gym.make_vec("vibgym/Transport-v0", num_envs=WATCHED_AMONG + 20)
    _, info = env.reset(seed=5)
    nothing = np.zeros(WATCHED_AMONG + 20)
    assert farthest_goal(env.unwrapped, nothing) == info["position_error"][:WATCHED_AMONG].argmax()
    heap = gym.make_vec("vibgym/Singulate-v0", num_envs=WATCHED_AMONG + 20)
    _, info = heap.reset(seed=5)
    assert farthest_goal(heap.unwrapped, info["touching"]) == info["touching"][:WATCHED_AMONG].argmax()


def test_rates_leave_the_first_step_out(found):
    timing = found.rollout("Transport", "ideal", "still <&>").timing
    assert timing.world_steps == 8 * 249
    assert timing.rates()[0] == pytest.approx(timing.world_steps / (timing.policy + timing.environment))
    assert timing.rates()[2] > timing.rates()[0]
