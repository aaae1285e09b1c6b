"""Construction of policies from names, mappings, files and objects."""

import math
import pathlib
import subprocess
import sys

import gymnasium as gym
import numpy as np
import pytest

import vibgym
from tests.policies.helpers import episodes, info_of
from vibgym.envs.vector import batch_of
from vibgym.policies.classical.law import Law, laws, lead_of
from vibgym.policies.classical.planner import PlannerPolicy
from vibgym.policies.classical.steering import LocalFieldPolicy
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import POLICIES, TaskInfo
from vibgym.settings import BaseSettings
from vibgym.tasks import TASKS


class Mine:
    """A user-defined controller."""

    action, observation = "field", "state"

    def __init__(self, info, strength=0.5, seed=None):
        self.info, self.strength, self.seed = info, strength, seed

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.full(6, self.strength, dtype=np.float32), state


def test_policies_are_made_from_names_mappings_and_objects():
    info = info_of()
    mine = Mine(info)
    assert make_policy(mine, info) is mine
    assert type(make_policy("planner", info)) is type(make_policy({"kind": "planner"}, info)) is PlannerPolicy
    settings = {"kind": "local_field", "response": 0.1, "braking": 0.5, "approach": 3.0}
    law = make_policy(settings, info).law
    assert (law.response.tolist(), law.braking, law.approach) == ([0.1], 0.5, 3.0)
    assert settings == {"kind": "local_field", "response": 0.1, "braking": 0.5, "approach": 3.0}


def test_custom_controllers_have_a_name(monkeypatch):
    monkeypatch.setattr(POLICIES, "_items", dict(POLICIES))
    POLICIES.register("mine", Mine)
    info = info_of()
    policy = make_policy({"kind": "mine", "strength": 0.25}, info, seed=7)
    assert isinstance(policy, Mine) and (policy.info, policy.strength, policy.seed) == (info, 0.25, 7)
    assert make_policy({"kind": "mine", "seed": 3}, info, seed=7).seed == 3
    with pytest.raises(ValueError, match="policy 'mine'.*colour"):
        make_policy({"kind": "mine", "colour": 1}, info)
    for name in ("planner", "mine", "pose"):
        with pytest.raises(ValueError, match="policy name"):
            POLICIES.register(name, Mine)


@pytest.mark.parametrize("faulty", ["__init__", "predict"])
def test_a_type_error_of_a_policy_is_shown_as_such(faulty, monkeypatch):
    class Faulty(Mine):
        class Settings(BaseSettings):
            strength: float = 0.5

        def __init__(self, info, settings):
            super().__init__(info, settings.strength)

    setattr(Faulty, faulty, lambda *arguments, **settings: len(3))
    monkeypatch.setattr(POLICIES, "_items", {**POLICIES, "faulty": Faulty, "function": lambda info: len(3)})
    for policy in ("faulty", {"kind": "faulty", "strength": 0.25}, *(["function"] if faulty == "__init__" else [])):
        with pytest.raises(TypeError, match="has no len") as error:
            rollout(policy, "Align", seeds=[0])
        assert error.traceback[-1].path == pathlib.Path(__file__)


def test_a_type_error_of_a_task_is_shown_as_such(monkeypatch):
    class Faulty(TASKS["Align"]):
        def reward(self, step):
            return len(3)

    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Faulty": Faulty})
    with pytest.raises(TypeError, match="has no len"):
        batch_of("Faulty", num_envs=1)
    with pytest.raises(ValueError, match="colour"):
        batch_of("Align", num_envs=1, colour=1)


@pytest.mark.parametrize("policy, named", [
    ("magic", "policy.kind"), (3, "policy"), ({}, "policy.kind"), ({"kind": "local_field", "law": "loudest"}, "law"),
    ({"kind": "local_field", "law": "planner"}, "law"),
    ({"kind": "local_field", "law": {"kind": "local", "response": 0.1}, "response": 0.1}, "response.*twice"),
    ("nowhere/policy.json", "nowhere/policy.json"), (pathlib.Path("nowhere/policy.json"), "nowhere/policy.json"),
    ({"kind": "trained", "path": "nowhere/{task}.json"}, "nowhere/align.json"),
])  # fmt: skip
def test_bad_policies_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, info_of())
    assert "\n" not in str(error.value)


def test_the_file_of_a_trained_policy_may_be_a_path():
    path = pathlib.Path(vibgym.__file__).parent / "policies/trained/shipped/align.json"
    env = gym.make("vibgym/Align-v0", action="wrench", observation="parts")
    seen, _ = env.reset(seed=0)
    actions = [make_policy(spec, env).predict(seen)[0] for spec in (path, str(path), {"kind": "trained", "path": path})]
    assert (actions[0] == actions[1]).all() and (actions[0] == actions[2]).all()


@pytest.mark.parametrize("task, steered", [("Align", LocalFieldPolicy), ("Sort", PlannerPolicy)])
def test_environments_and_task_info_give_the_same_policy(task, steered):
    one = gym.make(f"vibgym/{task}-v0", action="phasor")
    many = gym.make_vec(f"vibgym/{task}-v0", num_envs=2, action="phasor")
    for env in (one, one.unwrapped, many, info_of(task)):
        policy = vibgym.make_policy("pose", env)
        assert type(policy) is steered and policy.action == "phasor"


@pytest.mark.parametrize("env", [None, 3, "vibgym/Align-v0", gym.make("CartPole-v1")])
def test_other_environments_are_refused(env):
    with pytest.raises(ValueError, match="env"):
        make_policy("zero", env)


@pytest.mark.parametrize("action", ["phasor", "wrench", "velocity", "element"])
def test_controllers_use_the_action_of_the_environment(action):
    env = gym.make("vibgym/Align-v0", action=action)
    policy = make_policy({"kind": "local_field", "law": "lqr"}, env)
    command, _ = policy.predict(env.reset(seed=0)[0])
    assert policy.action == action and command.shape == env.action_space.shape


