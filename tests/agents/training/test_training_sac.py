"""SAC with hindsight: its update against Stable-Baselines3's, its checkpoints, its run."""

import csv
import json

import numpy as np
import pytest
import torch
import yaml
from gymnasium.vector import VectorRewardWrapper
from stable_baselines3 import SAC

from agents.training import checkpoint, off_policy
from agents.training.checkpoint import Diverged
from agents.training.settings import TrainSettings, load_settings
from agents.training.train import train
from tests.policies.helpers import info_of
from vibgym.policies.registry import make_policy
from vibgym.tasks import TASKS, Align

SMALL = {
    "task": "Align", "algorithm": "sac", "environment": {"action": "field", "max_episode_steps": 8}, "worlds": 4,
    "steps": 96, "judging": {"episodes": 3, "every": 40},
    "sac": {"buffer_size": 200, "learning_starts": 16, "batch_size": 16, "gradient_steps": 2, "net": [8, 8]},
}  # fmt: skip


def settings_of(**changes):
    sac = {**SMALL["sac"], **changes.pop("sac", {})}
    return TrainSettings.model_validate({**SMALL, **changes, "sac": sac})


@pytest.fixture
def made():
    """Model of some settings, with some experience."""
    envs = []

    def make(steps=48, **changes):
        settings = settings_of(**changes)
        envs.append(off_policy.make_env(settings))
        model = off_policy.make_model(settings, envs[-1])
        if steps:
            model.learn(steps, log_interval=None)
        return model, settings

    yield make
    for env in envs:
        env.close()


class Doubled(VectorRewardWrapper):
    """Pays twice."""

    def rewards(self, reward):
        return 2.0 * reward


def test_values_are_bounded_for_the_shipped_goal_reward_alone(made, monkeypatch):
    assert made(steps=0)[0].values == (pytest.approx(-1.0 / (1.0 - settings_of().sac.gamma)), 0.0)
    kind = type("Paying", (Align,), {"compute_reward": lambda self, *goals: 10.0 + Align.compute_reward(self, *goals)})
    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Paying": kind})
    model, _ = made(task="Paying")
    assert model.values is None and (model.replay_buffer.sample(50).rewards >= 9.0).all()
    make_vec = off_policy.gym.make_vec
    monkeypatch.setattr(off_policy.gym, "make_vec", lambda *args, **more: Doubled(make_vec(*args, **more)))
    with pytest.raises(ValueError, match=r"^sac.hindsight: got 0.8; allowed: 0 where a wrapper changes"):
        made()
    model, _ = made(sac={"hindsight": 0.0})
    assert model.values is None and set(np.unique(model.replay_buffer.sample(50).rewards)) <= {-2.0, 0.0, -100.0}


def test_the_update_is_that_of_stable_baselines(made):
    """With the same batch, the same noise, an actor's update for each of the critics and no limit of values: same weights."""
    model, settings = made(steps=32, sac={"policy_delay": 1, "hindsight": 0.5})
    other, _ = made(steps=0, sac={"policy_delay": 1})
    other.policy.load_state_dict(model.policy.state_dict())
    with torch.no_grad():
        other.log_ent_coef.copy_(model.log_ent_coef)
    for each in (model, other):
        # Plain steps along the gradient: Adam would blow up what is almost zero.
        each.actor.optimizer = torch.optim.SGD(each.actor.parameters(), 1.0)
        each.critic.optimizer = torch.optim.SGD(each.critic.parameters(), 1.0)
        each.ent_coef_optimizer = torch.optim.SGD([each.log_ent_coef], 1.0)
        each.lr_schedule = lambda _: 1e-2
        each.values = (-np.inf, np.inf)
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
        SAC.train(other, 1, 64)
    for name, value in model.policy.state_dict().items():
        mine, theirs = ((each - before[name]).numpy() for each in (value, other.policy.state_dict()[name]))
        assert mine == pytest.approx(theirs, rel=1e-2, abs=1e-2 * float(np.abs(theirs).max())), name
        assert np.abs(theirs).max() > 0.0, name
    assert model.log_ent_coef.item() == pytest.approx(other.log_ent_coef.item(), abs=1e-6)


def test_the_actor_in_numpy_is_the_model_s(made):
    model, settings = made()
    seen = model.get_env().reset()
    mine, _ = off_policy.acting(model, settings).predict(seen)
    assert mine == pytest.approx(model.predict(seen, deterministic=True)[0], abs=1e-5)


def test_actor_and_coefficient_wait_for_their_turn(made):
    model, _ = made(sac={"policy_delay": 1000})
    fresh, _ = made(steps=0, sac={"policy_delay": 1000})
    assert model._n_updates > 0 and model.log_ent_coef.item() == fresh.log_ent_coef.item()
    for part, same in ((("actor",), True), (("critic",), False)):
        one, other = (getattr(each, part[0]).state_dict() for each in (model, fresh))
        assert all(bool((one[name] == other[name]).all()) for name in one) is same


def test_what_is_not_finite_is_not_written(tmp_path, made):
    model, settings = made(steps=24)
    with torch.no_grad():
        model.actor.mu.bias[0] = np.nan
    with pytest.raises(Diverged, match="actor.mu.bias"):
        checkpoint.save(tmp_path, model, settings, 1.0)
    with pytest.raises(Diverged, match="mean.bias"):
        off_policy.save_policy(tmp_path / "policy.json", model, settings, {})
    assert list(tmp_path.iterdir()) == []
    with torch.no_grad():
        model.critic.qf0[0].weight[0] = np.nan
    with pytest.raises(Diverged):
        model.train(1, 8)


def test_buffers_that_are_too_large_and_other_observations_are_refused():
    settings = settings_of(sac={"buffer_size": 100_000_000})
    with pytest.raises(
        ValueError, match=r"^sac.buffer_size: got 100000000; allowed: a buffer of at most 2.0e\+09 bytes"
    ):
        off_policy.make_model(settings, off_policy.make_env(settings))
    with pytest.raises(ValueError, match="^observation: got 'state'; allowed: 'goal'"):
        off_policy.make_env(settings_of(environment={"observation": "state"}))


@pytest.mark.parametrize("field, value", [
    ("gamma", 1.0), ("batch_size", 0), ("hindsight", 1.5), ("policy_delay", 0), ("net", []), ("noise_steps", 0.5), ("tau", 2),
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
        record["network"] == "goal" and record["training"]["steps"] == 96 and "SAC" in record["training"]["algorithm"]
    )
    policy = make_policy(str(path), info_of())
    assert policy.observation == "goal" and policy.action == "field"

    def curve():
        with (output / "curve.csv").open(newline="") as file:
            return [int(row["steps"]) for row in csv.DictReader(file)]

    assert curve() == [40, 80, 96]
    config.write_text(yaml.safe_dump({**SMALL, "steps": 128}))
    longer = json.loads(train(config, output, quiet=True).read_text())
    assert longer["training"]["steps"] == 128 and curve() == [40, 80, 96, 128]
    with pytest.raises(ValueError, match="checkpoint.json: got .other .*sac"):
        config.write_text(yaml.safe_dump({**SMALL, "sac": {**SMALL["sac"], "tau": 0.5}}))
        train(config, output, quiet=True)
