"""Tensors and settings on disk: damaged or foreign files are rejected by name, a kill leaves files that load."""

import hashlib
import json
import os
import pickle
import subprocess
import sys

import numpy as np
import pytest

from tests.policies.helpers import info_of
from tests.policies.trained.helpers import actor_tensors, coding_for, observations, policy_file
from vibgym.policies.registry import make_policy
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import TrainedPolicy, described, load_trained

KIND = "vibgym-test"
FIRST = {"a": np.arange(6, dtype=np.float32).reshape(2, 3), "b": np.array([1.5]), "n": np.array(7, dtype=np.int64)}
SECOND = {"a": -FIRST["a"]}


def tensor_file(path):
    (file,) = path.parent.glob("*.safetensors")
    return file


def test_round_trip(tmp_path):
    path = tmp_path / "deeper" / "set.json"
    save_set(path, KIND, FIRST, {"task": "Align", "numbers": [1, 2.5]})
    tensors, record = load_set(path, KIND)
    assert tensors.keys() == FIRST.keys()
    for name, value in FIRST.items():
        assert tensors[name].dtype == value.dtype and (tensors[name].ravel() == value.ravel()).all()
    assert record["task"] == "Align" and record["numbers"] == [1, 2.5]
    mask = os.umask(0)
    os.umask(mask)
    assert path.stat().st_mode & 0o777 == 0o666 & ~mask  # to be read like any other file


def test_saving_again_replaces_and_leaves_no_litter(tmp_path):
    path = tmp_path / "set.json"
    other = tmp_path / "set-of-mine.safetensors"
    other.write_bytes(b"mine")
    for tensors in (FIRST, FIRST, SECOND):
        save_set(path, KIND, tensors, {})
    assert load_set(path, KIND)[0]["a"].tolist() == SECOND["a"].tolist()
    assert len(list(tmp_path.iterdir())) == 3 and other.read_bytes() == b"mine"


@pytest.mark.parametrize("name, others", [
    ("align[12]", ("align1", "align2", "align[1]")), ("align", ("align-0123456789ab", "align-0123456789ab-0123456789ab")),
    ("a.b", ("a", "axb", "a.b.c")),
])  # fmt: skip
def test_names_are_not_patterns(tmp_path, name, others):
    paths = [tmp_path / f"{other}.json" for other in others]
    for path in paths:
        save_set(path, KIND, FIRST, {})
    for tensors in (FIRST, SECOND):
        save_set(tmp_path / f"{name}.json", KIND, tensors, {})
    assert all((load_set(path, KIND)[0]["a"] == FIRST["a"]).all() for path in paths)
    assert load_set(tmp_path / f"{name}.json", KIND)[0]["a"].tolist() == SECOND["a"].tolist()
    assert len(list(tmp_path.iterdir())) == 2 * (1 + len(others))


def test_sets_that_would_share_tensors_are_refused(tmp_path):
    for name in ("set", "set.JSON.txt", "set.safetensors"):
        with pytest.raises(ValueError, match="path"):
            save_set(tmp_path / name, KIND, FIRST, {})
    assert list(tmp_path.iterdir()) == []


def test_saving_the_same_again_mends_damaged_tensors(tmp_path):
    path = tmp_path / "set.json"
    save_set(path, KIND, FIRST, {})
    flip(path)
    save_set(path, KIND, FIRST, {})
    assert load_set(path, KIND)[0]["a"].tolist() == FIRST["a"].tolist()


def flip(path):
    file = tensor_file(path)
    data = bytearray(file.read_bytes())
    data[-3] ^= 1
    file.write_bytes(bytes(data))


def rewritten(**changes):
    def change(path):
        path.write_text(json.dumps({**json.loads(path.read_text()), **changes}))

    return change


def pickled(path):
    path.write_bytes(pickle.dumps({"format": KIND, "version": 1}))


