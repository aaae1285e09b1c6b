"""Training of a correction: the whole hybrid is trained, judged, written, loaded and tabulated, on its own base."""

import json

import gymnasium as gym
import numpy as np
import pytest
import torch

from agents.training.judging import Judge, play
from agents.training.ppo.algorithm import PPO
from agents.training.table import Places, tabulate
from agents.training.train import train
from agents.training.training_file import load_settings
from tests.policies.helpers import info_of
from vibgym.policies.registry import make_policy
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


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """Configuration and directory of a whole, tiny run."""
    folder = tmp_path_factory.mktemp("hybrid")
    path = folder / "many.yaml"
    path.write_text(TEXT.replace("OUTPUT", str(folder / "run")))
    train(path, quiet=True, agent="Align/hybrid")
    return path, folder / "run"


@pytest.fixture
def config(tmp_path):
    """Writes the file with one thing changed, and reads it."""

    def write(old="", new=""):
        assert old in TEXT
        path = tmp_path / "many.yaml"
        path.write_text(TEXT.replace(old, new, 1).replace("OUTPUT", str(tmp_path / "run")))
        return load_settings(path, "Align/hybrid")

    return write


def test_a_run_writes_what_it_corrects(run):
    _, directory = run
    tensors, record = load_set(directory / "policy.json", KIND, VERSION)
    assert record["residual"] == {"base": POSE, "scale": 0.3} and record["remembers"] is False
    assert record["columns"][-1] == ["base", 3] and all(np.isfinite(each).all() for each in tensors.values())
    curve = (directory / "curve.csv").read_text().splitlines()
    assert len(curve) == 3 and curve[1].startswith("128,") and curve[2].startswith("256,")


def test_the_file_says_what_it_corrects(run):
    """Loaded with nothing but its path it acts as its parts do; with another base or scale, or with none, not at all."""
    path, info = str(run[1] / "policy.json"), info_of("Align", action="wrench")
    policy = make_policy({"kind": "residual", "path": path}, info)
    found = load_correction(run[1] / "policy.json", info)
    again = ResidualPolicy(info, make_policy(POSE, info), found.learned, scale=0.3)
    env = gym.make_vec("vibgym/Align-v0", num_envs=4, action="wrench", observation="parts_and_state")
    seen, _ = env.reset(seed=0)
    said, _ = make_policy(POSE, info).predict(seen["state"])
    action, _ = policy.predict(seen)
    assert (action == again.predict(seen)[0]).all() and (action != said).any()
    same = make_policy({"kind": "residual", "path": path, "base": "pose", "scale": 0.3}, info)
    assert (action == same.predict(seen)[0]).all()
    for wrong, message in (
        ({"base": "lqr"}, "base"),
        ({"base": {"kind": "pose", "law": "pose"}}, "base"),
        ({"base": make_policy(POSE, info)}, "base"),
        ({"scale": 0.5}, "scale"),
    ):
        with pytest.raises(ValueError, match=message):
            make_policy({"kind": "residual", "path": path, **wrong}, info)
    with pytest.raises(ValueError, match=r"policy.json: residual.*'kind': 'residual'"):
        load_trained(run[1] / "policy.json", info)


def test_the_table_plays_the_hybrid(run, tmp_path):
    rows = tabulate(run[0], ["Align/hybrid"], [0], 2, Places(tmp_path, ship=tmp_path / "shipped"))
    assert rows[0]["success"] == 1.0  # as the base alone does; the network alone would not
    shipped = tmp_path / "shipped" / "align-hybrid.json"
    assert json.loads(shipped.read_text())["residual"]["scale"] == 0.3
    make_policy({"kind": "residual", "path": str(shipped)}, info_of("Align", action="wrench"))


