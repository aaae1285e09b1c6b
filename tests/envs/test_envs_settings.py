"""Keyword arguments of environments. Bad ones: see ``tests/contracts``."""

import inspect
import json
import subprocess
import sys

import numpy as np
import pytest

import vibgym
from tests.envs.helpers import single
from vibgym.envs import Options, VibgymEnv, VibgymVectorEnv

FULL = {
    "surface": {"rows": 6, "columns": 20, "element_size_mm": 30.0, "horizontal_amplitude": 0.003, "max_amplitude": 3e-4},
    "parts": [
        {"shape": "polygon", "vertices_mm": [[0, 0], [50, 0], [50, 30], [30, 30], [30, 50], [0, 50]], "friction": 0.5,
         "static_friction": 0.55, "height_mm": 10, "mass_g": 150, "name": "bracket"},
    ],
}  # fmt: skip


def test_settings_take_effect():
    core = single("Align", **FULL).unwrapped.core
    assert (core.surface.rows, core.surface.columns, core.surface.element_size) == (6, 20, 0.03)
    assert core.surface.max_amplitude == 3e-4
    (part,) = core.parts
    assert part.name == "bracket" and part.mass == pytest.approx(0.15) and part.height == 0.01
    assert part.area == pytest.approx(0.05**2 - 0.02**2) and part.static_friction == 0.55
    assert single("Align").unwrapped.core.parts[0].name == "aluminium_block"
    assert single("Align", parts=["steel_block"]).unwrapped.core.parts[0].friction == 0.64
    assert single("Align", surface=vibgym.Surface(rows=5)).unwrapped.core.surface.rows == 5
    disc = vibgym.Part.disc(0.02, friction=0.3)
    assert single("Align", parts=[disc]).unwrapped.core.parts[0] is disc


def test_make_imports_the_package_in_a_fresh_process():
    code = (
        "import gymnasium as gym; env = gym.make('vibgym:vibgym/Rotate-v0'); env.reset(seed=0);"
        "vec = gym.make_vec('vibgym:vibgym/Rotate-v0', num_envs=2); vec.reset(seed=0); print(type(vec.unwrapped).__name__)"
    )
    result = subprocess.run([sys.executable, "-W", "error", "-c", code], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    assert result.stdout.strip() == "VibgymVectorEnv"


def test_sticking_parts_are_allowed():
    """On a slow table friction holds the part for every command; it circles with the table."""
    env = single("Align", surface={"horizontal_amplitude": 1.5e-4, "max_amplitude": 5e-5})
    env.reset(seed=0)
    simulator = env.unwrapped.core.simulator
    start = simulator.pose
    for _ in range(20):
        env.step(np.full(env.action_space.shape, -1.0, dtype=np.float32))
    assert simulator.sticking.all() and np.abs(simulator.pose - start).max() < 2e-3


def test_constructors_have_the_options_as_keyword_arguments():
    for cls in (VibgymEnv, VibgymVectorEnv):
        parameters = inspect.signature(cls).parameters
        assert all(parameters[name].default == Options.model_fields[name].default for name in Options.names())
    assert "max_episode_periods" not in json.loads(
        single("Align").unwrapped.core.identity
    )  # snapshots do not depend on it
