"""Adapters of the environments to other libraries; each module but `lerobot` needs the library that it is named after."""

from __future__ import annotations

import importlib
from typing import Any


def __getattr__(name: str) -> Any:
    """Import a module on first use."""
    if name in ("pettingzoo", "sb3"):
        return importlib.import_module(f"vibgym.adapters.{name}")
    raise AttributeError(f"module 'vibgym.adapters' has no attribute {name!r}")
