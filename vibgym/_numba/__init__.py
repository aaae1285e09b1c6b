"""How kernels are compiled: everything that leans on numba, and all that leans on its private parts (docs/numba.md).

The rest of the project imports three doors: :mod:`vibgym._numba.jit`, :mod:`vibgym._numba.reference` and
:mod:`vibgym._numba.foreign`. With ``VIBGYM_PLAIN_NUMBA=1`` they open on :mod:`vibgym._numba.plain`, which needs nothing but
numba's public interface, else on the modules beside it.
"""
