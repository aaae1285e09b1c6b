"""The wheel alone, installed in an empty environment outside of the checkout, plays and trains."""

import importlib.util
import json
import os
import subprocess
import sys
import sysconfig
from pathlib import Path

import pytest

import vibgym
from studies.release import distributions

ROOT = Path(__file__).parents[1]

PLAY = """
import importlib.util, json
import gymnasium as gym, numpy as np, vibgym

found = {name: getattr(importlib.util.find_spec(name), "origin", None) for name in ("vibgym", "agents", "studies", "tests")}


def successes(policy, task, **settings):
    settings |= {"action": policy.action, "observation": policy.observation}
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=3, **settings)
    seen, _ = env.reset(seed=11)
    state, start, succeeded = None, np.ones(3, bool), np.zeros(3, bool)
    over = np.zeros(3, bool)
    while not over.all():
        action, state = policy.predict(seen, state, start)
        seen, _, terminated, truncated, info = env.step(action)
        succeeded |= ~over & info["is_success"]
        start = terminated | truncated
        over |= start
    return int(succeeded.sum())


played = {}
for task, policies in {"Align": ("pose", "learned"), "Sort": ("planner", "pose", "learned")}.items():
    made = gym.make(f"vibgym/{task}-v0")
    for name in policies:
        played[f"{task} {name}"] = successes(vibgym.make_policy(name, vibgym.policies.TaskInfo.of(made)), task)

from stable_baselines3 import PPO

env = gym.make_vec("vibgym/Align-v0", num_envs=8, action="field", autoreset_mode="SameStep")
model = PPO("MlpPolicy", vibgym.adapters.sb3.VecEnv(env), n_steps=32, batch_size=64, device="cpu")
before = [each.detach().clone() for each in model.policy.parameters()]
model.learn(512)
moved = any(bool((each != old).any()) for each, old in zip(model.policy.parameters(), before))
print(json.dumps({"found": found, "played": played, "steps": model.num_timesteps, "learned": moved}))
"""


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    """Build the wheel with pip, and with the installed hatchling if there is one."""
    directory = tmp_path_factory.mktemp("wheel")
    have = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
    pip("wheel", "--no-deps", *have, "--wheel-dir", directory, ROOT)
    (path,) = directory.glob("vibgym-*-py3-none-any.whl")
    return path


def pip(*arguments):
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *map(str, arguments)]
    result = subprocess.run(command, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr


def installed(wheel, directory):
    """Install the wheel; return interpreter and packages. Dependencies are those of the tests' environment."""
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", directory], check=True)
    python = directory / "bin" / "python"
    pip("--python", python, "install", "--no-deps", "--no-index", "--no-compile", wheel)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(directory), "platbase": str(directory)}))
    # .pth files in that directory, such as the one for the checkout, are not followed.
    (packages / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    return python, packages


def test_the_wheel_alone_plays_and_trains(wheel, tmp_path):
    python, packages = installed(wheel, tmp_path / "environment")
    hidden = {"PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME"}
    environment = {name: value for name, value in os.environ.items() if name not in hidden}
    result = subprocess.run([python, "-c", PLAY], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    printed = json.loads(result.stdout.splitlines()[-1])
    assert printed["found"].pop("vibgym") == str(packages / "vibgym" / "__init__.py")
    assert set(printed["found"].values()) == {None}  # the checkout cannot be imported
    assert printed["played"] == dict.fromkeys(printed["played"], 3) and len(printed["played"]) == 5
    assert printed["steps"] == 512 and printed["learned"]


def test_the_wheel_passes_the_checks_of_a_release(wheel):
    rows = []
    distributions.inspect_wheel(wheel, vibgym.__version__, rows.append)
    assert {row.check for row in rows} == {"wheel", "metadata"}
    pages = list((ROOT / "vibgym" / "plugins" / "play" / "page").rglob("*.*"))
    assert ("page", f"{len(pages)} files" if pages else "not in the checkout") in {row[1:] for row in rows}
