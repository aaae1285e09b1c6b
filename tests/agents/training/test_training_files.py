"""Files of a run: damaged and foreign ones are one error and stay as they are; failures keep the last checkpoint."""

import io
import json
import math
import os
import zipfile

import numpy as np
import pytest
import torch
from tensorboard.backend.event_processing.event_accumulator import EventAccumulator

from agents import __main__ as command
from agents import checkpoint
from agents.checkpoint import Diverged
from agents.ppo import PPO
from agents.sb3 import SB3
from agents.train import Log, Training
from agents.training_file import load_settings
from tests.agents.training import helpers
from tests.agents.training.helpers import trained, written
from tests.commands import file_at, files_in, fill_the_disk, folder_at, refusal, rows_of, said_in_one_line
from tests.policies.helpers import info_of
from vibgym import checks
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained

OWN = helpers.PPO
SAC = {"algorithm": "sb3.SAC", "sb3": helpers.SB3}


def kept(run):
    """Return the files of a run except its logs, and its record, which has the new number of steps."""
    return {name: data for name, data in files_in(run).items() if "log-from" not in name and "run.json" not in name}


# -- checkpoints -------------------------------------------------------------------------------------------------------


def altered(content):
    """Change a bit of the first weight."""
    with zipfile.ZipFile(io.BytesIO(content)) as file:
        first = next(entry for entry in file.infolist() if "/data/" in entry.filename)
    place = content.index(first.filename.encode()) + 200  # behind its header, which is padded to 64 bytes
    return content[:place] + bytes([content[place] ^ 1]) + content[place + 1 :]


def with_contents(**changes):
    def change(run):
        content = checkpoint.load(run)
        checkpoint.save(run, content | {name: change(content[name]) for name, change in changes.items()})

    return change


MEAN = "actor.mean.weight"


def rewritten(name, change):
    return lambda run: (run / name).write_bytes(change((run / name).read_bytes()))


FOREIGN = {  # changes of the settings, or of the files; what the error names
    "task": ({"task": "Transport"}, "task"),
    "seed": ({"seed": 4}, "seed"),
    "environment": ({"environment": {"action": "patch"}}, "environment"),
    "algorithm": (SAC, "algorithm"),
    "truncated": (rewritten("checkpoint.pt", lambda data: data[:400]), "checkpoint.pt"),
    "altered": (rewritten("checkpoint.pt", altered), "checkpoint.pt"),
    "version": (lambda run: torch.save({"version": 1}, run / "checkpoint.pt"), "checkpoint.pt"),
    "shapes": (with_contents(policy=lambda policy: {**policy, MEAN: policy[MEAN].T}), "checkpoint.pt"),
    "optimizer": (with_contents(optimizer=lambda optimizer: {}), "checkpoint.pt"),
    "generator": (with_contents(torch=lambda state: state[:9]), "checkpoint.pt"),
    "worlds": (with_contents(worlds=lambda worlds: {**worlds, "env": {}}), "checkpoint.pt"),
    "record": (rewritten("run.json", lambda data: b""), "run.json"),
    "contents of the record": (rewritten("run.json", lambda data: b'{"settings": 3, "seconds": 1}'), "run.json"),
    "no record": (lambda run: (run / "run.json").unlink(), "run.json"),
    "policy alone": (lambda run: [(run / name).unlink() for name in ("run.json", "checkpoint.pt")], "policy.json"),
}  # fmt: skip


@pytest.mark.parametrize("name", FOREIGN)
def test_files_of_other_runs_and_damaged_ones_are_refused(copied, tmp_path, capsys, name):
    change, named = FOREIGN[name]
    if callable(change):
        change(copied)
    config = written(tmp_path, steps=512, **(change if isinstance(change, dict) else {}))
    before = files_in(copied)
    line = refusal(capsys, command.main, "train", config, "--output", copied)
    assert str(copied) in line and named in line and files_in(copied) == before


def test_reading_a_checkpoint_runs_no_code(copied, tmp_path):
    class Code:
        def __reduce__(self):
            return os.mkdir, (str(tmp_path / "made"),)

    torch.save({"version": checkpoint.VERSION, "state": {"steps": Code()}}, copied / "checkpoint.pt")
    with pytest.raises(checks.Refused, match="checkpoint.pt"):
        checkpoint.load(copied)
    assert not (tmp_path / "made").exists()


