"""Offline learning: cloning succeeds on unseen episodes, and IQL's values are those of the paper."""

import math

import pytest
import torch
import yaml

from agents.checkpoint import KIND, VERSION
from agents.offline import Offline
from agents.train import train
from agents.training_file import settings_from
from agents.transitions import Transitions
from vibgym.policies.trained.storage import load_set

pytestmark = pytest.mark.usefixtures("one_thread")

DATA = "vibgym/align/pose-v0"
RATES = {"learning_rate": 5e-3, "final_learning_rate": 5e-5, "tau": 0.05}
NETWORK = {"turned": True, "remembers": True, "blind": ["position"], "activation": "relu"}


def settings_of(directory, **changes):
    own = {"dataset": DATA, "directory": str(directory), "batch_size": 256, **NETWORK, **changes.pop("offline", {})}
    given = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": "offline", "steps": 200, "offline": own}
    return settings_from({**given, **changes})


def test_cloning_succeeds_on_unseen_episodes(recorded, tmp_path):
    config = tmp_path / "run.yaml"
    network = {"batch_size": 512, "learning_rate": 2e-3}
    given = settings_of(recorded, steps=900, judging={"episodes": 50, "every": 10_000}, offline=network)
    config.write_text(yaml.safe_dump(given.model_dump(exclude_none=True)))
    path = train(config, tmp_path / "run", quiet=True)
    assert float((tmp_path / "run" / "curve.csv").read_text().splitlines()[-1].split(",")[3]) > 0.7
    _, written = load_set(path, "vibgym-policy", 2)
    assert written["training"]["data"]["dataset"] == DATA and len(written["training"]["data"]["sha256"]) == 64


@pytest.mark.parametrize("method", ["cloning", "iql"])
def test_a_stopped_run_ends_with_the_same_weights(recorded, tmp_path, method):
    config, small = tmp_path / "run.yaml", {"method": method, "net": [8], "critic_net": [8], "batch_size": 32}

    def weights(name, stop=False):
        given = settings_of(recorded, steps=300, checkpoint_steps=100, offline=small)
        config.write_text(yaml.safe_dump(given.model_dump(exclude_none=True)))
        update = Offline._update

        def stopping(self, step):
            if step == 250:
                raise KeyboardInterrupt
            return update(self, step)

        if stop:
            with pytest.MonkeyPatch.context() as patch, pytest.raises(KeyboardInterrupt):
                patch.setattr(Offline, "_update", stopping)
                train(config, tmp_path / name, quiet=True)
        train(config, tmp_path / name, quiet=True)
        return load_set(tmp_path / name / "checkpoint.json", KIND, VERSION)[0]

    whole, stopped = weights("whole"), weights("stopped", stop=True)
    assert whole.keys() == stopped.keys() and all((whole[each] == stopped[each]).all() for each in whole)


def learned(recorded, updates=1200, samples=4000, **changes):
    """Learn from one state with two equally frequent actions, one of which is worth 1 more; episodes end at once.

    Returns:
        The action, the state's value and the actions' values.
    """
    own = {"method": "iql", "batch_size": 128, "net": [16], "critic_net": [16], "floor": 10.0, **RATES, **changes}
    learner = Offline(settings_of(recorded, steps=updates, offline=own))
    data, good = learner.data, torch.arange(samples) % 2 == 0
    action = torch.where(good[:, None, None], 0.5, -0.5) * torch.ones(1, 1, 3)
    rows, mask = data.rows[:1].expand(samples + 1, -1, -1), data.mask[:1].expand(samples + 1, -1)
    learner.data = Transitions(rows, mask, torch.arange(samples), action, good.float(), torch.ones(samples), data.facts)
    torch.manual_seed(0)
    for step in range(updates):
        learner._update(step)
    with torch.no_grad():
        mean, value = learner.policy.actor(rows[:1])[0].mean(), learner.policy.critic(rows[:1], mask[:1]).item()
        worth = None if learner.values is None else learner.values(rows[:2], mask[:2], action[:2]).mean(0)[:, 0]
    learner.close()
    return float(mean), value, worth


@pytest.mark.parametrize("expectile", [0.6, 0.9])
def test_values_are_those_of_the_paper(recorded, expectile):
    """Kostrikov et al. 2021: a state's value is an expectile of its actions' values; of 1 and 0, equally frequent, it is the
    expectile itself. Cloning gives the mean of the two actions; weights exp(advantage / temperature) are Boltzmann's.
    """
    action, value, worth = learned(recorded, expectile=expectile, temperature=2.0)
    assert worth == pytest.approx([1.0, 0.0], abs=0.02) and value == pytest.approx(expectile, abs=0.02)
    # Advantages differ by 1, whose standard deviation over both actions is 1/2: weights differ by a factor of e.
    share = math.e / (1.0 + math.e)
    assert action == pytest.approx(0.5 * (2.0 * share - 1.0), abs=0.02)
    assert learned(recorded, method="cloning", updates=500)[0] == pytest.approx(0.0, abs=0.02)
