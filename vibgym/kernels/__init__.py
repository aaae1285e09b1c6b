"""Compilation of kernels with numba (docs/numba.md).

The rest of the project uses :mod:`vibgym.kernels.jit`, :mod:`vibgym.kernels.reference` and :mod:`vibgym.kernels.vector` only.
"""
