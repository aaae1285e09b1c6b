"""Builds sdist and wheel, and looks into both."""

from __future__ import annotations

import re
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

from packaging.metadata import Metadata

from studies.release.checked import ROOT, Row, Tell, ran, require, same

SOURCES = ("vibgym", "agents", "studies", "configs", "docs", "examples", "notebooks", "results", "tests")
"""Folders of an sdist."""

BESIDE = (
    "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile", "PKG-INFO", "README.md", "constraints.txt",
    "hatch_build.py", "pyproject.toml",
)  # fmt: skip
"""Files beside them."""


def project() -> dict[str, Any]:
    """Return the project table of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def versions_agree(tag: str | None, tell: Tell) -> str:
    """Return the version after checking that pyproject.toml, package, changelog, citation and tag agree on it."""
    version = project()["version"]
    places = {
        "vibgym/__init__.py": r'^__version__ = "(.+)"$',
        "CHANGELOG.md": r"^## \[(\d.*?)\]",
        "CITATION.cff": r"^version: (\S+)$",
    }
    for name, pattern in places.items():
        found = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.M)
        require(found and found[1] == version, f"version in {name}", found[1] if found else "none")
    require(tag is None or tag == f"v{version}", "tag", f"{tag}, where pyproject.toml has {version}")
    tell(Row("version", "pyproject.toml and beside", f"{version}, {len(places) + 1 + (tag is not None)} places"))
    return version


def build(folder: Path, tell: Tell) -> tuple[Path, Path]:
    """Both distributions, in ``folder``: the sdist from the checkout, the wheel from the sdist, so that it lacks nothing."""
    ran("sdist", [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder], ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    tell(Row("sdist", "built", f"{sdist.name}, {sdist.stat().st_size / 1e6:.1f} MB"))
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
    ran("wheel", [*pip, "--no-deps", "--no-build-isolation", "-w", folder, sdist], folder)
    (wheel,) = folder.glob("*.whl")
    tell(Row("wheel", "built from it", f"{wheel.name}, {wheel.stat().st_size / 1e6:.1f} MB"))
    return sdist, wheel


def look_into_sdist(sdist: Path, tell: Tell) -> None:
    """It holds what is needed to build, to test and to write the documentation, and nothing that was computed here."""
    with tarfile.open(sdist) as packed:
        names = [name.partition("/")[2] for name in packed.getnames()]
    # .gitignore comes along: hatchling goes by it, in a build from the sdist, too.
    tops = {name.partition("/")[0] for name in names} - {".gitignore"}
    same("sdist's folders", tops, [*(name for name in SOURCES if (ROOT / name).exists()), *BESIDE])
    unwanted = [name for name in names if re.search(r"(^|/)(runs|__pycache__|\.venv[^/]*|_build)(/|$)", name)]
    require(not unwanted, "sdist without runs and caches", unwanted[:3])
    tell(Row("sdist", "contents", f"{len(names)} files, no runs, no caches"))


def look_into_wheel(wheel: Path, version: str, tell: Tell) -> None:
    """It holds the package alone, with kernels, shipped policies, types and pages; its metadata are valid."""
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
        metadata = packed.read(f"vibgym-{version}.dist-info/METADATA")
    same("wheel's folders", {name.partition("/")[0] for name in names}, ["vibgym", f"vibgym-{version}.dist-info"])
    require("vibgym/py.typed" in names, "wheel", "no vibgym/py.typed")
    for what, folder in {"policies": "vibgym/policies/trained/shipped", "page": "vibgym/plugins/play/page"}.items():
        expected = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*.*")}
        if not expected:
            tell(Row("wheel", what, "not in the checkout"))
            continue
        require(expected <= names, f"wheel's {what}", f"missing {sorted(expected - names)[:3]}")
        tell(Row("wheel", what, f"{len(expected)} files"))
    kernels = sum(name.endswith(".bitcode") for name in names)
    require(kernels > 30, "wheel's kernels", kernels)
    tell(Row("wheel", "kernels", f"{kernels}, for Python {sys.version_info[0]}.{sys.version_info[1]}"))
    look_into_metadata(metadata, tell)


def look_into_metadata(metadata: bytes, tell: Tell) -> None:
    """What package indexes ask for: valid by their standard, with a description that they show, and all extras."""
    try:
        read = Metadata.from_email(metadata, validate=True)
    except ExceptionGroup as errors:
        require(False, "metadata", "; ".join(map(str, errors.exceptions)))
        raise
    asked = project()
    require(
        str(read.version) == asked["version"] and read.name == asked["name"], "metadata", f"{read.name} {read.version}"
    )
    same("metadata's extras", read.provides_extra or (), asked["optional-dependencies"])
    require(read.description_content_type == "text/markdown", "metadata's description", read.description_content_type)
    require(
        read.description == (ROOT / "README.md").read_text(encoding="utf-8"), "metadata's description", "another README"
    )
    require(read.license_expression and read.license_files, "metadata's license", read.license_expression)
    tell(
        Row(
            "metadata", "wheel", f"version {read.metadata_version}, valid; {len(asked['optional-dependencies'])} extras"
        )
    )
