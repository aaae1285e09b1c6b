"""Where results come from: versions, commit, machine, time."""

from __future__ import annotations

import os
import platform
import subprocess
from datetime import UTC, datetime
from importlib import metadata
from pathlib import Path

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


def processor() -> str:
    """Name of the processor, as far as the system tells."""
    try:
        for line in Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    except OSError:
        pass  # not Linux
    return platform.processor() or platform.machine()


def cores() -> int:
    """Processors that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def provenance() -> dict[str, object]:
    """All of it, as JSON values."""
    return {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "commit": commit(),
        "machine": {"system": platform.platform(), "processor": processor(), "cores": cores()},
        "versions": versions(),
    }
