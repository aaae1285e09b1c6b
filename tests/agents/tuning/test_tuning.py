"""Tuning: the same study whatever happens to it on the way."""

import json
import os
import re

import optuna
import pytest
import yaml
from sqlalchemy import event
from sqlalchemy.engine import Engine

import vibgym
from agents import __main__ as command
from agents import locks
from agents.tuning import study as studies
from agents.tuning import tuning_page
from agents.tuning.study import STUDY, best, proposed
from agents.tuning.trial import Tried
from agents.tuning.tune import tune
from agents.tuning.tuning_settings import Tuning
from tests.commands import fill_the_disk
from vibgym.files import write_together

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
    with pytest.raises(ValueError, match="plain.yaml: tuning"):
        Tuning(path)


def test_studies_that_do_not_belong_are_refused_and_stay(tmp_path, capsys, monkeypatch):
    config, folder = written(tmp_path, trials=1), tmp_path / "s"
    arguments = ["tune", str(config), "--output", str(folder), "--quiet", "--processes", "1"]
    monkeypatch.setattr(
        studies, "run_trial", lambda path, agent, number, values, *_: Tried(number, values, "failed", None, {})
    )
    assert command.main(arguments) == 0
    settings, kept = (folder / studies.SETTINGS).read_text(), (folder / STUDY).read_bytes()
    capsys.readouterr()

    def refused(*words):
        assert command.main(arguments) == 2
        line = capsys.readouterr().err
        assert line.count("\n") == 1 and all(word in line for word in words), line

    (folder / studies.SETTINGS).write_text(settings.replace(vibgym.__version__, "0.0.0-other"))
    refused(str(folder), "version.vibgym", "remove it or choose another output")
    (folder / studies.SETTINGS).write_text("[1]")
    refused(studies.SETTINGS, "not readable")
    (folder / studies.SETTINGS).unlink()
    refused(STUDY, "unknown settings")
    assert (folder / STUDY).read_bytes() == kept and not (folder / studies.SETTINGS).exists()
    (folder / studies.SETTINGS).write_text(settings)
    (folder / STUDY).write_bytes(b"no database at all" * 100)
    refused(STUDY, "not readable", "not a database")
    assert (folder / STUDY).read_bytes() == b"no database at all" * 100
    (folder / STUDY).write_bytes(kept)
    with locks.one_run(folder):
        refused("output", str(folder), "no other run is at work", f"process {os.getpid()}")
    assert (folder / STUDY).read_bytes() == kept and (folder / studies.SETTINGS).read_text() == settings


@pytest.mark.parametrize("full", ["trial", "study", "page"])
def test_a_full_disk_ends_tuning_in_one_line_and_it_goes_on(tmp_path, capsys, monkeypatch, full):
    config, folder = written(tmp_path, trials=2), tmp_path / "s"
    arguments = ["tune", str(config), "--output", str(folder), "--quiet", "--processes", "1"]

    def tried(path, agent, number, values, *_):
        if full == "trial":
            write_together({folder / "x": "x"})
        return Tried(number, values, "complete", 1.0 + number, {})

    monkeypatch.setattr(studies, "run_trial", tried)
    with monkeypatch.context() as patch:
        if full == "study":  # as SQLite says it: no page may be added to the file
            assert command.main([*arguments, "--trials", "1"]) == 0

            def small(connection, _):
                pages = connection.execute("PRAGMA page_count").fetchone()[0]
                connection.execute(f"PRAGMA max_page_count = {max(pages, 1)}")

            tried_with = {f"ppo.{number}": "x" * 4000 for number in range(3)}
            patch.setattr(studies.Tried, "frozen", _large(studies.Tried.frozen, tried_with))
            event.listen(Engine, "connect", small)
        elif full == "trial":
            real = studies.write_atomically  # of the settings, after which nothing goes on the disk any more
            patch.setattr(studies, "write_atomically", lambda *a: (real(*a), fill_the_disk(patch)))
        else:
            write = lambda contents: (fill_the_disk(patch), write_together(contents))  # noqa: E731
            patch.setattr(tuning_page, "write_together", write)
        try:
            assert command.main(arguments) == 1
        finally:
            if full == "study":
                event.remove(Engine, "connect", small)
    line = capsys.readouterr().err
    assert line.count("\n") == 1 and ("No space left" in line or "disk is full" in line), line
    assert not [path for path in folder.iterdir() if path.suffix == ".tmp"]
    assert command.main(arguments) == 0 and len(study_in(folder)) == 2


def _large(frozen, more):
    def made(self, space):
        found = frozen(self, space)
        found.set_user_attr("more", more)
        return found

    return made
