"""Tuning: the same study whatever happens to it on the way."""

import json
import re

import optuna
import pytest
import yaml

from agents import __main__ as command
from agents.tuning import study as studies
from agents.tuning.settings import Tuning
from agents.tuning.study import STUDY, best, proposed
from agents.tuning.trial import Tried
from agents.tuning.tune import tune

SETTINGS = {
    "task": "Transport", "environment": {"action": "wrench"}, "worlds": 8, "steps": 512, "checkpoint_steps": 128,
    "imitation": {"expert": {"kind": "pose", "action": "wrench"}, "rounds": 1, "steps": 20, "epochs": 1},
    "judging": {"episodes": 4, "every": 160},
    "ppo": {"n_steps": 8, "batch_size": 64, "n_epochs": 1, "net": [8], "critic_net": [8]},
    "tuning": {
        "trials": 5, "startup": 2,
        "space": {
            "ppo.learning_rate": {"low": 1.0e-4, "high": 1.0e-2, "log": True}, "ppo.n_epochs": {"low": 1, "high": 3},
            "ppo.activation": ["tanh", "relu"],
        },
    },
}  # fmt: skip


pytestmark = pytest.mark.usefixtures("one_thread")


def written(tmp_path, **tuning):
    path = tmp_path / "tuned.yaml"
    path.write_text(yaml.safe_dump({**SETTINGS, "tuning": {**SETTINGS["tuning"], **tuning}}))
    return path


def study_in(directory):
    """All that a study has found, but for dates."""
    kept = optuna.load_study(storage=f"sqlite:///{directory / STUDY}", study_name=studies.NAME)
    return [(each.number, each.state, each.value, each.params, each.intermediate_values) for each in kept.trials]


def test_a_study_is_the_same_killed_or_not_and_side_by_side(tmp_path, monkeypatch):
    config = written(tmp_path)
    page, found = tune(config, output=tmp_path / "whole", quiet=True, processes=1)
    whole = study_in(tmp_path / "whole")
    assert [each[0] for each in whole] == list(range(5)) and found is not None and found.state == "complete"
    assert min(each[2] for each in whole if each[1].name == "COMPLETE") == found.score
    text = page.read_text(encoding="utf-8")
    assert len(re.findall(r"data:image/png", text)) >= 3 and f"Trial {found.number} is best" in text
    assert len((tmp_path / "whole" / "trials.csv").read_text().splitlines()) == 6

    # Interrupted inside a trial's training, and between a trial and its entry.
    from agents.training.progress import Progress

    stops = [(2, 300), (4, 200)]

    def step(self):
        number = int(self.directory.parent.name.partition("-")[2])
        if stops and number == stops[0][0] and self.num_timesteps >= stops[0][1]:
            stops.pop(0)
            raise KeyboardInterrupt
        return True

    monkeypatch.setattr(Progress, "_on_step", step)
    for _ in range(2):
        with pytest.raises(KeyboardInterrupt):
            tune(config, output=tmp_path / "broken", quiet=True, processes=1)
    tune(config, output=tmp_path / "broken", quiet=True, processes=1)
    assert not stops and study_in(tmp_path / "broken") == whole
    monkeypatch.undo()
    tune(config, output=tmp_path / "two", quiet=True, processes=2)
    assert study_in(tmp_path / "two") == whole


def test_more_trials_go_on_and_other_settings_are_refused(tmp_path, capsys):
    config = written(tmp_path, trials=2)
    assert command.main(["tune", str(config), "--output", str(tmp_path / "s"), "--quiet", "--processes", "1"]) == 0
    assert "best: trial" in capsys.readouterr().out
    before = study_in(tmp_path / "s")
    arguments = ["tune", str(config), "--trials", "3", "--output", str(tmp_path / "s"), "--quiet", "--processes", "1"]
    assert (
        command.main(arguments) == 0 and study_in(tmp_path / "s")[:2] == before and len(study_in(tmp_path / "s")) == 3
    )
    capsys.readouterr()
    written(tmp_path, trials=2, startup=1)
    assert command.main(arguments) == 2
    line = capsys.readouterr().err
    assert "tuning.startup" in line and "same settings" in line and line.count("\n") == 1


@pytest.mark.parametrize("tuning, named", [
    ({"space": {}}, "space"), ({"space": {"ppo.learning_rate": {"low": 1.0}}}, "space.ppo.learning_rate"),
    ({"space": {"ppo.speed": [1, 2]}}, "ppo.*speed"), ({"space": {"ppo.net": {"low": 2, "high": 1}}}, "space.ppo.net"),
    ({"space": {"ppo.learning_rate": [2.0]}}, "learning_rate"), ({"trials": 0}, "trials"), ({"wish": 1}, "wish"),
    ({"judging": {"episodes": 0}}, "episodes"),
])  # fmt: skip
def test_bad_settings_are_refused_by_name(tmp_path, tuning, named):
    with pytest.raises(ValueError, match=named):
        Tuning(written(tmp_path, **tuning))


def test_what_is_proposed_depends_on_nothing_but_what_was_found(tmp_path):
    tuning = Tuning(written(tmp_path))
    values = [proposed(tuning, number, []) for number in range(20)]
    assert values == [proposed(tuning, number, []) for number in range(20)]
    assert len({json.dumps(each) for each in values}) == 20
    found = [Tried(k, each, "complete", abs(each["ppo.learning_rate"] - 1e-3), {}) for k, each in enumerate(values)]
    later = [proposed(tuning, 20 + k, found) for k in range(20)]
    assert sum(3e-4 < each["ppo.learning_rate"] < 3e-3 for each in later) > 14  # where it is good
    assert best(found) == min(found, key=lambda each: each.score)


def test_a_file_without_a_space_is_refused(tmp_path):
    path = tmp_path / "plain.yaml"
    path.write_text(yaml.safe_dump({key: value for key, value in SETTINGS.items() if key != "tuning"}))
    with pytest.raises(ValueError, match="plain.yaml: tuning: got None; allowed: a mapping with 'space'"):
        Tuning(path)
