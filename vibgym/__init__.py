"""Learned manipulation on a segmented vibrating surface: exact planar physics, Gymnasium environments, baselines."""

from __future__ import annotations

import importlib
from typing import TYPE_CHECKING, Any

from vibgym import registration

if TYPE_CHECKING:
    from vibgym.policies import make_policy
    from vibgym.scene import Part, Surface
    from vibgym.simulation import Simulator

__version__ = "0.2.0"
__all__ = ["Part", "Simulator", "Surface", "make_policy"]

_ROOMS = (
    "actuators", "adapters", "allocation", "bounds", "config", "envs", "fields", "hardware", "identification", "policies",
    "rendering", "scene", "seeds", "sensing", "simulation", "tasks",
)  # fmt: skip

_PLACES = {
    "Part": "vibgym.scene",
    "Simulator": "vibgym.simulation",
    "Surface": "vibgym.scene",
    "make_policy": "vibgym.policies",
    "parallel_env": "vibgym.adapters.pettingzoo",  # PettingZoo is an extra
}
"""Modules of names that are imported on first use."""

registration.register_environments()


def __getattr__(name: str) -> Any:
    """Import a submodule or a name on first use; ``gym.make`` resolves registered names this way."""
    if name in _ROOMS:
        return importlib.import_module(f"vibgym.{name}")
    if name in _PLACES:
        return getattr(importlib.import_module(_PLACES[name]), name)
    raise AttributeError(f"module 'vibgym' has no attribute {name!r}")
