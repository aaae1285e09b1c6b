"""The algorithms that training files may name."""

from __future__ import annotations

from agents.training.algorithm import Algorithm
from agents.training.offline.algorithm import Offline
from agents.training.ppo.algorithm import PPO
from agents.training.sac.algorithm import SAC
from vibgym.registry import Registry

ALGORITHMS: Registry[type[Algorithm]] = Registry("algorithm", {"ppo": PPO, "sac": SAC, "offline": Offline})
"""Algorithms by name; ``ALGORITHMS.register(name, cls)`` adds one of your own."""