def test_phasors_are_converted_to_element_actions():
    """Policies work with the default action."""
    env = gym.make("vibgym/Align-v0")
    reported, meant = make_policy("pose", env), make_policy("pose", info_of())
    assert (reported.action, meant.action) == ("element", "phasor")
    seen, _ = env.reset(seed=3)
    (elements, _), (phasors, _) = reported.predict(seen), meant.predict(seen)
    amplitude, phase = (0.5 * (elements.reshape(-1, 2)[:, 0] + 1.0), math.pi * elements.reshape(-1, 2)[:, 1])
    assert amplitude.max() > 0.5
    vectors = np.stack([amplitude * np.cos(phase), amplitude * np.sin(phase)], axis=-1)
    assert vectors == pytest.approx(phasors.reshape(-1, 2), abs=1e-6)
    assert reported.predict(np.stack([seen, seen]))[0].shape == (2, 512)
    assert episodes(reported, "Align", 10).success == 10


class Proportional(Law):
    """Minimal controller: acceleration from the displacement to the goal."""

    class Settings(Law.Settings):
        stiffness: float = 60.0
        damping: float = 12.0

    def wanted(self, measured, displacement, heading_error, memory):
        own = self.settings
        push = own.stiffness * displacement - own.damping * measured.velocity
        torque = own.stiffness * heading_error - own.damping * measured.spin
        return np.concatenate([push, torque[..., None]], axis=-1), memory


@pytest.fixture
def custom_law(monkeypatch):
    monkeypatch.setattr(POLICIES, "_items", dict(POLICIES))
    POLICIES.register("mine", Proportional)


def test_a_registered_law_is_a_controller(custom_law):
    alone, several = make_policy("mine", info_of("Align")), make_policy("mine", info_of("Sort"))
    assert (type(alone), type(several)) == (LocalFieldPolicy, PlannerPolicy) and "mine" in POLICIES
    for name, policy in (("Align", {"kind": "mine"}), ("Sort", {"kind": "planner", "law": "mine"})):
        assert make_policy({**policy, "damping": 20.0}, info_of(name)).law.settings.damping == 20.0
    assert several.lead == pytest.approx(0.2) and several.slack == 0.0  # 12 / 60
    assert episodes(alone, "Align", 20).success == 20
    assert episodes(several, "Sort", 6).success == 6


@pytest.mark.parametrize("name", ["local", "pose", "lqr"])
def test_missing_leads_are_measured(name):
    info = info_of("Transport")
    law = laws()[name](info)
    lead, law.lead = law.lead, None
    assert lead_of(law, info, 0.1) == pytest.approx(lead, rel=1e-6)


def test_a_law_without_braking_requires_a_lead(custom_law):
    with pytest.raises(ValueError, match=r"Proportional\.lead"):
        make_policy({"kind": "mine", "damping": 0.0}, info_of("Sort"))


WITHOUT = """
import sys
sys.modules.update(dict.fromkeys(("scipy", "scipy.linalg", "scipy.optimize", "safetensors", "safetensors.numpy")))
import gymnasium as gym, vibgym
alone, several = (gym.make(f"vibgym/{task}-v0", action="phasor") for task in ("Align", "Sort"))
for name in ("zero", "random", "open_loop", "local_field", "local", "pose", "pid"):
    print(type(vibgym.make_policy(name, alone)).__name__)
for name, env in (("lqr", alone), ("planner", several), ("learned", alone)):
    try:
        vibgym.make_policy(name, env)
    except ModuleNotFoundError as error:
        print(error)
"""


def test_only_policies_that_need_the_extra_require_it():
    """A module that is None in sys.modules counts as not installed."""
    result = subprocess.run([sys.executable, "-c", WITHOUT], capture_output=True, text=True)
    lines = result.stdout.splitlines()
    assert lines[:7] == ["ZeroPolicy", "RandomPolicy", "OpenLoopPolicy"] + ["LocalFieldPolicy"] * 4, result.stderr
    needed = [("lqr", "scipy"), ("planner", "scipy"), ("learned", "safetensors")]
    assert lines[7:] == [
        f"policy '{name}' needs {module}, which is not installed: pip install 'vibgym[policies]'"
        for name, module in needed
    ]


def test_worlds_with_drawn_shapes_have_policies_for_their_parts():
    """As if each world had a policy of its own, also where an episode has drawn another shape."""
    law, worlds, changes = {"kind": "pose", "action": "wrench"}, 20, 0
    env = gym.make_vec("vibgym/AlignShapes-v0", num_envs=worlds, action="wrench", autoreset_mode="Disabled")
    policy, kinds, info = make_policy(law, env), env.unwrapped.core.kinds, TaskInfo.of(env)
    seen, _ = env.reset(seed=1)
    state, start, alone, memories = None, np.ones(worlds, dtype=bool), {}, [None] * worlds
    for step in range(8):
        action, state = policy.predict(seen, state, start)
        for world, (kind,) in enumerate(kinds.kind):
            if kind not in alone:
                alone[kind] = make_policy(law, info.with_parts([kinds.every[kind]]))
            memory = None if start[world] else memories[world]
            expected, memories[world] = alone[kind].predict(seen[world], memory)
            assert (action[world] == expected).all()
        seen, shapes = env.step(action)[0], kinds.kind.copy()
        start = np.arange(worlds) % 3 == step % 3
        seen[start] = env.reset(options={"reset_mask": start})[0][start]
        changes += (kinds.kind != shapes).sum()
    assert changes > 20
    with pytest.raises(ValueError, match="batch of 3"):
        policy.predict(seen[:3])
