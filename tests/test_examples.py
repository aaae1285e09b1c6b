"""The examples run at small size."""

import os
import re
import runpy
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from vibgym.seeds import RANGES

ROOT = Path(__file__).parent.parent
EXAMPLES = {
    "demo": ("2", "Sort    learned        100.0 %"),
    "first_steps": ("picture.png", "learned      100 %"),
    "custom_algorithm": ("8000", "trained"),
    "custom_law": ("4", "{'kind': 'pose'}                     in the plane                       100.0 %"),
    "custom_sensor": ("10", "off by up to 0.0 mm: success 100 %, ends 0.00 mm"),
    "custom_task": ("10", "pose         100.0 %"),
    "speed_against_error": ("16", "averaged  {'order': 2}"),
}
"""Examples by name: argument, and part of the output."""

LEARNING = {"custom_reward_sac": ("320", 32, 100), "train_ppo": ("100000", 128, 200)}
"""Examples that train and evaluate in batches: argument, worlds of the training, episodes of the evaluation."""

PICTURES = {"demo": ["runs/demo/demo.png"], "first_steps": ["picture.png"]}
"""Pictures that examples write."""

LINES = 70


def test_every_example_is_tested_and_short():
    files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "examples").glob("*.py")}
    assert files.keys() == EXAMPLES.keys() | LEARNING.keys()
    assert all(len(text.splitlines()) < LINES for text in files.values())


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, tmp_path):
    if name == "custom_algorithm":
        pytest.importorskip("torch")
    argument, expected = EXAMPLES[name]
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), argument]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert done.returncode == 0, done.stderr[-2000:]
    assert expected in done.stdout
    pictures = list(tmp_path.rglob("*.png"))
    assert [path.relative_to(tmp_path).as_posix() for path in pictures] == PICTURES.get(name, [])
    assert all(np.asarray(Image.open(path).convert("L")).std() > 10.0 for path in pictures)  # not blank
    if name == "demo":
        assert re.findall(r"^(\w+) +random +0.0 %", done.stdout, re.M) == ["Align", "Sort"]


@pytest.mark.parametrize("name", LEARNING)
def test_examples_learn_and_evaluate_on_episodes_of_which_none_was_trained_on(name, monkeypatch, capsys, resets):
    pytest.importorskip("torch")
    argument, worlds, episodes = LEARNING[name]
    monkeypatch.setattr(sys, "argv", [name, argument])
    runpy.run_path(str(ROOT / "examples" / f"{name}.py"))
    training = {seed for count, seeds, _ in resets if count == worlds for seed in seeds}
    evaluation = {seed for count, seeds, _ in resets if count != worlds for seed in seeds}
    assert len(training) == worlds and all(seed in RANGES["training"] for seed in training)
    assert len(evaluation) == episodes and all(seed in RANGES["own"] for seed in evaluation)
    printed = capsys.readouterr().out
    assert re.findall(r"^(untrained|trained) ", printed, re.M) == ["untrained", "trained"]
    if name == "train_ppo":
        before, after = (float(share) for share in re.findall(r"success ([\d.]+) %", printed))
        assert before < 20.0 and after >= 90.0
