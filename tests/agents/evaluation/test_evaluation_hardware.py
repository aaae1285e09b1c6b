"""One evaluation on several machines: which runs where, and what the files say of it."""

import csv
import json

import numpy as np
import pytest
from agents.evaluation.entries import laid_over, with_sensor
from agents.evaluation.log import Log
from agents.evaluation.records import Trial

from agents import evaluation
from tests.agents.evaluation.conftest import Pusher, Still
from vibgym.policies.rollout import rollout

BROKEN = {"kind": "prototype", "dead": 1.0, "latency": 0}
LATE = {"kind": "prototype", "dead_zone": 0.0, "gain_spread": 0.0, "phase_spread": 0.0, "latency": 3}

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
}


@pytest.fixture(scope="module")
def machines(tmp_path_factory):
    """Results of two policies on two tasks and three machines."""
    directory = tmp_path_factory.mktemp("machines")
    settings = evaluation.settings_from({**DATA, "output": str(directory)})
    return evaluation.evaluate(evaluation.prepare(settings), quiet=True)


@pytest.fixture(scope="module")
def files(machines):
    return evaluation.write(machines, quiet=True).parent


def test_what_runs_where(machines):
    assert list(machines.rollouts) == [
        ("Transport", "ideal", "still"),
        ("Transport", "ideal", "pusher"),
        ("Transport", "broken", "pusher"),
        ("Transport", "late", "pusher"),
        ("Align", "ideal", "still"),
        ("Align", "ideal", "pusher"),
        ("Align", "late", "pusher"),
    ]
    assert [(row.task, row.hardware, row.policy) for row in machines.rows] == list(machines.rollouts)
    assert [row.episodes for row in machines.rows] == [6, 6, 4, 6, 6, 6, 6]
    assert machines.rollouts[Trial("Transport", "broken", "pusher")].seeds == (300, 301, 302, 303)


def test_starts_and_goals_are_the_same_on_all_hardware(machines):
    plain = machines.rollouts[Trial("Transport", "ideal", "pusher")]
    for hardware in ("broken", "late"):
        other = machines.rollouts[Trial("Transport", hardware, "pusher")]
        count = len(other.seeds)
        np.testing.assert_array_equal(other.goals, plain.goals[:count])
        np.testing.assert_array_equal(other.poses[:, 0], plain.poses[:count, 0])


def test_a_machine_whose_elements_are_all_dead_does_what_no_command_does(machines):
    broken, still = (
        machines.rollouts[Trial("Transport", "broken", "pusher")],
        machines.rollouts[Trial("Transport", "ideal", "still")],
    )
    np.testing.assert_array_equal(broken.poses, still.poses[:4])
    assert machines.rollouts[Trial("Transport", "ideal", "pusher")].success.sum() >= 3  # else this has shown little


def test_same_numbers_as_on_that_hardware_alone(machines):
    alone = rollout(Pusher(), "Align", seeds=range(300, 306), keep=Log, actuators=LATE)
    together = machines.rollouts[Trial("Align", "late", "pusher")]
    np.testing.assert_array_equal(alone.poses, together.poses)
    np.testing.assert_array_equal(alone.returns, together.returns)
    first = np.abs(together.poses[:, 1:6] - machines.rollouts[Trial("Align", "ideal", "pusher")].poses[:, 1:6]).max()
    assert first > 1e-4  # the latency shows


def test_comparisons_stay_on_one_machine(machines):
    found = [(each.task, each.hardware, each.first, each.second) for each in machines.comparisons]
    assert found == [("Transport", "ideal", "still", "pusher"), ("Align", "ideal", "still", "pusher")]


def test_tables(machines, files):
    for name, count in (("results.csv", 7), ("episodes.csv", 6 + 6 + 4 + 6 + 3 * 6)):
        with (files / name).open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert len(rows) == count and list(rows[0])[:3] == ["task", "hardware", "policy"]
        assert list(dict.fromkeys((row["task"], row["hardware"], row["policy"]) for row in rows)) == list(
            machines.rollouts
        )
    content = json.loads((files / "results.json").read_text(encoding="utf-8"))
    assert list(content["hardware"]) == ["ideal", "broken", "late"]
    assert any("100 % of the elements" in sentence for sentence in content["hardware"]["broken"])
    assert content["settings"]["hardware"]["late"] == {"actuators": LATE}
    assert content["settings"]["policies"]["still"]["hardware"] == ["ideal"]
    assert [each["hardware"] for each in content["results"]] == [trial.hardware for trial in machines.rollouts]
    summary = evaluation.summary_table(machines).splitlines()
    assert summary[0].startswith("| task | hardware | policy |")
    assert summary[4].startswith("| Transport | broken | pusher | 0.0 % |")


