"""Provenance of results: versions, commit, host, time, and the files of policies."""

from __future__ import annotations

import contextlib
import hashlib
import json
import os
import platform
import re
import subprocess
import sys
import sysconfig
from collections.abc import Iterable, Mapping
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path
from typing import Any

import vibgym
from vibgym.simulation.threads import available_threads

PACKAGES = (
    "vibgym", "numpy", "numba", "gymnasium", "scipy", "torch", "stable-baselines3", "safetensors", "pygame-ce", "cma",
    "matplotlib", "pillow",
)  # fmt: skip


def versions() -> dict[str, str | None]:
    """Return the versions of Python and of the packages that affect results; None if not installed."""
    installed: dict[str, str | None] = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            installed[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            installed[name] = None
    if installed["vibgym"] is None:  # run from a checkout that is not installed
        installed["vibgym"] = vibgym.__version__
    return installed


def commit() -> str | None:
    """Return the Git commit of the checkout, with "+ changes" if tracked files differ from it; None without Git."""
    try:
        head = _git("rev-parse", "HEAD")
        return f"{head} + changes" if _git("status", "--porcelain", "--untracked-files=no") else head
    except (OSError, subprocess.SubprocessError):
        return None


def code(*packages: Path, without: Path) -> str:
    """Return a digest of all files of packages, tracked by Git or not, but compiled ones and those ``without``."""
    contents = {
        str(path.relative_to(package.parent)): digest(path.read_bytes())
        for package in packages
        for path in package.rglob("*")
        if path.is_file() and "__pycache__" not in path.parts and not path.is_relative_to(without)
    }
    return digest(json.dumps(contents, sort_keys=True))


def _git(*arguments: str) -> str:
    command = ["git", "-C", str(Path(__file__).parent), *arguments]
    return subprocess.run(command, capture_output=True, encoding="utf-8", check=True, timeout=20).stdout.strip()


def processor() -> str:
    """Return the name of the processor."""
    with contextlib.suppress(OSError):  # not Linux
        if named := re.search(r"model name\s*: (.+)", Path("/proc/cpuinfo").read_text(encoding="utf-8")):
            return named[1].strip()
    return platform.processor() or platform.machine()


def provenance() -> dict[str, object]:
    """Return time, commit, host and versions as JSON values."""
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "host": {"system": platform.platform(), "processor": processor(), "cores": available_threads()},
        "versions": versions(),
    }


def digest(data: str | bytes) -> str:
    """Return the SHA-256 of bytes, or of a text as UTF-8, in hexadecimal digits."""
    return hashlib.sha256(data.encode() if isinstance(data, str) else data).hexdigest()


def portable(value: Any) -> Any:
    """Return JSON values without absolute paths: those below the current directory become relative, others their names.

    Args:
        value: a text, or mappings and lists of values; keys and other values are unchanged.
    """
    if isinstance(value, Mapping):
        return {key: portable(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [portable(entry) for entry in value]
    if not isinstance(value, str) or not (path := Path(value)).is_absolute():
        return value
    here = Path.cwd()
    return path.relative_to(here).as_posix() if path.is_relative_to(here) else path.name


def policy_files(policies: Iterable[tuple[Any, str]]) -> dict[str, str | None]:
    """Return the files that policies are read from, with the digests of their contents, see :func:`policy_sources`.

    Args:
        policies: what :func:`vibgym.policies.registry.make_policy` takes, and the name of a task.

    Returns:
        The digests by path, see :func:`portable`; None for a JSON file that cannot be read.
    """
    digests: dict[str, str | None] = {}
    for content, task in policies:
        digests |= policy_sources(content, task)[1]
    return {portable(name): digests[name] for name in sorted(digests)}


def policy_sources(content: Any, task: str) -> tuple[set[str], dict[str, str | None]]:
    """Return all texts in a policy's settings and in the bases of its files, and the files that they name.

    Args:
        content: what :func:`vibgym.policies.registry.make_policy` takes.
        task: name of a task, which ``{task}`` stands for.

    Returns:
        The texts, and path -> digest of every file: texts that are names of files, and tensors that a JSON file names. None for
        a JSON file that cannot be read.
    """
    texts: set[str] = set()
    files: dict[str, str | None] = {}

    def collect(value: Any) -> None:
        if isinstance(value, Mapping):
            value = list(value.values())
        if isinstance(value, list | tuple):
            for entry in value:
                collect(entry)
        elif isinstance(value, str | os.PathLike):
            text = os.fspath(value).replace("{task}", task.lower())
            if text not in texts and (text.endswith(".json") or os.path.isfile(text)):
                texts.add(text)
                collect(_file_and_tensors(Path(text), files))
            texts.add(text)

    collect(content)
    return texts, files


def _file_and_tensors(path: Path, files: dict[str, str | None]) -> Any:
    """Add the digests of a file and of the tensors that it names to ``files``; return the settings of its base policy."""
    base = files[path.as_posix()] = None
    with contextlib.suppress(OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        # A file without tensors is complete; what is missing or invalid is refused when the policy is made.
        data = path.read_bytes()
        files[path.as_posix()] = digest(data)
        record = json.loads(data)
        base = record.get("residual")
        tensors = path.with_name(record["tensors"])
        files[tensors.as_posix()] = digest(tensors.read_bytes())
    return base


def user_modules() -> dict[str, str]:
    """Return the digests of all loaded modules that are neither installed nor in ``vibgym`` or ``agents``, by name."""
    places = [*(sysconfig.get_path(name) for name in ("stdlib", "platstdlib", "purelib", "platlib"))]
    places += [str(Path(__file__).parent), *vibgym.__path__]
    digests = {}
    for name, module in list(sys.modules.items()):
        file = getattr(module, "__dict__", {}).get("__file__")
        if file and not any(Path(file).is_relative_to(place) for place in places):
            with contextlib.suppress(OSError):
                digests[name] = digest(Path(file).read_bytes())
    return digests
