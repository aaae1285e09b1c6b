"""Files of a run: damaged and foreign ones are one error and stay as they are; failures keep the last checkpoint."""

import csv
import io
import json
import math
import os
import zipfile

import numpy as np
import pytest
import torch
import yaml
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents import __main__ as command
from agents import checkpoint, train
from agents.failures import Diverged, TrainingError
from agents.ppo import PPO
from agents.training_file import load_settings
from tests.commands import file_at, files_in, fill_the_disk, folder_at, refusal, said_in_one_line
from tests.policies.helpers import info_of
from vibgym import checks
from vibgym.files import WriteError
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained

SETTINGS = {
    "task": "Align", "environment": {"action": "field"}, "worlds": 8, "steps": 256, "seed": 3, "checkpoint_steps": 128,
    "ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 1, "net": [8], "critic_net": [8]},
}  # fmt: skip
OWN = SETTINGS["ppo"]

pytestmark = pytest.mark.usefixtures("one_thread")


def written(folder, **changes):
    path = folder / "tiny.yaml"
    path.write_text(yaml.safe_dump({**SETTINGS, **changes}))
    return path


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Directory of one whole run."""
    folder = tmp_path_factory.mktemp("trained")
    train.train(written(folder), folder / "run", quiet=True)
    return folder / "run"


@pytest.fixture
def copied(trained, tmp_path):
    """A copy of it that may be damaged."""
    run = folder_at(tmp_path / "run")
    for path in trained.iterdir():
        if path.is_file():
            (run / path.name).write_bytes(path.read_bytes())
    return run


def kept(run):
    return {name: data for name, data in files_in(run).items() if "log-from" not in name}


# -- checkpoints -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes, named", [
    ({"task": "Transport"}, "task"), ({"seed": 4}, "seed"), ({"environment": {"action": "patch"}}, "environment"),
    ({"ppo": {**OWN, "net": [9]}}, "ppo"), ({"algorithm": "sb3.SAC"}, "algorithm"),
])  # fmt: skip
def test_checkpoints_of_other_settings_are_refused(copied, tmp_path, capsys, changes, named):
    before = files_in(copied)
    line = refusal(capsys, command.main, "train", written(tmp_path, **changes), "--output", copied)
    assert str(copied) in line and named in line and files_in(copied) == before


def altered(content):
    """Change a bit of the first weight."""
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        first = next(each for each in file.infolist() if "/data/" in each.filename)
    place = content.index(first.filename.encode()) + 200  # behind its header, which is padded to 64 bytes
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def damage(run, name, how):
    """Damage a set of the run."""
    path = run / name
    if path.suffix == ".pt":
        content = path.read_bytes()
        if how == "version":
            torch.save({"version": 1}, path)
        else:
            path.write_bytes(content[:400] if how == "truncated" else altered(content))
        return path
    record = json.loads(path.read_text())
    tensors = run / record["tensors"]
    data = tensors.read_bytes()
    if how == "truncated":
        os.truncate(path, 40)
    elif how == "version":
        path.write_text(json.dumps({**record, "version": 1}))
    else:
        tensors.write_bytes(data[:-2] + bytes([data[-2] ^ 1]) + data[-1:])
    return path


@pytest.mark.parametrize("name", ["checkpoint.pt", "policy.json"])
@pytest.mark.parametrize("how", ["truncated", "version", "altered tensors"])
def test_damaged_files_are_refused(copied, tmp_path, capsys, name, how):
    """Checkpoints to continue, policies to start from."""
    path = damage(copied, name, how)
    new = name == "policy.json"
    config = written(tmp_path, **({"start": str(path)} if new else {}))
    before = files_in(copied)
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "new" if new else copied)
    assert str(path) in line and files_in(copied) == before and not (tmp_path / "new").exists()


@pytest.mark.parametrize("text", ["", '{"settings": 3, "seconds": 1}', None])
def test_a_damaged_record_of_the_run_is_refused(copied, tmp_path, capsys, text):
    path = copied / "run.json"
    path.unlink() if text is None else path.write_text(text)
    before = files_in(copied)
    line = refusal(capsys, command.main, "train", written(tmp_path, steps=512), "--output", copied)
    assert str(path) in line and files_in(copied) == before


@pytest.mark.parametrize("name, change", [
    ("policy", lambda value: {**value, "actor.mean.weight": value["actor.mean.weight"].T}),
    ("policy", lambda value: {}), ("optimizer", lambda value: {}), ("torch", lambda value: value[:9]),
    ("worlds", lambda value: {**value, "env": {}}),
])  # fmt: skip
def test_a_checkpoint_with_wrong_contents_is_refused(copied, tmp_path, name, change):
    content = checkpoint.load(copied)
    checkpoint.save(copied, {**content, name: change(content[name])})
    before = files_in(copied)
    with pytest.raises(checks.Refused) as error:
        train.train(written(tmp_path), copied, quiet=True)
    assert str(copied / "checkpoint.pt") in str(error.value) and "\n" not in str(error.value)
    assert files_in(copied) == before


def test_reading_a_checkpoint_runs_no_code(copied, tmp_path):
    class Code:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "made"),)

    torch.save({"version": checkpoint.VERSION, "state": {"steps": Code()}}, copied / "checkpoint.pt")
    with pytest.raises(checks.Refused, match="checkpoint.pt"):
        checkpoint.load(copied)
    assert not (tmp_path / "made").exists()


# -- failures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place, method", [("actor.mean", "collect"), ("critic.value", "update")])
def test_a_diverged_training_keeps_the_last_checkpoint(copied, tmp_path, monkeypatch, capsys, place, method):
    config, before, original = written(tmp_path, steps=1024), kept(copied), getattr(PPO, method)

    def poisoned(self, *arguments):
        with torch.no_grad():
            self.policy.get_submodule(place).weight[0, 0] = math.nan
        return original(self, *arguments)

    monkeypatch.setattr(PPO, method, poisoned)
    assert command.main(["train", str(config), "--output", str(copied), "--quiet"]) == 1
    line = said_in_one_line(capsys)
    assert str(copied) in line and "diverged" in line and "256 steps" in line
    after = kept(copied)
    changed = {name for name in before | after if before.get(name) != after.get(name)}
    assert changed <= {str(copied / "run.json")}  # has the new number of steps
    with pytest.raises(TrainingError):
        train.train(config, copied, quiet=True)
    monkeypatch.undo()
    assert load_set(train.train(config, copied, quiet=True), KIND, VERSION)[1]["training"]["steps"] == 1024


@pytest.mark.parametrize("place", ["actor.log_std", "critic.value", "optimizer"])
def test_values_that_are_not_finite_are_not_written(copied, tmp_path, place):
    learner = PPO(load_settings(written(tmp_path)))
    assert learner.load(copied)
    before = files_in(copied)
    with torch.no_grad():
        if place == "optimizer":
            next(iter(learner.optimizer.state.values()))["exp_avg_sq"].view(-1)[-1] = math.inf
        else:
            learner.policy.get_submodule(place).bias[-1] = math.nan
    with pytest.raises(Diverged, match=place):
        learner.save(copied)
    if place == "actor.log_std":
        with pytest.raises(Diverged):
            learner.save_policy(copied / "policy.json", {})
    learner.close()
    assert files_in(copied) == before


@pytest.mark.parametrize("algorithm", ["ppo", "sb3.SAC"])
def test_a_full_disk_is_one_error_and_keeps_the_checkpoint(tmp_path, monkeypatch, capsys, algorithm):
    own = {
        "algorithm": algorithm,
        "sb3": {"policy_kwargs": {"net_arch": [8]}, "learning_starts": 64, "buffer_size": 200},
    }
    run, arguments = (
        tmp_path / "run",
        ("train", str(tmp_path / "tiny.yaml"), "--output", str(tmp_path / "run"), "--quiet"),
    )
    written(tmp_path, **own)
    assert command.main(arguments) == 0
    config, before = written(tmp_path, **own, steps=1024), kept(run)
    save = train.Training._save

    def while_full(self):
        with pytest.MonkeyPatch.context() as patch:
            fill_the_disk(patch)
            save(self)

    monkeypatch.setattr(train.Training, "_save", while_full)
    capsys.readouterr()
    assert command.main(arguments) == 1
    assert "256 steps" in said_in_one_line(capsys)
    assert {name for name in before if kept(run)[name] != before[name]} <= {str(run / "run.json")}
    with pytest.raises(WriteError):
        train.train(config, run, quiet=True)


BAD_PLACES = {
    "a file": lambda folder: file_at(folder),
    "a directory as the policy": lambda folder: folder_at(folder / "policy.json"),
    "a directory as the checkpoint": lambda folder: folder_at(folder / "checkpoint.pt"),
}


@pytest.mark.parametrize("case", BAD_PLACES)
def test_places_that_cannot_be_written_are_refused_before_training(tmp_path, monkeypatch, capsys, case):
    monkeypatch.setattr(PPO, "learn", lambda *_, **__: pytest.fail("trains"))
    run = tmp_path / "runs"
    BAD_PLACES[case](run)
    assert command.main(["train", str(written(tmp_path)), "--output", str(run), "--quiet"]) == 2
    assert "output" in said_in_one_line(capsys)
    assert run.is_dir() or run.read_text() == "mine"
    assert not list(tmp_path.rglob("*.safetensors")) and not list(tmp_path.rglob("log-from-*"))


# -- start -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("changes, named", [
    ({"task": "Transport"}, "tasks"), ({"environment": {"action": "patch"}}, "action"),
    ({"environment": {"action": "field", "surface": {"rows": 12, "columns": 16}}}, "surface"),
    *(({"ppo": {**OWN, key: value}}, named) for key, value, named in (
        ("blind", ["position"], "columns"), ("turned", True, "turned"), ("remembers", True, "remembers"),
        ("activation", "relu", "activation"), ("net", [9], "layers"))),
    ({"algorithm": "sb3.SAC"}, "start"),
])  # fmt: skip
def test_policies_that_do_not_fit_are_no_start(trained, tmp_path, capsys, changes, named):
    config, before = written(tmp_path, **changes, start=str(trained / "policy.json")), files_in(trained)
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "next")
    assert named in line and str(config) in line
    assert not (tmp_path / "next").exists() and files_in(trained) == before


def test_a_run_starts_with_the_weights_of_a_policy(trained, tmp_path):
    """Its first steps train the critic alone; exploration starts anew."""
    start = trained / "policy.json"
    config = written(tmp_path, start=str(start), ppo={**OWN, "critic_steps": 256})
    path = train.train(config, tmp_path / "next", quiet=True)
    before, after = (load_set(each, KIND, VERSION)[0] for each in (start, path))
    same = {name for name in before if np.array_equal(before[name], after[name])}
    assert before.keys() == after.keys() and {"hidden.0.weight", "mean.weight", "mean.bias"} <= same
    assert (after["log_std.bias"] == np.float32(-0.5)).all() and (before["log_std.bias"] != -0.5).any()


def test_a_policy_with_other_columns_is_refused(trained, tmp_path):
    tensors, record = load_set(trained / "policy.json", KIND, VERSION)
    plain = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    save_set(tmp_path / "policy.json", KIND, tensors, {**plain, "columns": [*plain["columns"], ["age", 1]]}, VERSION)
    with pytest.raises(ValueError, match="columns"):
        load_trained(tmp_path / "policy.json", info_of("Align"))
    # Columns of the scene that the policy does not have are skipped.
    found = load_trained(trained / "policy.json", info_of("Align", sensor="pose"))
    assert found.coding.columns == plain["columns"]


# -- progress.csv ------------------------------------------------------------------------------------------------------


def rows_of(path):
    with path.open(newline="") as file:
        return list(csv.DictReader(file))


def test_progress_is_written_row_by_row(tmp_path):
    log, path = train.Log(tmp_path / "log"), tmp_path / "log" / "progress.csv"
    assert not path.parent.exists()
    log.write({"steps": 1, "loss": 0.5})
    assert rows_of(path) == [{"steps": "1", "loss": "0.5"}]
    log.write({"steps": 2, "loss": 0.25})
    log.write({"steps": 3, "success": 1.0, "loss": 0.125})
    log.write({"steps": 4, "loss": 0.0})
    log.add("evaluation", {"steps": 4, "phase": "ppo", "success": 0.5, "rate": ""})
    log.close()
    events = EventAccumulator(str(path.parent)).Reload()
    assert [(each.step, each.value) for each in events.Scalars("training/loss")] == [
        (1, 0.5),
        (2, 0.25),
        (3, 0.125),
        (4, 0.0),
    ]
    assert events.Scalars("evaluation/success")[0].value == 0.5 and len(events.Tags()["scalars"]) == 3
    found = rows_of(path)
    assert [row["steps"] for row in found] == ["1", "2", "3", "4"]
    assert [row["success"] for row in found] == ["", "", "1.0", ""] and found[1]["loss"] == "0.25"
