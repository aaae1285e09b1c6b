"""How a scene moves on: the simulator, its models, and what "auto" picks."""

from vibgym.simulation.simulator import Simulator

__all__ = ["Simulator"]
