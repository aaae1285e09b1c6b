"""Compile the kernels of the tilting model."""

from __future__ import annotations

from collections.abc import Iterator

from vibgym import Simulator, Surface
from vibgym.warm import BLOCKS


def compile_kernels() -> Iterator[None]:
    """Run a period with tilted parts, of one part and of several."""
    simulators = [Simulator(Surface(), parts, model="tilting") for parts in (BLOCKS[:1], BLOCKS)]
    yield
    for simulator in simulators:
        simulator.tip(0, 0.02)
        simulator.advance(0.0, 0.0)