def signed_rubbish(path):
    tensor_file(path).write_bytes(b"rubbish")
    rewritten(sha256=hashlib.sha256(b"rubbish").hexdigest())(path)


DAMAGE = {
    "flipped byte": (flip, "tensors.*SHA-256"),
    "truncated tensors": (lambda path: os.truncate(tensor_file(path), 20), "tensors.*SHA-256"),
    "missing tensors": (lambda path: tensor_file(path).unlink(), "tensors.*readable file"),
    "tensors that are none": (signed_rubbish, "tensors.*whole safetensors"),
    "truncated json": (lambda path: os.truncate(path, 30), "not JSON"),
    "not text": (lambda path: path.write_bytes(b"\xff\xfe\x00\x01"), "not JSON"),
    "foreign json": (lambda path: path.write_text('{"hello": 1}'), f"format '{KIND}', version 1"),
    "number": (lambda path: path.write_text("3"), f"format '{KIND}', version 1"),
    "another kind": (rewritten(format="vibgym-other"), "vibgym-other"),
    "a later version": (rewritten(version=2), "'version': 2"),
    "pickle": (pickled, "not JSON"),
    "path traversal": (rewritten(tensors="../set.safetensors"), "tensors.*beside it"),
    "null byte": (rewritten(tensors="a\0.safetensors"), "tensors.*beside it"),
    "a directory": (lambda path: (path.unlink(), path.mkdir()), "readable"),
    "tensors no name": (rewritten(tensors=["a.safetensors"]), "tensors.*beside it"),
    "missing file": (lambda path: path.unlink(), "readable"),
}


@pytest.mark.parametrize("damage, message", DAMAGE.values(), ids=DAMAGE)
def test_damaged_and_foreign_files_are_refused_by_name(tmp_path, damage, message):
    path = tmp_path / "set.json"
    save_set(path, KIND, FIRST, {})
    damage(path)
    with pytest.raises(ValueError, match=message) as error:
        load_set(path, KIND)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


class Killed(BaseException):
    """What no `except Exception` stops."""


@pytest.mark.parametrize("call", [1, 2])
@pytest.mark.parametrize("moment", ["before", "after"])
def test_a_kill_while_saving_leaves_a_set_that_loads(tmp_path, monkeypatch, call, moment):
    path = tmp_path / "set.json"
    save_set(path, KIND, FIRST, {"which": "first"})
    replace, calls = os.replace, []

    def dying(source, target):
        calls.append(target)
        if len(calls) == call and moment == "before":
            raise Killed
        replace(source, target)
        if len(calls) == call:
            raise Killed

    monkeypatch.setattr(os, "replace", dying)
    with pytest.raises(Killed):
        save_set(path, KIND, SECOND, {"which": "second"})
    monkeypatch.undo()
    tensors, record = load_set(path, KIND)
    done = (call, moment) == (2, "after")
    assert record["which"] == ("second" if done else "first")
    assert tensors["a"].tolist() == (SECOND if done else FIRST)["a"].tolist()
    save_set(path, KIND, SECOND, {"which": "second"})
    assert load_set(path, KIND)[1]["which"] == "second"
    assert len(list(tmp_path.iterdir())) == 2  # the next save tidies up


# -- policies ----------------------------------------------------------------------------------------------------------


INFO = info_of("Align")
SHAPE = coding_for(INFO).shape


NETWORK = actor_tensors(SHAPE)


