"""Every algorithm with declared settings refuses bad ones before anything is written."""

import pytest
import yaml

from agents.train import train
from agents.training_file import load_settings
from tests.contracts.entries import is_one_line

TINY = {"worlds": 4, "steps": 320, "checkpoint_steps": 96, "judging": {"episodes": 3, "every": 100}}
RUNS = {
    "offline": {
        "worlds": 1,
        "offline": {"dataset": "vibgym/align/pose-v0", "method": "iql", "batch_size": 32, "net": [8], "critic_net": [8],
                    "remembers": True},
    },
    "ppo": {"ppo": {"n_steps": 16, "batch_size": 64, "n_epochs": 2, "net": [8], "critic_net": [8], "target_kl": 0.02}},
}  # fmt: skip
"""What makes it tiny, by name; one that is not here runs as it comes."""

pytestmark = [pytest.mark.usefixtures("one_thread"), pytest.mark.parametrize("algorithm", ("ppo", "offline"))]


def settings_of(algorithm, recorded):
    settings = {"task": "Align", "environment": {"action": "wrench"}, "algorithm": algorithm, **TINY}
    settings |= RUNS.get(algorithm, {})
    if "offline" in settings:
        settings["offline"] = {**settings["offline"], "directory": str(recorded)}
    return settings


@pytest.mark.parametrize("bad", ["colour", "learning_rate"])
def test_bad_settings_are_refused_by_name_before_anything_is_written(algorithm, bad, tmp_path, recorded):
    settings = settings_of(algorithm, recorded)
    settings[algorithm] = {**settings.get(algorithm, {}), bad: -1}
    config = tmp_path / "run.yaml"
    config.write_text(yaml.safe_dump(settings))
    for load in (load_settings, lambda path: train(path, tmp_path / "run", quiet=True)):
        with pytest.raises(ValueError) as error:
            load(config)
        assert is_one_line(str(error.value), str(config), algorithm, bad)
    assert not (tmp_path / "run").exists()
