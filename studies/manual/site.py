"""Documentation of several versions in one directory of static files.

Each version is a directory, which later builds of other versions leave as it is. ``versions.js`` and ``index.html`` beside them
are written anew by each build: the list of versions, which the pages of all versions load, and a page that leads to the newest
release. The list is a script, not JSON, so that it loads from local files as well.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

from studies.manual.figures_file import ROOT
from vibgym import checks, files

_RELEASE = re.compile(r"v?(\d+(?:\.\d+)+)")
INDEX = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>vibgym</title><meta http-equiv="refresh" content="0; url={first}/index.html">
</head><body><ul>{items}</ul></body></html>
"""


def build(directory: Path, refs: Sequence[str] = ()) -> Path:
    """Build versions into a site and list all versions that it contains; return its first page.

    Args:
        directory: of the site, new or with other versions.
        refs: branches, tags or commits of Git. Empty: the checkout, with its changes, named as its branch.

    Raises:
        ValueError: an unknown ref; nothing is built.  RuntimeError: a build fails; its version and the list are not changed.
    """
    for ref in refs:
        if _git("rev-parse", "--verify", "--quiet", f"{ref}^{{commit}}") is None:
            raise checks.refuse("REF", ref, "a branch, tag or commit")
    directory = files.output_directory(directory).resolve()
    if not refs:
        _build(ROOT, directory, name_of(_git("branch", "--show-current") or "checkout"))
    for ref in refs:
        with tempfile.TemporaryDirectory() as folder:
            checkout = Path(folder) / "checkout"
            _run("git", "-C", str(ROOT), "worktree", "add", "--detach", "--quiet", str(checkout), ref)
            try:
                _build(checkout, directory, name_of(ref))
            finally:
                _run("git", "-C", str(ROOT), "worktree", "remove", "--force", str(checkout))
    return write_list(directory)


def write_list(directory: Path) -> Path:
    """Write the list of a site's versions and its first page; return the page."""
    names = versions(directory)
    items = "".join(f'<li><a href="{name}/index.html">{name}</a></li>' for name in names)
    listed = f"window.VIBGYM_VERSIONS = {json.dumps(names)};\n"
    page = INDEX.format(first=next((name for name in names if _RELEASE.fullmatch(name)), names[0]), items=items)
    files.write_together({directory / "versions.js": listed, directory / "index.html": page})
    return directory / "index.html"


def name_of(ref: str) -> str:
    """Return the directory of a branch, tag or commit: 1.2.3 for the tag v1.2.3, ``a-b`` for the branch ``a/b``."""
    release = _RELEASE.fullmatch(ref)
    return release[1] if release else re.sub(r"[^\w.-]", "-", ref)


def versions(directory: Path) -> list[str]:
    """Return the versions of a site: branches by name, then releases, newest first."""
    names = sorted(path.parent.name for path in directory.glob("*/index.html"))
    releases = [name for name in names if _RELEASE.fullmatch(name)]
    releases.sort(key=lambda name: [int(part) for part in name.split(".")], reverse=True)
    return [*(name for name in names if name not in releases), *releases]


def _build(checkout: Path, directory: Path, name: str) -> None:
    """Build the pages of a checkout with its own code and settings."""
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    environment.setdefault("NUMBA_CACHE_DIR", str(ROOT / "vibgym" / "kernels" / "__pycache__"))  # keyed by sources
    with tempfile.TemporaryDirectory(dir=directory) as folder:
        pages = Path(folder) / "pages"
        command = [sys.executable, "-m", "sphinx", "-W", "--keep-going", "-q", "-b", "html", "-d", f"{folder}/doctrees"]
        command += ["-A", f"site_version={name}", "docs", str(pages)]
        done = subprocess.run(command, cwd=checkout, env=environment, stderr=subprocess.PIPE, text=True, check=False)
        if done.returncode:
            raise RuntimeError(f"the pages of {name} could not be built:\n{done.stderr[-2000:]}")
        shutil.rmtree(directory / name, ignore_errors=True)
        pages.rename(directory / name)


def _run(*command: str) -> None:
    subprocess.run(command, check=True)


def _git(*arguments: str) -> str | None:
    done = subprocess.run(["git", "-C", str(ROOT), *arguments], capture_output=True, text=True, check=False)
    return done.stdout.strip() if done.returncode == 0 else None
