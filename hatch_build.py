"""How wheels are built: by hatchling, with the kernels' bitcode for the Python and the versions that build it.

``vibgym/kernels/cache.py`` describes it, and docs/numba.md how to put several versions into one wheel. It is made by
``python -m vibgym warm --ship`` in the environment of the build, which takes a minute or two where nothing is compiled yet. So
that environment holds what the package runs on, in the versions of constraints.txt; an editable installation, which holds no
bitcode, asks for nothing but hatchling.

``VIBGYM_SHIP=0``: a wheel without bitcode. ``VIBGYM_SHIP_PYTHONS=/one/python:/another/python``: for these interpreters, each
with what the package runs on, in place of the one that builds.
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

OTHERWISE = "Set VIBGYM_SHIP=0 for a wheel whose kernels are compiled where they are used."

WIDTHS = ("4", "8")
"""Doubles in a register of the processors that the wheel is for: AVX2, and AVX-512. ``VIBGYM_VECTOR`` names one of them."""

UNSET = ("NUMBA_BOUNDSCHECK", "NUMBA_DEBUGINFO", "NUMBA_DISABLE_JIT", "VIBGYM_CACHE", "VIBGYM_PLAIN_NUMBA")
"""Environment variables that bitcode must not depend on."""


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """What the package runs on, in the tested versions, besides what hatchling asks for."""
    return [*_hatchling_requires(config_settings), *(_tested() if SHIP else [])]


def _tested() -> list[str]:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    wanted = [*project["dependencies"], *project["optional-dependencies"]["policies"], "llvmlite"]
    needed = {_plain(each) for each in wanted}
    lines = (ROOT / "constraints.txt").read_text(encoding="utf-8").splitlines()
    return [line for line in lines if _plain(line) in needed]


def _plain(requirement: str) -> str:
    """The name alone, as package indexes have it."""
    return re.split(r"[^\w.-]", requirement, maxsplit=1)[0].lower().replace("_", "-")


class Kernels(BuildHookInterface):
    """Puts the kernels into the wheel."""

    _folder: Path | None = None

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:
        """Before files are collected; ``version`` is "standard" or "editable"."""
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
                said, failed = done.stdout + done.stderr, done.returncode != 0
            except OSError as error:
                said, failed = str(error), True
            if failed:
                self._remove()
                self.app.abort(
                    f"{said.strip()}\nkernels for the wheel: {' '.join(command)} failed, see above. {OTHERWISE}"
                )
            self.app.display_info(said.strip())

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """After the wheel is written."""
        self._remove()

    def _remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
