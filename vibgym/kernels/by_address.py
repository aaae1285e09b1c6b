"""Calls from kernels to compiled functions of other libraries, by address, unless in plain mode.

Addresses come in as integers at run time, so kernels that use them can be cached. Only integers, pointers and float64 may be
passed: every platform's calling convention puts them in the same registers, independently of the exact pointer type.
"""

from __future__ import annotations

from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.extending import intrinsic


def _call_foreign(typingctx: Any, address: Any, arguments: Any) -> Any:
    """``call_foreign(address, arguments)`` in a kernel: ``address(*arguments)``, its result thrown away.

    ``arguments`` is a tuple of int64 (integers, pointers) and float64.
    """
    kinds = getattr(arguments, "types", ())  # of a tuple
    if not kinds or not all(each in (types.int64, types.float64) for each in kinds):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        pointer, packed = values
        passed = cgutils.unpack_tuple(builder, packed)
        kind = ir.FunctionType(ir.VoidType(), [each.type for each in passed])
        builder.call(builder.inttoptr(pointer, kind.as_pointer()), passed)
        return context.get_dummy_value()

    return types.none(types.int64, arguments), generate


call_foreign: Any = intrinsic(_call_foreign)


def foreign(address: int, *arguments: str) -> int:
    """What kernels call: the address itself; see :mod:`vibgym.kernels.foreign`."""
    return address
