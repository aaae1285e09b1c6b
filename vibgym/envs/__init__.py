"""Gymnasium environments, single and vectorised, on the same batched core."""

from vibgym.envs.actions import ACTIONS, Action
from vibgym.envs.local_actions import Field, Patch
from vibgym.envs.motions import Target, Velocity, Wrench
from vibgym.envs.observations import OBSERVATIONS, Observation
from vibgym.envs.options import Options
from vibgym.envs.shared import Truth
from vibgym.envs.single import VibgymEnv
from vibgym.envs.vector import VibgymVectorEnv

__all__ = [
    "ACTIONS",
    "OBSERVATIONS",
    "Action",
    "Field",
    "Observation",
    "Options",
    "Patch",
    "Target",
    "Truth",
    "Velocity",
    "VibgymEnv",
    "VibgymVectorEnv",
    "Wrench",
]
