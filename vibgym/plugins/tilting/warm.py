"""Compile the kernels of the tilting model."""

from __future__ import annotations

from vibgym import Simulator, Surface
from vibgym.warm import BLOCKS


def compile_kernels() -> None:
    """Run a period with tilted parts, of one part and of several."""
    for parts in (BLOCKS[:1], BLOCKS):
        simulator = Simulator(Surface(), parts, model="tilting")
        simulator.tip(0, 0.02)
        simulator.advance(0.0, 0.0)
