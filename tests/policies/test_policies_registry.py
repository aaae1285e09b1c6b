"""How policies are made from names, mappings, files and objects."""

import math

import numpy as np
import pytest

from tests.policies.helpers import info_of
from vibgym.policies.classical.local_field import LocalFieldPolicy
from vibgym.policies.registry import CONTROLLERS, make_policy

NAMES = ("zero", "random", "open_loop", "local_field", "local_fields", "planner")


class Mine:
    """A controller of a user's."""

    action, observation = "field", "state"

    def __init__(self, info, strength=0.5, seed=None):
        self.info, self.strength, self.seed = info, strength, seed

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(6, self.strength, dtype=np.float32), state


def test_policies_are_made_from_names_mappings_and_objects():
    info = info_of()
    mine = Mine(info)
    assert make_policy(mine, info) is mine
    for name in NAMES:
        info = info_of("Sort" if name == "local_fields" else "Align")
        named, mapped = make_policy(name, info), make_policy({"kind": name}, info)
        assert type(named) is type(mapped) and hasattr(named, "predict")
        assert named.action in ("element", "phasor", "patch", "field") and named.observation == "state"
    info = info_of()
    tuned = make_policy({"kind": "local_field", "response": 0.1, "braking": 0.5, "approach": 3.0}, info)
    assert isinstance(tuned, LocalFieldPolicy) and tuned.law.response.tolist() == [0.1]
    assert (tuned.law.braking, tuned.law.approach) == (0.5, 3.0)
    settings = {"kind": "local_field", "response": 0.1}
    make_policy(settings, info)
    assert settings == {"kind": "local_field", "response": 0.1}


def test_a_controller_of_ones_own_has_a_name(monkeypatch):
    monkeypatch.setattr(CONTROLLERS, "_items", dict(CONTROLLERS))
    CONTROLLERS.register("mine", Mine)
    info = info_of()
    policy = make_policy({"kind": "mine", "strength": 0.25}, info, seed=7)
    assert isinstance(policy, Mine) and (policy.info, policy.strength, policy.seed) == (info, 0.25, 7)
    assert make_policy({"kind": "mine", "seed": 3}, info, seed=7).seed == 3
    with pytest.raises(ValueError, match="policy 'mine'.*colour"):
        make_policy({"kind": "mine", "colour": 1}, info)
    with pytest.raises(ValueError, match="controller name: got 'planner'"):
        CONTROLLERS.register("planner", Mine)


@pytest.mark.parametrize("policy, named", [
    ("magic", "policy.kind.*magic.*'zero', 'random', 'open_loop', 'local_field', 'local_fields', 'planner', 'pose', 'lqr', "
     "'pid', 'state_space', 'trained'"),
    (3, "policy.*3"), (None, "policy.*None"), ({}, "policy.kind.*None"), ({"kind": 3}, "policy.kind"),
    ({"kind": "zero", "colour": 1}, "policy 'zero'.*colour"),
    ({"kind": "local_field", "response": -1}, "response.*-1"),
    ({"kind": "local_field", "braking": 1.5}, "braking.*1.5"),
    ({"kind": "local_field", "approach": "fast"}, "approach.*fast"),
    ({"kind": "local_field", "info": 1}, "policy 'local_field'"),
    ({"kind": "open_loop", "turn_rate": 0}, "turn_rate"), ({"kind": "open_loop", "gather_time": math.nan}, "gather_time"),
    ({"kind": "open_loop", "centring": 2}, "centring"), ({"kind": "random", "seed": -1}, "seed"),
    ({"kind": "random", "seed": "x"}, "seed"),
    ({"kind": "trained"}, "policy 'trained'.*'path'"), ({"kind": "trained", "path": 3}, "policy.path.*3"),
    ({"kind": "trained", "path": "x.json", "colour": 1}, "policy 'trained'.*colour"),
    ("nowhere/policy.json", "path.*nowhere/policy.json"),
    ({"kind": "trained", "path": "nowhere/{task}.json"}, "path.*nowhere/align.json"),
])  # fmt: skip
def test_bad_policies_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, info_of())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("policy, named", [
    ({"kind": "local_fields", "law": "loudest"}, "law.*loudest.*'local'"),
    ({"kind": "local_fields", "response": 0}, "response"), ({"kind": "planner", "braking": 2}, "braking"),
    ({"kind": "local_fields", "margin": -1}, "margin"), ({"kind": "planner", "safe": 0}, "safe"),
    ({"kind": "planner", "soft": -1}, "soft"), ({"kind": "planner", "hard": math.nan}, "hard"),
    ({"kind": "planner", "yielding": 1.5}, "yielding"), ({"kind": "planner", "calm": 0}, "calm"),
    ({"kind": "planner", "faithful": -1}, "faithful"), ({"kind": "planner", "edge": 0}, "edge"),
    ({"kind": "planner", "inset": -0.1}, "inset"),
    ({"kind": "planner", "colour": 1}, "law 'local'.*colour.*response"),
])  # fmt: skip
def test_bad_arguments_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, info_of("Sort"))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name, task, allowed", [
    ("open_loop", "Sort", "one part with a goal pose"), ("open_loop", "Singulate", "one part with a goal pose"),
    ("local_field", "Singulate", "with goal poses.*'local_fields'"),
    ("local_fields", "Align", "without goal poses.*'local_field'"),
])  # fmt: skip
def test_policies_say_which_tasks_they_do_not_serve(name, task, allowed):
    with pytest.raises(ValueError, match=f"policy '{name}'.*{task}.*tasks.*{allowed}") as error:
        make_policy(name, info_of(task))
    assert "\n" not in str(error.value)
