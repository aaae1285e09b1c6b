"""Controllers without learning."""

from __future__ import annotations

from typing import Any

from agents.classical.constant import RandomPolicy, ZeroPolicy
from agents.classical.local_field import LocalFieldPolicy
from agents.classical.local_fields import LocalFieldsPolicy
from agents.classical.open_loop import OpenLoopPolicy
from agents.classical.planner import PlannerPolicy

CLASSICAL: dict[str, Any] = {
    "zero": ZeroPolicy,
    "random": RandomPolicy,
    "open_loop": OpenLoopPolicy,
    "local_field": LocalFieldPolicy,
    "local_fields": LocalFieldsPolicy,
    "planner": PlannerPolicy,
}

__all__ = [
    "CLASSICAL",
    "LocalFieldPolicy",
    "LocalFieldsPolicy",
    "OpenLoopPolicy",
    "PlannerPolicy",
    "RandomPolicy",
    "ZeroPolicy",
]
