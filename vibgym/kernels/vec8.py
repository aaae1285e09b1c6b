"""Eight doubles as one value of a kernel, unless in plain mode; see :mod:`vibgym.kernels.vector`.

A value is ``<8 x double>`` to LLVM, which splits it for processors with narrower registers, or as many doubles as a register
holds (:data:`WIDTH`). What is written with it are vector instructions by construction, where a loop over lanes is vectorised
or not as the compiler thinks fit.

The operators are IEEE's own, and kernels that use them are compiled without fast-math (:func:`vibgym.kernels.jit.exact`). A
product that is added to something is rounded once, with the sum; which products these are is decided here, from the kernel's
source, and not by the optimiser. So the bits depend neither on how wide the processor's registers are, nor on who made it, nor
on what else is compiled along, as long as it multiplies and adds in one instruction: all x86 processors with AVX2 or AVX-512,
and ARM's, do.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable
from typing import Any

from llvmlite import binding, ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

LANES = 8
"""Doubles of a value."""

_ASKED = os.environ.get("VIBGYM_VECTOR", "")
if _ASKED not in ("", "4", "8"):
    raise ValueError(f"VIBGYM_VECTOR: got {_ASKED!r}; allowed: 4 or 8")

WIDTH = int(_ASKED or (8 if binding.get_host_cpu_features().get("avx512f") else 4))
"""Doubles of a value that fits into one of the processor's registers, 4 or 8."""

_INDEX, _BYTE = ir.IntType(32), ir.IntType(8)


class Vec(types.Type):
    """Type of eight doubles, ``Vec8``, or of fewer."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(name=f"Vec{lanes}")


class Mask(types.Type):
    """Type of as many truth values, which a comparison yields."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(name=f"Mask{lanes}")


VEC = {lanes: Vec(lanes) for lanes in {WIDTH, LANES}}
MASK = {lanes: Mask(lanes) for lanes in {WIDTH, LANES}}


@register_default(Vec)
class _VecModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), kind.lanes))


@register_default(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.lanes))


def _spread(builder: Any, number: Any, lanes: int) -> Any:
    nothing = ir.Constant(ir.VectorType(ir.DoubleType(), lanes), ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, lanes), [0] * lanes))


@lower_cast(types.Float, Vec)
@lower_cast(types.Integer, Vec)
def _cast(context: Any, builder: Any, given: Any, kind: Any, value: Any) -> Any:
    return _spread(builder, context.cast(builder, value, given, types.float64), kind.lanes)


# -- what numba is taught ----------------------------------------------------------------------------------------------

_ANY_VEC, _ANY_MASK = "Vec", "Mask"
"""Of the width of the other arguments."""

_OWN = {_ANY_VEC: VEC, _ANY_MASK: MASK}


def _fits(given: Any, kind: Any) -> bool:
    if kind == types.Array:
        return isinstance(given, kind) and given.ndim == 1 and given.layout == "C"
    return given == kind or (not isinstance(kind, Mask) and isinstance(given, types.Number))


def _teach(function: Any, generate: Callable[..., Any], result: Any, kinds: tuple[Any, ...]) -> None:
    """Teach numba what a function of values of these kinds is; numbers stand for a value with that number in every lane."""
    wide = any(kind in _OWN for kind in kinds)

    def of(kind: Any, lanes: int) -> Any:
        return _OWN[kind][lanes] if kind in _OWN else kind

    class _Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            lanes = next((each.lanes for each in args if isinstance(each, (Vec, Mask))), 0)
            if kws or len(args) != len(kinds) or (wide and not lanes):
                return None
            mine = [of(kind, lanes) for kind in kinds]
            if not all(map(_fits, args, mine)):
                return None
            return signature(of(result, lanes), *(a if k == types.Array else k for a, k in zip(args, mine)))

    of_numba: Any = infer_global
    if function.__module__ == "_operator":
        of_numba(function)(_Template)
    else:
        of_numba(function, types.Function(_Template))

    def lower(context: Any, builder: Any, made: Any, values: Any) -> Any:
        given = [
            context.make_array(kind)(context, builder, value).data if isinstance(kind, types.Array) else value
            for kind, value in zip(made.args, values)
        ]
        found = generate(builder, *given)
        return context.get_dummy_value() if result == types.none else found

    for lanes in VEC if wide else (LANES,):
        lower_builtin(function, *(of(kind, lanes) for kind in kinds))(lower)


