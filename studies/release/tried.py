"""Installs the distributions where nothing else is, on each Python that there is, and runs the examples there."""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from pathlib import Path

from studies.release.checked import ROOT, Row, Tell, ran, require

MINORS = ("3.11", "3.12", "3.13")
"""Versions of Python that pyproject.toml names."""

EXAMPLES = {
    "first_steps": ("picture.png", "play"),
    "own_law": ("4", "play"),
    "own_sensor": ("10", "play"),
    "own_task": ("10", "play"),
    "speed_against_error": ("16", "play"),
    "own_reward_sac": ("320", "learn"),
}
"""By name: the argument, which makes it small, and the extra that it needs."""

FROM_CHECKOUT = {"own_algorithm"}
"""Examples that need ``agents``, which distributions do not install; ``make test`` runs them."""

FOUND = "import sys, vibgym; print(vibgym.__version__, vibgym.__file__.startswith(sys.prefix))"


def interpreter(minor: str) -> str | None:
    """The executable of a version of Python: the one that runs, one on PATH, or one of pyenv's; None where there is none."""
    own = getattr(sys, "_base_executable", sys.executable)
    pyenv = sorted((Path.home() / ".pyenv" / "versions").glob(f"{minor}.*/bin/python"))
    for each in (own, shutil.which(f"python{minor}"), *map(str, reversed(pyenv))):
        if each is not None and _version(each) == minor:
            return each
    return None


def _version(executable: str) -> str | None:
    asked = [executable, "-c", "import sys, venv, ensurepip; print('%d.%d' % sys.version_info[:2])"]
    try:
        done = subprocess.run(asked, capture_output=True, text=True, timeout=60)
    except (OSError, subprocess.TimeoutExpired):
        return None
    return done.stdout.strip() if done.returncode == 0 else None  # a shim of pyenv's is there and fails


def examples_of(extras: str) -> tuple[list[str], list[str]]:
    """Names of the examples that run with these extras, and of those that do not."""
    asked = extras.split(",")
    able = [name for name, (_, extra) in EXAMPLES.items() if extra in asked]
    return able, [name for name in EXAMPLES if name not in able]


def try_on(minor: str, distribution: Path, version: str, extras: str, folder: Path, tell: Tell) -> None:
    """Install a distribution in an empty environment of a Python and run the examples, far from the checkout.

    Args:
        minor: version of Python; if it is not installed, a row reports that.
        distribution: sdist or wheel. Kernels come with the wheel; what is built from the sdist compiles them.
        version: that it must have.
        extras: of the package, with commas between.
        folder: for environment and kernels; kernels are kept for the next distribution on the same Python.
        tell: receives a row per result.

    Raises:
        Failed: something did.
    """
    kind = "wheel" if distribution.suffix == ".whl" else "sdist"
    where = f"Python {minor}, {kind}"
    base = interpreter(minor)
    if base is None:
        tell(Row("installation", where, "not tried: no such Python"))
        return
    home = folder / f"{minor}-{kind}"
    began = time.perf_counter()
    ran(f"{where}: environment", [base, "-m", "venv", home], folder)
    python = home / "bin" / "python"
    pip = [python, "-m", "pip", "--disable-pip-version-check"]
    wanted = f"vibgym[{extras}] @ {distribution.resolve().as_uri()}"
    # What the wheel carries is tried with the wheel.
    settings = {"VIBGYM_SHIP": "0"}
    ran(f"{where}: pip install", [*pip, "install", "--quiet", "-c", ROOT / "constraints.txt", wanted], folder, settings)
    ran(f"{where}: pip check", [*pip, "check"], folder)
    printed, _ = ran(f"{where}: import vibgym", [python, "-W", "error", "-c", FOUND], home)
    require(printed.split() == [version, "True"], f"{where}: import vibgym", printed)
    tell(Row("installation", where, f"vibgym[{extras}], {time.perf_counter() - began:.0f} s"))
    if (ROOT / "vibgym" / "plugins" / "play").exists():
        ran(f"{where}: python -m vibgym play --help", [python, "-m", "vibgym", "play", "--help"], home)
        tell(Row("python -m vibgym play", where, "answers"))
    run_examples(python, where, minor, extras, folder, tell)


def run_examples(python: Path, where: str, minor: str, extras: str, folder: Path, tell: Tell) -> None:
    """Those of the checkout, copied, at small size."""
    place = python.parents[1] / "examples"
    shutil.copytree(ROOT / "examples", place)
    able, others = examples_of(extras)
    cache = {"NUMBA_CACHE_DIR": str(folder / f"{minor}-kernels")}
    own = minor == f"{sys.version_info[0]}.{sys.version_info[1]}"
    for name in able:
        began = time.perf_counter()
        _, printed = ran(f"{where}: examples/{name}.py", [python, f"{name}.py", EXAMPLES[name][0]], place, cache)
        if own and where.endswith("wheel"):
            require("compiling" not in printed, f"{where}: kernels of the wheel, in examples/{name}.py", printed)
        tell(Row(f"examples/{name}.py", where, f"runs, {time.perf_counter() - began:.0f} s"))
    for name in others:
        tell(Row(f"examples/{name}.py", where, f"not tried: needs the extra {EXAMPLES[name][1]}, see --extras"))
