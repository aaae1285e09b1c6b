"""SAC with hindsight: its update against Stable-Baselines3's, its checkpoints, its run."""

import csv
import json

import numpy as np
import pytest
import torch
import yaml
from stable_baselines3 import SAC

from agents.learned.storage import load_set, save_set
from agents.registry import make_policy
from agents.training import off_policy, sac_run
from agents.training.checkpoint import FILE, KIND, Diverged
from agents.training.settings import TrainSettings, load_settings
from agents.training.train import train
from tests.agents.helpers import info_of

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
        envs.append(sac_run.make_env(settings))
        model = off_policy.make_model(settings, envs[-1])
        if steps:
            model.learn(steps, log_interval=None)
        return model, settings

    yield make
    for env in envs:
        env.close()


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


def test_a_checkpoint_goes_to_another_model(tmp_path, made):
    model, settings = made()
    off_policy.save(tmp_path, model, settings, 12.5)
    other, _ = made(steps=0)
    assert off_policy.restore(tmp_path, other, settings) == 12.5
    for name, value in model.policy.state_dict().items():
        assert (other.policy.state_dict()[name] == value).all()
    assert (other.num_timesteps, other._n_updates) == (model.num_timesteps, model._n_updates)
    assert other.log_ent_coef.item() == model.log_ent_coef.item()
    for mine, theirs in zip(*(off_policy._optimizers(each).values() for each in (model, other))):
        one, two = mine.state_dict()["state"], theirs.state_dict()["state"]
        assert one.keys() == two.keys() and len(one) > 0
        assert all((one[key][name] == two[key][name]).all() for key in one for name in one[key])
    stored = other.replay_buffer.get_state()
    assert (stored["actions"] == model.replay_buffer.get_state()["actions"]).all() and len(stored["actions"]) == 12
    other.learn(16, reset_num_timesteps=False, log_interval=None)
    assert other.num_timesteps == model.num_timesteps + 16 and other._n_updates > model._n_updates


def edited(tensors, record, change):
    """A checkpoint with one thing that is not as it was."""
    if isinstance(change, dict):
        return tensors, {**record, **change}
    return change(dict(tensors)), record


@pytest.mark.parametrize("change, match", [
    ({"steps": -1}, "steps"), ({"updates": "many"}, "updates"), ({"seconds": None}, "seconds"), ({"position": 50}, "position"),
    ({"position": 3}, "buffer"), ({"full": 1}, "full"), ({"settings": None}, "other task"),
    (lambda tensors: {**tensors, "log_ent_coef": tensors["log_ent_coef"] * np.nan}, "NaN or infinity in log_ent_coef"),
    (lambda tensors: {**tensors, "log_ent_coef": np.zeros(2)}, "another network"),
    (lambda tensors: {n: v for n, v in tensors.items() if n != "policy.actor.mu.bias"}, "another network"),
    (lambda tensors: {n: v for n, v in tensors.items() if n != "adam.critic.0.exp_avg"}, "another network"),
    (lambda tensors: {n: v for n, v in tensors.items() if n != "buffer.rewards"}, "buffer.rewards"),
    (lambda tensors: {**tensors, "buffer.rewards": tensors["buffer.rewards"] * np.inf}, "buffer.rewards"),
])  # fmt: skip
def test_a_damaged_checkpoint_changes_nothing(tmp_path, made, change, match):
    model, settings = made(steps=24)
    off_policy.save(tmp_path, model, settings, 1.0)
    tensors, record = load_set(tmp_path / FILE, KIND)
    kept = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    save_set(tmp_path / FILE, KIND, *edited(tensors, kept, change))
    other, _ = made(steps=0)
    before = {name: value.clone() for name, value in other.policy.state_dict().items()}
    with pytest.raises(ValueError, match=f"{FILE}.*{match}"):
        off_policy.restore(tmp_path, other, settings)
    assert all((before[name] == value).all() for name, value in other.policy.state_dict().items())
    assert other.num_timesteps == 0 and other.replay_buffer.size() == 0


def test_what_is_not_finite_is_not_written(tmp_path, made):
    model, settings = made(steps=24)
    with torch.no_grad():
        model.actor.mu.bias[0] = np.nan
    with pytest.raises(Diverged, match="actor.mu.bias"):
        off_policy.save(tmp_path, model, settings, 1.0)
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
        off_policy.make_model(settings, sac_run.make_env(settings))
    with pytest.raises(ValueError, match="^observation: got 'state'; allowed: 'goal'"):
        sac_run.make_env(settings_of(environment={"observation": "state"}))


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
