"""Learned manipulation on a segmented vibrating surface: exact planar physics, Gymnasium environments, baselines."""

from vibgym.envs import register_environments
from vibgym.scene import Part, Simulator, Surface

__version__ = "0.1.0"
__all__ = ["Part", "Simulator", "Surface"]

register_environments()
