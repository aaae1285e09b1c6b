"""What a network sees of goals, and the actor in NumPy."""

import json
import math

import numpy as np
import pytest
import torch

from agents.training.off_policy import GoalExtractor
from tests.envs.helpers import batch
from tests.policies.helpers import POSE_TASKS, SURFACE, episodes, info_of
from vibgym.policies.registry import make_policy
from vibgym.policies.trained.goal_features import GoalFeatures
from vibgym.policies.trained.goal_policy import GoalPolicy
from vibgym.policies.trained.storage import load_set, save_set
from vibgym.policies.trained.trained import KIND, VERSION, described, load_trained

WORLDS = 20


def observed(task="Align", seed=0):
    """Goal observations of parts that move."""
    env = batch(task, WORLDS, action="field", observation="goal")
    env.reset(seed=seed)
    generator = np.random.default_rng(seed)
    for _ in range(4):
        seen = env.step(generator.uniform(-1, 1, (WORLDS, 6)).astype(np.float32))[0]
    return seen, env


@pytest.mark.parametrize("task", POSE_TASKS)
def test_way_and_turn_are_those_of_the_state(task):
    """Made anew from the two goals, in tanh of 50 and 5 mm, 0.5 and 0.05 rad, as the state has them."""
    seen, _ = observed(task)
    features = GoalFeatures(info_of(task))
    rows = features.of(seen)
    assert rows.shape == (WORLDS, features.size) and rows.dtype == np.float32 and (np.abs(rows) <= 1.0).all()
    made = {
        key: rows[:, len(features.kept) + k]
        for k, key in enumerate(zip(features.goal.tolist(), features.scale.tolist()))
    }
    layout = features.layout
    names = {"way_coarse": 0.05, "way_fine": 0.005, "turn_coarse": 0.5, "turn_fine": 0.05}
    for name, scale in names.items():
        if name in layout and (info_of(task).has_heading or name.startswith("way")):
            wanted = layout.numbers(seen["observation"], name)[:, 0]
            for axis, column in enumerate(wanted.T):
                key = (2 if name.startswith("turn") else axis, np.float32(scale).item())
                assert made[key] == pytest.approx(column, abs=2e-4)  # goals are float32 metres


def test_nothing_but_the_goals_tells_of_the_goal():
    """As in replay: with another desired goal, rows are those of an environment that has it, whatever the state says."""
    seen, env = observed()
    features = GoalFeatures(info_of())
    other = np.roll(seen["desired_goal"], 1, axis=0)
    replayed = features.of({**seen, "desired_goal": other})
    state = seen["observation"].copy()
    for row in features.layout.rows:
        if row.name.startswith(("way", "turn")):
            state[:, row.start : row.start + row.width] = 0.123
    assert (features.of({**seen, "observation": state, "desired_goal": other}) == replayed).all()
    assert (replayed != features.of(seen)).any()
    turned = seen["desired_goal"] + np.array([0, 0, math.pi], dtype=np.float32)  # a block looks the same
    assert features.of({**seen, "desired_goal": turned}) == pytest.approx(features.of(seen), abs=1e-4)


@pytest.mark.parametrize("task", POSE_TASKS)
def test_torch_sees_the_same(task):
    seen, env = observed(task)
    features = GoalFeatures(info_of(task))
    extractor = GoalExtractor(env.unwrapped.single_observation_space, features)
    tensors = {key: torch.from_numpy(value.copy()) for key, value in seen.items()}
    assert extractor(tensors).numpy() == pytest.approx(features.of(seen), abs=1e-5)
    assert all((tensors[key].numpy() == seen[key]).all() for key in seen)  # a batch is used more than once


def test_other_tasks_and_observations_are_refused():
    with pytest.raises(ValueError, match="^network: got 'goal'; allowed: .*Sort has not"):
        GoalFeatures(info_of("Sort"))
    features, (seen, _) = GoalFeatures(info_of()), observed()
    for bad, name in (
        (seen["observation"], "observation"), ({"observation": seen["observation"]}, "observation"),
        ({**seen, "desired_goal": seen["desired_goal"][:, :2]}, "desired_goal"),
        ({**seen, "achieved_goal": seen["achieved_goal"][0]}, "achieved_goal"),
        ({**seen, "observation": seen["observation"][:, :3]}, "observation"),
    ):  # fmt: skip
        with pytest.raises(ValueError, match=f"{name}.*allowed"):
            features.of(bad)


