"""The independent integrator for the tests: :mod:`benchmarks.point_sampling`, which knows nothing of the kernels."""

from benchmarks.point_sampling import simulate, strew, strew_disc

__all__ = ["simulate", "strew", "strew_disc"]
