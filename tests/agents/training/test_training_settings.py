"""Settings of training: files of one run, files of many agents, and what is refused before anything is written."""

from pathlib import Path

import gymnasium as gym
import pytest

from agents import __main__ as command
from agents.training_file import agents_in, load_settings
from tests.agents.training.helpers import DATA, POSE, PPO, written
from tests.commands import refusal

MANY = """
defaults:
  worlds: 16
  steps: 1000
  environment: {action: wrench}
  ppo: {learning_rate: 0.002, net: [32]}
vibgym/Align-v0:
  ideal: {}
  prototype:
    seed: 4
    steps: 2000
    environment: {action: patch, actuators: prototype}
    ppo: {net: [64, 64]}
    imitation: {expert: pose, rounds: 2}
vibgym/SortTwelve-v0:
  ideal: {output: runs/mine}
"""


@pytest.fixture
def many(tmp_path):
    path = tmp_path / "ppo.yaml"
    path.write_text(MANY)
    return path


def test_agents_have_their_own_settings_and_directories_on_top_of_the_defaults(many):
    assert agents_in(many) == ("Align/ideal", "Align/prototype", "SortTwelve/ideal")
    plain, own = load_settings(many, "Align/ideal"), load_settings(many, "Align/prototype")
    assert (plain.task, plain.worlds, plain.steps, plain.seed) == ("Align", 16, 1000, 0)
    assert (own.task, own.worlds, own.steps, own.seed) == ("Align", 16, 2000, 4)
    assert plain.environment == {"action": "wrench"}
    assert own.environment == {"action": "patch", "actuators": "prototype"}  # whole, unlike the algorithm's settings
    assert (plain.own.learning_rate, plain.own.net) == (0.002, (32,))
    assert (own.own.learning_rate, own.own.net) == (0.002, (64, 64))
    assert plain.imitation is None and (own.imitation.expert, own.imitation.rounds) == ("pose", 2)
    agents = [("Align/ideal", 0, None), ("Align/ideal", 2, 2), ("Align/prototype", 4, None), ("Align/prototype", 1, 1)]
    for agent, seed, argument in agents:
        settings = load_settings(many, agent, argument)
        assert settings.seed == seed and settings.output == f"runs/agents/{agent.replace('/', '-')}/seed-{seed}"
    assert load_settings(many, "SortTwelve/ideal", 5).output == "runs/mine"


def test_environments_of_others_keep_their_whole_name(tmp_path, monkeypatch):
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("mine/Align-v0", kwargs={"task": "Align"}, **entry)
    monkeypatch.setitem(gym.registry, "mine/Align-v0", spec)
    path = tmp_path / "many.yaml"
    path.write_text("mine/Align-v0: {own: {steps: 5}}")
    assert load_settings(path, "Align/own").task == "mine/Align-v0"
    path.write_text("mine/Align-v0: {own: {steps: 5}}\nvibgym/Align-v0: {own: {steps: 6}}")
    with pytest.raises(ValueError, match="vibgym/Align-v0"):
        load_settings(path, "Align/own")


FOLDER = Path(__file__).parents[3] / "configs" / "agents"


@pytest.mark.parametrize("path", sorted(FOLDER.glob("*.yaml")), ids=lambda path: path.name)
def test_shipped_files_are_sound(path):
    agents = [None] if "\ntask:" in f"\n{path.read_text()}" else agents_in(path)
    assert all(load_settings(path, agent).steps > 0 for agent in agents)


@pytest.mark.parametrize("old, new, named", [
    ("", "", "'Align/real'"),
    ("defaults:", "defaults: 3\nothers:", "ppo.yaml"),
    ("vibgym/Align-v0:", "vibgym/Juggle-v0:", "ppo.yaml"),
    ("vibgym/Align-v0:", "3:", "ppo.yaml"),
    ("  ideal: {}", "  ideal: 3", "vibgym/Align-v0.ideal"),
    ("  ideal: {}", "  ideal: {task: Sort}", "vibgym/Align-v0.ideal"),
    ("  worlds: 16", "  worlds: 0", "Align/prototype.worlds"), ("net: [64, 64]", "net: [0]", "Align/prototype: ppo.net"),
    ("ppo: {net: [64, 64]}", "ppo: 3", "Align/prototype: ppo"),
    (MANY, "task: Align\nsteps: 5", "--agent"),
    (MANY, "defaults: 3\nvibgym/Align-v0: {prototype: {steps: 5}}", "ppo.yaml: defaults"),
])  # fmt: skip
def test_faults_of_files_of_many_agents_are_one_line_with_file_and_agent(many, capsys, old, new, named):
    many.write_text(MANY.replace(old, new, 1) if old else MANY)
    line = refusal(capsys, command.main, "train", many, "--agent", "Align/prototype" if old else "Align/real")
    assert named in line and str(many) in line
    assert [path.name for path in many.parent.iterdir()] == ["ppo.yaml"]


# -- settings of one run -----------------------------------------------------------------------------------------------

WRENCH = {"action": "wrench"}
HYBRID = {"environment": WRENCH, "residual": {"base": POSE}}
PAIR = [{"shape": "disc", "radius_mm": 20, "friction": 0.6, "name": "disc"}] * 2
COSTLY = {"action": "velocity", "parts": PAIR, "costs": {"effort": 1.0}, "max_episode_steps": 8}
START = {"start": "START"}


def own(**changes):
    return {"ppo": {**PPO, **changes}}


def stage(environment, until=None):
    return {"curriculum": [{"environment": environment, "until": {"steps": 9} if until is None else until}]}


def offline(algorithm="offline", environment=WRENCH, **changes):
    data = {"dataset": DATA, "directory": "RECORDED", "net": [8, 8], **changes}
    return {"algorithm": algorithm, "environment": environment, algorithm: data}


