"""Kernels are compiled once a node, by the first process that has work there."""

from __future__ import annotations

from pathlib import Path

import numba
from filelock import FileLock

import vibgym
from vibgym.files import write_atomically
from vibgym.kernels.jit import cache_folder
from vibgym.warm import warm

STAMP = f"vibgym {vibgym.__version__}, numba {numba.__version__}"
"""What the mark of a warm cache says."""


def compiled() -> None:
    """Compile all kernels and keep them, where no process of this node has done so; others wait meanwhile."""
    folder = cache_folder()
    if folder is None:
        return
    mark = Path(folder) / "warm"
    mark.parent.mkdir(parents=True, exist_ok=True)
    with FileLock(mark.with_suffix(".lock")):
        if not mark.exists() or mark.read_text(encoding="utf-8") != STAMP:
            warm(lambda text: None)
            write_atomically(mark, STAMP)
