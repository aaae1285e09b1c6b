"""Where results come from: versions, commit, machine, time."""

from __future__ import annotations

import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

from vibgym.accuracy.provenance import processor
from vibgym.simulation.threads import available_threads

PACKAGES = (
    "vibgym",
    "numpy",
    "numba",
    "gymnasium",
    "scipy",
    "torch",
    "stable-baselines3",
    "safetensors",
    "pygame-ce",
    "cma",
    "matplotlib",
    "pillow",
)


def versions() -> dict[str, str | None]:
    """Version of Python and of every package that has a part in the results; None of one that is not installed."""
    found: dict[str, str | None] = {"python": platform.python_version()}
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = None
    if found["vibgym"] is None:  # run from a checkout that is not installed
        import vibgym

        found["vibgym"] = getattr(vibgym, "__version__", None)
    return found


def commit() -> str | None:
    """Git commit of the checkout, "+ changes" if its tracked files differ from it; None if there is none."""
    here = Path(__file__).parent

    def git(*arguments: str) -> str:
        command = ["git", "-C", str(here), *arguments]
        return subprocess.run(command, capture_output=True, text=True, check=True, timeout=20).stdout.strip()

    try:
        found = git("rev-parse", "HEAD")
        return f"{found} + changes" if git("status", "--porcelain", "--untracked-files=no") else found
    except (OSError, subprocess.SubprocessError):
        return None


def provenance() -> dict[str, object]:
    """All of it, as JSON values."""
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "machine": {"system": platform.platform(), "processor": processor(), "cores": available_threads()},
        "versions": versions(),
    }
