"""Timed paths: lines and arcs that a part shall go along, and where along them its goal is at each instant."""

from vibgym.tasks.paths.drawn import DrawnPaths
from vibgym.tasks.paths.given import GivenPaths
from vibgym.tasks.paths.reach import Reach

__all__ = ["DrawnPaths", "GivenPaths", "Reach"]
