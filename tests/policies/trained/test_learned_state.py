"""The actor that SAC has trained on the state, in NumPy."""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import SURFACE, episodes, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION, StatePolicy, columns_of, described, load_trained

WORLDS = 20


def observed():
    """States of parts that move."""
    env = batch("Align", WORLDS, action="field")
    env.reset(seed=0)
    generator = np.random.default_rng(0)
    for _ in range(4):
        seen = env.step(generator.uniform(-1, 1, (WORLDS, 6)).astype(np.float32))[0]
    return seen


def tensors_of(width, size=3, hidden=(16, 8), seed=0):
    generator, tensors = np.random.default_rng(seed), {}
    shapes = [(f"layer{k}", n) for k, n in enumerate(hidden)] + [("mean", size), ("log_std", size)]
    for name, n in shapes:
        tensors[f"{name}.weight"] = generator.normal(size=(n, width)).astype(np.float32)
        tensors[f"{name}.bias"] = generator.normal(size=n).astype(np.float32)
        width = n if name.startswith("layer") else width
    return tensors


def write(path, **changes):
    info = info_of()
    scene = {"tasks": ["Align"], "surface": described(SURFACE), "parts": 1}
    record = {"network": "state", **scene, "action": "wrench", "columns": columns_of(info), **changes}
    save_set(path, KIND, tensors_of(info.layout.size), record, VERSION)
    return path


def test_a_file_acts_as_its_network(tmp_path):
    info = info_of()
    policy = make_policy(str(write(tmp_path / "policy.json")), info)
    assert isinstance(policy, StatePolicy) and (policy.action, policy.observation) == ("wrench", "state")
    seen = observed()
    tensors = tensors_of(info.layout.size)
    x = seen.astype(np.float64)
    for k in range(2):
        x = np.maximum(x @ tensors[f"layer{k}.weight"].T + tensors[f"layer{k}.bias"], 0.0)
    wanted = np.tanh(x @ tensors["mean.weight"].T + tensors["mean.bias"])
    action, state = policy.predict(seen)
    assert action == pytest.approx(wanted, abs=1e-4) and action.dtype == np.float32 and state is None
    one, _ = policy.predict(seen[3])
    assert one.shape == (3,) and one == pytest.approx(action[3], abs=1e-5)
    explored, _ = policy.predict(seen, deterministic=False)
    assert (np.abs(explored) <= 1.0).all() and (explored != action).any()
    assert episodes(policy, "Align", worlds=2, max_episode_steps=3).success == 0


def lacking(*names):
    return lambda tensors: {key: value for key, value in tensors.items() if key not in names}


def changed(name, change):
    return lambda tensors: {**tensors, name: change(tensors[name])}


@pytest.mark.parametrize("change, match", [
    (lacking("log_std.bias"), "log_std"), (lacking("layer0.weight"), "tensors"),
    (changed("mean.weight", lambda value: value[:2]), "mean"), (changed("layer0.bias", lambda value: value[:2]), "layer0"),
    (changed("layer0.weight", lambda value: value[:, :5]), "layer0"),
    (changed("layer1.weight", lambda value: value * np.nan), "tensors"),
    (changed("layer1.bias", lambda value: value[:, None]), "layer1"),
])  # fmt: skip
def test_damaged_tensors_are_refused(tmp_path, change, match):
    path = write(tmp_path / "policy.json")
    tensors, record = load_set(path, KIND, VERSION)
    kept = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    save_set(path, KIND, change(tensors), kept, VERSION)
    with pytest.raises(ValueError, match=f"policy.json: {match}"):
        load_trained(path, info_of())


def test_other_observations_are_refused(tmp_path):
    policy = make_policy(str(write(tmp_path / "policy.json")), info_of())
    with pytest.raises(ValueError, match="observation"):
        policy.predict(observed()[:, :3])
