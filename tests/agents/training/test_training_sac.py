"""SAC: its update against Stable-Baselines3's, its checkpoints, its run."""

import copy
import csv
import json

import numpy as np
import pytest
import stable_baselines3
import torch
import yaml
from gymnasium import spaces

from agents.failures import Diverged
from agents.training import checkpoint
from agents.training.sac.algorithm import SAC
from agents.training.sac.replay import STORED, Replay, buffer_bytes
from agents.training.train import train
from agents.training.training_file import load_settings, settings_from
from tests.policies.helpers import info_of
from vibgym.policies.registry import make_policy

SMALL = {
    "task": "Align", "algorithm": "sac", "environment": {"action": "field", "max_episode_steps": 8}, "worlds": 4,
    "steps": 96, "judging": {"episodes": 3, "every": 40},
    "sac": {"buffer_size": 200, "learning_starts": 16, "batch_size": 16, "gradient_steps": 2, "net": [8, 8]},
}  # fmt: skip


def settings_of(**changes):
    sac = {**SMALL["sac"], **changes.pop("sac", {})}
    return settings_from({**SMALL, **changes, "sac": sac})


@pytest.fixture
def made():
    """Model of some settings, with some experience."""
    envs = []

    def make(steps=48, **changes):
        settings = settings_of(**changes)
        envs.append(SAC(settings).make_env())
        model = SAC(settings).make_model(envs[-1])
        if steps:
            model.learn(steps, log_interval=None)
        return model, settings

    yield make
    for env in envs:
        env.close()


def test_the_update_is_that_of_stable_baselines(made):
    """With the same batch and the same noise: same weights."""
    model, settings = made(steps=32)
    other, _ = made(steps=0)
    other.policy.load_state_dict(model.policy.state_dict())
    with torch.no_grad():
        other.log_ent_coef.copy_(model.log_ent_coef)
    for each in (model, other):
        # Plain steps along the gradient: Adam would blow up what is almost zero.
        each.actor.optimizer = torch.optim.SGD(each.actor.parameters(), 1.0)
        each.critic.optimizer = torch.optim.SGD(each.critic.parameters(), 1.0)
        each.ent_coef_optimizer = torch.optim.SGD([each.log_ent_coef], 1.0)
        each.lr_schedule = lambda _: 1e-2
        each._logger = model.logger
    batch = model.replay_buffer.sample(64)
    model.replay_buffer.sample = other.replay_buffer.sample = lambda size, env=None: batch
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}

    def constant(shape, *args, **more):
        return torch.full(tuple(shape), 0.3)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch, "randn_like", lambda like: torch.full_like(like, 0.3))
        patch.setattr("torch.distributions.normal._standard_normal", constant)
        model.train(1, 64)
        stable_baselines3.SAC.train(other, 1, 64)
    for name, value in model.policy.state_dict().items():
        mine, theirs = ((each - before[name]).numpy() for each in (value, other.policy.state_dict()[name]))
        assert mine == pytest.approx(theirs, rel=1e-2, abs=1e-2 * float(np.abs(theirs).max())), name
        assert np.abs(theirs).max() > 0.0, name
    assert model.log_ent_coef.item() == pytest.approx(other.log_ent_coef.item(), abs=1e-6)


def test_the_actor_in_numpy_is_the_model_s(made):
    model, settings = made()
    seen = model.get_env().reset()
    mine, _ = SAC(settings).acting(model).predict(seen)
    assert mine == pytest.approx(model.predict(seen, deterministic=True)[0], abs=1e-5)


