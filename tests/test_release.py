"""Releases: metadata agree, broken distributions are rejected, and the wheel alone plays and trains."""

import importlib.util
import json
import os
import re
import shutil
import subprocess
import sys
import sysconfig
import tarfile
import tomllib
import zipfile
from pathlib import Path

import pytest
import yaml

import vibgym
from studies.release import __main__ as release
from studies.release import distributions, installation, results

ROOT = Path(__file__).parents[1]
PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def test_versions_citation_and_supported_pythons_agree():
    rows = []
    version = distributions.versions_agree(f"v{vibgym.__version__}", rows.append)
    assert version == PROJECT["version"] == vibgym.__version__
    with pytest.raises(results.Failed, match="v9"):
        distributions.versions_agree("v9", rows.append)
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    assert {"cff-version", "message"} <= citation.keys() and citation["title"] == PROJECT["name"]
    assert all(citation[name] == PROJECT[name] for name in ("version", "license", "authors"))
    minors = [line.rpartition(" ")[2] for line in PROJECT["classifiers"] if re.search(r":: 3\.\d+$", line)]
    assert tuple(minors) == installation.MINORS
    assert PROJECT["requires-python"] == f">={minors[0]},<3.{int(minors[-1].split('.')[1]) + 1}"


def test_missing_and_unexpected_files_of_a_distribution_fail(tmp_path):
    sdist = tmp_path / "vibgym.tar.gz"
    with tarfile.open(sdist, "w:gz") as packed:
        for name in (*distributions.SOURCES, *distributions.FILES):
            if name != "tests":
                packed.add(ROOT / "pyproject.toml", f"vibgym-1/{name}")
    with pytest.raises(results.Failed, match=r"\['tests'\]"):
        distributions.inspect_sdist(sdist, print)
    wheel = tmp_path / "vibgym.whl"
    with zipfile.ZipFile(wheel, "w") as packed:
        packed.writestr("vibgym-1.dist-info/METADATA", "")
        packed.writestr("tests/a.py", "")
    with pytest.raises(results.Failed, match=r"\['gym_vibgym', 'vibgym'\].*\['tests'\]"):
        distributions.inspect_wheel(wheel, "1", print)
    for metadata in (b"Metadata-Version: 2.4\nName: vibgym\n", b"Metadata-Version: 2.4\nName: vibgym\nVersion: one\n"):
        with pytest.raises(results.Failed, match="ersion"):
            distributions.inspect_metadata(metadata, print)


def test_the_command_stops_at_the_first_failure_and_leaves_no_files(capsys, tmp_path, monkeypatch):
    def fails(folder, report):
        code = "import sys; print('a'); sys.exit('no room\\nleft')"
        results.run_command("sdist", [sys.executable, "-c", code], folder)

    monkeypatch.setattr(distributions, "build", fails)
    assert release.main(["--quiet", "--output", str(tmp_path / "dist")]) == 1
    error = capsys.readouterr().err
    assert error.startswith("sdist: exit code 1") and error.count("\n") == 1
    assert list((tmp_path / "dist").iterdir()) == []
    for option, value in (("--pythons", "3.9"), ("--extras", "playing")):
        assert release.main([option, value]) == 2
        assert value in capsys.readouterr().err


# -- the wheel ---------------------------------------------------------------------------------------------------------

PLAY = """
import importlib.util, json
import gymnasium as gym, numpy as np, vibgym

packages = ("vibgym", "agents", "studies", "tests")
files = {name: getattr(importlib.util.find_spec(name), "origin", None) for name in packages}


def successes(policy, task):
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=3, action=policy.action, observation=policy.observation)
    observation, _ = env.reset(seed=11)
    state, start = None, np.ones(3, bool)
    over, succeeded = np.zeros(3, bool), np.zeros(3, bool)
    while not over.all():
        action, state = policy.predict(observation, state, start)
        observation, _, terminated, truncated, info = env.step(action)
        succeeded |= ~over & info["is_success"]
        start = terminated | truncated
        over |= start
    return int(succeeded.sum())


played = {}
for task, policies in {"Align": ("pose", "learned"), "Sort": ("planner", "pose", "learned")}.items():
    info = vibgym.policies.TaskInfo.of(gym.make(f"vibgym/{task}-v0"))
    for name in policies:
        played[f"{task} {name}"] = successes(vibgym.make_policy(name, info), task)

from stable_baselines3 import PPO

env = gym.make_vec("vibgym/Align-v0", num_envs=8, action="field", autoreset_mode="SameStep")
model = PPO("MlpPolicy", vibgym.adapters.sb3.VecEnv(env), n_steps=32, batch_size=64, device="cpu")
before = [weights.detach().clone() for weights in model.policy.parameters()]
model.learn(512)
learned = any(bool((now != old).any()) for now, old in zip(model.policy.parameters(), before))
print(json.dumps({"files": files, "played": played, "steps": model.num_timesteps, "learned": learned}))
"""


def pip(*arguments):
    command = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check", *map(str, arguments)]
    done = subprocess.run(command, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr


def test_the_wheel_passes_the_checks_of_a_release_and_plays_and_trains_alone(tmp_path):
    """In an empty environment outside of the checkout, with the dependencies of the tests' environment."""
    options = ["--no-build-isolation"] if importlib.util.find_spec("hatchling") else []
    pip("wheel", "--no-deps", *options, "--wheel-dir", tmp_path, ROOT)
    (wheel,) = tmp_path.glob("vibgym-*-py3-none-any.whl")
    rows = []
    distributions.inspect_wheel(wheel, vibgym.__version__, rows.append)
    assert {row.check for row in rows} == {"wheel", "metadata"}
    pages = list((ROOT / "vibgym" / "plugins" / "play" / "page").rglob("*.*"))
    assert ("page", f"{len(pages)} files" if pages else "not in the checkout") in {row[1:] for row in rows}

    home = tmp_path / "environment"
    subprocess.run([sys.executable, "-m", "venv", "--without-pip", home], check=True)
    python = home / "bin" / "python"
    pip("--python", python, "install", "--no-deps", "--no-index", "--no-compile", wheel)
    packages = Path(sysconfig.get_path("purelib", vars={"base": str(home), "platbase": str(home)}))
    # .pth files in that directory, such as the one for the checkout, are not followed.
    (packages / "dependencies.pth").write_text(f"{sysconfig.get_path('purelib')}\n")
    for kernel in (ROOT / "vibgym").rglob("*.nb?"):  # of the same sources: nothing is compiled again
        copy = packages / kernel.relative_to(ROOT)
        copy.parent.mkdir(exist_ok=True)
        shutil.copyfile(kernel, copy)

    environment = {k: v for k, v in os.environ.items() if k not in ("PYTHONPATH", "VIRTUAL_ENV", "PYTHONHOME")}
    done = subprocess.run([python, "-c", PLAY], cwd=tmp_path, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    printed = json.loads(done.stdout.splitlines()[-1])
    assert printed["files"].pop("vibgym") == str(packages / "vibgym" / "__init__.py")
    assert set(printed["files"].values()) == {None}  # the checkout cannot be imported
    assert len(printed["played"]) == 5 and set(printed["played"].values()) == {3}
    assert printed["steps"] == 512 and printed["learned"]