@pytest.mark.parametrize("activation", ["tanh", "relu"])
def test_a_loaded_policy_is_its_network(tmp_path, activation):
    tensors = NETWORK
    policy = make_policy(str(policy_file(tmp_path, INFO, tensors, activation=activation)), INFO)
    assert isinstance(policy, TrainedPolicy) and (policy.action, policy.observation) == ("field", "parts")
    seen = observations(policy.coding, 7)
    hidden = seen["parts"][:, 0] @ tensors["hidden.0.weight"].T + tensors["hidden.0.bias"]
    hidden = np.tanh(hidden) if activation == "tanh" else np.maximum(hidden, 0)
    mean = hidden @ tensors["mean.weight"].T + tensors["mean.bias"]
    action, state = policy.predict(seen)
    assert action.shape == (7, 6) and action.dtype == np.float32
    assert (policy.predict(seen, state)[0] == action).all()  # it remembers nothing
    assert action == pytest.approx(np.clip(mean, -1, 1), abs=1e-5)
    one, _ = policy.predict({name: values[2] for name, values in seen.items()})
    assert one.shape == (6,) and one == pytest.approx(action[2], abs=1e-6)
    still = {**seen, "parts": 0 * seen["parts"]}
    draws = np.concatenate([policy.predict(still, deterministic=False)[0] for _ in range(50)])
    inner = np.abs(policy.predict(still)[0][0]) < 0.2
    assert draws.dtype == np.float32 and draws.std(axis=0).max() > 0.1 and np.abs(draws).max() <= 1.0
    assert inner.any() and draws.std(axis=0)[inner] == pytest.approx(np.exp(-1.0), rel=0.2)


def test_a_loaded_policy_remembers_what_its_file_states(tmp_path):
    memory = {"history": 3, "history_columns": ["velocity", "heading"]}
    coding = coding_for(INFO, **memory)
    tensors = actor_tensors(coding.shape)
    loaded = load_trained(policy_file(tmp_path, INFO, tensors, **memory), INFO)
    made, states = TrainedPolicy(tensors, "parts", "tanh", coding), [None, None]
    for step in range(5):
        seen = observations(coding, 4, seed=step)
        (one, states[0]), (two, states[1]) = (
            actor.predict(seen, state) for actor, state in zip((loaded, made), states, strict=True)
        )
        forgetful, _ = loaded.predict(seen)
        assert (one == two).all() and (one == forgetful).all() == (step == 0)


DOUBLE = {key: value.astype(np.float64) for key, value in NETWORK.items()}


def with_one(name, number, kind=np.float64):
    tensors = {**NETWORK, name: DOUBLE[name].astype(kind)}
    tensors[name].flat[-1] = number
    return tensors


COLUMNS = coding_for(INFO).columns
SURFACE = described(INFO.surface)
FIT = f"rows of {SHAPE.columns} numbers and actions of 6"


@pytest.mark.parametrize("changes, message", [
    ({"tasks": ["Rotate"]}, "tasks"), ({"tasks": None}, "tasks"),
    ({"surface": {**SURFACE, "frequency": 50.0}}, "surface.*50.0"), ({"surface": None}, "surface"),
    ({"parts": 2}, "parts"), ({"parts": True}, "parts"),
    ({"action": "swing"}, "action.*swing"), ({"action": ["patch"]}, "action"),
    ({"action": "patch"}, "tensors.*actions of 32"),
    ({"activation": "sine"}, "activation"),
    ({"network": "mlp"}, "network"), ({"network": "elements"}, "network"),
    ({"network": "elements", "action": "patch", "columns": [column for column in COLUMNS if column[0] != "element"]},
     "network"),
    ({"turned": None}, "turned"), ({"symmetric": 1}, "symmetric"), ({"symmetric": True}, "symmetric"),
    ({"history": None}, "history"), ({"history": True}, "tensors.*rows of"),
    ({"history_columns": ["velocity"]}, "history_columns requires history"),
    ({"columns": None}, "columns"), ({"columns": []}, "columns"), ({"columns": COLUMNS[:-1]}, "tensors.*rows of"),
    ({"columns": [*COLUMNS, ["smell", 2]]}, "columns.*smell"), ({"columns": COLUMNS[::-1]}, "columns.*in this order"),
    ({"columns": [["position", 3], *COLUMNS[1:]]}, "columns.*position"),
    ({"columns": [*COLUMNS, COLUMNS[-1]]}, "columns"), ({"columns": [[["position"], 2]]}, "columns"),
    ({"columns": [[name, width] for name, width in COLUMNS if name not in ("element", "way_far")], "turned": True},
     "columns"),
    ({"tensors": {}}, "tensors"),
    ({"tensors": {name: NETWORK[name] for name in NETWORK if name != "log_std.bias"}}, "tensors.*log_std"),
    ({"tensors": actor_tensors(SHAPE._replace(action=7))}, f"tensors.*{FIT}"),
    *[({"tensors": with_one("mean.bias", number)}, "tensors") for number in (1e300, np.nan)],
    ({"tensors": with_one("hidden.0.bias", 1, np.int64)}, "tensors"),
])  # fmt: skip
def test_policies_that_do_not_fit_are_refused(tmp_path, changes, message):
    path = policy_file(tmp_path, INFO, **changes)
    with pytest.raises(ValueError, match=message) as error:
        load_trained(path, INFO)
    assert str(path) in str(error.value) and "\n" not in str(error.value)


