"""Training of a correction: the hybrid is trained, evaluated, written, loaded and tabulated with its own base."""

import contextlib
import json

import gymnasium as gym
import numpy as np
import pytest
import torch
import yaml

from agents import served
from agents.learning_curve import LearningCurve
from agents.ppo import PPO
from agents.tabulate import tabulate
from agents.train import train
from agents.training_file import load_settings
from tests.agents.training import helpers
from tests.agents.training.helpers import POSE
from tests.commands import rows_of
from tests.policies.helpers import info_of
from vibgym.files import csv_text
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.trained.residual import ResidualPolicy, load_correction
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained


def written(folder, **changes):
    """Write a file of one agent."""
    own = {
        "environment": {"action": "wrench"}, "residual": {"base": {"kind": "pose"}, "scale": 0.3}, "worlds": 8,
        "steps": 256, "output": str(folder / "run"), "selection": {"episodes": 4, "every": 128},
        "ppo": {**helpers.PPO, "log_std_init": -3.0},
    }  # fmt: skip
    path = folder / "many.yaml"
    path.write_text(yaml.safe_dump({"vibgym/Align-v0": {"hybrid": {**own, **changes}}}))
    return path


@pytest.fixture(scope="module")
def hybrid(tmp_path_factory):
    """Settings file and policy of a whole, tiny run."""
    path = written(tmp_path_factory.mktemp("hybrid"))
    return path, train(path, quiet=True, agent="Align/hybrid")


@contextlib.contextmanager
def learner(folder, **changes):
    """Make a learner with changed settings."""
    learner = PPO(load_settings(written(folder, **changes), "Align/hybrid"))
    yield learner
    learner.close()


