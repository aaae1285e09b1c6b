"""The project's public address, from which links to its files derive."""

from __future__ import annotations

import tomllib
from pathlib import Path

PYPROJECT = Path(__file__).parents[1] / "pyproject.toml"
BRANCH = "main"
COLAB = "https://colab.research.google.com/github"
GITHUB = "https://github.com/"


def repository(pyproject: Path = PYPROJECT) -> str | None:
    """Return the address of the repository: ``Repository`` in ``[project.urls]`` of pyproject.toml; None if there is none."""
    urls = tomllib.loads(pyproject.read_text(encoding="utf-8"))["project"].get("urls", {})
    address = urls.get("Repository")
    return None if address is None else address.removesuffix("/").removesuffix(".git")


def colab(path: str, pyproject: Path = PYPROJECT) -> str | None:
    """Return the address at which Colab opens a notebook of the repository; None if the repository is not public on GitHub.

    Args:
        path: of the notebook, relative to the checkout.
        pyproject: file that names the repository.
    """
    address = repository(pyproject)
    if address is None or not address.startswith(GITHUB):
        return None
    return f"{COLAB}/{address.removeprefix(GITHUB)}/blob/{BRANCH}/{path}"
