"""The camera: optics, images, the processing chain of the thesis's chapter 5, tracking, and their statistics."""

from vibgym.plugins.camera.sensor import CameraSensor
from vibgym.plugins.camera.setup import Setup

__all__ = ["CameraSensor", "Setup"]
