"""Compile the kernels of the camera."""

from __future__ import annotations

from collections.abc import Iterator

from vibgym.warm import environment


def compile_kernels() -> Iterator[None]:
    """Run a step with camera images, and one with the statistical camera."""
    yield from environment(sensor="camera", observation="camera")
    yield from environment(sensor={"kind": "camera", "statistical": True})
