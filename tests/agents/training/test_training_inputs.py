"""What a training begins with and goes on from: what does not fit is one error, and nothing is written."""

import csv
import json
import os
import re

import numpy as np
import pytest

from agents import __main__ as command
from agents.training import checkpoint
from agents.training.train import train
from agents.training.training_file import load_settings
from tests.commands import files_in, refusal
from tests.policies.helpers import info_of
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained

TEXT = """
task: Align
environment: {action: field}
worlds: 8
steps: 256
seed: 3
checkpoint_steps: 128
ppo: {n_steps: 16, batch_size: 64, n_epochs: 1, net: [8], critic_net: [8]}
"""


pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def trained(tmp_path_factory):
    """Configuration and output of one whole run."""
    folder = tmp_path_factory.mktemp("trained")
    path = folder / "tiny.yaml"
    path.write_text(TEXT)
    train(path, folder / "run", quiet=True)
    return path, folder / "run"


@pytest.fixture
def copied(trained, tmp_path):
    """The same, to be spoilt."""
    run = tmp_path / "run"
    run.mkdir()
    for path in trained[1].iterdir():
        if path.is_file():
            (run / path.name).write_bytes(path.read_bytes())
    config = tmp_path / "tiny.yaml"
    config.write_text(TEXT)
    return config, run


OTHERS = {
    "another task": (("task: Align", "task: Transport"), "other task"),
    "another surface": (("field}", "field, surface: {rows: 12, columns: 16}}"), "other environment"),
    "another action": (("action: field", "action: patch"), "other environment"),
    "another network": (("net: [8]", "net: [9]"), "other ppo"),
    "blind": (("net: [8]", "blind: [position], net: [8]"), "other ppo"),
    "another seed": (("seed: 3", "seed: 4"), "other seed"),
    "another number of worlds": (("worlds: 8", "worlds: 16"), "other worlds"),
}


@pytest.mark.parametrize("case", OTHERS)
def test_checkpoints_of_other_runs_are_refused(copied, capsys, case):
    config, run = copied
    (old, new), named = OTHERS[case]
    config.write_text(TEXT.replace(old, new, 1))
    before = files_in(run)
    line = refusal(capsys, command.main, "train", config, "--output", run)
    assert str(run / "checkpoint.json") in line and named in line and files_in(run) == before


def test_a_checkpoint_of_another_number_of_parts_is_refused(tmp_path, capsys):
    config, run = tmp_path / "many.yaml", tmp_path / "run"

    def write(number):
        parts = ", ".join(["steel_block", "aluminium_block", "steel_block"][:number])
        text = TEXT.replace("task: Align", "task: Sort").replace("field}", f"field, parts: [{parts}]}}")
        config.write_text(text.replace("worlds: 8", "worlds: 2").replace("steps: 256", "steps: 32"))

    write(2)
    train(config, run, quiet=True)
    before = files_in(run)
    write(3)
    assert (
        "other environment" in refusal(capsys, command.main, "train", config, "--output", run)
        and files_in(run) == before
    )
    # The policy, too: by itself, and as a beginning.
    policy = run / "policy.json"
    with pytest.raises(ValueError, match="policy.json: parts"):
        load_trained(policy, info_of("Sort", parts=["steel_block", "aluminium_block", "steel_block"]))
    config.write_text(config.read_text() + f"start: {policy}\n")
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "other")
    assert "policy.json: parts" in line and not (tmp_path / "other").exists()


