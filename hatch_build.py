"""Hatchling build hooks: bitcode of the kernels in the wheel, for the Python and the package versions of the build, and links.

``python -m vibgym warm --ship`` writes the bitcode (``vibgym/kernels/cache.py``) in the build environment, in a minute or two.
That environment has the run-time dependencies in the versions of constraints.txt. An editable installation needs only
hatchling. A wheel with bitcode is tagged with the Pythons and the platform of its bitcode, such as
``cp313-none-manylinux_2_17_x86_64``; pip prefers it to the universal one, ``py3-none-any``, which has none (docs/platforms.md).

Environment variables: ``VIBGYM_SHIP=0`` builds the universal wheel. ``VIBGYM_SHIP_PYTHONS=/one/python:/another/python``
compiles for these interpreters, with the dependencies installed in each, instead of the one that builds.
``VIBGYM_REPOSITORY``, the address of the repository that a release is built from, adds links to the metadata.
"""

from __future__ import annotations

import os
import platform
import re
import shutil
import subprocess
import sys
import sysconfig
import tempfile
import tomllib
from pathlib import Path
from typing import Any, NoReturn

from hatchling.build import *  # noqa: F403
from hatchling.build import get_requires_for_build_wheel as _hatchling_requires
from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from hatchling.metadata.plugin.interface import MetadataHookInterface

ROOT = Path(__file__).parent

SHIP = os.environ.get("VIBGYM_SHIP", "1") != "0"

WITHOUT_KERNELS = "Set VIBGYM_SHIP=0 for a wheel whose kernels are compiled where they are used."

REPOSITORY = os.environ.get("VIBGYM_REPOSITORY", "")

WIDTHS = "4 8" if platform.machine() in ("x86_64", "AMD64") else "4"
"""Vector widths of the target processors, in doubles: 8 is AVX-512, 4 all others. ``VIBGYM_VECTOR`` selects one."""

VERSION = "import sys; print('cp%d%d' % sys.version_info[:2])"

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


def _platform() -> str:
    """Return the platform tag of bitcode from this machine.

    Bitcode links to no libraries, so the oldest glibc that package indexes accept will do; they reject the tag "linux".
    """
    tag = re.sub(r"\W", "_", sysconfig.get_platform())
    return tag.replace("linux", "manylinux_2_17", 1) if platform.libc_ver()[0] == "glibc" else tag


def description(version: str) -> str:
    """Return the README; with ``VIBGYM_REPOSITORY``, its links lead to the files of the version's tag there."""
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    if not REPOSITORY:
        return text

    def link(found: re.Match[str]) -> str:
        image, label, path = found.groups()
        return f"{image}[{label}]({REPOSITORY}/{'raw' if image else 'blob'}/v{version}/{path})"

    return re.sub(r"(!?)\[([^\]]*)\]\((?![a-z]+:|#)([^)]+)\)", link, text)


class Links(MetadataHookInterface):
    """Add the long description, and the project's links."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the dynamic fields of the project table."""
        version = metadata["version"]
        metadata["readme"] = {"content-type": "text/markdown", "text": description(version)}
        metadata["urls"] = {
            "Source": REPOSITORY,
            "Documentation": f"{REPOSITORY}/blob/v{version}/docs/index.md",
            "Changelog": f"{REPOSITORY}/blob/v{version}/CHANGELOG.md",
            "Issues": f"{REPOSITORY}/issues",
        } if REPOSITORY else {}  # fmt: skip


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
        versions = set()
        for python in os.environ.get("VIBGYM_SHIP_PYTHONS", sys.executable).split(os.pathsep):
            versions.add(self._run([python, "-c", VERSION], {}).strip())
            for width in os.environ.get("VIBGYM_VECTOR", WIDTHS).split():
                command = [python, "-m", "vibgym", "warm", "--ship", str(self._folder)]
                self.app.display_info(self._run(command, {"VIBGYM_VECTOR": width}).strip())
        build_data["force_include"][str(self._folder)] = "vibgym/kernels/shipped"
        build_data["tag"] = f"{'.'.join(sorted(versions))}-none-{_platform()}"

    def _run(self, command: list[str], variables: dict[str, str]) -> str:
        """Run a command in the checkout and return its output; end the build if it fails."""
        environment = {name: value for name, value in os.environ.items() if name not in UNSET} | variables
        try:
            done = subprocess.run(command, cwd=ROOT, env=environment, text=True, capture_output=True)
        except OSError as error:
            self._fail(command, str(error))
        if done.returncode != 0:
            self._fail(command, done.stdout + done.stderr)
        return done.stdout

    def _fail(self, command: list[str], output: str) -> NoReturn:
        self._remove()
        self.app.abort(
            f"{output.strip()}\nkernels for the wheel: {' '.join(command)} failed, see above. {WITHOUT_KERNELS}"
        )

    def finalize(self, version: str, build_data: dict[str, Any], artifact_path: str) -> None:
        """Remove the temporary folder after the wheel is written."""
        self._remove()

    def _remove(self) -> None:
        if self._folder is not None:
            shutil.rmtree(self._folder, ignore_errors=True)
