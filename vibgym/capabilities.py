"""What this installation can do: ``python -m vibgym capabilities``.

Each capability depends on the platform or on interfaces that other libraries do not guarantee. Where it is missing, something
slower replaces it, or one error says so; each can be switched off.
"""

from __future__ import annotations

import os
from typing import NamedTuple

from vibgym.kernels import interfaces, options
from vibgym.kernels.jit import cache_folder
from vibgym.simulation.threads import available_threads


class Capability(NamedTuple):
    """A capability of this installation."""

    name: str
    state: str  # "yes", with details, or "no", with the reason
    effect: str  # what happens without it
    switch: str  # how to switch it off


def capabilities() -> list[Capability]:
    """Return all capabilities, as of this process."""
    folder = cache_folder()
    private = interfaces.MODE == interfaces.PRIVATE
    return [
        Capability(
            "fast compilation",
            "yes" if private else f"no: {interfaces.REASON}",
            "without: numba.njit compiles, four to six times as long, once",
            f"{interfaces.SWITCH}=1",
        ),
        Capability(
            "kernel cache",
            f"yes, in {folder}" if folder else "no: VIBGYM_CACHE is 0, or no folder may be written",
            "without: every process compiles again",
            "VIBGYM_CACHE=0",
        ),
        Capability(
            "kernels in the wheel",
            _bitcode() if private else f"no: {interfaces.REASON}",
            "without: kernels are compiled on first use",
            "VIBGYM_BITCODE=0",
        ),
        Capability(
            "wide registers",
            _registers(),
            "without: half as many parts of a group at a time",
            "VIBGYM_VECTOR=4",
        ),
        Capability(
            "forks while a kernel compiles",
            "yes" if private and hasattr(os, "register_at_fork") else "no",
            "without: a child forked at that time may wait for ever; use spawn",
            f"{interfaces.SWITCH}=1",
        ),
        Capability(
            "threads",
            f"yes, {available_threads()}" if available_threads() > 1 else "no: one processor",
            "without: a batch advances its worlds one block after the other",
            "VIBGYM_THREADS=1",
        ),
    ]


def _bitcode() -> str:
    from vibgym.kernels.cache import SHIPPED, version_mismatch

    if not options.BITCODE:
        return "no: VIBGYM_BITCODE is 0"
    if not SHIPPED.is_dir():
        return "no: a checkout, or a wheel without kernels"
    mismatch = version_mismatch()
    return f"no: {mismatch}" if mismatch else "yes"


def _registers() -> str:
    if interfaces.MODE == interfaces.INTERPRETED:
        return f"no: {interfaces.REASON}"
    from vibgym.kernels.vec8 import WIDTH

    return "yes, 8 doubles" if WIDTH == 8 else "no: 4 doubles"
