"""Run each page of docs/learners with few steps."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
FEW = 4096  # one update of every learner
# A file with its name above it, or a command.
BLOCK = re.compile(r"^(?:`(?P<name>[\w.]+)`:\n\n)?```(?P<kind>python|yaml|sh)\n(?P<text>.*?)^```", re.M | re.S)


def environment(name):
    """Return the environment that ``make learners`` creates."""
    directory = Path(f"{sys.prefix}-{name}" if name else sys.prefix)
    assert (directory / ".installed").exists() or not name, f"{directory} is missing: make learners"
    return directory


@pytest.mark.parametrize("page, own", [
    ("benchmarl", "benchmarl"), ("cleanrl", ""), ("lerobot", "lerobot"), ("rllib", "rllib"), ("skrl", ""), ("torchrl", ""),
    ("zoo", "zoo"),
])  # fmt: skip
def test_a_page_trains_and_plays(page, own, tmp_path):
    text = (ROOT / f"docs/learners/{page}.md").read_text(encoding="utf-8")
    commands = []
    for block in BLOCK.finditer(text):
        if block["kind"] == "sh":
            commands.append(block["text"])
        else:
            (tmp_path / block["name"]).write_text(block["text"], encoding="utf-8")
    assert commands
    settings = {
        "PATH": f"{environment(own) / 'bin'}{os.pathsep}{os.environ['PATH']}",
        "PYTHONPATH": str(ROOT),
        "STEPS": str(FEW),
        "CLEANRL": str(environment("cleanrl") / "cleanrl"),
        "OMP_NUM_THREADS": "1",
    }
    script = "\n".join(["set -eu", *commands])
    # A hanging process is killed with its group; loaded hosts take minutes.
    command = ["timeout", "600", "bash", "-c", script]
    result = subprocess.run(command, cwd=tmp_path, env={**os.environ, **settings}, capture_output=True, text=True)
    assert result.returncode == 0, (result.stdout + result.stderr)[-4000:]
    assert re.search(r"^success \d+%, time (\d+\.\d\d|nan) s$", result.stdout, re.M), result.stdout[-2000:]
