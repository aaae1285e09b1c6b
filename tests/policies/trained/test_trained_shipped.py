"""Shipped policies against the table of trained agents, and the choice of one for a scene."""

import csv
import json
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from scipy.stats import binom

import vibgym
from tests.policies.helpers import DISC, FRESH, HARDWARE, episodes, info_of
from vibgym import Surface
from vibgym.envs.vector import environment_id
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.catalogue import SHIPPED, shipped_agent, shipped_agents
from vibgym.policies.trained.trained import RESIDUAL, described, serves_surface

pytest.importorskip("torch")

from agents.learning_curve import evaluation_environments
from agents.tabulate import shipped_name
from agents.training_file import agents_in, load_settings
from agents.training_settings import TrainSettings

ROOT = Path(__file__).parents[3]
TABLE = ROOT / "results" / "agents.csv"
FILES = {agent: path for path in sorted((ROOT / "configs" / "agents").glob("*.yaml"))
         if "\nvibgym/" in path.read_text() for agent in agents_in(path)}  # fmt: skip
"""Agent -> file with its settings."""

ALL = [path.stem for path in sorted(SHIPPED.glob("*.json"))]
SINGLE, CROWD, SCENES = 40, 8, 4
"""Episodes with one part and with several; of an agent of many scenes as many of these, and each gets its share."""

RARE = 1e-3
"""On either side: probability that a new sample fails although the table's interval is right."""


def table() -> dict[str, dict[str, str]]:
    """The rows of the policies that are shipped, by the names of their files."""
    with TABLE.open(newline="") as file:
        return {shipped_name(row["agent"]): row for row in csv.DictReader(file) if row["shipped"] == "True"}


def scenes(settings: TrainSettings) -> list[dict]:
    """Environments that the table's episodes are played in, the first few of many."""
    kept = evaluation_environments(settings)[:SCENES]
    return [{name: value for name, value in scene.items() if name not in ("action", "observation")} for scene in kept]


def record(name: str) -> dict:
    return json.loads((SHIPPED / f"{name}.json").read_text())


def shipped(name: str, info: TaskInfo) -> Policy:
    """A policy, or the correction of one."""
    kind = RESIDUAL if RESIDUAL in record(name) else "trained"
    return make_policy({"kind": kind, "path": str(SHIPPED / f"{name}.json")}, info)


def test_the_table_has_exactly_the_shipped_policies():
    assert ALL and sorted(table()) == sorted(ALL)
    named = [record(name)["tensors"] for name in ALL]
    assert sorted(path.name for path in SHIPPED.glob("*.safetensors")) == sorted(named)
    assert sum(path.stat().st_size for path in SHIPPED.iterdir()) < 10_000_000


@pytest.mark.parametrize("name", ALL)
def test_a_shipped_policy_succeeds_as_often_as_the_table_says(name):
    """On episodes that are not the table's.

    The table has an interval ``low`` to ``high`` of the success rate (95 % confidence). The number of successes is binomial. It
    must not be below the quantile :data:`RARE` at ``low``, nor above the quantile 1 - :data:`RARE` at ``high``.
    """
    row = table()[name]
    settings = load_settings(FILES[row["agent"]], row["agent"])
    assert json.loads(row["environment"]) == settings.environment  # trained with the file's settings
    task, every_scene = row["agent"].partition("/")[0], scenes(settings)
    success = []
    for number, scene in enumerate(every_scene):
        env = gym.make_vec(environment_id(settings.task), num_envs=1, action=record(name)["action"], **scene)
        info = TaskInfo.of(env)
        policy = shipped(name, info)
        count = (SINGLE if len(info.parts) == 1 else CROWD) // len(every_scene)
        seeds = range(FRESH + 1000 * number, FRESH + 1000 * number + count)
        if info.continuous_feed:  # parts come and go, and nothing succeeds
            played = rollout(policy, task, seeds=seeds[:2], keep=Measures, **scene)
            assert played.reported("good_per_minute").mean() == pytest.approx(
                float(row["good_per_minute_mean"]), rel=0.05
            )
            return
        success += rollout(policy, task, seeds=seeds, **scene).success.tolist()
    least = binom.ppf(RARE, len(success), float(row["success_low"]))
    most = binom.ppf(1.0 - RARE, len(success), float(row["success_high"]))
    assert least <= sum(success) <= most, (sum(success), least, most)
    assert least > 0  # otherwise the test could not fail


@pytest.mark.parametrize("settings", [{"parts": [DISC]}, {"surface": {"rows": 12, "columns": 12}}])
def test_the_policy_of_images_serves_other_shapes_and_surfaces_too(settings):
    policy = make_policy(str(SHIPPED / "transport-image.json"), info_of("Transport", **settings))
    assert policy.observation == "image"
    assert episodes(policy, "Transport", worlds=32, **settings).success >= 30


def test_numbers_of_the_table_belong_together():
    for row in table().values():
        low, rate, high = (float(row[name]) for name in ("success_low", "success", "success_high"))
        assert 0.0 <= low <= rate <= high <= 1.0 and low < high
        assert rate * int(row["episodes"]) == pytest.approx(np.rint(rate * int(row["episodes"])), abs=1e-6)
        assert int(row["steps"]) > 0 and float(row["minutes"]) > 0.0 and row["processor"] and row["versions"]


