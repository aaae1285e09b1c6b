"""A classical policy with a learned correction: nothing changes without one, and both sides see and remember alike."""

import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

from tests.envs.helpers import batch
from tests.policies.helpers import HARDWARE, info_of
from tests.policies.trained.helpers import actor_tensors, policy_file
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.residual import Base, ResidualPolicy, with_base

pytest.importorskip("torch")

from agents.training_envs import ResidualEnv

POSE, PLANNER = {"kind": "pose", "action": "wrench"}, {"kind": "planner", "law": "pose", "action": "wrench"}
PUSH = {"kind": "push", "action": "velocity"}


class Constant:
    """A correction that is the same everywhere, and counts its steps."""

    def __init__(self, info, value):
        self.value, self.parts, self.seen = np.float32(value), len(info.parts), []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.seen.append(observation)
        action = np.full((len(observation["mask"]), 3 * self.parts), self.value, dtype=np.float32)
        return action, (0 if state is None else state) + 1


def worlds(task, number=6, observation="parts_and_state", action="wrench", **settings):
    return batch(
        task, number, action=action, observation=observation, autoreset_mode=AutoresetMode.SAME_STEP, **settings
    )


@pytest.mark.parametrize("task, kind, hardware, velocities", [
    ("Align", POSE, HARDWARE, False), ("Align", POSE, {}, False), ("Sort", PLANNER, {}, False),
    ("Align", {**POSE, "action": "velocity"}, HARDWARE, False), ("Sort", {**PLANNER, "action": "target"}, {}, False),
    ("Align", {**POSE, "action": "velocity"}, HARDWARE, True), ("Push", PUSH, {}, True),
])  # fmt: skip
def test_no_correction_leaves_the_base_as_it_is(task, kind, hardware, velocities):
    """Bit for bit, as a policy and in training, over episodes that end."""
    hardware = {**hardware, "action": kind["action"]}
    alone, both, trained = worlds(task, observation="state", **hardware), worlds(task, **hardware), None
    info = TaskInfo.of(alone)
    base, policy = make_policy(kind, info), make_policy(kind, info)
    policy = ResidualPolicy(info, policy, Constant(info, 0.0), velocities=velocities)
    trained = ResidualEnv(worlds(task, **hardware), make_policy(kind, info), velocities=velocities)
    one, _ = alone.reset(seed=4)
    two, _ = both.reset(seed=4)
    trained.reset(seed=4)
    memory, other, start, ended = None, None, np.ones(6, dtype=bool), 0
    for _ in range(50 if task == "Align" else 12):
        proposed, memory = base.predict(one, memory, start)
        again, other = policy.predict(two, other, start)
        assert (proposed == again).all()
        one, reward, terminated, truncated, _ = alone.step(proposed)
        two, *_ = both.step(again)
        _, same, *_ = trained.step(np.zeros_like(proposed))
        assert (two["state"] == one).all() and (reward == same).all()
        start = terminated | truncated
        ended += start.sum()
    assert ended > 0 or task != "Align"


@pytest.mark.parametrize("action", ["wrench", "velocity", "target"])
def test_the_base_receives_applied_actions(action):
    """With the applied action its state is the environment's; the state of parts without a correction is unchanged."""
    env = worlds("Sort", action=action)
    info = TaskInfo.of(env)
    policy = make_policy({**PLANNER, "action": action}, info)
    seen, _ = env.reset(seed=1)
    memory = None
    for _ in range(5):
        proposed, memory = policy.predict(seen["state"], memory)
        done = proposed.copy()
        done[:, :3] = np.clip(done[:, :3] + 0.3, -1.0, 1.0)  # of the first part
        after = policy.acted(memory, proposed, done)
        seen, *_ = env.step(done)
        assumed = env.unwrapped.core.action.live()["given"]
        assert after.output.given == pytest.approx(assumed, rel=1e-4, abs=1e-3)
        assert (after.acceleration[:, 1:] == memory.acceleration[:, 1:]).all()
        assert (after.acceleration[:, 0] != memory.acceleration[:, 0]).any()
        memory = after
    assert policy.acted(memory, proposed, proposed) == memory
    with pytest.raises(ValueError, match="action"):
        other = make_policy("pose", info_of("Align"))
        other.acted(other.initial(1), proposed, proposed)


