"""The independent integrator for the tests: :mod:`benchmarks.point_sampling`, which knows nothing of ``vibgym``."""

from benchmarks.point_sampling import simulate, strew, strew_disc

__all__ = ["simulate", "strew", "strew_disc"]