@pytest.mark.parametrize("steps", [0, 9, 2 * 50 + 3])
def test_a_buffer_goes_on_from_a_state(steps):
    """With the same memory and draws; what the step limit cuts off does not count as an end."""
    box, worlds = spaces.Box(-1, 1, (2,)), 3
    kept, other = (Replay(50 * worlds, box, box, "cpu", worlds, seed=seed) for seed in (0, 9))

    def fill(into, count):
        for k in range(count):
            seen = np.array([[world, k] for world in range(worlds)], dtype=np.float32)
            infos = [{"TimeLimit.truncated": k % 5 == 0} for _ in range(worlds)]
            into.add(seen, seen + [0, 1], seen / 200, seen[:, 1], np.full(worlds, k % 5 == 0 or k % 7 == 0), infos)

    fill(kept, steps)
    other.set_state(copy.deepcopy(kept.get_state()))
    for each in (kept, other):
        fill(each, 7)
    assert (other.pos, other.full, other.size()) == (kept.pos, kept.full, kept.size())
    mine, theirs = kept.sample(500), other.sample(500)
    assert all(torch.equal(*pair) for pair in zip(mine[:5], theirs[:5], strict=True))
    place, done = mine.observations[:, 1], mine.dones[:, 0] > 0.5
    assert torch.equal(mine.next_observations[:, 1], place + 1) and torch.equal(mine.rewards[:, 0], place)
    assert torch.equal(done, (place % 7 == 0) & (place % 5 != 0))
    stored = sum(getattr(kept, name).nbytes for name in STORED)
    assert buffer_bytes(50 * worlds, worlds, box, box) == stored


def test_what_is_not_finite_is_not_written(tmp_path, made):
    model, settings = made(steps=24)
    with torch.no_grad():
        model.actor.mu.bias[0] = np.nan
    with pytest.raises(Diverged, match="actor.mu.bias"):
        checkpoint.save(tmp_path, model, settings, 1.0)
    with pytest.raises(Diverged, match="mean.bias"):
        SAC(settings).save_policy(tmp_path / "policy.json", model, {})
    assert list(tmp_path.iterdir()) == []
    with torch.no_grad():
        model.critic.qf0[0].weight[0] = np.nan
    with pytest.raises(Diverged):
        model.train(1, 8)


def test_buffers_that_are_too_large_and_other_observations_are_refused():
    settings = settings_of(sac={"buffer_size": 100_000_000})
    with pytest.raises(ValueError, match=r"sac.buffer_size"):
        SAC(settings).make_model(SAC(settings).make_env())
    with pytest.raises(ValueError, match="observation"):
        SAC(settings_of(environment={"observation": "goal"})).make_env()


@pytest.mark.parametrize("field, value", [
    ("gamma", 1.0), ("batch_size", 0), ("gradient_steps", 0), ("net", []), ("ent_coef", 0.0), ("tau", 2),
])  # fmt: skip
def test_bad_settings_are_refused_by_name(tmp_path, field, value):
    path = tmp_path / "bad.yaml"
    path.write_text(yaml.safe_dump({**SMALL, "sac": {field: value}}))
    with pytest.raises(ValueError, match=f"bad.yaml: sac.*{field}"):
        load_settings(path)


def test_a_run_writes_curve_checkpoint_and_policy_and_goes_on(tmp_path):
    config, output = tmp_path / "small.yaml", tmp_path / "run"
    config.write_text(yaml.safe_dump(SMALL))
    path = train(config, output, quiet=True)
    record = json.loads(path.read_text())
    assert (
        record["network"] == "state" and record["training"]["steps"] == 96 and "SAC" in record["training"]["algorithm"]
    )
    policy = make_policy(str(path), info_of())
    assert policy.observation == "state" and policy.action == "field"

    def curve():
        with (output / "curve.csv").open(newline="") as file:
            return [int(row["steps"]) for row in csv.DictReader(file)]

    assert curve() == [40, 80, 96]
    config.write_text(yaml.safe_dump({**SMALL, "steps": 128}))
    longer = json.loads(train(config, output, quiet=True).read_text())
    assert longer["training"]["steps"] == 128 and curve() == [40, 80, 96, 128]
    with pytest.raises(ValueError, match="checkpoint.json"):
        config.write_text(yaml.safe_dump({**SMALL, "sac": {**SMALL["sac"], "tau": 0.5}}))
        train(config, output, quiet=True)