@pytest.mark.parametrize("task, kind", [("Align", POSE), ("Sort", PLANNER)])
def test_the_learner_observes_the_base_action(task, kind):
    settings = {"slots": 7, "randomize": {"parts": [2, 6]}} if task == "Sort" else {}
    env = worlds(task, **settings)
    info = TaskInfo.of(env)
    trained, base = ResidualEnv(env, make_policy(kind, info), scale=0.3), make_policy(kind, info)
    seen, _ = trained.reset(seed=3)
    at = next(row for row in trained.parts_layout if row.name == "base")
    proposed, _ = base.predict(env.observed("state"))
    parts = len(info.parts)
    columns = slice(at.start, at.start + 3)
    assert (seen["parts"][:, :parts, columns] == proposed.reshape(6, parts, 3)).all() and proposed.any()
    assert not seen["parts"][seen["mask"] == 0].any() and trained.observation_space.contains(seen)
    plain = env.observed("parts")["parts"]
    assert (np.delete(seen["parts"], range(columns.start, columns.stop), axis=-1) == plain).all()
    shape = Coding(info.surface, info.parts, trained.parts_layout, "wrench").shape
    assert shape.own == Coding(info.surface, info.parts, info.parts_layout, "wrench").shape.own + 3
    assert at.start + 3 == shape.own  # neighbours stay last
    # The policy's observation is the same.
    spy = Constant(info, 0.0)
    ResidualPolicy(info, base, spy).predict({**env.observed("parts"), "state": env.observed("state")})
    assert (spy.seen[0]["parts"] == seen["parts"]).all()


def test_final_observations_contain_the_base_action_and_new_episodes_reset_it():
    env = worlds("Align", 8, max_episode_steps=6)
    trained = ResidualEnv(env, make_policy(POSE, TaskInfo.of(env)))
    trained.reset(seed=2)
    generator = np.random.default_rng(0)
    for _ in range(6):
        seen, _, terminated, truncated, info = trained.step(generator.uniform(-1, 1, (8, 3)).astype(np.float32))
    assert truncated.all() and not terminated.any()
    at = next(row for row in trained.parts_layout if row.name == "base").start
    fresh, _ = make_policy(POSE, TaskInfo.of(env)).predict(env.observed("state"))
    assert (seen["parts"][:, 0, at : at + 3] == fresh).all()
    for world, final in enumerate(info["final_obs"]):
        assert trained.single_observation_space.contains(final)
        assert final["parts"][0, at : at + 3].any()
        assert (final["parts"][0, at : at + 3] != seen["parts"][world, 0, at : at + 3]).any()


def test_bad_input():
    info = info_of("Align", action="wrench")
    pose = make_policy(POSE, info)
    for base, scale, message in (
        (make_policy("pose", info), 0.5, "base.action"),
        (replace_observation(pose), 0.5, "base.observation"),
        (pose, 0.0, "scale"),
        (pose, float("nan"), "scale"),
    ):
        with pytest.raises(ValueError, match=message):
            ResidualPolicy(info, base, None, scale=scale)
    with pytest.raises(ValueError, match="autoreset_mode"):
        ResidualEnv(batch("Align", 2, action="wrench", observation="parts_and_state"), pose)
    with pytest.raises(ValueError, match="parts_and_state"):
        ResidualEnv(worlds("Align", 2, observation="parts"), pose)
    with pytest.raises(ValueError, match="env.action"):
        env = batch("Align", 2, action="field", observation="parts_and_state", autoreset_mode=AutoresetMode.SAME_STEP)
        ResidualEnv(env, pose)
    with pytest.raises(ValueError, match="state"):
        ResidualPolicy(info, pose, None).predict({"mask": np.zeros((1, 1)), "parts": None, "state": None}, 3)
    with pytest.raises(ValueError, match=r"nowhere.json"):
        make_policy({"kind": "residual", "base": "pose", "path": "nowhere.json"}, info)


