"""Gymnasium environments: a single and a vector one, both thin over the same batched core."""

from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import VibgymVectorEnv

__all__ = ["VibgymEnv", "VibgymVectorEnv"]
