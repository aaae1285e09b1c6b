"""Build sdist and wheel, and inspect their contents."""

from __future__ import annotations

import re
import sys
import tarfile
import tomllib
import zipfile
from pathlib import Path
from typing import Any

from packaging.metadata import Metadata
from readme_renderer import markdown

from studies.release.results import ROOT, Report, Row, require, require_names, run_command

SOURCES = ("vibgym", "gym_vibgym", "agents", "studies", "configs", "docs", "examples", "notebooks", "results", "tests")
"""Folders of an sdist."""

FILES = (
    "CHANGELOG.md", "CITATION.cff", "CONTRIBUTING.md", "LICENSE", "Makefile", "PKG-INFO", "README.md", "constraints.txt",
    "pyproject.toml",
)  # fmt: skip
"""Top-level files of an sdist."""


def project() -> dict[str, Any]:
    """Return the project table of pyproject.toml."""
    return tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]


def versions_agree(tag: str | None, report: Report) -> str:
    """Return the version after checking that pyproject.toml, package, changelog, citation and tag agree on it."""
    version = project()["version"]
    patterns = {
        "vibgym/__init__.py": r'^__version__ = "(.+)"$',
        "CHANGELOG.md": r"^## \[(\d.*?)\]",
        "CITATION.cff": r"^version: (\S+)$",
    }
    for name, pattern in patterns.items():
        match = re.search(pattern, (ROOT / name).read_text(encoding="utf-8"), re.M)
        require(match and match[1] == version, f"version in {name}", match[1] if match else "missing")
    require(tag is None or tag == f"v{version}", "tag", f"{tag}, but pyproject.toml has {version}")
    report(Row("version", "pyproject.toml and others", f"{version} in {len(patterns) + 1 + (tag is not None)} places"))
    return version


def build(folder: Path, report: Report) -> tuple[Path, Path]:
    """Build the sdist from the checkout, and from it, which shows that it is complete, the wheel; return both."""
    run_command("sdist", [sys.executable, "-m", "hatchling", "build", "-t", "sdist", "-d", folder], ROOT)
    (sdist,) = folder.glob("*.tar.gz")
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "wheel", "--quiet"]
    run_command("wheel", [*pip, "--no-deps", "--no-build-isolation", "-w", folder, sdist], folder)
    (wheel,) = folder.glob("*-py3-none-any.whl")
    for path in (sdist, wheel):
        report(Row(path.name, "built", f"{path.stat().st_size / 1e6:.1f} MB"))
    return sdist, wheel


def inspect_sdist(sdist: Path, report: Report) -> None:
    """Require the files for build, tests and documentation, and no outputs or caches."""
    with tarfile.open(sdist) as packed:
        names = [name.partition("/")[2] for name in packed.getnames()]
    # hatchling includes .gitignore, since builds from the sdist use it.
    tops = {name.partition("/")[0] for name in names} - {".gitignore"}
    require_names("folders of sdist", tops, [*(name for name in SOURCES if (ROOT / name).exists()), *FILES])
    unwanted = [name for name in names if re.search(r"(^|/)(runs|__pycache__|\.venv[^/]*|_build)(/|$)", name)]
    require(not unwanted, "outputs or caches in sdist", unwanted[:3])
    report(Row("sdist", "contents", f"{len(names)} files, no runs, no caches"))


def inspect_wheel(wheel: Path, version: str, report: Report) -> None:
    """Require the packages alone, with shipped policies, types and web page, and valid metadata."""
    with zipfile.ZipFile(wheel) as packed:
        names = set(packed.namelist())
        metadata = packed.read(f"vibgym-{version}.dist-info/METADATA")
    expected = ["gym_vibgym", "vibgym", f"vibgym-{version}.dist-info"]
    require_names("folders of wheel", {name.partition("/")[0] for name in names}, expected)
    require("vibgym/py.typed" in names, "wheel", "no vibgym/py.typed")
    for content, folder in {"policies": "vibgym/policies/trained/shipped", "page": "vibgym/plugins/play/page"}.items():
        expected = {path.relative_to(ROOT).as_posix() for path in (ROOT / folder).rglob("*.*")}
        if not expected:
            report(Row("wheel", content, "not in the checkout"))
            continue
        require(expected <= names, f"{content} of wheel", f"missing {sorted(expected - names)[:3]}")
        report(Row("wheel", content, f"{len(expected)} files"))
    inspect_metadata(metadata, report)


def inspect_metadata(metadata: bytes, report: Report) -> None:
    """Require metadata that package indexes accept, with the README as description, and all extras."""
    try:
        read = Metadata.from_email(metadata, validate=True)
    except ExceptionGroup as errors:
        require(False, "metadata", "; ".join(map(str, errors.exceptions)))
        raise
    expected = project()
    require(
        str(read.version) == expected["version"] and read.name == expected["name"],
        "metadata",
        f"{read.name} {read.version}",
    )
    require_names("extras in metadata", read.provides_extra or (), expected["optional-dependencies"])
    require(read.description_content_type == "text/markdown", "description in metadata", read.description_content_type)
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    require(read.description == readme, "description in metadata", "differs from README.md")
    rendered = markdown.render(read.description or "")
    require(rendered and "<table>" in rendered and "<img" in rendered, "description in metadata", "cannot be rendered")
    require(read.license_expression and read.license_files, "license in metadata", read.license_expression)
    report(
        Row(
            "metadata",
            "wheel",
            f"version {read.metadata_version}, valid; {len(expected['optional-dependencies'])} extras",
        )
    )