# -- failures ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("place, method", [("actor.mean", "collect"), (None, "learn")])
def test_a_diverged_training_keeps_the_last_checkpoint(copied, tmp_path, monkeypatch, capsys, place, method):
    """Of PPO, and of Stable-Baselines3."""
    changes, run, kind = ({}, copied, PPO) if place else (SAC, tmp_path / "sac", SB3)
    trained(tmp_path, run.name, **changes)
    before, original = kept(run), getattr(kind, method)

    def poisoned(self, *arguments):
        weights = self.policy.get_submodule(place) if place else self.model.policy.actor.mu
        with torch.no_grad():
            weights.weight[0, 0] = math.nan
        return original(self, *arguments)

    monkeypatch.setattr(kind, method, poisoned)
    config = written(tmp_path, steps=1024, **changes)
    assert command.main(["train", str(config), "--output", str(run), "--quiet"]) == 1
    line = said_in_one_line(capsys)
    assert str(run) in line and "diverged" in line and "256 steps" in line and kept(run) == before
    monkeypatch.undo()
    assert command.main(["train", str(config), "--output", str(run), "--quiet"]) == 0
    assert json.loads((run / "run.json").read_text())["settings"]["steps"] == 1024


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


@pytest.mark.parametrize("changes", [{}, SAC], ids=["ppo", "sac"])
def test_a_full_disk_is_one_error_and_keeps_the_checkpoint(tmp_path, monkeypatch, capsys, changes):
    run = trained(tmp_path, **changes).parent
    config, before, save = written(tmp_path, **changes, steps=1024), kept(run), Training._save

    def while_full(self):
        with pytest.MonkeyPatch.context() as patch:
            fill_the_disk(patch)
            save(self)

    monkeypatch.setattr(Training, "_save", while_full)
    assert command.main(["train", str(config), "--output", str(run), "--quiet"]) == 1
    assert "256 steps" in said_in_one_line(capsys) and kept(run) == before


@pytest.mark.parametrize("make", [
    file_at, lambda run: folder_at(run / "policy.json"), lambda run: folder_at(run / "checkpoint.pt"),
])  # fmt: skip
def test_places_that_cannot_be_written_are_refused_before_training(tmp_path, monkeypatch, capsys, make):
    monkeypatch.setattr(PPO, "learn", lambda *_, **__: pytest.fail("trains"))
    run = tmp_path / "runs"
    make(run)
    assert "output" in refusal(capsys, command.main, "train", written(tmp_path), "--output", run)
    assert run.is_dir() or run.read_text() == "mine"
    assert not list(tmp_path.rglob("*.safetensors")) and not list(tmp_path.rglob("log-from-*"))


# -- policies and logs -------------------------------------------------------------------------------------------------


def test_a_run_starts_with_the_weights_of_a_policy(agent, tmp_path):
    """Its first steps train the critic alone; exploration starts anew."""
    start = agent / "policy.json"
    path = trained(tmp_path, "next", start=str(start), ppo={**OWN, "critic_steps": 256})
    before, after = (load_set(file, KIND, VERSION)[0] for file in (start, path))
    same = {name for name in before if np.array_equal(before[name], after[name])}
    assert before.keys() == after.keys() and {"hidden.0.weight", "mean.weight", "mean.bias"} <= same
    assert (after["log_std.bias"] == np.float32(-0.5)).all() and (before["log_std.bias"] != -0.5).any()


def test_columns_that_a_policy_does_not_have_are_skipped(agent):
    columns = load_set(agent / "policy.json", KIND, VERSION)[1]["columns"]
    info = info_of("Align", sensor={"kind": "ideal", "report": ["age"]})
    assert load_trained(agent / "policy.json", info).coding.columns == columns
    assert len(info.parts_layout) > len(columns)


def test_progress_is_written_row_by_row(tmp_path):
    log, path = Log(tmp_path / "log"), tmp_path / "log" / "progress.csv"
    assert not path.parent.exists()
    log.write({"steps": 1, "loss": 0.5})
    assert rows_of(path) == [{"steps": "1", "loss": "0.5"}]
    log.write({"steps": 2, "success": 1.0, "loss": 0.25})
    log.write({"steps": 3, "loss": 0.0})
    log.add("evaluation", {"steps": 3, "phase": "ppo", "success": 0.5, "rate": ""})
    log.close()
    assert [tuple(row.values()) for row in rows_of(path)] == [("1", "0.5", ""), ("2", "0.25", "1.0"), ("3", "0.0", "")]
    events = EventAccumulator(str(path.parent)).Reload()
    losses = [(event.step, event.value) for event in events.Scalars("training/loss")]
    assert losses == [(1, 0.5), (2, 0.25), (3, 0.0)]
    assert events.Scalars("evaluation/success")[0].value == 0.5 and len(events.Tags()["scalars"]) == 3
