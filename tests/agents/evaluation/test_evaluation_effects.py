"""The study of which effect breaks whom: its numbers against rollouts of their own, and where it is shown."""

import json
import re

import numpy as np
import pytest
from agents.evaluation.log import Log
from agents.evaluation.report.effects import cell_of

from agents import evaluation
from agents.evaluation import tables
from tests.agents.evaluation.conftest import Pusher, Shepherd, Still
from vibgym.policies.rollout import Ends, Outcomes, rollout

OFF = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}
CASES = {"none": {}, "latency": {"actuators": {**OFF, "latency": 4}}, "all dead": {"actuators": {**OFF, "dead": 1.0}}}
SENSOR = {"kind": "pose", "noise": 0.0, "delay": 5}


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    """Results with a study of two policies, one of them with another sensor besides."""
    settings = evaluation.settings_from(
        {
            "tasks": ["Transport"],
            "policies": [Still(), Pusher()],
            "episodes": 8,
            "first_seed": 300,
            "resamples": 100,
            "animations": False,
            "output": str(tmp_path_factory.mktemp("effects")),
            "effects": {
                "task": "Transport",
                "policies": ["pusher", {"policy": "pusher", "name": "late <eyes>", "sensor": SENSOR}, "still <&>"],
                "episodes": 6,
                "cases": CASES,
            },
        }
    )
    return evaluation.evaluate(evaluation.prepare(settings), quiet=True)


@pytest.fixture(scope="module")
def table(study):
    assert study.effects is not None
    return study.effects


@pytest.fixture(scope="module")
def files(study):
    return evaluation.write(study, quiet=True).parent


def test_cells_are_those_of_rollouts(table):
    cells = {(cell.case, cell.policy): cell for cell in table.cells}
    assert list(cells) == [(case, policy) for case in CASES for policy in ("pusher", "late <eyes>", "still <&>")]
    for case, arguments in CASES.items():
        for policy, own in (("pusher", {}), ("late <eyes>", {"sensor": SENSOR})):
            alone = rollout(Pusher(), "Transport", seeds=range(300, 306), **{**arguments, **own})
            assert repr(cells[case, policy]) == repr(cell_of(case, policy, alone, 0.95, 100))  # nan is not nan
            assert cells[case, policy].successes == alone.success.sum()
            assert cells[case, policy].position_error_median_m == np.median(alone.position_error)
    plain, late = cells["none", "pusher"], cells["none", "late <eyes>"]
    assert plain.successes >= 3 and cells["all dead", "pusher"].successes == 0  # else this has shown little
    assert late.position_error_median_m != plain.position_error_median_m


@pytest.mark.parametrize("task", ["Transport", "Singulate"])
def test_outcomes_are_those_of_a_rollout(task):
    policy = Pusher() if task == "Transport" else Shepherd()
    whole, ends = (rollout(policy, task, seeds=[5, 6, 7], keep=keep) for keep in (Log, Ends))
    for name in Outcomes.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(whole, name), getattr(ends, name))
    assert len(set(ends.steps.tolist())) > 1


def test_seeds_are_the_first_ones(table):
    assert table.seeds == (300, 301, 302, 303, 304, 305)
    assert {cell.episodes for cell in table.cells} == {6}


def test_episodes_from_the_command_line_bound_those_of_the_study():
    data = {
        "tasks": ["Transport"],
        "policies": ["zero"],
        "effects": {"task": "Transport", "policies": ["zero"], "cases": {"none": {}}, "episodes": 6},
    }
    for given, expected in ((4, 4), (9, 6), (None, 6)):
        study = evaluation.prepare(evaluation.settings_from(data, episodes=given)).study
        assert [len(job.seeds) for job in study.values()] == [expected]


def test_json(study, files):
    content = json.loads((files / "results.json").read_text(encoding="utf-8"))
    found = content["effects"]
    assert found["task"] == "Transport" and found["seeds"] == list(range(300, 306)) and found["cases"] == CASES
    assert [(each["case"], each["policy"], each["successes"]) for each in found["results"]] == [
        (cell.case, cell.policy, cell.successes) for cell in study.effects.cells
    ]
    assert len(content["results"]) == 2 and content["settings"]["effects"]["episodes"] == 6


def test_summary(study):
    text = evaluation.summary_table(study).split("\n\n")[-1].splitlines()
    assert text[0] == "| Transport: effect | pusher | late <eyes> | still <&> |"
    assert len(text) == 5 and {line.count("|") for line in text} == {5}
    assert re.fullmatch(r"\| none \| \d+\.\d % \(\d\.\d\d s\) \| .* \| 0\.0 % \|", text[2])


def test_page(table, files):
    text = (files / "report.html").read_text(encoding="utf-8")
    section = text[text.index('id="effects"') : text.index('id="reading"')]
    assert 'href="#effects"' in text and "late &lt;eyes&gt;" in section and "<eyes>" not in section
    assert section.count("<td style=") == len(table.cells)
    assert "latency of 4 periods (160 ms)" in section and "100 % of the elements dead" in section
    assert "5 periods (200 ms) old" in section
    for cell in table.cells:
        assert f"{100 * cell.success_rate:.1f} %" in section
        assert f"background:{tables.colour(cell.success_rate)}" in section


def test_colour_tells_success_from_failure():
    def opacity(share):
        hue, _, alpha = tables.colour(share).removesuffix(")").rpartition(", ")
        return hue, float(alpha)

    assert opacity(1.0)[0] == opacity(0.6)[0] != opacity(0.4)[0] == opacity(0.0)[0]
    assert opacity(1.0)[1] > opacity(0.8)[1] > opacity(0.5)[1] == 0.0 < opacity(0.2)[1] < opacity(0.0)[1] < 0.5
