"""Training of a correction: the hybrid is trained, evaluated, written, loaded and tabulated with its own base."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch

from agents.learning_curve import LearningCurve
from agents.ppo import PPO
from agents.tabulate import tabulate
from agents.train import train
from agents.training_file import load_settings
from tests.policies.helpers import info_of
from vibgym.files import csv_text
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import run as play
from vibgym.policies.trained.residual import ResidualPolicy, load_correction
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, VERSION, load_trained

POSE = {"kind": "pose", "action": "wrench"}
TEXT = """
vibgym/Align-v0:
  hybrid:
    environment: {action: wrench}
    residual: {base: {kind: pose}, scale: 0.3}
    worlds: 8
    steps: 256
    output: OUTPUT
    judging: {episodes: 4, every: 128}
    ppo: {n_steps: 16, batch_size: 64, n_epochs: 1, net: [8], critic_net: [8], log_std_init: -3.0}
"""

pytestmark = pytest.mark.usefixtures("one_thread")


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Configuration and directory of a whole, tiny run."""
    folder = tmp_path_factory.mktemp("hybrid")
    path = folder / "many.yaml"
    path.write_text(TEXT.replace("OUTPUT", str(folder / "run")))
    train(path, quiet=True, agent="Align/hybrid")
    return path, folder / "run"


@pytest.fixture
def learner(tmp_path):
    """Makes a learner of the file with one change."""
    made = []

    def make(old="", new=""):
        assert old in TEXT
        path = tmp_path / "many.yaml"
        path.write_text(TEXT.replace(old, new, 1).replace("OUTPUT", str(tmp_path / "run")))
        made.append(PPO(load_settings(path, "Align/hybrid")))
        return made[-1]

    yield make
    for each in made:
        each.close()


def test_the_file_has_the_base_and_loads_with_no_other(run):
    tensors, record = load_set(run[1] / "policy.json", KIND, VERSION)
    assert record["residual"] == {"base": POSE, "scale": 0.3} and record["columns"][-1] == ["base", 3]
    assert all(np.isfinite(each).all() for each in tensors.values())
    path, info = str(run[1] / "policy.json"), info_of("Align", action="wrench")
    policy = make_policy({"kind": "residual", "path": path}, info)
    found = load_correction(run[1] / "policy.json", info)
    again = ResidualPolicy(info, make_policy(POSE, info), found.learned, scale=0.3)
    env = gym.make_vec("vibgym/Align-v0", num_envs=4, action="wrench", observation="parts_and_state")
    seen, _ = env.reset(seed=0)
    action, _ = policy.predict(seen)
    assert (action == again.predict(seen)[0]).all() and (
        action != make_policy(POSE, info).predict(seen["state"])[0]
    ).any()
    same = make_policy({"kind": "residual", "path": path, "base": "pose", "scale": 0.3}, info)
    assert (action == same.predict(seen)[0]).all()
    for wrong in ({"base": "lqr"}, {"base": make_policy(POSE, info)}, {"scale": 0.5}):
        with pytest.raises(ValueError, match=next(iter(wrong))):
            make_policy({"kind": "residual", "path": path, **wrong}, info)
    with pytest.raises(ValueError, match="residual"):
        load_trained(run[1] / "policy.json", info)


def test_the_table_plays_the_hybrid(run, tmp_path):
    older = {
        "agent": "Align/before",
        "seed": "0",
        "processor": "one",
        "threads": "1",
        "versions": "",
        "steps": "5",
        "success": "1",
    }
    (tmp_path / "agents.csv").write_text(csv_text([{**older, "episodes": "2", "fallen": "0", "shipped": "True"}]))
    rows = tabulate(run[0], ["Align/hybrid"], [0], 2, tmp_path, ship=tmp_path / "shipped")
    assert rows[0]["success"] == 1.0  # as the base; the network alone would fail
    shipped = tmp_path / "shipped" / "align-hybrid.json"
    assert json.loads(shipped.read_text())["residual"]["scale"] == 0.3
    table = (tmp_path / "agents.csv").read_text().splitlines()
    assert [line.split(",")[0] for line in table] == [
        "agent",
        "Align/before",
        "Align/hybrid",
    ]  # the other agent's row is kept
    make_policy({"kind": "residual", "path": str(shipped)}, info_of("Align", action="wrench"))


def test_a_correction_of_zero_is_evaluated_as_the_base(learner, tmp_path):
    made = learner()
    with torch.no_grad():
        made.policy.actor.mean.weight.zero_()
        made.policy.actor.mean.bias.zero_()
    (tmp_path / "run").mkdir()
    curve = LearningCurve(made.settings, tmp_path / "run")
    curve.begin(0)
    row = curve.measure(made.acting(), 0, 0.0, "ppo")
    alone = gym.make_vec("vibgym/Align-v0", num_envs=4, action="wrench", autoreset_mode="Disabled")
    found = play(
        make_policy(POSE, info_of("Align", action="wrench")), alone, range(500_000, 500_000 + alone.num_envs), "Align"
    )
    seconds = alone.unwrapped.step_time * found.steps
    assert row["success"] == found.success.mean() == 1.0
    assert row["return_"] == round(float(np.median(found.returns)), 4)
    assert row["time_to_goal"] == round(float(np.median(seconds)), 4)
    assert made.env.envs[0].parts_layout[-1].name == "base"


def test_each_scene_has_its_own_base(learner):
    disc = "{parts: [{shape: disc, radius: 0.03, friction: 0.6}]}"
    one, other = learner("    worlds: 8", f"    scenes: [{{}}, {disc}]\n    worlds: 8").env.envs
    assert one.base.policy is not other.base.policy and other.base.policy.info.parts == other.parts != one.parts


def test_a_run_starts_from_a_correction_of_the_same_base(learner, run):
    path = run[1] / "policy.json"
    made = learner("    worlds", f"    start: {path}\n    worlds")
    assert (made.actor()["mean.weight"] == load_set(path, KIND, VERSION)[0]["mean.weight"]).all()
    with pytest.raises(ValueError, match="scale"):
        learner("scale: 0.3}\n", f"scale: 0.4}}\n    start: {path}\n")
    with pytest.raises(ValueError, match="residual"):
        learner("    residual: {base: {kind: pose}, scale: 0.3}\n", f"    start: {path}\n")


@pytest.mark.parametrize("old, new, named", [
    ("{kind: pose}", "pose", "residual.base"), ("{kind: pose}", "{law: pose}", "residual.base"),
    ("{kind: pose}", "{kind: residual, path: x.json}", "residual.base"), ("{kind: pose}", "{kind: nobody}", "nobody"),
    ("{kind: pose}", "{kind: pose, action: phasor}", "base.action"), ("scale: 0.3", "scale: 0", "residual.scale"),
    ("ppo: {", "ppo: {remembers: true, ", "ppo.remembers"),
    ("ppo: {", "ppo: {turned: true, ", "ppo.turned"), ("ppo: {", "ppo: {network: pixels, ", "ppo.network"),
    ("{action: wrench}", "{action: patch}", "environment.action"),
    ("    worlds", "    imitation: {expert: pose}\n    worlds", "imitation"),
])  # fmt: skip
def test_settings_that_conflict_with_a_correction_are_refused(learner, old, new, named):
    with pytest.raises(ValueError, match=named):
        learner(old, new)
