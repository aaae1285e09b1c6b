"""One evaluation on several hardware models, and the study of effects: which policy runs where, and what the files contain."""

import csv
import json

import numpy as np
import pytest

from agents import evaluation
from agents.evaluation import report
from agents.evaluation.films import Log
from agents.evaluation.settings import laid_over, with_sensor
from tests.agents.evaluation.conftest import Pusher, Still
from vibgym.policies.rollout import rollout

LATE = {"kind": "prototype", "dead_zone": 0.0, "gain_spread": 0.0, "phase_spread": 0.0, "latency": 3}
BROKEN = {"kind": "prototype", "dead": 1.0, "latency": 0}
SENSOR = {"kind": "pose", "noise": 0.0, "delay": 5}
CASES = {"none": {}, "latency": {"actuators": {**LATE, "latency": 4}}, "all dead": {"actuators": {**LATE, "dead": 1.0}}}

DATA = {
    "tasks": ["Transport", "Align"],
    "policies": [{"name": "still", "policy": Still(), "hardware": ["ideal"]}, Pusher()],
    "episodes": 6,
    "first_seed": 300,
    "resamples": 100,
    "animations": False,
    "hardware": {
        "ideal": {},
        "broken": {"actuators": BROKEN, "tasks": ["Transport"], "episodes": 4},
        "late": {"actuators": LATE},
    },
    "effects": {
        "task": "Transport",
        "policies": ["pusher", {"policy": "pusher", "name": "late <eyes>", "sensor": SENSOR}],
        "episodes": 5,
        "cases": CASES,
    },
}

TRIALS = [
    ("Transport", "ideal", "still"),
    ("Transport", "ideal", "pusher"),
    ("Transport", "broken", "pusher"),
    ("Transport", "late", "pusher"),
    ("Align", "ideal", "still"),
    ("Align", "ideal", "pusher"),
    ("Align", "late", "pusher"),
]


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    settings = evaluation.settings_from({**DATA, "output": str(tmp_path_factory.mktemp("machines"))})
    return evaluation.evaluate(evaluation.prepare(settings), quiet=True)


@pytest.fixture(scope="module")
def files(machines):
    return evaluation.write(machines, quiet=True).parent


def test_which_policy_runs_where(machines):
    rows = report.rows(machines)
    assert [(row["task"], row["hardware"], row["policy"]) for row in rows] == TRIALS
    assert [row["episodes"] for row in rows] == [6, 6, 4, 6, 6, 6, 6]
    found = [(each["task"], each["hardware"], each["first"], each["second"]) for each in report.comparisons(machines)]
    assert found == [("Transport", "ideal", "still", "pusher"), ("Align", "ideal", "still", "pusher")]


def test_starts_and_goals_are_the_same_on_all_hardware(machines):
    plain = machines.rollout("Transport", "ideal", "pusher")
    assert plain.success.sum() >= 3  # else this shows little
    for hardware in ("broken", "late"):
        other = machines.rollout("Transport", hardware, "pusher")
        count = len(other.seeds)
        np.testing.assert_array_equal(other.goals, plain.goals[:count])
        np.testing.assert_array_equal(other.poses[:, 0], plain.poses[:count, 0])
    still = machines.rollout("Transport", "ideal", "still")
    np.testing.assert_array_equal(machines.rollout("Transport", "broken", "pusher").poses, still.poses[:4])


def test_same_numbers_as_on_that_hardware_alone(machines):
    alone = rollout(Pusher(), "Align", seeds=range(300, 306), keep=Log, actuators=LATE)
    together = machines.rollout("Align", "late", "pusher")
    np.testing.assert_array_equal(alone.poses, together.poses)
    np.testing.assert_array_equal(alone.returns, together.returns)


