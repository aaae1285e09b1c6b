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
    for agent in agents:  # names of files agree with their records
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


@pytest.mark.parametrize("task, settings, arguments", [
    ("Follow", {}, {}), ("Align", {"surface": {"rows": 12, "columns": 12}}, {"action": "wrench"}),
    ("Align", {}, {"action": "field"}), ("Align", PROTOTYPE, {"variant": "iql"}), ("Align", {}, {"hardware": "real"}),
])  # fmt: skip
def test_scenes_without_an_agent_are_refused(task, settings, arguments):
    with pytest.raises(ValueError, match="policy") as error:
        vibgym.make_policy({"kind": "learned", **arguments}, info_of(task, **settings))
    assert "\n" not in str(error.value)


def test_an_environment_with_an_action_asks_for_an_agent_that_speaks_it():
    assert vibgym.make_policy("learned", gym.make("vibgym/Align-v0")).action == "wrench"  # the default
    assert (
        vibgym.make_policy("learned", gym.make_vec("vibgym/Align-v0", num_envs=2, action="phasor")).action == "phasor"
    )
    env = gym.make("vibgym/Align-v0", action="field")
    with pytest.raises(ValueError, match="policy 'learned'"):
        vibgym.make_policy("learned", env)
    with pytest.raises(ValueError, match="policy 'trained'"):
        vibgym.make_policy(str(SHIPPED / "align.json"), env)
