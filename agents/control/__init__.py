"""Controllers without learning."""

from __future__ import annotations

from typing import Any

from agents.control.constant import RandomPolicy, ZeroPolicy
from agents.control.local_field import LocalFieldPolicy
from agents.control.local_fields import LocalFieldsPolicy
from agents.control.open_loop import OpenLoopPolicy
from agents.control.planner import PlannerPolicy

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
