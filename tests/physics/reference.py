"""The independent integrator for the tests: :mod:`studies.benchmarks.point_sampling`, which knows nothing of the kernels."""

from studies.benchmarks.point_sampling import simulate, strew, strew_disc

__all__ = ["simulate", "strew", "strew_disc"]