def test_a_policy_may_serve_any_surface_and_any_number_of_parts(tmp_path):
    path = policy_file(tmp_path, INFO, surface="any", parts="any", tasks=["Align", "Rotate"])
    other = info_of("Rotate", surface={"rows": 12, "columns": 20})
    seen = observations(coding_for(INFO), 3)
    assert (load_trained(path, other).predict(seen)[0] == load_trained(path, INFO).predict(seen)[0]).all()
    with pytest.raises(ValueError, match="tasks.*'Transport'"):
        load_trained(path, info_of("Transport"))


def test_a_policy_in_double_precision_acts_as_the_same_in_single(tmp_path):
    single, double = (load_trained(policy_file(tmp_path, INFO, source), INFO) for source in (NETWORK, DOUBLE))
    seen = observations(single.coding, 7)
    assert (single.predict(seen)[0] == double.predict(seen)[0]).all()


@pytest.mark.parametrize("change, got", [
    (lambda seen: seen["parts"], "array"), (lambda seen: {"parts": seen["parts"]}, ""), (lambda seen: None, ""),
    (lambda seen: {**seen, "parts": seen["parts"][..., 1:]}, f"{SHAPE.columns - 1}\\)"),
    (lambda seen: {**seen, "mask": seen["mask"][:2]}, "\\(2, 1\\)"), (lambda seen: {**seen, "parts": "all"}, ""),
])  # fmt: skip
def test_other_observations_are_refused(tmp_path, change, got):
    policy = load_trained(policy_file(tmp_path, INFO), INFO)
    with pytest.raises(ValueError, match="observation") as error:
        policy.predict(change(observations(policy.coding, 3)))
    assert "\n" not in str(error.value)


def test_loading_and_acting_need_neither_torch_nor_pickle(tmp_path):
    """Only JSON and safetensors are read, in a process that cannot unpickle."""
    path = policy_file(tmp_path, INFO)
    code = f"""
import builtins, marshal, pickle, sys
from pathlib import Path
import numpy as np
import gymnasium
import vibgym
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
info = TaskInfo.of(gymnasium.make("vibgym/Align-v0"))
read = []
def hook(event, arguments):
    if event == "open" and isinstance(arguments[0], str) and str({str(tmp_path)!r}) in arguments[0]:
        read.append(Path(arguments[0]).suffix)
    if event in ("exec", "compile", "pickle.find_class", "marshal.loads") and ARMED:
        raise SystemExit(f"code ran: {{event}} {{arguments}}")
ARMED = False
make_policy({str(path)!r}, info)  # lazy imports happen here
read.clear()
sys.addaudithook(hook)
ARMED = True
policy = make_policy({str(path)!r}, info)
action, _ = policy.predict({{"parts": np.zeros((1, {SHAPE.columns})), "mask": np.ones(1)}})
ARMED = False
assert action.shape == (6,), action
assert sorted(read) == [".json", ".safetensors"], read
assert "torch" not in sys.modules and "stable_baselines3" not in sys.modules
"""
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
