"""Hatchling build hook: add the kernels' bitcode to the wheel, for the Python and the package versions of the build.

``python -m vibgym warm --ship`` writes the bitcode (``vibgym/kernels/cache.py``) in the build environment, in a minute or two.
That environment has the run-time dependencies in the versions of constraints.txt. An editable installation needs only
hatchling. docs/numba.md describes wheels for several versions.

Environment variables: ``VIBGYM_SHIP=0`` builds a wheel without bitcode. ``VIBGYM_SHIP_PYTHONS=/one/python:/another/python``
compiles for these interpreters, with the dependencies installed in each, instead of the one that builds.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from pathlib import Path
from typing import Any

from hatchling.build import *  # noqa: F403
from hatchling.build import get_requires_for_build_wheel as _hatchling_requires
from hatchling.builders.hooks.plugin.interface import BuildHookInterface

ROOT = Path(__file__).parent

SHIP = os.environ.get("VIBGYM_SHIP", "1") != "0"

WITHOUT_KERNELS = "Set VIBGYM_SHIP=0 for a wheel whose kernels are compiled where they are used."

WIDTHS = ("4", "8")
"""Vector widths of the target processors, in doubles: AVX2 and AVX-512. ``VIBGYM_VECTOR`` selects one."""

UNSET = ("NUMBA_BOUNDSCHECK", "NUMBA_DEBUGINFO", "NUMBA_DISABLE_JIT", "VIBGYM_CACHE", "VIBGYM_PLAIN_NUMBA")
"""Environment variables that bitcode must not depend on."""


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """Return hatchling's build requirements and, for wheels with bitcode, the run-time dependencies in tested versions."""
    return [*_hatchling_requires(config_settings), *(_tested() if SHIP else [])]


def _tested() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["policies"], "llvmlite"]
    needed = {_plain(each) for each in wanted}
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if _plain(line) in needed]


def _plain(requirement: str) -> str:
    """Return the normalised package name of a requirement."""
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0].lower().replace("_", "-")


class Kernels(BuildHookInterface):
    """Add the kernels to the wheel."""

    _folder: Path | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Compile the kernels before files are collected; ``version`` is "standard" or "editable"."""
        if version == "editable":
            return
        if not SHIP:
            self.app.display_warning("VIBGYM_SHIP is 0: the wheel holds no kernels")
            return
        self._folder = Path(tempfile.mkdtemp(prefix="vibgym-kernels-"))
        for python in os.environ.get("VIBGYM_SHIP_PYTHONS", sys.executable).split(os.pathsep):
            self._collect(python, self._folder)
        build_data["force_include"][str(self._folder)] = "vibgym/kernels/shipped"

    def _collect(self, python: str, folder: Path) -> None:
        environment = {name: value for name, value in os.environ.items() if name not in UNSET}
        command = [python, "-m", "vibgym", "warm", "--ship", str(folder)]
        for width in os.environ.get("VIBGYM_VECTOR", " ".join(WIDTHS)).split():
            try:
                done = subprocess.run(
                    command, cwd=ROOT, env={**environment, "VIBGYM_VECTOR": width}, text=True, capture_output=True
                )
                output, failed = done.stdout + done.stderr, done.returncode != 0
            except OSError as error:
                output, failed = str(error), True
            if failed:
                self._remove()
                self.app.abort(
                    f"{output.strip()}\nkernels for the wheel: {' '.join(command)} failed, see above. {WITHOUT_KERNELS}"
                )
            self.app.display_info(output.strip())

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder after the wheel is written."""
        self._remove()

    def _remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
