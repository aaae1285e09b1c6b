"""Control laws by name."""

from __future__ import annotations

from typing import Any

from agents.control.local_law import LocalLaw
from agents.control.lqr import LqrLaw
from agents.control.pid_law import PidLaw
from agents.control.pose_law import PoseLaw
from agents.control.state_space_law import StateSpaceLaw
from vibgym.registry import Registry

LAWS: Registry[Any] = Registry(
    "law", {"local": LocalLaw, "pose": PoseLaw, "lqr": LqrLaw, "pid": PidLaw, "state_space": StateSpaceLaw}
)
"""``LAWS.register(name, cls)`` adds one of your own, made as ``cls(info, **settings)``; see :mod:`agents.control.law`."""
