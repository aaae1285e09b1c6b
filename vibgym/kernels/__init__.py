"""Compilation of kernels with numba, and all uses of its private interfaces (docs/numba.md).

The rest of the project compiles by :mod:`vibgym.kernels.jit`, :mod:`vibgym.kernels.reference` and
:mod:`vibgym.kernels.vector` only.
:mod:`vibgym.kernels.interfaces` decides what these use.
"""