@pytest.mark.parametrize("frequency", [24.0, 26.0])
@pytest.mark.parametrize("hardware", [{}, HARDWARE])
@pytest.mark.parametrize("task", ["Transport", "Align", "Rotate", "Sort", "Pack"])
def test_agents_serve_machines_near_the_frequency_of_their_training(task, hardware, frequency):
    result = rollout("learned", task, seeds=range(FRESH, FRESH + 20), surface={"frequency": frequency}, **hardware)
    assert result.success.mean() >= 0.95


def test_policies_do_not_serve_other_frequencies():
    stated = described(Surface())
    served = {frequency: serves_surface(stated, Surface(frequency=frequency)) for frequency in (23.9, 24.0, 26.0, 26.1)}
    assert served == {23.9: False, 24.0: True, 26.0: True, 26.1: False}
    assert not serves_surface(stated, Surface(rows=9)) and not serves_surface(stated, Surface(element_size=0.0265))


RANGED = [name for name in ALL if isinstance(record(name)["surface"]["frequency"], list)]


@pytest.mark.parametrize("end", [0, 1])
@pytest.mark.parametrize("name", RANGED)
def test_a_policy_succeeds_at_the_ends_of_the_ranges_that_it_states(name, end):
    stated, task = record(name)["surface"], record(name)["tasks"][0]
    policy = {"kind": "trained", "path": str(SHIPPED / f"{name}.json")}
    for what in ("frequency", "element_size"):
        surface = {what: stated[what][end]}
        assert rollout(policy, task, seeds=range(FRESH, FRESH + 20), surface=surface).success.mean() >= 0.95
        beyond = {what: stated[what][end] * (0.9, 1.1)[end]}
        with pytest.raises(ValueError, match="surface"):
            rollout(policy, task, seeds=[FRESH], surface=beyond)


def test_the_catalogue_is_what_the_files_say():
    agents = shipped_agents()
    assert [agent.path for agent in agents] == sorted(SHIPPED.glob("*.json")) and len(agents) > 10
    for agent in agents:  # names of files agree with their records
        words = [agent.tasks[0].lower(), *([agent.hardware] if agent.hardware == "prototype" else []), agent.variant]
        assert agent.path.stem == "-".join(filter(None, words))


@pytest.mark.parametrize("task, settings, arguments, name", [
    ("Align", {}, {}, "align"), ("Align", HARDWARE, {}, "align-prototype"),
    ("Align", HARDWARE, {"hardware": "ideal"}, "align"), ("Align", {}, {"hardware": "prototype"}, "align-prototype"),
    ("Align", {"actuators": {"kind": "prototype", "dead_zone": 0.0, "latency": 0}}, {}, "align"),
    ("Align", {}, {"variant": "cloned"}, "align-cloned"), ("Align", {}, {"action": "phasor"}, "align-phasor"),
    ("Align", {"surface": {"rows": 12, "columns": 12}}, {}, "align-element"), ("Transport", {}, {}, "transport"),
    ("Sort", {}, {}, "sort"), ("SortTwelve", HARDWARE, {}, "sorttwelve-prototype"), ("SortCrowded", {}, {}, "sort"),
    ("Sort", {"parts": ["steel_block"] * 3 + ["aluminium_block"]}, {}, "sort"),
    ("Swap", {}, {}, "swap"), ("Swap", HARDWARE, {}, "swap"), ("SwapCrowded", HARDWARE, {}, "swapcrowded"),
    ("Pack", HARDWARE, {}, "pack-prototype"), ("PackFull", HARDWARE, {"hardware": "prototype"}, "packfull"),
])  # fmt: skip
def test_the_agent_for_a_task_its_hardware_and_what_is_wished(task, settings, arguments, name):
    info = info_of(task, **settings)
    assert shipped_agent(info, **arguments).path.stem == name
    assert vibgym.make_policy({"kind": "learned", **arguments}, info).predict


@pytest.mark.parametrize("task, settings, arguments", [
    ("Follow", {}, {}), ("Align", {"surface": {"rows": 12, "columns": 12}}, {"action": "wrench"}),
    ("Align", {}, {"action": "field"}), ("Align", HARDWARE, {"variant": "iql"}), ("Align", {}, {"hardware": "real"}),
])  # fmt: skip
def test_scenes_without_an_agent_are_refused(task, settings, arguments):
    with pytest.raises(ValueError, match=r"^[^\n]*policy[^\n]*$"):
        vibgym.make_policy({"kind": "learned", **arguments}, info_of(task, **settings))


def test_an_environment_with_an_action_asks_for_an_agent_that_speaks_it():
    assert vibgym.make_policy("learned", gym.make("vibgym/Align-v0")).action == "wrench"  # the default
    phasors = gym.make_vec("vibgym/Align-v0", num_envs=2, action="phasor")
    assert vibgym.make_policy("learned", phasors).action == "phasor"
    env = gym.make("vibgym/Align-v0", action="field")
    with pytest.raises(ValueError, match="policy 'learned'"):
        vibgym.make_policy("learned", env)
    with pytest.raises(ValueError, match="policy 'trained'"):
        vibgym.make_policy(str(SHIPPED / "align.json"), env)
