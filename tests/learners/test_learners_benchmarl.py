"""Specs, seeds, bounds, weights and absent parts of BenchMARL's experiments, in its virtual environment."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import vibgym  # noqa: F401

ROOT = Path(__file__).parents[2]
HOME = Path(f"{sys.prefix}-benchmarl")
PAIR = {"parts": ["steel_block", "aluminium_block"]}

pytestmark = [
    pytest.mark.full,
    pytest.mark.skipif(not (HOME / ".installed").exists(), reason=f"{HOME} is missing: make learners"),
]

# The task is that of the page; `collected` are the keys of the first batch, (worlds, steps, ...).
RUN = """
import json, re, sys
from pathlib import Path

page = Path(sys.argv[1]).read_text(encoding="utf-8")
code = re.search(r"^```python\\n(.*?)^```", page, re.M | re.S)[1]
sys.argv = ["page", "0"]
exec(code[: code.index("experiment = Experiment(")])
from benchmarl import algorithms

PAIR, SOME = {"parts": SCENE["parts"][:2]}, {"randomize": {"parts": [2, 6]}}
collected, found = {}, {}


class First(Callback):
    batch = None

    def on_batch_collected(self, batch):
        self.batch = batch.clone() if self.batch is None else self.batch


def run(name="Mappo", env="Swap", scene=PAIR, seed=0, **settings):
    first = First()
    config = replace(
        ExperimentConfig.get_from_yaml(), max_n_iters=2, max_n_frames=None, evaluation=False, loggers=[], create_json=False,
        on_policy_n_envs_per_worker=4, on_policy_collected_frames_per_batch=64, on_policy_n_minibatch_iters=1,
        on_policy_minibatch_size=32, off_policy_n_envs_per_worker=4, off_policy_collected_frames_per_batch=64,
        off_policy_n_optimizer_steps=2, off_policy_train_batch_size=32, evaluation_episodes=2, **settings,
    )
    net = MlpConfig(num_cells=[16], activation_class=torch.nn.Tanh, layer_class=torch.nn.Linear)
    experiment = Experiment(
        PartsTask(env.lower(), {"env": f"vibgym/{env}-v0", **scene}), getattr(algorithms, f"{name}Config").get_from_yaml(),
        net, seed, config, callbacks=[first],
    )
    before = [each.detach().clone() for each in experiment.policy.parameters()]
    experiment.run()
    after = list(experiment.policy.parameters())
    about = {
        "finite": all(each.isfinite().all().item() for each in after),
        "learned": any(not torch.equal(*each) for each in zip(before, after)),
        "groups": experiment.group_map, "observed": [list(each) for each in experiment.observation_spec.keys(True, True)],
        "steps": experiment.max_steps, "frames": experiment.total_frames,
    }
    return first.batch, experiment, about


def same(experiment):  # actions of two parts with equal rows
    rows = torch.full((1, 2, 97), 0.3)
    with torch.no_grad(), set_exploration_type(ExplorationType.DETERMINISTIC):
        chosen = experiment.policy(TensorDict({GROUP: TensorDict({"observation": rows}, [1, 2])}, [1]))[GROUP, "action"][0]
    return torch.allclose(chosen[0], chosen[1], atol=1e-5)


for name in ("Mappo", "Ippo", "Maddpg", "Iddpg", "Masac", "Isac"):
    batch, experiment, found[name] = run(name)
    found[name]["same"] = same(experiment)
    collected[name] = batch[GROUP, "action"].numpy()
batch, experiment, found["own"] = run(share_policy_params=False)
found["own"]["same"] = same(experiment)
for key, seed in (("first", 0), ("again", 0), ("other", 5)):
    batch, experiment, _ = run(seed=seed)
    collected[key] = batch[GROUP, "observation"].numpy()
    if key == "first":
        done = experiment.algorithm.process_batch(GROUP, batch)["next", GROUP, "terminated"]
        found["done"] = [list(done.shape), list(batch["next", "terminated"].shape)]
batch, experiment, found["absent"] = run(env="SortCrowded", scene=SOME)
collected["mask"] = batch[GROUP, "mask"].numpy()
collected["rows"], collected["reward"] = batch[GROUP, "observation"].numpy(), batch["next", GROUP, "reward"].numpy()
np.savez(sys.stdin.readline().strip(), **collected)
print(json.dumps(found))
"""


@pytest.fixture(scope="module")
def ran(tmp_path_factory):
    """Return what the experiments report and collect."""
    directory = tmp_path_factory.mktemp("benchmarl")
    command = ["timeout", "600", HOME / "bin/python", "-W", "ignore", "-c", RUN, ROOT / "docs/learners/benchmarl.md"]
    env, output = {**os.environ, "PYTHONPATH": str(ROOT), "OMP_NUM_THREADS": "1"}, str(directory / "collected.npz")
    done = subprocess.run(command, cwd=directory, input=output, env=env, capture_output=True, text=True)
    assert done.returncode == 0, (done.stdout + done.stderr)[-4000:]
    with np.load(directory / "collected.npz") as columns:
        return json.loads(done.stdout.splitlines()[-1]), dict(columns)


@pytest.mark.parametrize("name", ["Mappo", "Ippo", "Maddpg", "Iddpg", "Masac", "Isac"])
def test_algorithms_of_continuous_actions_learn_within_the_bounds(ran, name):
    results, collected = ran
    about = results[name]
    assert about["finite"] and about["learned"] and about["frames"] == 128 and about["steps"] == 750
    assert about["groups"] == {"parts": ["part_0", "part_1"]} and about["observed"] == [["parts", "observation"]]
    assert collected[name].shape == (4, 16, 2, 3) and np.abs(collected[name]).max() <= 1.0


def test_parts_share_weights_unless_this_is_switched_off_and_the_end(ran):
    results, _ = ran
    assert results["Mappo"]["same"] and not results["own"]["same"]
    assert results["done"] == [[4, 16, 2, 1], [4, 16, 1]]  # the end of a world is that of all its parts


def test_the_seed_of_the_experiment_is_that_of_the_worlds(ran):
    _, collected = ran
    np.testing.assert_array_equal(collected["first"], collected["again"])
    for key, seed in (("first", 1000), ("other", 1005)):
        env = gym.make_vec("vibgym/Swap-v0", num_envs=4, action="velocity", observation="parts", **PAIR)
        np.testing.assert_array_equal(collected[key][:, 0], env.reset(seed=seed)[0]["parts"])
    assert not np.array_equal(collected["first"], collected["other"])


def test_absent_parts_are_samples_without_reward(ran):
    results, collected = ran
    absent = ~collected["mask"][..., 0]
    assert results["absent"]["finite"] and results["absent"]["groups"] == {"parts": [f"part_{k}" for k in range(6)]}
    assert absent.any() and not collected["rows"][absent].any() and not collected["reward"][absent].any()
