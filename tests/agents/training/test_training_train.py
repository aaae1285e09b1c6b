"""Training: files, interruptions, and that the shipped form of a policy is what was trained."""

import copy
import csv
import math
import os
import re

import gymnasium as gym
import numpy as np
import pytest
import torch
from stable_baselines3 import PPO

from agents import __main__ as command
from agents import locks
from agents.training import checkpoint
from agents.training.ppo import algorithm
from agents.training.progress import Progress
from agents.training.train import train
from agents.training.training_file import load_settings
from tests.commands import file_at, files_in, fill_the_disk, folder_at, said_in_one_line
from tests.envs.helpers import single
from tests.policies.helpers import info_of
from vibgym.envs import VibgymEnv
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND as POLICY
from vibgym.policies.trained.trained import VERSION, load_trained
from vibgym.tasks import TASKS, Transport

ADAM = "adam.policy.optimizer"

TEXT = """
task: Rotate
environment: {action: patch}
worlds: 32
steps: 8192
seed: 3
checkpoint_steps: 1024
ppo: {n_steps: 32, batch_size: 256, n_epochs: 1, net: [16, 8]}
"""


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture
def config(tmp_path):
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT)
    return path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Configuration and output of one whole run."""
    folder = tmp_path_factory.mktemp("trained")
    path = folder / "tiny.yaml"
    path.write_text(TEXT)
    train(path, folder / "run", quiet=True)
    return path, folder / "run"


def steps_of(directory):
    return load_set(directory / "checkpoint.json", checkpoint.KIND, checkpoint.VERSION)[1]["steps"]


def test_a_run_writes_policy_checkpoint_and_logs(trained):
    _, run = trained
    assert steps_of(run) == 8192
    tensors, record = load_set(run / "policy.json", POLICY, VERSION)
    assert record["tasks"] == ["Rotate"] and record["action"] == "patch"
    assert record["parts"] == 1 and record["network"] == "parts" and record["turned"] is False
    assert record["columns"] == [[row.name, row.width] for row in single("Rotate").unwrapped.parts_layout]
    assert record["training"]["steps"] == 8192 and record["training"]["settings"]["seed"] == 3
    assert all(np.isfinite(value).all() for value in tensors.values())
    (log,) = run.glob("log-from-0")
    rows = list(csv.DictReader((log / "progress.csv").open()))
    assert rows and "rollout/ep_rew_mean" in rows[0]
    (events,) = log.glob("events.out.tfevents.*")
    assert events.stat().st_size > 0
    names = sorted(path.name.split("-")[0].split(".")[0] for path in run.iterdir())
    assert names == ["checkpoint", "checkpoint", "log", "policy", "policy"]  # nothing temporary is left
    assert not any(path.suffix in (".zip", ".pkl", ".pt", ".pth") for path in run.rglob("*"))


def test_a_finished_run_started_again_changes_nothing(trained):
    path, run = trained
    before = load_set(run / "policy.json", POLICY, VERSION)[0]
    assert train(path, run, quiet=True) == run / "policy.json"
    after = load_set(run / "policy.json", POLICY, VERSION)[0]
    assert before.keys() == after.keys() and all((before[name] == after[name]).all() for name in before)
    assert steps_of(run) == 8192


@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_the_policy_on_disk_predicts_what_the_model_does(tmp_path, activation):
    path = tmp_path / "tiny.yaml"
    path.write_text(TEXT.replace("net:", f"activation: {activation}, net:"))
    settings = load_settings(path)
    env = algorithm.PPO(settings).make_env()
    model = algorithm.PPO(settings).make_model(env)
    with torch.no_grad():  # an untrained one acts near zero: make it act, into the bounds, too
        for parameter in model.policy.parameters():
            parameter.add_(0.4 * torch.randn_like(parameter))
    algorithm.PPO(settings).save_policy(tmp_path / "policy.json", model, {})
    policy = load_trained(tmp_path / "policy.json", info_of("Rotate"))
    rows = np.random.default_rng(0).uniform(-1, 1, (200, *env.observation_space["parts"].shape)).astype(np.float32)
    seen = {"parts": rows, "mask": np.ones((200, 1), dtype=np.int8)}
    expected, _ = model.predict(seen, deterministic=True)
    action, _ = policy.predict(seen)
    assert action.shape == (200, 32)
    assert np.abs(action - expected).max() < 1e-5
    assert (np.abs(expected) == 1).any() and (np.abs(expected) < 1).mean() > 0.2


class Interrupted(Progress):
    """Ctrl-C in the middle of a run."""

    def _on_step(self):
        if self.num_timesteps >= 2500:
            raise KeyboardInterrupt
        return super()._on_step()


def test_an_interruption_says_what_the_checkpoint_holds(config, tmp_path, monkeypatch):
    """Not what this sitting has saved, which is nothing yet."""

    def interrupted(self):
        raise KeyboardInterrupt

    run = tmp_path / "run"
    monkeypatch.setattr(Progress, "_on_training_start", interrupted)
    with pytest.raises(KeyboardInterrupt, match="nothing is saved"):
        train(config, run, quiet=True)
    settings = load_settings(config)
    model = algorithm.PPO(settings).make_model(algorithm.PPO(settings).make_env())
    model.num_timesteps = 1024
    checkpoint.save(run, model, settings, 1.0)
    with pytest.raises(KeyboardInterrupt, match="1024 steps are saved in .*goes on from there"):
        train(config, run, quiet=True)


def test_ctrl_c_and_a_restart_go_on_from_the_last_checkpoint(config, tmp_path, monkeypatch):
    """To the same end as without: see test_training_resume.py."""
    run = tmp_path / "run"
    monkeypatch.setattr("agents.training.train.Progress", Interrupted)
    with pytest.raises(KeyboardInterrupt, match="2048 steps are saved"):
        train(config, run, quiet=True)
    monkeypatch.undo()
    assert steps_of(run) == 2048  # the last whole checkpoint before 2500
    assert not (run / "policy.json").exists()
    train(config, run, quiet=True)
    assert steps_of(run) == 8192
    assert (run / "log-from-0" / "progress.csv").exists() and (run / "log-from-2048" / "progress.csv").exists()


@pytest.mark.parametrize("task", ["Sort", "SortTwelve", "mine/Park-v0", "Park"])
def test_any_registered_task_can_be_trained(tmp_path, monkeypatch, task):
    """Environments of the package by name, others by their whole name, and tasks that have no environment."""

    class Park(Transport):
        """A task of a user's."""

    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Park": Park})
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("mine/Park-v0", max_episode_steps=9, kwargs={"task": "Park"}, **entry)
    monkeypatch.setitem(gym.registry, "mine/Park-v0", spec)
    config = tmp_path / "any.yaml"
    text = (
        TEXT.replace("task: Rotate", f"task: {task}")
        .replace("steps: 8192", "steps: 64")
        .replace("worlds: 32", "worlds: 2")
    )
    config.write_text(text.replace("action: patch", "action: field").replace("batch_size: 256", "batch_size: 64"))
    path = train(config, tmp_path / "run", quiet=True)
    name = {"mine/Park-v0": "Park"}.get(task, task)
    assert load_set(path, POLICY, VERSION)[1]["tasks"] == [name]
    where = {"task": "Park"} if name == "Park" else {}
    acts = {"action": "field", "observation": "parts"}
    env = VibgymEnv(**acts, **where) if where else single(name, **acts)
    policy = make_policy(str(path), TaskInfo.of(env))
    seen, _ = env.reset(seed=0)
    env.step(policy.predict(seen)[0])


