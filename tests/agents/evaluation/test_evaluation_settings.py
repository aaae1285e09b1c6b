"""Which policies run on which tasks, and how often."""

import pytest

from agents import evaluation
from agents.evaluation import compare, score
from agents.evaluation.settings import ComparisonSettings
from tests.agents.evaluation.conftest import Pusher, Shepherd


def settings(**changes):
    return evaluation.settings_from({"tasks": ["Transport", "Sort"], "policies": ["zero"], "first_seed": 9, **changes})


def test_episodes_of_a_task():
    found = settings(episodes=5, task_episodes={"Sort": 2})
    assert found.seed_list() == found.seed_list("Transport") == [9, 10, 11, 12, 13]
    assert found.seed_list("Sort") == [9, 10]
    found = settings(first_seed=None, seeds=[7, 3, 5], task_episodes={"Sort": 1})
    assert found.seed_list("Transport") == [7, 3, 5] and found.seed_list("Sort") == [7]
    assert len(settings().seed_list("Sort")) == 100


def test_episodes_from_the_command_line_are_those_of_all_tasks():
    data = {"tasks": ["Transport", "Sort"], "policies": ["zero"], "episodes": 5, "task_episodes": {"Sort": 3}}
    found = evaluation.settings_from(data, episodes=4)
    assert len(found.seed_list("Transport")) == len(found.seed_list("Sort")) == 4


def test_a_policy_runs_on_its_tasks_or_on_all_that_it_serves():
    prepared = evaluation.prepare(
        settings(
            policies=[
                "open_loop",
                {"name": "mine", "policy": Pusher(), "tasks": ["Transport"]},
                Shepherd(),
                {"kind": "zero", "name": "still", "tasks": ["Sort"]},
                {"kind": "local_field", "name": "local_fields", "tasks": ["Sort"]},
                "zero",
            ]
        )
    )
    pairs = [
        ("Transport", "open_loop"),
        ("Transport", "mine"),
        ("Transport", "shepherd"),  # nobody knows what an object serves
        ("Transport", "zero"),
        ("Sort", "shepherd"),
        ("Sort", "still"),
        ("Sort", "local_fields"),
        ("Sort", "zero"),
    ]
    assert [(case.place.task, case.place.policy) for case in prepared.cases] == pairs


def test_every_environment_can_be_evaluated():
    prepared = evaluation.prepare(settings(tasks=["SortThreeKinds", "SortCrowded"], policies=["local_field"]))
    facts = prepared.tasks["SortThreeKinds"]
    assert facts.kinds == ("steel_block", "aluminium_block", "disc") and facts.step_limit == 750
    assert prepared.scenery["SortThreeKinds"].kinds == (0, 1, 2, 0, 1, 2)
    assert [zone.label for zone in prepared.scenery["SortThreeKinds"].zones] == [
        "steel block",
        "aluminium block",
        "disc",
    ]


def test_one_error_names_what_does_not_fit():
    with pytest.raises(ValueError, match=r"policies \(open_loop on Sort\)"):
        evaluation.prepare(settings(policies=["zero", {"kind": "open_loop", "tasks": ["Sort"]}]))


@pytest.mark.parametrize("name", ["\ud800", "a\nb", "", "x" * 41, 3])
def test_names_that_nothing_can_show_are_refused_before_anything_runs(name):
    with pytest.raises(ValueError, match=r"policies.0.name"):
        settings(policies=[{"kind": "zero", "name": name}])
    if isinstance(name, str):
        pusher = Pusher()
        pusher.name = name * 2
        with pytest.raises(ValueError, match=r"policies.0.name"):
            settings(policies=[pusher])
    if isinstance(name, str) and name:
        with pytest.raises(ValueError, match=r"policies.0.name"):
            settings(policies=[f"{name * 2}.json"])


def test_a_model_may_be_told_what_it_speaks():
    mapping = {"policy": Pusher(), "action": "field", "name": "told"}
    (entry,) = settings(policies=[mapping]).entries()
    assert entry.name == "told" and set(entry.content) == {"policy", "action"}


FAST = {"model": {"kind": "planar", "contacts": "fast"}}


@pytest.mark.parametrize(
    "changes",
    [
        {"environment": FAST},
        {"hardware": {"one": {}, "other": FAST}},
        {"effects": {"task": "Sort", "policies": ["local_field"], "cases": {"one": FAST}}},
    ],
    ids=["environment", "hardware", "effects"],
)
def test_fast_contacts_are_not_published(changes):
    found = settings(tasks=["Sort"], policies=["local_field"], **changes)
    with pytest.raises(ValueError, match="contacts='fast' is for training"):
        evaluation.prepare(found)


def test_scores_and_comparisons_reject_fast_contacts(tmp_path):
    suite = {
        "tasks": ["Sort"],
        "policies": ["local_field"],
        "episodes": 1,
        "output": str(tmp_path),
        "environment": FAST,
    }
    with pytest.raises(ValueError, match="contacts='fast' is for training"):
        score.prepare(score.SuiteSettings.checked({**suite, "training_steps": 1}))
    with pytest.raises(ValueError, match="contacts='fast' is for training"):
        compare.prepare(ComparisonSettings.checked(suite))
