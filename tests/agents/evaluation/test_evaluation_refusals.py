"""Bad settings, files and places: one line that names the setting and the value, and nothing is written."""

import os

import gymnasium as gym
import pytest
import yaml

from agents import __main__ as command
from agents.evaluation import EvaluationSettings, prepare
from agents.locks import one_run
from tests.agents.evaluation.conftest import Pusher
from tests.commands import file_at, folder_at, refusal, saved

GOOD = {
    "evaluate": {"tasks": ["Rotate"], "policies": ["zero", "local_field"], "episodes": 3, "animations": False},
    "compare": {"tasks": ["Rotate"], "policies": ["zero"], "episodes": 2},
    "score": {"tasks": ["Transport", "Feed"], "policies": ["zero"], "episodes": 3, "training_steps": 1000},
}
SHORT = {
    "FAST": "model: {kind: planar, contacts: fast}",
    "SEEDED": "kind: trained, path: '{seed}.json', training_seeds:",
    "ROTATE": "task: Rotate, policies: [zero], cases:",
    "STUDY": "name: m, task: Rotate, policies: [zero], cases:",
    "FEED": "tasks: [Feed], policies: [zero, lanes]",
    "LOAD": "task: Feed, policies: [lanes], parts: [6], episodes: 1",
}

# Command, changes of its settings (YAML, with abbreviations), and words of the error.
BAD = """
evaluate | tasks: [Stack] | evaluation.tasks[0] 'Stack'
evaluate | tasks: [Align, Align] | evaluation.tasks 'Align'
evaluate | policies: [fuzzy] | (fuzzy on Rotate 'fuzzy'
evaluate | tasks: [Rotate, Sort], policies: [zero, {kind: open_loop, tasks: [Sort]}] | (open_loop on Sort
evaluate | tasks: [Sort], policies: [zero, open_loop] | 'open_loop' Sort: one part
evaluate | tasks: [Rotate, Sort], policies: [{kind: zero, tasks: [Rotate]}] | evaluation.tasks 'Sort'
evaluate | policies: [{policy: zero}] | policies[0] zero
evaluate | policies: [zero, {name: zero, kind: random}] | policies.1.name 'zero'
evaluate | policies: [{kind: trained, path: 'nowhere/{task}.json'}] | nowhere/rotate.json
evaluate | policies: ["a\\0.json"] | policies a
evaluate | episodes: null, seeds: [1, 2], task_episodes: {Rotate: 3} | task_episodes.Rotate 3
evaluate | episodes: null, seeds: [1, 1] | evaluation.seeds 1
evaluate | environment: {action: patch} | evaluation.environment 'action'
evaluate | environment: {FAST}, tasks: [Sort] | contacts='fast'
evaluate | hardware: {a: {walls: []}} | evaluation.hardware a walls
evaluate | hardware: {a: {}, b: {}}, policies: [{kind: zero, hardware: [a]}] | evaluation.hardware.b
evaluate | hardware: {a: {}}, policies: [{kind: zero, hardware: [ideal]}] | policies.0.hardware 'ideal'
evaluate | hardware: {a: {tasks: [Sort]}} | evaluation.hardware.a.tasks 'Sort'
evaluate | hardware: {one: {}, other: {FAST}}, tasks: [Sort] | hardware.other contacts='fast'
evaluate | effects: {ROTATE {none: {}}, policies: [pid]} | evaluation.effects.policies.0 'pid'
evaluate | effects: {ROTATE {none: {}}, task: Align} | evaluation.effects.task 'Align'
evaluate | effects: {ROTATE {dust: {actuators: {kind: prototype, dust: 1}}}} | evaluation.effects.cases.dust 'dust'
evaluate | effects: {ROTATE {none: {}}, policies: [{policy: zero, sensor: {zoom: 2}}]} | evaluation.effects zoom
evaluate | FEED, under_load: {LOAD, task: Sort} | evaluation.under_load.task 'Sort'
evaluate | FEED, under_load: {LOAD, policies: [magic]} | under_load.policies 'magic'
evaluate | FEED, under_load: {LOAD, parts: [4, 4]} | evaluation.under_load.parts 4
evaluate | under_load: {LOAD, task: Rotate, policies: [zero]} | evaluation.under_load.task 'Rotate'
evaluate | policies: [{SEEDED [1, 2]}] | policies.0.training_seeds tasks,
evaluate | policies: [{kind: zero, episodes: 2}] | policies.0.episodes tasks,
compare | policies: [{kind: zero, training_steps: 5}] | policies.0.training_steps tasks,
score | held_out: false | 'held_out'
compare | policies: [{kind: zero, group: best}] | policies[0].group 'best' hybrid
compare | policies: [{SEEDED [1]}] | policies[0].training_seeds 2
compare | policies: [{SEEDED [1, 1]}] | policies[0].training_seeds 1
compare | policies: [{kind: zero, training_seeds: [1, 2]}] | training_seeds classical
compare | policies: [{kind: trained, path: a.json, training_seeds: [1, 2]}] | policies[0] (policy) {seed}
compare | policies: [{kind: trained, path: '{seed}.json'}] | policies[0] (policy) training_seeds
compare | policies: [{SEEDED [1, 2], curve: a.csv}] | policies[0] (curve) {seed}
compare | policies: [{kind: zero, curve: nowhere.csv}] | comparison.policies (zero).curve nowhere.csv
compare | generalisation: [{STUDY {none: {}}, policies: [pid]}] | generalisation.0.policies.0 'pid'
compare | generalisation: [{STUDY {a: {action: patch}}}] | generalisation[0].cases a 'action' randomize
compare | generalisation: [{STUDY {a: {}}}, {STUDY {b: {}}}] | (name of a study) 'm'
compare | policies: [open_loop], generalisation: [{STUDY {a: {task: Sort}}, policies: [open_loop]}] | .0.policies 'open_loop'
compare | policies: [zero, pose], ladders: [{name: l, task: Rotate, policies: [zero, pose]}] | ladders.0.policies curve
compare | ladders: [{name: l, task: Rotate, policies: [zero]}] | ladders[0].policies 2
compare | ladders: [{name: l, task: Align, policies: [zero, pose]}] | ladders.0.task 'Align' Rotate
score | tasks: [Sort] | suite.tasks 'Sort'
score | policies: [{kind: pose, training_steps: 2000}] | suite.policies.0.training_steps 2000
score | policies: [open_loop], tasks: [Feed] | suite.policies 'open_loop'
score | cost_limit: 1.0 | suite.cost_limit environment.costs
score | cost_limit: -1.0, environment: {costs: {effort: 1.0}} | suite.cost_limit -1
"""


