"""Compile the kernels of the camera."""

from __future__ import annotations

from vibgym.warm import environment


def compile_kernels() -> None:
    """Run a step with camera images, and one with the statistical camera."""
    environment(sensor="camera", observation="camera")
    environment(sensor={"kind": "camera", "statistical": True})
