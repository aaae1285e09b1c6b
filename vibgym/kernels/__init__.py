"""Compilation of kernels with numba, and all uses of its private interfaces (docs/numba.md).

The rest of the project imports only :mod:`vibgym.kernels.jit`, :mod:`vibgym.kernels.reference`, :mod:`vibgym.kernels.vector`.
:mod:`vibgym.kernels.interfaces` decides what these use.
"""