@pytest.mark.parametrize("row", BAD.strip().splitlines())
def test_bad_settings(row, tmp_path, capsys):
    name, changes, words = row.split(" | ")
    for short, text in SHORT.items():
        changes = changes.replace(short, text)
    path = saved(tmp_path, GOOD[name], **yaml.load(f"{{{changes}}}", Loader=yaml.SafeLoader))
    before, _, fault = refusal(capsys, command.main, name, path).partition(f"{path}: ")
    assert before == "" and all(word in fault for word in words.split()), fault
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("name", ["\ud800", "a\nb", "", "x" * 41, 3])
def test_bad_names(name):
    policies = [{"kind": "zero", "name": name}]
    if isinstance(name, str):
        policies += [type("Own", (Pusher,), {"name": name * 2})(), *([f"{name * 2}.json"] if name else [])]
    for policy in policies:
        with pytest.raises(ValueError, match=r"policies\[0\].*name"):
            EvaluationSettings.checked({"tasks": ["Transport"], "policies": [policy]})


def test_an_episode_without_an_end_is_refused(monkeypatch):
    entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": "vibgym.envs:VibgymVectorEnv"}
    spec = gym.envs.registration.EnvSpec("endless/Feed-v0", kwargs={"task": "Feed"}, **entry)
    monkeypatch.setitem(gym.registry, "endless/Feed-v0", spec)
    with pytest.raises(ValueError, match="'endless/Feed-v0'"):
        prepare(EvaluationSettings.checked({"tasks": ["endless/Feed-v0"], "policies": ["zero"]}))


@pytest.mark.parametrize("text, named", [
    ("{colour: 1}", "kind"), ("{kind: magic}", "magic"), ("[1]", "mine.yaml"), ("{kind: zero, name: 3}", "name"),
])  # fmt: skip
def test_bad_files_of_policies(tmp_path, capsys, text, named):
    own, suite = tmp_path / "mine.yaml", folder_at(tmp_path / "suite")
    own.write_text(text)
    assert named in refusal(capsys, command.main, "score", saved(suite, GOOD["score"]), "--policy", own)


FILM = ["--gif", "Rotate", "zero"]


@pytest.mark.parametrize("make, named", [
    (lambda folder: ["--episodes", "0"], "--episodes"),
    (lambda folder: ["--gif", "Align", "zero", folder / "a.gif"], "--gif TASK"),
    (lambda folder: ["--gif", "Rotate", "nobody", folder / "a.gif"], "--gif POLICY"),
    (lambda folder: [*FILM, folder / "a.gif", "--gif-hardware", "prototype"], "--gif-hardware"),
    (lambda folder: ["--gif-hardware", "ideal"], "--gif-hardware requires --gif"),
    (lambda folder: [*FILM, folder / "out" / "report.html"], "--gif PATH"),
    (lambda folder: ["--output", file_at(folder / "file") / "below"], "evaluation.output"),
    (lambda folder: ["--output", folder_at(folder / "there" / "report.html").parent], "evaluation.output"),
])  # fmt: skip
def test_bad_arguments(make, named, tmp_path, capsys):
    path = saved(tmp_path, GOOD["evaluate"])
    line = refusal(capsys, command.main, "evaluate", path, *make(tmp_path))
    assert named in line and len(line) < 500
    assert not (tmp_path / "file").exists() or (tmp_path / "file").read_text() == "mine"
    assert not (tmp_path / "out").exists() or not any((tmp_path / "out").iterdir())


def test_a_second_evaluation_in_a_directory_is_refused(tmp_path, capsys):
    path, output = saved(tmp_path, GOOD["evaluate"]), folder_at(tmp_path / "out")
    with one_run(output):
        line = refusal(capsys, command.main, "evaluate", path)
        assert "evaluation.output" in line and f"process {os.getpid()} on host" in line
    assert os.listdir(output) == []
