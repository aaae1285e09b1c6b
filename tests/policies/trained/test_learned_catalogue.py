"""Which of the shipped agents serves a scene."""

import gymnasium as gym
import pytest

import vibgym
from tests.policies.helpers import info_of
from vibgym.policies.trained.catalogue import SHIPPED, shipped_agent, shipped_agents

PROTOTYPE = {"actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}


def test_the_catalogue_is_what_the_files_say():
    agents = shipped_agents()
    assert [agent.path for agent in agents] == sorted(SHIPPED.glob("*.json")) and len(agents) > 10
    for agent in agents:  # what files are called is what their records say
        words = [agent.tasks[0].lower(), *([agent.hardware] if agent.hardware != "ideal" else []), agent.variant]
        assert agent.path.stem == "-".join(filter(None, words))


@pytest.mark.parametrize("task, settings, arguments, name", [
    ("Align", {}, {}, "align"), ("Align", PROTOTYPE, {}, "align-prototype"),
    ("Align", PROTOTYPE, {"hardware": "ideal"}, "align"), ("Align", {}, {"hardware": "prototype"}, "align-prototype"),
    ("Align", {"actuators": {"kind": "prototype", "dead_zone": 0.0, "latency": 0}}, {}, "align"),
    ("Align", {}, {"variant": "cloned"}, "align-cloned"), ("Align", {}, {"action": "phasor"}, "align-phasor"),
    ("Align", {"surface": {"rows": 12, "columns": 12}}, {}, "align-element"), ("Transport", {}, {}, "transport"),
    ("Sort", {}, {}, "sort"), ("SortTwelve", PROTOTYPE, {}, "sorttwelve-prototype"), ("SortCrowded", {}, {}, "sort"),
    ("Sort", {"parts": ["steel_block"] * 3 + ["aluminium_block"]}, {}, "sort"),
])  # fmt: skip
def test_the_agent_for_a_task_its_hardware_and_what_is_wished(task, settings, arguments, name):
    info = info_of(task, **settings)
    assert shipped_agent(info, **arguments).path.stem == name
    assert vibgym.make_policy({"kind": "learned", **arguments}, info).predict


@pytest.mark.parametrize("task, settings, arguments, got, allowed", [
    ("Follow", {}, {}, "Follow", r"Align \(ideal, action 'wrench', 1 part, 8 x 32 elements\); .*Sort, .*Transport"),
    ("Align", {"surface": {"rows": 12, "columns": 12}}, {"action": "wrench"}, "12 x 12 elements, action 'wrench'",
     r"Align \(ideal, action 'wrench', 1 part, 8 x 32 elements\)"),
    ("Singulate", {"parts": ["steel_block"] * 4}, {}, "parts: 4", r"Singulate \(ideal, action 'wrench', 6 parts"),
    ("Align", {}, {"action": "field"}, "action 'field'", "action 'element', 1 part, any surface, variant 'element'"),
    ("Align", {}, {"variant": "best"}, "variant 'best'", "variant 'cloned'"),
    ("Align", PROTOTYPE, {"variant": "iql"}, "prototype", "variant 'iql'"),
    ("Align", {}, {"hardware": "real"}, "real", "'ideal', 'prototype'"),
])  # fmt: skip
def test_what_no_agent_serves_is_refused_with_all_that_there_is(task, settings, arguments, got, allowed):
    with pytest.raises(ValueError, match="policy") as error:
        vibgym.make_policy({"kind": "learned", **arguments}, info_of(task, **settings))
    assert "\n" not in str(error.value)


def test_an_environment_with_an_action_asks_for_an_agent_that_speaks_it():
    assert vibgym.make_policy("learned", gym.make("vibgym/Align-v0")).action == "wrench"  # nobody has chosen one
    assert (
        vibgym.make_policy("learned", gym.make_vec("vibgym/Align-v0", num_envs=2, action="phasor")).action == "phasor"
    )
    env = gym.make("vibgym/Align-v0", action="field")
    with pytest.raises(ValueError, match="policy 'learned'"):
        vibgym.make_policy("learned", env)
    with pytest.raises(ValueError, match="policy 'trained'"):
        vibgym.make_policy(str(SHIPPED / "align.json"), env)
