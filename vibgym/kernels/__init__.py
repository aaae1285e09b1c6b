"""Compilation of kernels with numba, and all uses of numba's private interfaces (docs/numba.md).

The rest of the project imports only :mod:`vibgym.kernels.jit`, :mod:`vibgym.kernels.reference`, :mod:`vibgym.kernels.vector`.
With ``VIBGYM_PLAIN_NUMBA=1`` these use :mod:`vibgym.kernels.plain`, which needs numba's public interface alone.
"""