@pytest.mark.parametrize("name", ["checkpoint.json", "policy.json"])
@pytest.mark.parametrize("damage", ["truncated", "altered", "half a tensor file", "altered tensors", "version"])
def test_damaged_files_are_refused(copied, capsys, name, damage):
    """Checkpoints where a run would go on, policies where one would begin."""
    config, run = copied
    path = run / name
    tensors = run / json.loads(path.read_text())["tensors"]
    if damage == "truncated":
        os.truncate(path, 40)
    elif damage == "altered":
        path.write_text(path.read_text().replace('"sha256": "', '"sha256": "0'))
    elif damage == "half a tensor file":
        os.truncate(tensors, tensors.stat().st_size // 2)
    elif damage == "altered tensors":
        data = bytearray(tensors.read_bytes())
        data[-2] ^= 1
        tensors.write_bytes(bytes(data))
    else:
        path.write_text(json.dumps({**json.loads(path.read_text()), "version": 1}))
    output = run
    if name == "policy.json":
        output = run.parent / "other"
        config.write_text(f"{TEXT}start: {path}\n")
    before = files_in(run.parent)
    line = refusal(capsys, command.main, "train", config, "--output", output)
    expected = {"truncated": "not JSON", "version": "'version': "}.get(damage, "SHA-256")
    assert str(path) in line and expected in line and files_in(run.parent) == before


STARTS = {
    "another task": (("task: Align", "task: Transport"), "policy.json: tasks"),
    "another surface": (("field}", "field, surface: {rows: 12, columns: 16}}"), "policy.json: surface"),
    "another action": (("action: field", "action: patch"), "start"),
    "other columns": (("net: [8]", "blind: [position], net: [8]"), "start"),
    "columns of the same width": (("net: [8]", "blind: [velocity], net: [8]"), "start"),
    "turned": (("net: [8]", "turned: true, net: [8]"), "start"),
    "remembering": (("net: [8]", "remembers: true, net: [8]"), "start"),
    "another activation": (("net: [8]", "activation: relu, net: [8]"), "start"),
    "another width": (("net: [8]", "net: [9]"), "start"),
    "more layers": (("net: [8]", "net: [8, 8]"), "start"),
}


@pytest.mark.parametrize("case", STARTS)
def test_policies_that_do_not_fit_are_no_beginning(trained, tmp_path, capsys, case):
    (old, new), named = STARTS[case]
    config = tmp_path / "next.yaml"
    policy = trained[1] / "policy.json"
    config.write_text(TEXT.replace(old, new, 1) + f"start: {policy}\n")
    before = files_in(trained[1])
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "next")
    assert re.search(named, line) and str(config) in line
    assert not (tmp_path / "next").exists() and files_in(trained[1]) == before


def test_files_that_are_none_are_no_beginning(trained, tmp_path, capsys):
    config = tmp_path / "next.yaml"
    for start, named in ((tmp_path / "none.json", "readable"), (trained[1] / "checkpoint.json", "vibgym-checkpoint")):
        config.write_text(f"{TEXT}start: {start}\n")
        assert named in refusal(capsys, command.main, "train", config, "--output", tmp_path / "next")
    assert not (tmp_path / "next").exists()


def test_a_layout_that_the_policy_does_not_know_is_refused(trained, tmp_path):
    """A policy for a row that tells how old a measurement is, in a scene that does not."""
    tensors, record = load_set(trained[1] / "policy.json", KIND, VERSION)
    kept = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    path = tmp_path / "policy.json"
    save_set(path, KIND, tensors, {**kept, "columns": [*kept["columns"], ["age", 1]]}, VERSION)
    with pytest.raises(ValueError, match="policy.json: columns") as error:
        load_trained(path, info_of("Align"))
    assert "\n" not in str(error.value)
    # One that knows less serves: it does not read the rest.
    assert load_trained(trained[1] / "policy.json", info_of("Align", sensor="pose")).coding.columns == kept["columns"]


def test_a_run_begins_with_the_policy_it_is_given(trained, tmp_path):
    config, start = tmp_path / "next.yaml", trained[1] / "policy.json"
    config.write_text(TEXT.replace("net: [8]", "critic_steps: 256, net: [8]", 1) + f"start: {start}\n")
    path = train(config, tmp_path / "next", quiet=True)
    before, after = (load_set(each, KIND, VERSION)[0] for each in (start, path))
    same = {name for name in before if (before[name] == after[name]).all()}
    assert (
        before.keys() == after.keys() and {"hidden.0.weight", "mean.weight", "mean.bias"} <= same
    )  # critic alone learns
    assert (after["log_std.bias"] == np.float32(-0.5)).all() and (before["log_std.bias"] != -0.5).any()  # explores anew


