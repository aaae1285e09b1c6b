"""A cached kernel is compiled anew when a kernel that it calls in another file has changed, which numba does not notice."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vibgym

PROBE = """
import sys; sys.path.insert(0, {folder!r})
import numpy as np, vibgym
assert vibgym.__file__.startswith({folder!r})
part = vibgym.Part.rectangle(0.05, 0.035, friction=0.6)
simulator = vibgym.Simulator(vibgym.Surface(), part)
simulator.advance(vibgym.Surface().max_amplitude, 1.5 * np.pi, periods=2)
print(float(simulator.pose[0, 0, 0]))
"""


@pytest.fixture
def run(tmp_path):
    package = tmp_path / "vibgym"
    shutil.copytree(Path(vibgym.__file__).parent, package, ignore=shutil.ignore_patterns("__pycache__"))
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache")}

    def once():
        code = PROBE.format(folder=str(tmp_path))
        return float(subprocess.check_output([sys.executable, "-c", code], text=True, env=environment, cwd=tmp_path))

    return package, once


def test_an_edit_in_a_called_kernel_is_noticed(run):
    package, once = run
    first = once()
    cached = {path.name for path in (package.parent / "cache").rglob("*.nbc")}
    assert cached and once() == first
    assert {path.name for path in (package.parent / "cache").rglob("*.nbc")} == cached
    friction = package / "physics" / "friction.py"
    text = friction.read_text()
    result = "ny * along + nx * across, torque,"
    assert text.count(result) == 1
    friction.write_text(text.replace(result, f"2.0 * {result}"))
    assert abs(once() - first) > 1e-6