def test_the_file_has_the_base_and_loads_with_no_other(hybrid):
    _, path = hybrid
    tensors, record = load_set(path, KIND, VERSION)
    assert record["residual"] == {"base": POSE, "scale": 0.3} and record["columns"][-1] == ["base", 3]
    assert all(np.isfinite(tensor).all() for tensor in tensors.values())
    kind, info = {"kind": "residual", "path": str(path)}, info_of("Align", action="wrench")
    base = make_policy(POSE, info)
    again = ResidualPolicy(info, base, load_correction(path, info).learned, scale=0.3)
    env = gym.make_vec("vibgym/Align-v0", num_envs=4, action="wrench", observation="parts_and_state")
    seen, _ = env.reset(seed=0)
    action, _ = make_policy(kind, info).predict(seen)
    assert (action == again.predict(seen)[0]).all() and (action != base.predict(seen["state"])[0]).any()
    assert (action == make_policy({**kind, "base": "pose", "scale": 0.3}, info).predict(seen)[0]).all()
    for wrong in ({"base": "lqr"}, {"base": base}, {"scale": 0.5}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            make_policy({**kind, **wrong}, info)
    with pytest.raises(ValueError, match="residual"):
        load_trained(path, info)


def test_the_table_plays_the_hybrid(hybrid, tmp_path, monkeypatch):
    for name, few in (("EPISODES", 2), ("SCENES", 2), ("WORLDS", 1), ("FACTORS", (1.15,))):
        monkeypatch.setattr(served, name, few)
    older = {"agent": "Align/before", "seed": "0", "processor": "one", "threads": "1", "versions": "", "steps": "5"}
    former = {**older, "success": "1", "episodes": "2", "fallen": "0", "shipped": "True"}
    (tmp_path / "agents.csv").write_text(csv_text([former]))
    page = tmp_path / "agents.md"
    rows = tabulate(hybrid[0], ["Align/hybrid"], [0], 2, tmp_path, page, ship=tmp_path / "shipped")
    assert rows[0]["success"] == 1.0  # as the base; the network alone would fail
    shipped = tmp_path / "shipped" / "align-hybrid.json"
    record = json.loads(shipped.read_text())
    assert record["residual"]["scale"] == 0.3 and record["range"]["parts"]["friction"][0] <= 0.58
    assert [row["agent"] for row in rows_of(tmp_path / "agents.csv")] == ["Align/before", "Align/hybrid"]
    assert "| Align/before | 0 | 5 | – | 100.0 % |" in page.read_text()
    make_policy({"kind": "residual", "path": str(shipped)}, info_of("Align", action="wrench"))


def test_a_correction_of_zero_is_evaluated_as_the_base(tmp_path):
    with learner(tmp_path) as zero:
        with torch.no_grad():
            zero.policy.actor.mean.weight.zero_()
            zero.policy.actor.mean.bias.zero_()
        row = LearningCurve(zero.settings, tmp_path).measure(zero.acting(), 0, 0.0, "ppo")
        assert zero.env.envs[0].parts_layout[-1].name == "base"
    base = rollout(POSE, "Align", seeds=range(500_000, 500_004))
    assert row["success"] == base.success.mean() == 1.0
    assert row["return_"] == round(float(np.median(base.returns)), 4)
    assert row["time_to_goal"] == round(float(np.median(base.time_to_goal)), 4)


def test_each_scene_has_its_own_base(tmp_path):
    disc = {"parts": [{"shape": "disc", "radius": 0.03, "friction": 0.6}]}
    with learner(tmp_path, scenes=[{}, disc]) as scenes:
        one, other = scenes.env.envs
        assert one.base.policy is not other.base.policy and other.base.policy.info.parts == other.parts != one.parts


def test_one_row_for_all_parts_corrects_velocities(tmp_path):
    """The row sees the plan of the base, and the file's policy adds velocities to its action."""
    own = {
        "environment": {"action": "velocity"}, "residual": {"base": {"kind": "push", "action": "velocity"}, "scale": 0.4},
        "worlds": 8, "steps": 256, "output": str(tmp_path / "run"), "selection": {"episodes": 2, "every": 256},
        "ppo": {**helpers.PPO, "network": "joint", "standardized": True}, "serves": {"hardware": "any"},
    }  # fmt: skip
    file = tmp_path / "push.yaml"
    file.write_text(yaml.safe_dump({"vibgym/Push-v0": {"one": own}}))
    path = train(file, quiet=True, agent="Push/one")
    tensors, record = load_set(path, KIND, VERSION)
    assert ["plan_push", 4] in record["columns"] and (tensors["eyes.scale"] > 0.0).all()
    env = gym.make_vec("vibgym/Push-v0", num_envs=4, action="velocity", observation="parts_and_state")
    info = info_of("Push", action="velocity")
    seen, _ = env.reset(seed=0)
    action, _ = make_policy({"kind": "residual", "path": str(path)}, info).predict(seen)
    proposed, _ = make_policy(own["residual"]["base"], info).predict(seen["state"])
    change = (action * np.abs(action) - proposed * np.abs(proposed)).reshape(4, 3, 3)
    assert (
        1e-4 < np.abs(change[:, :2, :2]).max() < 0.4
        and np.abs(change[:, 2]).max() == np.abs(change[..., 2]).max() == 0.0
    )


@pytest.mark.parametrize("symmetric", [False, True])
def test_rows_are_standardized_by_a_rollout(tmp_path, symmetric):
    """In torch and in NumPy alike, and equal in equivalent scenes; a run that starts from a file keeps the file's."""
    own = {
        "task": "Push", "environment": {"action": "velocity"}, "residual": {"base": {"kind": "push", "action": "velocity"}},
        "ppo": {**helpers.PPO, "network": "joint", "standardized": True, "symmetric": symmetric, "averaging": 0.5},
    }  # fmt: skip
    learner = PPO(load_settings(helpers.written(tmp_path, **own)))
    assert learner.policy.unstandardized
    learner.learn(128, lambda metrics: None)
    rows = learner.rollout.rows[:-1].reshape(-1, learner.rollout.rows.shape[-1])
    actor = learner.policy.actor
    assert not learner.policy.unstandardized and learner.steps == 128  # the first rollout, without an update
    standard = actor.eyes(torch.from_numpy(rows)).numpy()
    varies = rows.std(axis=0) > 0.2
    assert np.abs(standard.mean(axis=0)).max() < 0.2 and np.abs(standard.std(axis=0)[varies] - 0.95).max() < 0.1
    with torch.no_grad():
        mean, log_std = actor(torch.from_numpy(rows))
    acting = learner.acting().outputs(rows[:, None])
    np.testing.assert_allclose(acting[0][:, 0], mean.numpy(), atol=1e-5)
    np.testing.assert_allclose(acting[1][:, 0], log_std.numpy(), atol=1e-5)
    with torch.no_grad():
        value = learner.policy.critic(torch.from_numpy(rows[:, None]), torch.ones(len(rows), 1))
    for order, sign, to, times in learner.policy.coding.equivalents if symmetric else ():
        other = torch.from_numpy(rows[:, order] * sign)
        with torch.no_grad():
            same, equal = actor(other)[0], learner.policy.critic(other[:, None], torch.ones(len(rows), 1))
        np.testing.assert_allclose(same.numpy(), mean.numpy()[:, to] * times, atol=1e-5)
        np.testing.assert_allclose(equal.numpy(), value.numpy(), atol=1e-4)
    path = tmp_path / "policy.json"
    learner.save_policy(path, {})
    learner.close()
    started = PPO(load_settings(helpers.written(tmp_path, **own, start=str(path))))
    assert not started.policy.unstandardized
    for network in (started.policy.actor, started.policy.critic):
        assert torch.equal(network.eyes.scale, actor.eyes.scale) and torch.equal(network.eyes.mean, actor.eyes.mean)
    started.close()
    policy = load_correction(path, info_of("Push", action="velocity", observation="parts_and_state")).learned
    np.testing.assert_allclose(policy.outputs(rows[:, None])[0][:, 0], mean.numpy(), atol=1e-5)


def test_a_run_starts_from_a_correction_of_the_same_base(hybrid, tmp_path):
    start = str(hybrid[1])
    with learner(tmp_path, start=start) as started:
        assert (started.actor()["mean.weight"] == load_set(hybrid[1], KIND, VERSION)[0]["mean.weight"]).all()
    for residual, name in (({"base": {"kind": "pose"}, "scale": 0.4}, "scale"), (None, "residual")):
        with pytest.raises(ValueError, match=name), learner(tmp_path, start=start, residual=residual):
            pass
