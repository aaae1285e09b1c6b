"""Import of the package."""

import importlib.metadata
import subprocess
import sys

import pytest

import vibgym

HEAVY = (
    "torch", "matplotlib", "pygame", "stable_baselines3", "scipy", "pandas", "PIL", "jinja2", "tensorboard", "safetensors",
    "tqdm", "rich", "vibgym.hardware", "vibgym.identification", "vibgym.plugins",
)  # fmt: skip


EXPECTED = "vibgym: compiling kernels", "vibgym: VIBGYM_PLAIN_NUMBA is set"
"""Beginnings of lines on stderr."""


def loaded_after(code):
    listing = f"{code}\nimport sys\nprint('MODULES', *(name for name in {HEAVY!r} if name in sys.modules))"
    result = subprocess.run([sys.executable, "-W", "error", "-c", listing], capture_output=True, text=True)
    assert result.returncode == 0, result.stderr
    messages = [line for line in result.stderr.splitlines() if not line.startswith(EXPECTED)]
    assert messages == []
    line = result.stdout.strip().splitlines()[-1]
    assert line.startswith("MODULES")
    return line.split()[1:]


@pytest.mark.parametrize("code", [
    "import vibgym",
    "import vibgym.fields, vibgym.config, vibgym.tasks, vibgym.envs",
    "import vibgym\nimport gymnasium\nenv = gymnasium.make('vibgym/Align-v0')\nenv.reset(seed=0)",
    "import vibgym.policies.task_info, vibgym.policies.registry",
])  # fmt: skip
def test_extras_are_not_imported(code):
    # All imports after `import gymnasium` are those of the package.
    assert set(loaded_after(code)) <= set(loaded_after("import gymnasium, numba"))


def test_importing_the_package_leaves_no_threads_and_no_output():
    code = "import threading, vibgym; print(threading.active_count())"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (result.stdout, result.stderr) == ("1\n", "")


def test_public_names():
    assert set(vibgym.__all__) >= {"Part", "Simulator", "Surface"}
    for name in vibgym.__all__:
        assert getattr(vibgym, name).__doc__


def test_version():
    assert vibgym.__version__.count(".") == 2
    assert all(number.isdigit() for number in vibgym.__version__.split("."))
    try:
        installed = importlib.metadata.version("vibgym")
    except importlib.metadata.PackageNotFoundError:  # run from the checkout
        from pathlib import Path

        text = (Path(vibgym.__file__).parents[1] / "pyproject.toml").read_text()
        assert f'version = "{vibgym.__version__}"' in text
    else:
        assert installed == vibgym.__version__
