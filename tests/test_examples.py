"""The examples run at small size."""

import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

ROOT = Path(__file__).parent.parent
EXAMPLES = {
    "demo": ("2", "Sort    learned        100.0 %"),
    "first_steps": ("picture.png", "learned      100 %"),
    "custom_algorithm": ("8000", "trained"),
    "custom_law": ("4", "{'kind': 'pose'}                     in the plane                       100.0 %"),
    "custom_reward_sac": ("320", "trained"),
    "custom_sensor": ("10", "off by up to 0.0 mm: success 100 %, ends 0.00 mm"),
    "custom_task": ("10", "pose         100.0 %"),
    "speed_against_error": ("16", "averaged  {'order': 2}"),
    "train_ppo": ("100000", "trained"),
}
"""Examples by name: argument, and part of the output."""

LEARN = ("custom_algorithm", "custom_reward_sac", "train_ppo")
"""Examples that require the extra ``learn``."""

PICTURES = {"demo": ["runs/demo/demo.png"], "first_steps": ["picture.png"]}
"""Pictures that examples write."""

LINES = 70


def test_every_example_is_tested_and_short():
    files = {path.stem: path.read_text(encoding="utf-8") for path in (ROOT / "examples").glob("*.py")}
    assert files.keys() == EXAMPLES.keys()
    assert all(len(text.splitlines()) < LINES for text in files.values())


@pytest.mark.parametrize("name", EXAMPLES)
def test_an_example_runs(name, tmp_path):
    if name in LEARN:
        pytest.importorskip("torch")
    argument, expected = EXAMPLES[name]
    command = [sys.executable, str(ROOT / "examples" / f"{name}.py"), argument]
    done = subprocess.run(
        command, cwd=tmp_path, capture_output=True, text=True, env={**os.environ, "PYTHONPATH": str(ROOT)}
    )
    assert done.returncode == 0, done.stderr[-2000:]
    assert expected in done.stdout
    pictures = list(tmp_path.rglob("*.png"))
    assert [path.relative_to(tmp_path).as_posix() for path in pictures] == PICTURES.get(name, [])
    assert all(np.asarray(Image.open(path).convert("L")).std() > 10.0 for path in pictures)  # not blank
    if name == "demo":
        assert re.findall(r"^(\w+) +random +0.0 %", done.stdout, re.M) == ["Align", "Sort"]
    if name == "train_ppo":
        shares = [float(each) for each in re.findall(r"success ([\d.]+) %", done.stdout)]
        assert len(shares) == 2 and shares[0] < 20.0 and shares[1] >= 90.0
