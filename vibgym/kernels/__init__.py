"""How kernels are compiled: everything that leans on numba, and all that leans on its private parts (docs/numba.md).

The rest of the project imports three doors: :mod:`vibgym.kernels.jit`, :mod:`vibgym.kernels.reference` and
:mod:`vibgym.kernels.foreign`. With ``VIBGYM_PLAIN_NUMBA=1`` they open on :mod:`vibgym.kernels.plain`, which needs nothing but
numba's public interface, else on the modules beside it.
"""
