"""Policies without learning, and the one call that all policies have."""

import math

import numpy as np
import pytest

import vibgym
from agents.control.seen import see, started
from agents.policy import Situation, make_policy
from tests.agents.helpers import TASKS, situation, successes
from tests.envs.helpers import batch, put, single

NAMES = ("zero", "random", "open_loop", "local_field")


def observations(task, worlds=6, steps=8, seed=0):
    """States that a batch comes through, (steps, worlds, 18)."""
    env = batch(task, worlds, action="patch")
    env.action_space.seed(seed)
    return np.array([env.reset(seed=seed)[0], *[env.step(env.action_space.sample())[0] for _ in range(steps - 1)]])


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("task", TASKS)
def test_actions_fit_the_environment(task, name):
    policy = make_policy(name, situation(task))
    env = single(task, action=policy.action, observation=policy.observation)
    many = batch(task, 3, action=policy.action, observation=policy.observation)
    for each in (env, many):
        seen, _ = each.reset(seed=0)
        state, start = None, np.ones(3 if each is many else 1, dtype=bool)
        for _ in range(3):
            action, state = policy.predict(seen, state, start)
            assert each.action_space.contains(action)
            seen, *_ = each.step(action)
            start = np.zeros_like(start)


@pytest.mark.parametrize("name", ["zero", "open_loop", "local_field"])
@pytest.mark.parametrize("task", TASKS)
def test_a_batch_is_its_rows(task, name):
    seen = observations(task)
    policy = make_policy(name, situation(task))
    batch_state, states = None, [None] * seen.shape[1]
    for step, rows in enumerate(seen):
        start = np.full(len(rows), step == 0)
        actions, batch_state = policy.predict(rows, batch_state, start)
        for world, row in enumerate(rows):
            action, states[world] = policy.predict(row, states[world], start[:1])
            assert action == pytest.approx(actions[world], abs=1e-6)
            again, _ = policy.predict(row[None], states[world], np.zeros(1, dtype=bool))
            assert again.shape == (1, *action.shape)


def test_random_policy():
    policy, again, other = (make_policy("random", situation(), seed=seed) for seed in (1, 1, 2))
    seen = observations("Align", steps=1)[0]
    first, second = policy.predict(seen)[0], policy.predict(seen)[0]
    assert first.shape == (6, 8, 32, 2) and first.dtype == np.float32
    assert np.abs(first).max() <= 1 and first.mean() == pytest.approx(0, abs=0.05) and first.std() > 0.5
    assert (first == again.predict(seen)[0]).all()
    assert (first != second).any() and (first != other.predict(seen)[0]).any()
    assert (make_policy({"kind": "random", "seed": 2}, situation(), seed=1).predict(seen)[0] != first).any()


def test_zero_policy_lets_the_part_rest():
    env = single("Transport", action="field")
    seen, _ = env.reset(seed=0)
    start = env.unwrapped.core.simulator.pose
    policy = make_policy("zero", situation("Transport"))
    for _ in range(20):
        seen, *_ = env.step(policy.predict(seen)[0])
    assert np.abs(env.unwrapped.core.simulator.pose - start).max() < 1e-4


@pytest.mark.parametrize("task", TASKS)
def test_open_loop_looks_once_an_episode(task):
    """After its first observation nothing that it sees changes what it does, until an episode starts."""
    policy = make_policy("open_loop", situation(task))
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


def test_open_loop_leaves_the_state_it_is_given():
    policy = make_policy("open_loop", situation("Rotate"))
    seen = observations("Rotate", steps=2)
    _, state = policy.predict(seen[0])
    before = state.copy()
    policy.predict(seen[1], state, np.ones(6, dtype=bool))
    assert (state == before).all()


def test_open_loop_turns_and_then_stops():
    policy = make_policy({"kind": "open_loop", "turn_rate": 10.0}, situation("Rotate"))
    env = single("Rotate", action="phasor")
    env.reset(seed=0)
    core = env.unwrapped.core
    core.goal[0] = [0.4, 0.1, 2.0]
    put(env, [0.4, 0.1, 0.0])
    seen, *_ = env.step(np.zeros((8, 32, 2), dtype=np.float32))
    state, acting = None, []
    for _ in range(10):
        action, state = policy.predict(seen, state)
        acting.append(bool(np.abs(action).max() > 0))
    assert acting == [True] * 5 + [False] * 5  # 2 rad at 10 rad/s last 5 periods of 40 ms


def test_local_field_has_no_memory():
    policy = make_policy("local_field", situation("Rotate"))
    seen = observations("Rotate", steps=2)
    first, state = policy.predict(seen[0])
    policy.predict(seen[1], state)
    assert state is None and (policy.predict(seen[0], None, np.zeros(6, dtype=bool))[0] == first).all()


