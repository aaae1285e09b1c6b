"""Calls from kernels to compiled functions of other libraries.

``foreign(address, "int64", "float64")`` is a function that kernels call by ``call_foreign(function, arguments)``, which throws
its result away. It comes in as an argument at run time, so kernels that use it can be cached. Only integers, pointers (as
int64) and float64 may be passed: every platform's calling convention puts them in the same registers, independently of the
exact pointer type.
"""

from __future__ import annotations

from vibgym.kernels.options import PLAIN

if PLAIN:
    from vibgym.kernels.plain import call_foreign, foreign
else:
    from vibgym.kernels.by_address import call_foreign, foreign

__all__ = ["call_foreign", "foreign"]