def test_no_correction_is_judged_as_the_base(config, tmp_path):
    settings = config()
    env = PPO(settings).make_env()
    model = PPO(settings).make_model(env)
    with torch.no_grad():
        model.policy.actor.mean.weight.zero_()
        model.policy.actor.mean.bias.zero_()
    tmp_path.joinpath("run").mkdir()
    judge = Judge(settings, tmp_path / "run")
    judge.begin(0)
    row = judge.judge(PPO(settings).acting(model), 0, 0.0, "ppo")
    alone = gym.make_vec("vibgym/Align-v0", num_envs=4, action="wrench", autoreset_mode="Disabled")
    success, steps, returns, _ = play(make_policy(POSE, info_of("Align", action="wrench")), alone, 500_000)
    assert row["success"] == success.mean() == 1.0 and row["return_"] == round(float(np.median(returns)), 4)
    assert row["time_to_goal"] == round(float(np.median(alone.unwrapped.step_time * steps)), 4)
    assert row["mean_time"] == round(float(np.mean(alone.unwrapped.step_time * steps)), 4)
    # What it was trained with it sees, too.
    assert (
        env.envs[0].parts_layout[-1].name == "base"
        and model.policy.coding.shape.columns == env.reset()["parts"].shape[-1]
    )


def test_each_scene_has_a_base_of_its_own(config):
    disc = "{parts: [{shape: disc, radius: 0.03, friction: 0.6}]}"
    settings = config("    worlds: 8", f"    scenes: [{{}}, {disc}]\n    worlds: 8")
    one, other = PPO(settings).make_env().envs
    assert one.base.policy is not other.base.policy and other.base.policy.info.parts == other.parts != one.parts


def test_a_run_begins_with_a_correction_of_the_same_base_alone(config, run):
    path = run[1] / "policy.json"
    settings = config("    worlds", f"    start: {path}\n    worlds")
    env = PPO(settings).make_env()
    model = PPO(settings).make_model(env)
    PPO(settings).begin_with(model)
    assert (PPO(settings).acting(model).tensors["mean.weight"] == load_set(path, KIND, VERSION)[0]["mean.weight"]).all()
    other = settings.model_copy(update={"residual": settings.residual.model_copy(update={"scale": 0.4})})
    with pytest.raises(ValueError, match="scale"):
        PPO(other).begin_with(model)


@pytest.mark.parametrize("old, new, message", [
    ("{kind: pose}", "pose", "residual.base"),
    ("{kind: pose}", "{law: pose}", "residual.base.*'kind'"),
    ("{kind: pose}", "{kind: residual, path: x.json}", "residual.base.*no correction"),
    ("{kind: pose}", "{kind: nobody}", "residual: policy.kind.*nobody"),
    ("{kind: pose}", "{kind: pose, action: phasor}", "residual: base.action"),
    ("scale: 0.3", "scale: 0", "residual.scale"),
    ("scale: 0.3", "size: 0.3", "residual.size"),
    ("ppo: {", "ppo: {remembers: true, ", "ppo.remembers"),
    ("ppo: {", "ppo: {turned: true, ", "ppo.turned"),
    ("ppo: {", "ppo: {network: pixels, ", "ppo.network"),
    ("{action: wrench}", "{action: patch}", "environment.action"),
    ("    worlds", "    imitation: {expert: pose}\n    worlds", "imitation"),
])  # fmt: skip
def test_bad_settings(config, old, new, message):
    with pytest.raises(ValueError, match=message):
        PPO(config(old, new)).make_env()


def test_a_correction_of_sac_is_refused(config):
    from agents.training.sac.algorithm import SAC

    with pytest.raises(ValueError, match="residual.*none with 'algorithm: sac'"):
        SAC(config("    worlds", "    algorithm: sac\n    worlds")).make_env()


@pytest.mark.parametrize(
    "what", [None, {"base": "pose"}, {"base": POSE, "scale": -1.0}, {"base": {"kind": "residual"}, "scale": 0.3}]
)
def test_altered_files(run, tmp_path, what):
    record = json.loads((run[1] / "policy.json").read_text())
    (tmp_path / record["tensors"]).write_bytes((run[1] / record["tensors"]).read_bytes())
    (tmp_path / "policy.json").write_text(json.dumps({**record, "residual": what}))
    with pytest.raises(ValueError, match=r"residual|base"):
        make_policy({"kind": "residual", "path": str(tmp_path / "policy.json")}, info_of("Align", action="wrench"))
