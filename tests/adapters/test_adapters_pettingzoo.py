"""PettingZoo adapter: PettingZoo's tests, and equality with the wrapped environment."""

import warnings

import gymnasium as gym
import numpy as np
import pettingzoo
import pytest
from gymnasium.error import ResetNeeded
from pettingzoo.test import parallel_api_test, parallel_seed_test

import vibgym
from tests.envs.helpers import assert_same, single
from vibgym.adapters.pettingzoo import PartsParallelEnv

FEW = {"max_episode_steps": 40}


@pytest.mark.parametrize("settings", [
    *({"action": action} for action in ("wrench", "velocity", "target", "patch", "field")), {"randomize": {"parts": [2, 4]}},
])  # fmt: skip
def test_pettingzoo_api(settings):
    settings = {**settings, **FEW}
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # The test passes an unknown option.
        warnings.filterwarnings("ignore", message=".*options options are ignored")
        if "randomize" in settings:  # it warns unless all possible agents are in every episode
            warnings.filterwarnings("ignore", message="No agents present but not all possible_agents")
        parallel_api_test(vibgym.parallel_env("Sort", **settings), num_cycles=100)
        parallel_seed_test(lambda: vibgym.parallel_env("Singulate", **settings), num_cycles=8)


def test_agents_of_slots_with_changing_parts_stay():
    parallel_api_test(vibgym.parallel_env("Feed", **FEW), num_cycles=60)
    env = vibgym.parallel_env("Feed", **FEW)
    _, infos = env.reset(seed=1, options={"parts": [0, 1, 2, 3]})
    assert env.agents == [f"part_{k}" for k in range(4)] and not all(info["present"] for info in infos.values())
    for _ in range(30):
        rows, _, _, _, infos = env.step(dict.fromkeys(env.agents, np.zeros(3)))
        assert all(rows[agent].any() == info["present"] for agent, info in infos.items())
    assert any(info["present"] for info in infos.values())


def test_ids_of_registered_environments_are_names(monkeypatch):
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    mine = gym.envs.registration.EnvSpec("MySort-v3", kwargs={"task": "Sort"}, max_episode_steps=9, **entry)
    monkeypatch.setitem(gym.registry, "MySort-v3", mine)
    for name in ("Sort", "vibgym/Sort-v0", "MySort-v3"):
        env = vibgym.parallel_env(name)
        assert len(env.reset(seed=0)[0]) == 6


@pytest.mark.parametrize("action", ["wrench", "velocity", "target", "patch"])
def test_agents_get_their_rows_of_all_arrays(action):
    settings = {"randomize": {"parts": [3, 3]}, "slots": 8, "action": action, "max_episode_steps": 6}
    many = vibgym.parallel_env("Sort", **settings)
    env = single("Sort", observation="parts", **settings)
    observations, infos = many.reset(seed=4)
    seen, info = env.reset(seed=4)
    there = np.flatnonzero(seen["mask"]).tolist()
    assert len(there) == 3 and many.agents == [f"part_{part}" for part in there]
    assert many.possible_agents == [f"part_{part}" for part in range(6)]
    rewards = np.zeros(6)
    for step in range(6):
        assert set(infos) == set(observations) == set(many.agents)
        for part in there:
            agent = f"part_{part}"
            assert_same(observations[agent], seen["parts"][part])
            assert many.observation_space(agent).contains(observations[agent])
            assert infos[agent]["done"] == info["parts"]["done"][part]
            terms = {name: values[part] for name, values in info["parts"]["reward_terms"].items()}
            assert infos[agent]["reward_terms"] == terms
        assert_same(many.state(), seen["parts"])
        actions = {agent: many.action_space(agent).sample() for agent in reversed(many.agents)}
        together = np.zeros((6, many.action_space("part_0").shape[0]), dtype=np.float32)
        for part in there:
            together[part] = actions[f"part_{part}"]
        agents = list(many.agents)
        observations, got, terminations, truncations, infos = many.step(actions)
        seen, _, terminated, truncated, info = env.step(together.ravel())
        assert got == {agent: info["parts"]["reward"][int(agent[5:])] for agent in agents}
        assert terminations == dict.fromkeys(agents, terminated) and truncations == dict.fromkeys(agents, step == 5)
        rewards[there] += [got[f"part_{part}"] for part in there]
        if step < 5:
            assert many.agents == agents
    assert many.agents == [] and (rewards[there] != 0.0).all() and truncated
    many.close()


