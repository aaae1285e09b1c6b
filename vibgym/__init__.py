"""Learned manipulation on a segmented vibrating surface: exact planar physics, Gymnasium environments, baselines."""

from __future__ import annotations

from vibgym import interrupts

if interrupts.started():
    interrupts.at_once()  # before the imports below, which take seconds

import importlib
from typing import Any

from vibgym.registration import register_environments
from vibgym.scene import Part, Surface
from vibgym.simulation import Simulator

__version__ = "0.1.0"
__all__ = ["Part", "Simulator", "Surface", "make_policy"]  # pyright: ignore[reportUnsupportedDunderAll]

_ROOMS = (
    "actuators", "adapters", "allocation", "bounds", "config", "envs", "fields", "policies", "rendering", "sensing", "tasks",
)  # fmt: skip

register_environments()


def __getattr__(name: str) -> Any:
    """Import a submodule, or what needs an extra, when first asked for; ``gym.make`` does so by the registered names."""
    if name in _ROOMS:
        return importlib.import_module(f"vibgym.{name}")
    if name == "make_policy":
        return importlib.import_module("vibgym.policies").make_policy
    if name == "parallel_env":  # PettingZoo is an extra
        return importlib.import_module("vibgym.adapters.pettingzoo").parallel_env
    raise AttributeError(f"module 'vibgym' has no attribute {name!r}")