@pytest.mark.parametrize("task", ["Juggle", "mine/Nowhere-v0", 3])
def test_unknown_tasks_are_refused(tmp_path, task):
    config = tmp_path / "bad.yaml"
    config.write_text(TEXT.replace("task: Rotate", f"task: {task}"))
    with pytest.raises(ValueError, match="bad.yaml.task") as error:
        load_settings(config)
    assert "\n" not in str(error.value) and (task == 3 or "'Transport'" in str(error.value))


@pytest.mark.parametrize("text, named", [
    *[(f"ppo: {{{name}: {value}}}", f"ppo.{name}") for name in ("learning_rate", "final_learning_rate", "gamma", "gae_lambda",
      "clip_range", "ent_coef", "log_std_init") for value in (".inf", ".nan", "-.inf", "1e999", "1" + 400 * "0")],
    *[(f"ppo: {{net: {value}}}", "ppo.net") for value in ("[0]", "[-8]", "[]", "[1000000]", "[8, true]", "[8, 2.5]",
      f"[{', '.join(9 * ['8'])}]", "[[8]]", "8")],
    ("ppo: {learning_rate: 2.0}", "ppo.learning_rate"), ("ppo: {log_std_init: 100}", "ppo.log_std_init"),
    *[(f"ppo: {{{name}: {value}}}", f"ppo.{name}") for name in ("n_steps", "batch_size", "n_epochs")
      for value in ("0", "-1", "1000000000000", "1" + 400 * "0")],
    *[(f"{name}: {value}", name) for name in ("worlds", "steps", "checkpoint_steps", "seed")
      for value in ("-1", "100000000000000000", "1" + 400 * "0")],
    ("colour: red", "colour"), ("worlds: 1.5", "worlds"), ("environment: 3", "environment"), ("output: 3", "output"),
    ("steps: 1e3x", "steps"),
])  # fmt: skip
def test_settings_that_cannot_work_are_refused_by_name(tmp_path, text, named):
    config, name = tmp_path / "bad.yaml", text.partition(":")[0]
    config.write_text("\n".join(each for each in TEXT.splitlines() if not each.startswith(f"{name}:")) + f"\n{text}\n")
    place = "line [0-9]+" if "000" * 100 in text else named  # no YAML number at all: found before fields have names
    with pytest.raises(ValueError, match=f"bad.yaml.*{place}") as error:
        load_settings(config)
    assert "\n" not in str(error.value) and len(str(error.value)) < 400