def tensors_of(features, size=3, hidden=(16, 8), seed=0):
    generator, width, tensors = np.random.default_rng(seed), features.size, {}
    shapes = [(f"layer{k}", n) for k, n in enumerate(hidden)] + [("mean", size), ("log_std", size)]
    for name, n in shapes:
        tensors[f"{name}.weight"] = generator.normal(size=(n, width)).astype(np.float32)
        tensors[f"{name}.bias"] = generator.normal(size=n).astype(np.float32)
        width = n if name.startswith("layer") else width
    return tensors


def write(path, **changes):
    features = GoalFeatures(info_of())
    scene = {"tasks": ["Align"], "surface": described(SURFACE), "parts": 1}
    record = {"network": "goal", **scene, "action": "wrench", "features": features.described, **changes}
    save_set(path, KIND, tensors_of(features), record, VERSION)
    return path


def test_a_file_acts_as_its_network(tmp_path):
    info = info_of()
    policy = make_policy(str(write(tmp_path / "policy.json")), info)
    assert isinstance(policy, GoalPolicy) and (policy.action, policy.observation) == ("wrench", "goal")
    seen, _ = observed()
    tensors = tensors_of(policy.features)
    x = policy.features.of(seen).astype(np.float64)
    for k in range(2):
        x = np.maximum(x @ tensors[f"layer{k}.weight"].T + tensors[f"layer{k}.bias"], 0.0)
    wanted = np.tanh(x @ tensors["mean.weight"].T + tensors["mean.bias"])
    action, state = policy.predict(seen)
    assert action == pytest.approx(wanted, abs=1e-4) and action.dtype == np.float32 and state is None
    one, _ = policy.predict({key: value[3] for key, value in seen.items()})
    assert one.shape == (3,) and one == pytest.approx(action[3], abs=1e-5)
    explored, _ = policy.predict(seen, deterministic=False)
    assert (np.abs(explored) <= 1.0).all() and (explored != action).any()
    assert episodes(policy, "Align", worlds=2, max_episode_steps=3).success == 0


def lacking(*names):
    return lambda tensors: {key: value for key, value in tensors.items() if key not in names}


def changed(name, change):
    return lambda tensors: {**tensors, name: change(tensors[name])}


@pytest.mark.parametrize("change, match", [
    (lacking("mean.weight"), "mean: got '?no weight"), (lacking("log_std.bias"), "log_std: .*bias"),
    (lacking("layer0.weight"), "tensors: got .*layer0.weight"), (lacking("layer1.weight", "layer1.bias"), "mean: .*16"),
    (changed("mean.weight", lambda value: value[:, 1:]), r"mean: got '?weight of shape \(3, 7\)'?; allowed: shape \(3, 8\)"),
    (changed("mean.weight", lambda value: value[:2]), "mean"), (changed("layer0.bias", lambda value: value[:2]), "layer0"),
    (changed("layer0.weight", lambda value: value[:, :5]), "layer0"),
    (changed("layer1.weight", lambda value: value * np.nan), "tensors: got '?NaN or infinity in layer1.weight"),
    (changed("layer1.weight", lambda value: value.astype(np.int64)), "tensors: got '?int64"),
    (changed("layer1.bias", lambda value: value[:, None]), "layer1"),
])  # fmt: skip
def test_damaged_tensors_are_refused(tmp_path, change, match):
    path = write(tmp_path / "policy.json")
    tensors, record = load_set(path, KIND, VERSION)
    kept = {key: value for key, value in record.items() if key not in ("format", "version", "tensors", "sha256")}
    save_set(path, KIND, change(tensors), kept, VERSION)
    with pytest.raises(ValueError, match=f"policy.json: {match}"):
        load_trained(path, info_of())


@pytest.mark.parametrize("changes, match", [
    ({"tasks": ["Rotate"]}, r"tasks: got \['Rotate'\]; allowed: .*'Align'"), ({"action": "wave"}, "action: got 'wave'"),
    ({"action": "patch"}, "mean"), ({"features": {"state": []}}, "features"), ({"action": None}, "action"),
])  # fmt: skip
def test_files_for_others_are_refused(tmp_path, changes, match):
    with pytest.raises(ValueError, match=f"policy.json: {match}"):
        load_trained(write(tmp_path / "policy.json", **changes), info_of())


def test_a_file_for_another_part_is_refused(tmp_path):
    """A disc has no heading that shows; its turns are wrapped otherwise."""
    path = write(tmp_path / "policy.json")
    assert json.loads(path.read_text())["features"]["period"] == pytest.approx(math.pi)
    with pytest.raises(ValueError, match="policy.json: features"):
        load_trained(path, info_of(parts=[{"shape": "disc", "radius": 0.03, "friction": 0.6}]))
