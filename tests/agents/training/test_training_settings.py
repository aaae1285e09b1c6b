"""Settings of training: files of one run, and files of many agents."""

from pathlib import Path

import gymnasium as gym
import pytest

from agents.train import Training, train_seeds
from agents.training_file import agents_in, load_settings

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


def test_agents_have_their_own_settings_on_top_of_the_defaults(many):
    assert agents_in(many) == ("Align/ideal", "Align/prototype", "SortTwelve/ideal")
    plain, own = load_settings(many, "Align/ideal"), load_settings(many, "Align/prototype")
    assert (plain.task, plain.worlds, plain.steps, plain.seed) == ("Align", 16, 1000, 0)
    assert (own.task, own.worlds, own.steps, own.seed) == ("Align", 16, 2000, 4)
    assert plain.environment == {"action": "wrench"}
    assert own.environment == {"action": "patch", "actuators": "prototype"}  # whole, unlike the algorithm's settings
    assert (plain.own.learning_rate, plain.own.net) == (0.002, (32,))
    assert (own.own.learning_rate, own.own.net) == (0.002, (64, 64))
    assert plain.imitation is None and (own.imitation.expert, own.imitation.rounds) == ("pose", 2)
    assert load_settings(many, "SortTwelve/ideal").task == "SortTwelve"


def test_every_agent_and_seed_has_a_directory_of_its_own(many):
    found = {
        load_settings(many, agent, seed).output
        for agent in ("Align/ideal", "Align/prototype") for seed in (None, 1, 2)
    }  # fmt: skip
    assert found == {
        *(f"runs/agents/Align-ideal/seed-{seed}" for seed in (0, 1, 2)),
        *(f"runs/agents/Align-prototype/seed-{seed}" for seed in (4, 1, 2)),
    }
    assert load_settings(many, "Align/ideal", 2).seed == 2
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


@pytest.mark.parametrize("agent", [None, "Align/real"])
def test_agents_that_a_file_has_not_are_refused(many, agent):
    with pytest.raises(ValueError, match="agent") as error:
        load_settings(many, agent)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("old, new, named", [
    ("vibgym/Align-v0:", "vibgym/Juggle-v0:", "ppo.yaml"),
    ("vibgym/Align-v0:", "3:", "ppo.yaml"),
    ("  ideal: {}", "  ideal: 3", "vibgym/Align-v0.ideal"),
    ("  ideal: {}", "  ideal: {task: Sort}", "vibgym/Align-v0.ideal"),
    ("  worlds: 16", "  worlds: 0", "Align/prototype.worlds"), ("net: [64, 64]", "net: [0]", "Align/prototype: ppo.net"),
    ("ppo: {net: [64, 64]}", "ppo: 3", "Align/prototype: ppo"),
])  # fmt: skip
def test_faults_are_one_line_with_file_and_agent(many, old, new, named):
    assert old in MANY
    many.write_text(MANY.replace(old, new))
    with pytest.raises(ValueError, match=named) as error:
        load_settings(many, "Align/prototype")
    assert "\n" not in str(error.value) and str(many) in str(error.value)


def test_defaults_that_are_none_are_refused(tmp_path):
    path = tmp_path / "many.yaml"
    path.write_text("defaults: 3\nvibgym/Align-v0: {ideal: {steps: 5}}")
    with pytest.raises(ValueError, match="many.yaml: defaults"):
        load_settings(path, "Align/ideal")


def test_a_file_of_one_run_has_no_agents(tmp_path):
    path = tmp_path / "one.yaml"
    path.write_text("task: Align\nsteps: 5")
    assert load_settings(path).task == "Align" and load_settings(path, seed=7).seed == 7
    with pytest.raises(ValueError, match="--agent"):
        load_settings(path, "Align/ideal")
    with pytest.raises(ValueError, match="one.yaml.seed"):
        load_settings(path, seed=-1)
    for text, needed in (("task: Align", "steps"), ("steps: 5", "task")):
        path.write_text(text)
        with pytest.raises(ValueError, match=f"one.yaml.{needed}"):
            load_settings(path)


FOLDER = Path(__file__).parents[3] / "configs" / "agents"
SHIPPED = [path for path in sorted(FOLDER.glob("*.yaml")) if path.stem != "sensorless"]
"""All but the study of schedules, which has settings of its own."""


@pytest.mark.parametrize("path", SHIPPED, ids=lambda path: path.name)
def test_shipped_files_are_sound(path):
    text = path.read_text()
    if "\ntask:" in f"\n{text}":
        assert load_settings(path).steps > 0
    else:
        for agent in agents_in(path):
            assert load_settings(path, agent).steps > 0


def test_a_policy_of_another_run_is_not_overwritten(tmp_path):
    path = tmp_path / "policy.json"
    path.write_text("mine")
    with pytest.raises(ValueError, match=r"policy\.json: a policy of another run, without run\.json"):
        Training(load_settings_of(tmp_path), tmp_path, quiet=True).run()
    assert path.read_text() == "mine" and not (tmp_path / "run.json").exists()


def load_settings_of(folder):
    path = folder / "w.yaml"
    path.write_text("task: Align\nsteps: 64\nworlds: 2\nppo: {n_steps: 32, batch_size: 64, net: [8]}\n")
    return load_settings(path)


def test_training_several_seeds_shows_the_progress_of_each(tmp_path, capfd):
    load_settings_of(tmp_path)
    train_seeds(tmp_path / "w.yaml", [3, 4], tmp_path / "out")
    shown = capfd.readouterr().err
    assert all(f"seed {seed}" in shown for seed in (3, 4))