IMITATED = """
task: Align
environment: {action: wrench}
worlds: 8
steps: 576
seed: 3
checkpoint_steps: 64
ppo: {n_steps: 16, batch_size: 64, n_epochs: 1, net: [32], critic_net: [8], log_std_init: -2.0}
imitation: {expert: {kind: pose, action: wrench}, rounds: 2, steps: 20, epochs: 10, batch_size: 64, learning_rate: 0.01}
judging: {episodes: 4, every: 128}
"""


def test_lessons_ppo_and_the_learning_curve_end_to_end(tmp_path):
    """Wrenches of the law ``pose``; the curve has a row for the lessons, and rows of PPO up to the end."""
    config = tmp_path / "wrench.yaml"
    config.write_text(IMITATED)
    runs = [train(config, tmp_path / name, quiet=True) for name in ("a", "b")]
    first, second = (load_set(path, KIND, VERSION)[0] for path in runs)
    assert all((first[name] == second[name]).all() for name in first)
    tensors, record = load_set(tmp_path / "a" / "checkpoint.json", checkpoint.KIND, checkpoint.VERSION)
    assert record["steps"] == 576 and all(np.isfinite(each).all() for each in tensors.values())
    rows = list(csv.DictReader((tmp_path / "a" / "curve.csv").open()))
    assert [(row["steps"], row["phase"]) for row in rows] == [("320", "imitation"), ("448", "ppo"), ("576", "ppo")]
    policy = load_trained(runs[0], info_of("Align"))
    assert policy.action == "wrench" and load_settings(config).imitation.expert["kind"] == "pose"


@pytest.mark.parametrize("expert, named", [
    ("local_field", "imitation.expert"), ("juggler", "juggler"), ("planner", "planner|expert"),
    ("3", "policy"),
])  # fmt: skip
def test_experts_that_cannot_teach_are_refused(tmp_path, capsys, expert, named):
    config = tmp_path / "wrench.yaml"
    config.write_text(IMITATED.replace("{kind: pose, action: wrench}", expert))
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "run")
    assert re.search(named, line) and not (tmp_path / "run").exists()


@pytest.mark.parametrize("old, new, named", [
    ("net: [8]", "network: elements, net: [8]", "ppo.network"),
    ("net: [8]", "blind: [smell], net: [8]", "ppo.blind"),
    ("field}", "field, observation: state}", "observation"),
    ("worlds: 8", "worlds: 2\nscenes: [{}, {}, {}]", "worlds"),
    ("worlds: 8", "worlds: 8\nscenes: [{}, {sensor: {kind: pose, tell: [age]}}]", "scenes"),
    ("worlds: 8", "worlds: 8\nscenes: [{word: 1}]", "environment: unknown key of keyword arguments"),
    ("field}", "field, word: 1}", "environment: unknown key of keyword arguments"),
])  # fmt: skip
def test_settings_that_do_not_go_together_are_refused(tmp_path, capsys, old, new, named):
    config = tmp_path / "bad.yaml"
    config.write_text(TEXT.replace(old, new, 1))
    line = refusal(capsys, command.main, "train", config, "--output", tmp_path / "run")
    assert re.search(named, line) and str(config) in line and not (tmp_path / "run").exists()


def test_an_element_network_has_to_see_where_elements_lie(tmp_path, capsys):
    config = tmp_path / "bad.yaml"
    text = TEXT.replace("action: field", "action: patch").replace(
        "net: [8]", "network: elements, blind: [element], net: [8]", 1
    )
    config.write_text(text)
    assert "ppo.network" in refusal(capsys, command.main, "train", config, "--output", tmp_path / "run")


def test_rows_cannot_be_turned_without_a_way(tmp_path, capsys):
    config = tmp_path / "bad.yaml"
    config.write_text(TEXT.replace("net: [8]", "turned: true, blind: [way_far], net: [8]", 1))
    assert "'way_far' among them" in refusal(capsys, command.main, "train", config, "--output", tmp_path / "run")