@pytest.mark.parametrize("credited", [True, False])
def test_absent_parts_can_be_agents_that_do_nothing(credited):
    settings = {"randomize": {"parts": [2, 5]}, "action": "wrench", **FEW}
    single_env = single("Sort", observation="parts", **settings)
    if not credited:
        single_env = gym.wrappers.TransformReward(single_env, lambda reward: reward + 1.0)
    kept, usual = PartsParallelEnv(single_env, keep_absent=True), vibgym.parallel_env("Sort", **settings)
    for seed in range(3):
        observations, infos = kept.reset(seed=seed)
        usual.reset(seed=seed)
        here = list(usual.agents)
        absent = set(kept.possible_agents) - set(here)
        assert kept.agents == kept.possible_agents and absent
        for _ in range(3):
            assert not any(observations[agent].any() or infos[agent]["present"] for agent in absent)
            actions = {agent: kept.action_space(agent).sample() for agent in kept.agents}
            observations, rewards, *_, infos = kept.step(actions)
            expected, own, *_ = usual.step({agent: actions[agent] for agent in here})
            assert_same({agent: observations[agent] for agent in here}, expected)
            assert [rewards[agent] for agent in absent] == [0.0] * len(absent)
            assert not credited or {agent: rewards[agent] for agent in here} == own
            assert all(rewards[agent] != 0.0 for agent in here)
    made = vibgym.parallel_env("Sort", keep_absent=True, **settings)
    assert made.reset(seed=0)[0].keys() == set(kept.possible_agents)


def test_pettingzoo_makes_them_by_their_ids():
    made = pettingzoo.make("parallel", "vibgym/SortTwelve-v0", action="field")
    assert isinstance(made, PartsParallelEnv) and made.max_num_agents == 12
    assert made.action_space("part_11").shape == (6,) and made.metadata["name"] == "vibgym/SortTwelve-v0"


def test_reset_options_are_passed_on_and_others_warned_about():
    many = vibgym.parallel_env("Sort")
    many.reset(seed=1, options={"parts": [1, 4]})
    assert many.agents == ["part_1", "part_4"]
    with pytest.warns(UserWarning, match="options colour are ignored"):
        many.reset(options={"colour": "red"})
    assert len(many.agents) == 6
    with pytest.raises(ValueError, match=r"options\['parts'\]"):
        many.reset(options={"parts": [9]})


def test_bad_input():
    for name, settings, named in (
        ("Juggle", {}, "name"), ("Sort", {"observation": "state"}, "observation"), ("Sort", {"action": "element"}, "action"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=named):
            vibgym.parallel_env(name, **settings)
    with pytest.raises(ValueError, match="env"):
        PartsParallelEnv(single("Sort"))
    many = vibgym.parallel_env("Sort", randomize={"parts": [2, 2]})
    with pytest.raises(ResetNeeded):
        many.step({})
    many.reset(seed=0)
    state = many.env.unwrapped.get_state()
    good = {agent: np.zeros(3, dtype=np.float32) for agent in many.agents}
    first = many.agents[0]
    for bad in (
        {}, {first: good[first]}, {**good, "part_9": good[first]}, [good], {**good, first: np.zeros(4)},
        {**good, first: [0.0, np.nan, 0.0]}, {**good, first: "push"}, {**good, first: [[0.0], [0.0, 1.0]]},
    ):  # fmt: skip
        with pytest.raises(ValueError, match="^actions"):
            many.step(bad)
    assert_same(many.env.unwrapped.get_state(), state)


def test_agents_get_the_rewards_of_wrappers():
    """The world's reward under wrappers that change it, the part's reward under others."""
    paid = []
    for wrap in (lambda env: env, lambda env: gym.wrappers.TransformReward(env, lambda reward: reward - 3.0)):
        many = PartsParallelEnv(wrap(single("Sort", observation="parts", action="wrench")))
        many.reset(seed=0)
        paid.append(many.step({agent: np.ones(3) for agent in many.agents})[1])
    own, wrapped = paid
    assert len(set(own.values())) > 1 and len(set(wrapped.values())) == 1
    assert wrapped["part_0"] == pytest.approx(np.mean(list(own.values())) - 3.0, abs=1e-12)