REFUSED = {
    "no task": ({"task": None}, "task"),
    "negative seed": ({"seed": -1}, "seed"),
    "algorithm": ({"algorithm": "nothing"}, "algorithm"),
    "algorithm of another library": ({"algorithm": "sb3.Nothing"}, "algorithm"),
    "settings as own": ({"own": {}}, "'own'"),
    "settings of another algorithm": ({"offline": {"dataset": ""}}, "offline.dataset"),
    "network": (own(network="nothing"), "network"),
    "memory": ({**own(n_steps=10**6), "worlds": 1000}, "ppo.n_steps"),
    "memory of imitation": (
        {"imitation": {"expert": "pose", "steps": 10**6, "rounds": 1000}, "environment": WRENCH}, "imitation.steps",
    ),
    "one sample": ({**own(n_steps=1), "worlds": 1}, "ppo.n_steps"),
    "worlds twice": ({"environment": {"num_envs": 3}}, "environment: num_envs"),
    "range": ({"serves": {"frequency": [30.0, 20.0]}}, "serves.frequency"),
    "expert": ({"imitation": {"expert": POSE}}, "imitation.expert"),
    "stage without an end": ({"curriculum": [{"environment": {}}]}, "curriculum[0].until"),
    "stage of another environment": (stage({"near": 1.0}), "curriculum[0].environment"),
    "stage with other actions": (stage({"action": "phasor"}), "curriculum[0].environment"),
    "curriculum of SAC": ({**stage({}), "algorithm": "sb3.SAC"}, "curriculum"),
    "imitation of SAC": ({"algorithm": "sb3.SAC", "imitation": {"expert": POSE}}, "imitation"),
    "start of SAC": ({"algorithm": "sb3.SAC", **START}, "start"),
    "argument of SAC": ({"algorithm": "sb3.SAC", "sb3": {"nothing": 1}}, "sb3"),
    "limit without costs": ({"environment": {**COSTLY, "costs": None}, "task": "Sort", **own(cost_limit=0.5)}, "costs"),
    "limit that cannot be kept": (
        {"environment": {**COSTLY, "costs": {"clearance": {"weight": 1.0, "below": 5.0}}}, "task": "Sort",
         **own(cost_limit=0.5)},
        "all elements rest",
    ),
    "selection without costs": ({"selection": {"cost_limit": 1.0}}, "selection.cost_limit"),
    "no start": ({"start": "nowhere.json"}, "nowhere.json"),
    "start of another task": ({**START, "task": "Transport"}, "tasks"),
    "start on another surface": (
        {**START, "environment": {"action": "field", "surface": {"rows": 12, "columns": 16}}}, "surface",
    ),
    "start with other columns": ({**START, **own(dropped_columns=["position"])}, "columns"),
    "start without memory": ({**START, **own(history=True)}, "history"),
    "start without a base": ({**START, **HYBRID}, "residual"),
    "base without a kind": ({**HYBRID, "residual": {"base": {"law": "pose"}}}, "residual.base"),
    "base that is corrected": ({**HYBRID, "residual": {"base": {"kind": "residual", "path": "x.json"}}}, "residual.base"),
    "network of a correction": ({**HYBRID, "ppo": {"network": "elements"}}, "network"),
    "one row that imitates": ({"ppo": {"network": "joint"}, "imitation": {"expert": {"kind": "pose"}}}, "imitation"),
    "parts that are standardized": ({"ppo": {"standardized": True}}, "standardized"),
    "parts that are averaged": ({"ppo": {"symmetric": True}}, "symmetric"),
    "one row that touches": ({"ppo": {"network": "joint", "touch_cost": 0.1}}, "touch_cost"),
    "action of the base": ({**HYBRID, "residual": {"base": {"kind": "pose", "action": "phasor"}}}, "base.action"),
    "base with memory": ({**HYBRID, **own(history=True)}, "ppo.history"),
    "base of images": ({**HYBRID, **own(network="pixels")}, "ppo.network"),
    "another action than the base's": ({**HYBRID, "environment": {"action": "patch"}}, "environment.action"),
    "base and expert": ({**HYBRID, "imitation": {"expert": "pose"}}, "imitation"),
    "data of another task": ({**offline(), "task": "Rotate"}, "task"),
    "data of another surface": (offline(environment={**WRENCH, "surface": {"rows": 8, "columns": 8}}), "surface"),
    "data for the state": (offline(environment={**WRENCH, "observation": "state"}), "observation"),
    "no data": (offline(dataset="vibgym/none-v0"), "offline.dataset"),
    "too many episodes": (offline("flow", network="parts", episodes=10**6), "flow.episodes"),
    "values of images": (offline(network="pixels", method="iql"), "cloning"),
    "data without images": (offline(network="pixels"), "observation: parts"),
    "start with data": ({**offline(), "start": "policy.json"}, "start"),
    "expert with data": ({**offline(), "imitation": {"expert": POSE}}, "imitation"),
    "widths of flow": (offline("flow", net=[8, 16]), "net"),
    "one row of flow": (offline("flow", network="joint"), "velocity"),
}  # fmt: skip


@pytest.mark.parametrize("name", REFUSED)
def test_settings_are_refused_before_anything_is_written(name, tmp_path, capsys, request):
    changes, named = REFUSED[name]
    path = written(tmp_path, **changes)
    for word, fixture in (("START", "agent"), ("RECORDED", "recorded")):
        if word in path.read_text():
            place = request.getfixturevalue(fixture)
            path.write_text(path.read_text().replace(word, str(place / "policy.json" if word == "START" else place)))
    line = refusal(capsys, command.main, "train", path, "--output", tmp_path / "out")
    assert named in line and str(path) in line
    assert not (tmp_path / "out").exists()