def test_page(machines, files):
    text = (files / "report.html").read_text(encoding="utf-8")
    words = " ".join(text.split())
    assert 'id="hardware"' in text and 'href="#hardware"' in text
    for heading in ("On ideal hardware", "On broken hardware", "On late hardware"):
        assert text.count(f">{heading}</h3>") == 1 + (heading != "On broken hardware")
    assert "broken hardware<small>4 episodes</small>" in text
    assert "A command takes effect 3 periods (120 ms) late." in words
    assert "Share of the 4 episodes that have" in words
    assert "No result on this page comes from a real machine." in words
    assert text.count('<article id="card-') == len(machines.rollouts)


def test_one_machine_is_not_spoken_of(written, found):
    """Of the evaluation of other tests, where nothing is said of hardware."""
    text = (written / "report.html").read_text(encoding="utf-8")
    body = text[text.index("</style>") :]
    assert "ardware" not in body[: body.index('id="origin"')] and 'id="effects"' not in body
    assert "hardware" not in evaluation.summary_table(found)
    content = json.loads((written / "results.json").read_text(encoding="utf-8"))
    assert list(content["hardware"]) == ["ideal"] and "effects" not in content
    assert content["settings"]["hardware"] == {"ideal": {}}


def test_the_only_machine_is_called_what_it_is():
    data = {"tasks": ["Transport"], "policies": ["zero"]}
    assert [each.name for each in evaluation.settings_from(data).machines()] == ["ideal"]
    data |= {"environment": {"actuators": LATE}}
    assert [each.name for each in evaluation.settings_from(data).machines()] == ["own"]


def test_fewer_episodes_from_the_command_line_are_those_of_all_hardware():
    settings = evaluation.settings_from(DATA, episodes=5)
    jobs = evaluation.prepare(settings).jobs
    assert {trial.hardware: len(job.seeds) for trial, job in jobs.items()} == {"ideal": 5, "broken": 4, "late": 5}
    jobs = evaluation.prepare(evaluation.settings_from(DATA, episodes=3)).jobs
    assert {len(job.seeds) for job in jobs.values()} == {3}


def test_hardware_lies_over_the_environment():
    environment = {"surface": "prototype", "actuators": "ideal", "randomize": {"parts": [1, 3], "friction": [1, 2]}}
    over = laid_over(environment, {"actuators": BROKEN, "randomize": {"friction": [0.9, 1.1]}})
    assert over == {"surface": "prototype", "actuators": BROKEN, "randomize": {"parts": [1, 3], "friction": [0.9, 1.1]}}
    assert environment["randomize"] == {"parts": [1, 3], "friction": [1, 2]}
    assert laid_over({"randomize": {"parts": [1, 3]}}, {"randomize": None}) == {"randomize": None}
    assert with_sensor({}, {}) == {}
    assert with_sensor({}, {"estimator": "model"}) == {"sensor": {"kind": "ideal", "estimator": "model"}}
    noisy = {"kind": "pose", "noise": [0.1, 0.2], "estimator": "none"}
    assert with_sensor({"sensor": noisy}, {"estimator": "model"})["sensor"] == {**noisy, "estimator": "model"}


def test_a_film_of_any_hardware(tmp_path):
    settings = evaluation.settings_from({**DATA, "output": str(tmp_path)})
    for hardware, expected in ((None, "ideal"), ("late", "late")):
        film = evaluation.prepare(settings, evaluation.Gif("Align", "pusher", tmp_path / "a.gif", hardware)).film
        assert film == (("Align", expected, "pusher"), tmp_path / "a.gif")
    with pytest.raises(ValueError, match=r"--gif POLICY"):
        evaluation.prepare(settings, evaluation.Gif("Align", "still", tmp_path / "a.gif", "late"))
