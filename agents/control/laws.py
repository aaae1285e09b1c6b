"""Control laws by name."""

from __future__ import annotations

from typing import Any

from agents.control.local_law import LocalLaw
from vibgym.registry import Registry

LAWS: Registry[Any] = Registry("law", {"local": LocalLaw})
"""``LAWS.register(name, cls)`` adds one of your own, made as ``cls(info, **settings)``; see :mod:`agents.control.law`."""
