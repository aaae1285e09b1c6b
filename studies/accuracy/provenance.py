"""Where results come from: time, machine, versions."""

from __future__ import annotations

import platform
from datetime import UTC, datetime
from importlib import metadata

from agents.provenance import processor
from vibgym.simulation.threads import available_threads

PACKAGES = ("vibgym", "numpy", "numba", "scipy", "shapely", "mujoco", "matplotlib")


def provenance() -> dict[str, str]:
    """Time, machine and versions; "not installed" where that is so."""
    found = {
        "time": datetime.now(UTC).isoformat(timespec="seconds"),
        "system": platform.platform(),
        "processor": f"{processor()}, {available_threads()} cores",
        "python": platform.python_version(),
    }
    for name in PACKAGES:
        try:
            found[name] = metadata.version(name)
        except metadata.PackageNotFoundError:
            found[name] = "not installed"
    return found
