"""Compile the kernels of the camera."""

from __future__ import annotations

from vibgym.warm import machine


def compile_kernels() -> None:
    """Run a step with camera images, and one with the camera's statistics."""
    machine(sensor="camera", observation="camera")
    machine(sensor={"kind": "camera", "statistical": True})
