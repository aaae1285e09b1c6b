"""Controllers without learning."""

from __future__ import annotations

from typing import Any

from agents.classical.constant import RandomPolicy, ZeroPolicy
from agents.classical.local_field import LocalFieldPolicy
from agents.classical.open_loop import OpenLoopPolicy

CLASSICAL: dict[str, Any] = {
    "zero": ZeroPolicy,
    "random": RandomPolicy,
    "open_loop": OpenLoopPolicy,
    "local_field": LocalFieldPolicy,
}

__all__ = ["CLASSICAL", "LocalFieldPolicy", "OpenLoopPolicy", "RandomPolicy", "ZeroPolicy"]