@pytest.mark.parametrize("part", ["steel_block", {"shape": "disc", "radius": 0.03, "friction": 0.4}])
@pytest.mark.parametrize("task", TASKS)
def test_what_policies_read_from_the_state_is_the_state(task, part):
    worlds = 8
    env = batch(task, worlds, action="patch", parts=[part])
    env.reset(seed=3)
    env.action_space.seed(3)
    core = env.unwrapped.core
    for _ in range(5):
        rows, *_ = env.step(env.action_space.sample())
        seen = see(rows, core.surface, core.part)
        pose, velocity = core.simulator.pose[:, 0], core.simulator.mean_velocity[:, 0]
        assert seen.centre == pytest.approx(pose[:, :2], abs=1e-6)
        assert seen.error == pytest.approx(core.goal[:, :2] - pose[:, :2], abs=1e-6)
        assert seen.velocity == pytest.approx(velocity[:, :2], abs=1e-6)
        assert seen.spin == pytest.approx(np.clip(velocity[:, 2], -10, 10), abs=1e-5)
        symmetry = core.part.symmetry
        assert np.cos(symmetry * seen.heading) == pytest.approx(np.cos(symmetry * pose[:, 2]), abs=1e-6)
        turn = {"Transport": 0 * pose[:, 2], "Rotate": core.goal[:, 2] - pose[:, 2]}.get(task, core.score.error[:, 2])
        assert seen.turn == pytest.approx(np.clip(turn, -2 * math.pi, 2 * math.pi), abs=1e-5)
        assert not seen.single and see(rows[0], core.surface, core.part).single


def test_started():
    assert started(None, None, 2).tolist() == [True, True]
    assert started(None, np.array([False, False]), 2).tolist() == [True, True]
    assert started(1, None, 2).tolist() == [False, False]
    assert started(1, np.array([True, False]), 2).tolist() == [True, False]


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("seen", [np.zeros(17), np.zeros((3, 19)), 0.0, np.zeros((0,))])
def test_wrong_observations_are_refused(name, seen):
    with pytest.raises(ValueError, match="^observation: .*18"):
        make_policy(name, situation()).predict(seen)


@pytest.mark.parametrize("task", TASKS)
def test_local_field_succeeds(task):
    assert successes(make_policy("local_field", situation(task)), task) >= 99


def test_open_loop_transports_without_looking():
    assert successes(make_policy("open_loop", situation("Transport")), "Transport") >= 95


def test_doing_nothing_does_not_succeed():
    assert successes(make_policy("zero", situation("Align")), "Align") <= 5


# -- how policies are made ---------------------------------------------------------------------------------------------


def test_policies_are_made_from_names_mappings_and_objects():
    class Mine:
        action, observation = "field", "state"

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            return np.zeros((1, 6)), state

    mine = Mine()
    assert make_policy(mine, situation()) is mine
    for name in NAMES:
        named, mapped = make_policy(name, situation()), make_policy({"kind": name}, situation())
        assert type(named) is type(mapped) and hasattr(named, "predict")
        assert named.action in ("element", "phasor", "patch", "field") and named.observation == "state"
    tuned = make_policy({"kind": "local_field", "response": 0.1, "braking": 0.5, "approach": 3.0}, situation())
    assert (tuned.response, tuned.braking, tuned.approach) == (0.1, 0.5, 3.0)
    settings = {"kind": "local_field", "response": 0.1}
    make_policy(settings, situation())
    assert settings == {"kind": "local_field", "response": 0.1}


@pytest.mark.parametrize("policy, named", [
    ("magic", "policy.kind.*magic.*'zero', 'random', 'open_loop', 'local_field', 'local_fields', 'planner', 'trained'"),
    (3, "policy.*3"), (None, "policy.*None"), ({}, "policy.kind.*None"), ({"kind": 3}, "policy.kind"),
    ({"kind": "zero", "colour": 1}, "policy 'zero'.*colour"),
    ({"kind": "local_field", "response": -1}, "response.*-1"),
    ({"kind": "local_field", "braking": 1.5}, "braking.*1.5"),
    ({"kind": "local_field", "approach": "fast"}, "approach.*fast"),
    ({"kind": "local_field", "situation": 1}, "policy 'local_field'"),
    ({"kind": "open_loop", "turn_rate": 0}, "turn_rate"), ({"kind": "open_loop", "gather_time": math.nan}, "gather_time"),
    ({"kind": "open_loop", "centring": 2}, "centring"), ({"kind": "random", "seed": -1}, "seed"),
    ({"kind": "random", "seed": "x"}, "seed"),
    ({"kind": "trained"}, "policy.*'path'"), ({"kind": "trained", "path": 3}, "policy.*'path'"),
    ({"kind": "trained", "path": "x.json", "colour": 1}, "policy.*'path'"),
    ("nowhere/policy.json", "path.*nowhere/policy.json"),
    ({"kind": "trained", "path": "nowhere/{task}.json"}, "path.*nowhere/align.json"),
])  # fmt: skip
def test_bad_policies_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, situation())
    assert "\n" not in str(error.value)


def test_policies_know_other_surfaces_and_parts():
    surface, part = vibgym.Surface(rows=10, columns=16, element_size=0.02), vibgym.Part.disc(0.03, friction=0.4)
    policy = make_policy("local_field", Situation("Transport", surface, part))
    settings = {"surface": {"rows": 10, "columns": 16, "element_size": 0.02}, "parts": [part]}
    env = batch("Transport", 20, action="field", autoreset_mode="SameStep", **settings)
    seen, _ = env.reset(seed=0)
    succeeded = np.zeros(20, dtype=bool)
    for _ in range(250):
        seen, _, done, _, info = env.step(policy.predict(seen)[0])
        if done.any():
            succeeded |= done & info["final_info"]["is_success"]
    assert succeeded.sum() >= 19