def replace_observation(policy):
    policy = type(policy)(policy.info, policy.settings)
    policy.observation = "image"
    return policy


def written(folder, info, layout, **record):
    """Write the file of a correction with random weights."""
    coding = Coding(info.surface, info.parts, layout, "wrench")
    return policy_file(folder, info, actor_tensors(coding.shape), columns=coding.columns, action="wrench", **record)


@pytest.mark.parametrize("task, base", [("Align", {"kind": "pose"}), ("Sort", {"kind": "planner", "law": "pose"})])
def test_files_hold_corrections(tmp_path, task, base):
    env = worlds(task)
    info = TaskInfo.of(env)
    what = {"base": base, "scale": 0.2}
    written(tmp_path, info, with_base(info.parts_layout), residual=what).rename(tmp_path / f"{task.lower()}.json")
    path = str(tmp_path / "{task}.json")
    policy = make_policy({"kind": "residual", "path": path}, info)
    seen, _ = env.reset(seed=0)
    action, _ = policy.predict(seen)
    proposed, _ = make_policy({**base, "action": "wrench"}, info).predict(seen["state"])
    change = np.abs(action - proposed).max()
    assert 0.005 < change <= 0.2 + 1e-6
    with pytest.raises(ValueError, match="residual"):  # it is no policy by itself
        make_policy(path.format(task=task.lower()), info)


def test_a_policy_by_itself_is_no_correction(tmp_path):
    info = info_of("Align", action="wrench")
    path = str(written(tmp_path, info, info.parts_layout))
    make_policy(path, info)
    with pytest.raises(ValueError, match=r"policy.json: residual"):
        make_policy({"kind": "residual", "base": "pose", "path": path}, info)


def test_the_learner_observes_the_plan_of_the_base():
    env = worlds("Push", action="velocity")
    info = TaskInfo.of(env)
    trained, base = ResidualEnv(env, make_policy(PUSH, info)), make_policy(PUSH, info)
    seen, _ = trained.reset(seed=3)
    _, memory = base.predict(env.observed("state"))
    starts = {row.name: row.start for row in trained.parts_layout}
    width = sum(width for _, width in base.PLAN)
    plan = seen["parts"][..., starts["plan_velocity"] : starts["plan_velocity"] + width]
    assert (
        (plan == memory.own).all() and plan[:, :2, 4:].any(axis=-1).all() and not plan[:, 2, :2].any()
    )  # the part rests
    assert starts["plan_velocity"] == starts["base"] + 3 and trained.observation_space.contains(seen)


def test_velocities_are_added():
    info = info_of("Sort", action="velocity", observation="state")
    base = Base(make_policy({**PLANNER, "action": "velocity"}, info), info, 0.5, velocities=True)
    proposed = np.linspace(-1.0, 1.0, 36, dtype=np.float32).reshape(2, 18)
    _, memory = base.policy.predict(np.zeros((2, info.layout.size)))
    done, _ = base.corrected(proposed, np.full((2, 18), 0.4), memory)
    assert done * np.abs(done) == pytest.approx(np.minimum(proposed * np.abs(proposed) + 0.2, 1.0), abs=1e-6)
    assert done.dtype == np.float32


def test_corrections_are_added_and_cut_off():
    info = info_of("Sort", action="wrench", observation="state")
    base = Base(make_policy(PLANNER, info), info, 0.25)
    proposed = np.linspace(-1.0, 1.0, 36, dtype=np.float32).reshape(2, 18)
    _, memory = base.policy.predict(np.zeros((2, info.layout.size)))
    done, _ = base.corrected(proposed, np.full((2, 18), 1.0), memory)
    assert done == pytest.approx(np.minimum(proposed + 0.25, 1.0)) and done.dtype == np.float32