def _function(result: Any, *kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """What makes the instructions is itself the function's name in kernels."""

    def teach(generate: Callable[..., Any]) -> Any:
        _teach(generate, generate, result, kinds)
        return generate

    return teach


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    """A function of LLVM's own on vectors of one kind."""
    kind = arguments[0].type
    name = f"{name}.v{kind.count}f{32 if kind.element == ir.FloatType() else 64}"
    whole = ir.FunctionType(kind, [kind] * len(arguments))
    return builder.call(cgutils.get_or_insert_function(builder.module, whole, name), arguments)


def _constant(kind: Any, number: Any) -> Any:
    return ir.Constant(kind, [number] * kind.count)


# -- operators ---------------------------------------------------------------------------------------------------------


def _is_product(value: Any) -> bool:
    return isinstance(value, ir.Instruction) and value.opname == "fmul"


def _add(builder: Any, one: Any, other: Any) -> Any:
    if _is_product(one):
        return _call(builder, "llvm.fmuladd", *one.operands, other)
    if _is_product(other):
        return _call(builder, "llvm.fmuladd", *other.operands, one)
    return builder.fadd(one, other)


def _subtract(builder: Any, one: Any, other: Any) -> Any:
    if _is_product(one):
        return _call(builder, "llvm.fmuladd", *one.operands, builder.fneg(other))
    if _is_product(other):
        first, second = other.operands
        return _call(builder, "llvm.fmuladd", builder.fneg(first), second, one)
    return builder.fsub(one, other)


def _compare(how: str) -> Callable[..., Any]:
    return lambda builder, one, other: builder.fcmp_ordered(how, one, other)


for _operator, _generate in (
    (operator.add, _add),
    (operator.sub, _subtract),
    (operator.mul, lambda builder, one, other: builder.fmul(one, other)),
    (operator.truediv, lambda builder, one, other: builder.fdiv(one, other)),
):
    _teach(_operator, _generate, _ANY_VEC, (_ANY_VEC, _ANY_VEC))
for _operator, _how in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _teach(_operator, _compare(_how), _ANY_MASK, (_ANY_VEC, _ANY_VEC))
_teach(operator.neg, lambda builder, value: builder.fneg(value), _ANY_VEC, (_ANY_VEC,))
_teach(operator.and_, lambda builder, one, other: builder.and_(one, other), _ANY_MASK, (_ANY_MASK, _ANY_MASK))
_teach(operator.or_, lambda builder, one, other: builder.or_(one, other), _ANY_MASK, (_ANY_MASK, _ANY_MASK))


# -- functions ---------------------------------------------------------------------------------------------------------


def _place(builder: Any, data: Any, at: Any, kind: Any) -> Any:
    return builder.bitcast(builder.gep(data, [at], inbounds=True), kind.as_pointer())


def _loader(lanes: int) -> Any:
    @_function(VEC[lanes], types.Array, types.intp)
    def load(builder: Any, data: Any, at: Any) -> Any:
        """The numbers of a flat array from a place on."""
        return builder.load(_place(builder, data, at, ir.VectorType(ir.DoubleType(), lanes)), align=8)

    return load


def _spreader(lanes: int) -> Any:
    @_function(VEC[lanes], types.float64)
    def spread(builder: Any, number: Any) -> Any:
        """A number in every lane."""
        return _spread(builder, number, lanes)

    return spread


def _masker(lanes: int) -> Any:
    @_function(MASK[lanes], types.int64)
    def mask_of(builder: Any, number: Any) -> Any:
        """The mask of a whole number, in which lane k is bit k."""
        return builder.bitcast(builder.trunc(number, ir.IntType(lanes)), ir.VectorType(ir.IntType(1), lanes))

    return mask_of


load, load_register = _loader(LANES), _loader(WIDTH)
spread, spread_register = _spreader(LANES), _spreader(WIDTH)
mask_of, mask_register = _masker(LANES), _masker(WIDTH)


@_function(types.none, types.Array, types.intp, _ANY_VEC)
def store(builder: Any, data: Any, at: Any, value: Any) -> None:
    """Write the lanes into a flat array from a place on."""
    builder.store(value, _place(builder, data, at, value.type), align=8)


@_function(MASK[LANES], types.Array, types.intp)
def load_mask(builder: Any, data: Any, at: Any) -> Any:
    """The truth values of a flat array of bool from a place on."""
    kind = ir.VectorType(_BYTE, LANES)
    return builder.icmp_unsigned("!=", builder.load(_place(builder, data, at, kind), align=1), _constant(kind, 0))


@_function(types.none, types.Array, types.intp, _ANY_MASK)
def store_mask(builder: Any, data: Any, at: Any, mask: Any) -> None:
    """Write truth values into a flat array of bool from a place on."""
    kind = ir.VectorType(_BYTE, mask.type.count)
    builder.store(builder.zext(mask, kind), _place(builder, data, at, kind), align=1)


@_function(types.int64, _ANY_MASK)
def bits(builder: Any, mask: Any) -> Any:
    """A mask as a whole number, in which lane k is bit k."""
    return builder.zext(builder.bitcast(mask, ir.IntType(mask.type.count)), ir.IntType(64))


@_function(_ANY_MASK, _ANY_MASK)
def no(builder: Any, mask: Any) -> Any:
    """Where a mask does not hold."""
    return builder.xor(mask, _constant(mask.type, 1))


@_function(_ANY_VEC, _ANY_MASK, _ANY_VEC, _ANY_VEC)
def select(builder: Any, mask: Any, one: Any, other: Any) -> Any:
    """One value where the mask holds, else the other."""
    return builder.select(mask, one, other)


@_function(_ANY_VEC, _ANY_VEC, _ANY_VEC)
def minimum(builder: Any, one: Any, other: Any) -> Any:
    """The smaller one; the second, if either is no number."""
    return builder.select(builder.fcmp_ordered("<", one, other), one, other)


@_function(_ANY_VEC, _ANY_VEC, _ANY_VEC)
def maximum(builder: Any, one: Any, other: Any) -> Any:
    """The larger one; the second, if either is no number."""
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


@_function(_ANY_VEC, _ANY_VEC)
def floor(builder: Any, value: Any) -> Any:
    """The whole number below."""
    return _call(builder, "llvm.floor", value)


@_function(_ANY_VEC, _ANY_VEC)
def magnitude(builder: Any, value: Any) -> Any:
    """Without its sign."""
    return _call(builder, "llvm.fabs", value)


@_function(_ANY_VEC, _ANY_VEC, _ANY_VEC)
def copysign(builder: Any, value: Any, sign: Any) -> Any:
    """The one with the other's sign."""
    return _call(builder, "llvm.copysign", value, sign)


@_function(_ANY_VEC, _ANY_VEC)
def root(builder: Any, value: Any) -> Any:
    """The root, rounded as IEEE says: estimates as by ``vrsqrtps`` have other bits on every maker's processors."""
    return _call(builder, "llvm.sqrt", value)


def _across(builder: Any, value: Any, how: str) -> Any:
    lanes = width = value.type.count
    nothing = ir.Constant(value.type, ir.Undefined)
    while width > 1:
        width //= 2
        where = [k + width if k < width else k for k in range(lanes)]
        other = builder.shuffle_vector(value, nothing, ir.Constant(ir.VectorType(_INDEX, lanes), where))
        value = builder.select(builder.fcmp_ordered(how, value, other), value, other)
    return builder.extract_element(value, ir.Constant(_INDEX, 0))


@_function(types.float64, _ANY_VEC)
def least(builder: Any, value: Any) -> Any:
    """The smallest lane's number."""
    return _across(builder, value, "<")


@_function(types.float64, _ANY_VEC)
def greatest(builder: Any, value: Any) -> Any:
    """The largest lane's number."""
    return _across(builder, value, ">")
