"""Contracts of every registered policy and control law, in every task."""

import functools
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from tests.contracts.entries import IDS, is_one_line
from tests.policies.trained.helpers import actor_tensors, policy_file
from vibgym.policies.classical.law import laws
from vibgym.policies.registry import make_policy, settings_of
from vibgym.policies.task_info import POLICIES, TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.residual import with_base
from vibgym.tasks import TASKS

WORLDS, STEPS = 4, 5
SHIPPED = Path("vibgym/policies/trained/shipped")
FILES = {
    "trained": SHIPPED / "{task}.json",
    "residual": "{folder}/{{task}}.json",
}
"""Files of the policies that are loaded from one."""

CASES = [(name, {}) for name in POLICIES] + [
    (kind, {"law": law}) for law in laws() for kind in ("local_field", "planner")
]
OF_TASKS = {gym.registry[name].kwargs["task"]: name for name in reversed(IDS)}
"""An environment of each task."""

controllers = pytest.mark.parametrize("case", CASES, ids=lambda case: "-".join((case[0], *case[1].values())))


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Return a directory with an untrained residual policy for Align."""
    directory = tmp_path_factory.mktemp("corrections")
    info = TaskInfo.of(made("vibgym/Align-v0"))
    coding = Coding(info.surface, info.parts, with_base(info.parts_layout), "wrench")
    record = {"columns": coding.columns, "action": "wrench", "residual": {"base": {"kind": "pose"}, "scale": 0.2}}
    policy_file(directory, info, actor_tensors(coding.shape), **record).rename(directory / "align.json")
    return directory


def made(name, **settings):
    return gym.make(name, **{"action": "field", **settings})


def policy_of(case, name, folder):
    """Return the policy of a case for an environment, or the error as text."""
    kind, arguments = case
    if kind in FILES:
        arguments = {**arguments, "path": str(FILES[kind]).format(folder=folder, task="{task}")}
    if kind == "by_task":
        arguments = {gym.spec(id).name: "zero" for id in IDS}
    if kind == "parallel_rollout":
        arguments = {"policies": ["planner", {"kind": "planner", "soft": 1.0}], "every": 2, "horizon": 3}
    try:
        return make_policy({"kind": kind, **arguments}, policy_info(name))
    except ValueError as error:
        return str(error)


@functools.cache
def policy_info(name):
    return TaskInfo.of(made(name))


@controllers
def test_a_policy_accepts_a_task_or_refuses_it_in_one_line(case, folder):
    policies = [policy_of(case, name, folder) for name in IDS]
    refusals = [policy for policy in policies if isinstance(policy, str)]
    assert len(refusals) < len(IDS) and all(map(is_one_line, refusals))


def rows_of(seen, chosen):
    """Return some worlds of a batch of observations."""
    return {key: values[chosen] for key, values in seen.items()} if isinstance(seen, dict) else seen[chosen]


@controllers
def test_a_batch_equals_its_rows_and_memory_resets_with_episodes(case, folder):
    """Actions are in the space; worlds are independent; random policies take a seed."""
    for name in OF_TASKS.values():
        policy = policy_of(case, name, folder)
        if isinstance(policy, str):
            continue
        drawn = TASKS[gym.spec(name).kwargs["task"]].RANDOMIZED
        settings = {"randomize": {"parts": [2, 6]}} if "parts" in drawn else {}
        env = gym.make_vec(name, num_envs=WORLDS, action=policy.action, observation=policy.observation, **settings)
        draws = "seed" in settings_of(case[0])
        seen, _ = env.reset(seed=3)
        together, alone, random = None, [None] * WORLDS, np.random.default_rng(0)
        for step in range(STEPS):
            start = np.array([step == 0] * WORLDS)
            start[2] |= step == 3
            before = repr(together)
            actions, memory = policy.predict(seen, together, start)
            assert repr(together) == before  # predict does not write to the memory it is given
            together = memory
            assert actions.dtype == np.float32 and env.action_space.contains(actions)
            for world in range(WORLDS):
                row = rows_of(seen, world)
                action, alone[world] = policy.predict(row, alone[world], start[world : world + 1])
                assert env.single_action_space.contains(action)
                assert draws or action == pytest.approx(actions[world], abs=1e-6)  # float32
            if step == 3 and not draws:
                fresh, _ = policy.predict(rows_of(seen, slice(2, 3)))
                assert fresh == pytest.approx(actions[2:3], abs=1e-6)
            push = random.uniform(-1, 1, actions.shape).astype(np.float32)
            seen, *_ = env.step(np.where(step % 2, push, actions))
        env.close()


@controllers
@pytest.mark.parametrize("bad", [{"colour": 1}, {"info": 1}])
def test_unknown_arguments_are_refused(case, bad, folder):
    with pytest.raises(ValueError) as error:
        make_policy({"kind": case[0], **case[1], **bad}, policy_info("vibgym/Align-v0"))
    assert is_one_line(str(error.value), *bad)
