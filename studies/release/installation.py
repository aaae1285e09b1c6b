"""Install the distributions in empty environments of each available Python, and run the examples."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

from studies.release.results import ROOT, Report, Row, require, run_command

MINORS = ("3.11", "3.12", "3.13", "3.14")
"""Supported versions of Python, as in pyproject.toml."""

EXAMPLES = {
    "demo": ("2", "play"),
    "first_steps": ("picture.png", "play"),
    "custom_law": ("4", "play"),
    "custom_sensor": ("10", "play"),
    "custom_task": ("10", "play"),
    "speed_against_error": ("16", "play"),
    "custom_reward_sac": ("320", "learn"),
    "train_ppo": ("4096", "learn"),
}
"""Example -> argument for a small run, and required extra."""

FROM_CHECKOUT = {"custom_algorithm"}
"""Examples that require ``agents``, which distributions do not contain; ``make test`` runs them."""

PRINT_VERSION = "import sys, vibgym; print(vibgym.__version__, vibgym.__file__.startswith(sys.prefix))"


def interpreter(minor: str) -> str | None:
    """Return the executable of a version of Python: the running one, one on PATH or one of pyenv; None without."""
    running = getattr(sys, "_base_executable", sys.executable)
    pyenv = sorted((Path.home() / ".pyenv" / "versions").glob(f"{minor}.*/bin/python"))
    for path in (running, shutil.which(f"python{minor}"), *map(str, reversed(pyenv))):
        if path is not None and _version(path) == minor:
            return path
    return None


def _version(executable: str) -> str | None:
    command = [executable, "-c", "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    # pyenv's shims exist and fail for versions that are not installed.
    return done.stdout.strip() if done.returncode == 0 else None


def examples_of(extras: str) -> tuple[list[str], list[str]]:
    """Return the names of the examples that run with these extras, and of the others."""
    installed = extras.split(",")
    able = [name for name, (_, extra) in EXAMPLES.items() if extra in installed]
    return able, [name for name in EXAMPLES if name not in able]


def install(minor: str, distribution: Path, version: str, extras: str, folder: Path, report: Report) -> None:
    """Install a distribution in an empty environment and run the examples outside of the checkout.

    Args:
        minor: version of Python; if it is not installed, the row "not tested" is reported.
        distribution: sdist or wheel.
        version: expected version.
        extras: comma-separated.
        folder: of environments and kernels. Kernels are reused by the next distribution on the same Python.
        report: receives each result.

    Raises:
        Failed: a check failed.
    """
    kind = "wheel" if distribution.suffix == ".whl" else "sdist"
    where = f"Python {minor}, {kind}"
    base = interpreter(minor)
    if base is None:
        report(Row("installation", where, "not tested: this Python is not installed"))
        return
    home = folder / f"{minor}-{kind}"
    began = time.perf_counter()
    run_command(f"{where}: environment", [base, "-m", "venv", home], folder)
    python = home / "bin" / "python"
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    wanted = f"vibgym[{extras}] @ {distribution.resolve().as_uri()}"
    run_command(f"{where}: pip install", [*pip, "install", "--quiet", "-c", ROOT / "constraints.txt", wanted], folder)
    run_command(f"{where}: pip check", [*pip, "check"], folder)
    printed, _ = run_command(f"{where}: import vibgym", [python, "-W", "error", "-c", PRINT_VERSION], home)
    require(printed.split() == [version, "True"], f"{where}: import vibgym", printed)
    report(Row("installation", where, f"vibgym[{extras}], {time.perf_counter() - began:.0f} s"))
    if (ROOT / "vibgym" / "plugins" / "play").exists():
        run_command(f"{where}: python -m vibgym play --help", [python, "-m", "vibgym", "play", "--help"], home)
        report(Row("python -m vibgym play", where, "runs"))
    run_examples(python, where, extras, folder / f"{minor}-kernels", report)


def run_examples(python: Path, where: str, extras: str, kernels: Path, report: Report) -> None:
    """Run copies of the examples at small size, with this folder of kernels."""
    directory = python.parents[1] / "examples"
    shutil.copytree(ROOT / "examples", directory)
    able, others = examples_of(extras)
    cache = {"NUMBA_CACHE_DIR": str(kernels)}
    for name in able:
        began = time.perf_counter()
        run_command(f"{where}: examples/{name}.py", [python, f"{name}.py", EXAMPLES[name][0]], directory, cache)
        report(Row(f"examples/{name}.py", where, f"runs, {time.perf_counter() - began:.0f} s"))
    for name in others:
        report(Row(f"examples/{name}.py", where, f"not tested: requires the extra {EXAMPLES[name][1]}, see --extras"))