@pytest.mark.parametrize("worlds, steps", [(1, 1), (1000, 1_000_000)])
def test_rollouts_too_short_and_too_large_are_refused(config, tmp_path, worlds, steps):
    config.write_text(TEXT.replace("worlds: 32", f"worlds: {worlds}").replace("n_steps: 32", f"n_steps: {steps}"))
    with pytest.raises(ValueError, match="tiny.yaml: ppo.n_steps"):
        train(config, tmp_path / "run", quiet=True)
    assert not (tmp_path / "run").exists()


def test_a_diverged_training_keeps_the_last_good_files(tmp_path, capsys):
    """Steps of Adam of 1 in a deep critic without bounds: its values, which feed on themselves, grow beyond all numbers."""
    config, run = tmp_path / "wild.yaml", tmp_path / "run"
    critic = f"activation: relu, critic_net: [{', '.join(8 * ['256'])}]"
    text = TEXT.replace("net:", f"{critic}, learning_rate: 1.0, final_learning_rate: 1.0, net:")
    config.write_text(text.replace("steps: 8192", "steps: 1024").replace("batch_size: 256", "batch_size: 1024"))
    arguments = ["train", str(config), "--output", str(run), "--quiet"]
    assert command.main(arguments) == 0
    before = files_in(run)
    config.write_text(config.read_text().replace("\nsteps: 1024", "\nsteps: 400000"))
    capsys.readouterr()
    assert command.main(arguments) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "Traceback" not in line
    assert re.search(rf"{run}: training diverged within \d+ steps .*checkpoint of \d+ steps stays.*learning_rate", line)
    tensors, _ = load_set(run / "checkpoint.json", checkpoint.KIND, checkpoint.VERSION)
    assert all(np.isfinite(value).all() for value in tensors.values())
    policies = {name: data for name, data in before.items() if "policy" in name}
    assert policies and policies.items() <= files_in(run).items()
    assert f"checkpoint of {steps_of(run)} steps" in line


