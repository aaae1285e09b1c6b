"""The camera: optics, images, the processing chain of the thesis's chapter 5, tracking, and their statistics."""

from vibgym.sensing.camera.sensor import CameraSensor
from vibgym.sensing.camera.setup import Settings, Setup

__all__ = ["CameraSensor", "Settings", "Setup"]
