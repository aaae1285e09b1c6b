"""Tuning: a study does not depend on interruptions."""

import pytest
import yaml

from agents import tune

SETTINGS = {
    "task": "Transport", "environment": {"action": "wrench"}, "worlds": 8, "steps": 256, "checkpoint_steps": 128,
    "selection": {"episodes": 4, "every": 128},
    "ppo": {"n_steps": 8, "batch_size": 64, "n_epochs": 1, "net": [8], "critic_net": [8]},
    "tuning": {"trials": 3, "startup": 1, "space": {"ppo.learning_rate": {"low": 1.0e-4, "high": 1.0e-2, "log": True}}},
}  # fmt: skip

pytestmark = pytest.mark.usefixtures("one_thread")


def test_a_study_continues_and_is_the_same(tmp_path):
    config = tmp_path / "tuned.yaml"
    config.write_text(yaml.safe_dump(SETTINGS))
    whole, best = tune.tune(config, output=tmp_path / "whole", quiet=True, processes=1)
    tune.tune(config, trials=2, output=tmp_path / "parts", quiet=True, processes=1)
    parts, again = tune.tune(config, output=tmp_path / "parts", quiet=True, processes=1)
    assert whole.read_text() == parts.read_text() and best is not None
    assert (best.number, best.params, best.value) == (again.number, again.params, again.value)
    config.write_text(yaml.safe_dump({**SETTINGS, "seed": 5}))
    with pytest.raises(ValueError, match="settings"):
        tune.tune(config, output=tmp_path / "whole", quiet=True, processes=1)