@pytest.mark.parametrize("number", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("where", ["actor.log_std", "actor.mean", "critic.value", "adam"])
def test_what_is_not_finite_is_not_written(config, tmp_path, where, number):
    settings = load_settings(config)
    env = algorithm.PPO(settings).make_env()
    model = algorithm.PPO(settings).make_model(env)
    for parameter in model.policy.parameters():
        parameter.grad = torch.ones_like(parameter)
    model.policy.optimizer.step()
    checkpoint.save(tmp_path, model, settings, 1.0)
    algorithm.PPO(settings).save_policy(tmp_path / "policy.json", model, {})
    before = files_in(tmp_path)
    with torch.no_grad():
        if where == "adam":
            next(iter(model.policy.optimizer.state.values()))["exp_avg_sq"].view(-1)[-1] = number
        else:
            model.policy.get_submodule(where).bias[-1] = number
    with pytest.raises(checkpoint.Diverged, match=f"in .*{where}"):
        checkpoint.save(tmp_path, model, settings, 2.0)
    if where.startswith("actor"):
        with pytest.raises(checkpoint.Diverged):
            algorithm.PPO(settings).save_policy(tmp_path / "policy.json", model, {})
    assert files_in(tmp_path) == before


NOT_FINITE = [(name, number) for number in (math.nan, math.inf, 1e300) for name in (
    "policy.actor.log_std.bias", "policy.critic.value.bias", ADAM + ".0.exp_avg", ADAM + ".2.exp_avg_sq", ADAM + ".1.step",
)]  # fmt: skip


def with_last(number):
    def change(value):
        value = value.astype(np.float64)
        value.flat[-1] = number
        return value

    return change


@pytest.mark.parametrize("name, change, named", [
    (ADAM + ".0.exp_avg", None, "another network"), (ADAM + ".1.exp_avg_sq", lambda value: value[:1], "another network"),
    ("policy.actor.log_std.bias", None, "another network"),
    ("policy.actor.mean.weight", lambda value: value.T, "another network"),
    *((name, with_last(to), "tensors") for name, to in NOT_FINITE),
])  # fmt: skip
def test_a_checkpoint_of_another_network_or_that_is_not_finite_is_refused(trained, tmp_path, name, change, named):
    path, run = trained
    settings = load_settings(path)
    tensors, record = load_set(run / "checkpoint.json", checkpoint.KIND, checkpoint.VERSION)
    value = tensors.pop(name)
    if change is not None:
        tensors[name] = change(value)
    kept = {key: record[key] for key in ("settings", "steps", "seconds")}
    save_set(tmp_path / "checkpoint.json", checkpoint.KIND, tensors, kept, checkpoint.VERSION)
    model = algorithm.PPO(settings).make_model(algorithm.PPO(settings).make_env())
    before = copy.deepcopy(model.policy.state_dict())
    with pytest.raises(ValueError, match=f"checkpoint.json.*{named}"):
        checkpoint.restore(tmp_path, model, settings)
    assert all(torch.equal(value, before[key]) for key, value in model.policy.state_dict().items())
    assert not model.policy.optimizer.state_dict()["state"] and model.num_timesteps == 0


BAD_PLACES = {
    "a file": lambda folder: ("--output", file_at(folder / "file")),
    "below a file": lambda folder: ("--output", file_at(folder / "file") / "below"),
    "overlong": lambda folder: ("--output", folder / ("x" * 300)),
    "no text": lambda folder: ("--output", folder / "a\ud800"),
    "NUL": lambda folder: ("--output", folder / "a\0b"),
    "of the system": lambda folder: ("--output", "/proc/vibgym"),
    "a directory as the policy": lambda folder: ("--policy", folder_at(folder / "policy.json")),
    "a policy below a file": lambda folder: ("--policy", file_at(folder / "file") / "policy.json"),
    "an overlong policy": lambda folder: ("--policy", folder / ("x" * 245 + ".json")),
    "a policy whose tensors are overlong": lambda folder: ("--policy", folder / ("x" * 240 + ".json")),
    "a policy with a NUL": lambda folder: ("--policy", folder / "a\0b.json"),
    "a policy of the system": lambda folder: ("--policy", "/proc/policy.json"),
    "a policy without a suffix": lambda folder: ("--policy", folder / "policy"),
    "no policy": lambda folder: ("--policy", ""),
    "the checkpoint": lambda folder: ("--policy", folder / "runs" / "checkpoint.json"),
}


@pytest.mark.parametrize("case", BAD_PLACES)
def test_bad_places_are_refused_before_training(config, tmp_path, monkeypatch, capsys, case):
    monkeypatch.setattr(PPO, "learn", lambda *_, **__: pytest.fail("trains"))
    option, place = BAD_PLACES[case](tmp_path)
    arguments = ["train", str(config), "--output", str(tmp_path / "runs"), option, str(place), "--quiet"]
    assert command.main(arguments) == 2
    line = said_in_one_line(capsys)
    assert len(line) < 400 and re.match(rf"({option}|{option[2:]})", line)
    assert not (tmp_path / "file").exists() or (tmp_path / "file").read_text() == "mine"
    assert not list(tmp_path.rglob("*.safetensors")) and not list(tmp_path.rglob("log-from-*"))


def test_a_policy_in_the_place_of_the_directorys_is_refused(config, tmp_path):
    (tmp_path / "run" / "policy.json").mkdir(parents=True)
    with pytest.raises(ValueError, match="output"):
        train(config, tmp_path / "run", quiet=True)


def test_a_full_disk_ends_training_in_one_line(config, tmp_path, monkeypatch, capsys):
    run = tmp_path / "run"
    config.write_text(TEXT.replace("steps: 8192", "steps: 1024"))
    assert command.main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    before = files_in(run, "*.*")  # not those of logs
    config.write_text(TEXT.replace("steps: 8192", "steps: 4096"))
    save = checkpoint.save

    def while_full(*arguments):
        fill_the_disk(monkeypatch)
        save(*arguments)

    monkeypatch.setattr(checkpoint, "save", while_full)
    assert command.main(["train", str(config), "--output", str(run), "--quiet"]) == 1
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and "1024 steps are saved" in line and "No space left" in line
    assert files_in(run, "*.*") == before and steps_of(run) == 1024


def test_policies_that_two_runs_write_beside_each_other_wait_for_each_other(config, tmp_path, monkeypatch):
    config.write_text(TEXT.replace("steps: 8192", "steps: 1024"))
    save, held = algorithm.PPO.save_policy, []

    def watched(self, path, *arguments):
        with pytest.raises(ValueError, match=f"process {os.getpid()}"), locks.one_run(path.parent, file=".p.json.lock"):
            pass
        held.append(path)
        save(self, path, *arguments)

    monkeypatch.setattr(algorithm.PPO, "save_policy", watched)
    path = train(config, tmp_path / "run", quiet=True, policy=tmp_path / "policies" / "p.json")
    assert held == [path] and sorted(each.suffix for each in path.parent.iterdir()) == [".json", ".safetensors"]


def test_models_are_plain_ppo(config):
    settings = load_settings(config)
    model = algorithm.PPO(settings).make_model(algorithm.PPO(settings).make_env())
    assert isinstance(model, PPO) and model.n_envs == 32 and model.n_steps == 32 and model.gamma == 0.98
    assert model.action_space.shape == (32,)