def test_effects_are_those_of_rollouts(machines):
    cells = {(cell["case"], cell["policy"]): cell for cell in report.effects_rows(machines)}
    assert list(cells) == [(case, policy) for case in CASES for policy in ("pusher", "late <eyes>")]
    for case, arguments in CASES.items():
        for policy, own in (("pusher", {}), ("late <eyes>", {"sensor": SENSOR})):
            alone = rollout(Pusher(), "Transport", seeds=range(300, 305), **{**arguments, **own})
            assert (cells[case, policy]["episodes"], cells[case, policy]["successes"]) == (5, alone.success.sum())
            assert cells[case, policy]["position_error_median_m"] == np.median(alone.position_error)
    assert cells["none", "pusher"]["successes"] > cells["all dead", "pusher"]["successes"] == 0


def test_files(machines, files):
    for name, count in (("results.csv", 7), ("episodes.csv", 6 + 6 + 4 + 6 + 3 * 6)):
        with (files / name).open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == count and list(rows[0])[:3] == ["task", "hardware", "policy"]
        assert list(dict.fromkeys((row["task"], row["hardware"], row["policy"]) for row in rows)) == TRIALS
    content = json.loads((files / "results.json").read_text(encoding="utf-8"))
    assert content["hardware"] == {"ideal": {}, "broken": {"actuators": BROKEN}, "late": {"actuators": LATE}}
    assert content["settings"]["policies"]["still"]["hardware"] == ["ideal"]
    effects = content["effects"]
    assert effects["seeds"] == list(range(300, 305)) and effects["cases"] == CASES and len(effects["episodes"]) == 30
    summary = evaluation.summary_table(machines).splitlines()
    assert summary[0].startswith("| task | hardware | policy |")
    assert summary[4].startswith("| Transport | broken | pusher | 0.0 % (")


def test_page_shows_hardware_as_yaml_and_effects(files):
    text = (files / "report.html").read_text(encoding="utf-8")
    assert "latency: 3" in text
    assert text.count('id="card-') == len(TRIALS)
    section = text[text.index('<h2 id="effects"') : text.index('<h2 id="Transport"')]
    assert "late &lt;eyes&gt;" in section and "<eyes>" not in section and "delay: 5" in section
    assert section.count("<td style=") == 6


def test_number_of_episodes_of_the_command_line():
    for given, expected in ((5, {"ideal": 5, "broken": 4, "late": 5}), (3, {"ideal": 3, "broken": 3, "late": 3})):
        cases = evaluation.prepare(evaluation.settings_from(DATA, episodes=given)).cases
        main = {case.place.hardware: len(case.seeds) for case in cases if case.place.study == "report"}
        assert main == expected
        assert {len(case.seeds) for case in cases if case.place.study == "effects"} == {given}


def test_hardware_replaces_arguments_of_the_environment():
    environment = {"surface": "prototype", "actuators": "ideal", "randomize": {"parts": [1, 3], "friction": [1, 2]}}
    over = laid_over(environment, {"actuators": BROKEN, "randomize": {"friction": [0.9, 1.1]}})
    assert over == {"surface": "prototype", "actuators": BROKEN, "randomize": {"parts": [1, 3], "friction": [0.9, 1.1]}}
    assert laid_over({"randomize": {"parts": [1, 3]}}, {"randomize": None}) == {"randomize": None}
    assert with_sensor({}, {"estimator": "model"}) == {"sensor": {"kind": "ideal", "estimator": "model"}}
    noisy = {"kind": "pose", "noise": [0.1, 0.2], "estimator": "none"}
    assert with_sensor({"sensor": noisy}, {"estimator": "model"})["sensor"] == {**noisy, "estimator": "model"}


def test_a_film_of_any_hardware(tmp_path):
    settings = evaluation.settings_from({**DATA, "output": str(tmp_path)})
    for hardware, expected in ((None, "ideal"), ("late", "late")):
        film = evaluation.prepare(settings, evaluation.Gif("Align", "pusher", tmp_path / "a.gif", hardware)).film
        assert film == (("report", "Align", expected, "pusher"), tmp_path / "a.gif")
    with pytest.raises(ValueError, match=r"--gif POLICY"):
        evaluation.prepare(settings, evaluation.Gif("Align", "still", tmp_path / "a.gif", "late"))
