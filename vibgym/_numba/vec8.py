"""Eight doubles as one value of a kernel, unless in plain mode; see :mod:`vibgym._numba.vector`.

A value is ``<8 x double>`` to LLVM, which splits it for processors with narrower registers. What is written with it are vector
instructions by construction, where a loop over lanes is vectorised or not as the compiler thinks fit.

The operators are IEEE's own, and kernels that use them are compiled without fast-math (:func:`vibgym._numba.jit.exact`). A
product that is added to something is rounded once, with the sum; which products these are is decided here, from the kernel's
source, and not by the optimiser. So the bits depend neither on how wide the processor's registers are, nor on who made it, nor
on what else is compiled along, as long as it multiplies and adds in one instruction: all x86 processors with AVX2 or AVX-512,
and ARM's, do.
"""

from __future__ import annotations

import operator
from collections.abc import Callable
from typing import Any

from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import lower_builtin, lower_cast
from numba.core.typing.templates import AbstractTemplate, infer_global, signature

LANES = 8
"""Doubles of a value."""

_FLAG, _INDEX = ir.IntType(1), ir.IntType(32)
_DOUBLES, _SINGLES = ir.VectorType(ir.DoubleType(), LANES), ir.VectorType(ir.FloatType(), LANES)
_FLAGS, _BYTES = ir.VectorType(_FLAG, LANES), ir.VectorType(ir.IntType(8), LANES)


class Vec8(types.Type):
    """Type of eight doubles."""

    def __init__(self) -> None:
        super().__init__(name="Vec8")


class Mask8(types.Type):
    """Type of eight truth values, which a comparison of eight doubles yields."""

    def __init__(self) -> None:
        super().__init__(name="Mask8")


vec8, mask8 = Vec8(), Mask8()


@register_default(Vec8)
class _Vec8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _DOUBLES)


@register_default(Mask8)
class _Mask8Model(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, _FLAGS)


@lower_cast(types.Float, Vec8)
@lower_cast(types.Integer, Vec8)
def _spread(context: Any, builder: Any, given: Any, kind: Any, value: Any) -> Any:
    """A number in every lane."""
    number, nothing = context.cast(builder, value, given, types.float64), ir.Constant(_DOUBLES, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


def _fits(given: Any, kind: Any) -> bool:
    if isinstance(kind, type):  # of arrays
        return isinstance(given, kind) and given.ndim == 1 and given.layout == "C"
    return given == kind or (kind != mask8 and isinstance(given, types.Number))


def _teach(function: Any, generate: Callable[..., Any], result: Any, kinds: tuple[Any, ...]) -> None:
    """Teach numba what a function of values of these kinds is; numbers count for all lanes."""

    class _Template(AbstractTemplate):
        key = function

        def generic(self, args: Any, kws: Any) -> Any:
            own = [each for each in args if isinstance(each, (Vec8, Mask8))]
            fits = len(args) == len(kinds) and all(_fits(*each) for each in zip(args, kinds))
            if kws or not fits or not (own or function not in _OPERATORS):
                return None
            return signature(result, *(each if isinstance(kind, type) else kind for each, kind in zip(args, kinds)))

    if function.__module__ == "_operator":
        infer_global(function)(_Template)
    else:
        infer_global(function, types.Function(_Template))

    def lower(context: Any, builder: Any, made: Any, values: Any) -> Any:
        arrays = [isinstance(each, types.Array) for each in made.args]
        values = [
            context.make_array(kind)(context, builder, value).data if array else value
            for kind, value, array in zip(made.args, values, arrays)
        ]
        given = generate(builder, *values)
        return context.get_dummy_value() if result == types.none else given

    lower_builtin(function, *kinds)(lower)


def _function(result: Any, *kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """What makes the instructions is itself the function's name in kernels."""

    def teach(generate: Callable[..., Any]) -> Any:
        _teach(generate, generate, result, kinds)
        return generate

    return teach


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    """A function of LLVM's own on vectors of one kind."""
    kind = arguments[0].type
    name = f"{name}.v{LANES}f{32 if kind == _SINGLES else 64}"
    whole = ir.FunctionType(kind, [kind] * len(arguments))
    return builder.call(cgutils.get_or_insert_function(builder.module, whole, name), arguments)


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


_OPERATORS: dict[Any, tuple[Callable[..., Any], Any, int]] = {
    operator.add: (_add, vec8, 2),
    operator.sub: (_subtract, vec8, 2),
    operator.mul: (lambda builder, one, other: builder.fmul(one, other), vec8, 2),
    operator.truediv: (lambda builder, one, other: builder.fdiv(one, other), vec8, 2),
    operator.neg: (lambda builder, value: builder.fneg(value), vec8, 1),
    operator.lt: (_compare("<"), mask8, 2),
    operator.le: (_compare("<="), mask8, 2),
    operator.gt: (_compare(">"), mask8, 2),
    operator.ge: (_compare(">="), mask8, 2),
}
for _operator, (_generate, _result, _number) in _OPERATORS.items():
    _teach(_operator, _generate, _result, (vec8,) * _number)
_teach(operator.and_, lambda builder, one, other: builder.and_(one, other), mask8, (mask8, mask8))
_teach(operator.or_, lambda builder, one, other: builder.or_(one, other), mask8, (mask8, mask8))


# -- functions ---------------------------------------------------------------------------------------------------------


@_function(vec8, types.float64)
def spread(builder: Any, number: Any) -> Any:
    """A number in every lane."""
    nothing = ir.Constant(_DOUBLES, ir.Undefined)
    first = builder.insert_element(nothing, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), [0] * LANES))


@_function(vec8, types.Array, types.intp)
def load(builder: Any, data: Any, at: Any) -> Any:
    """The numbers of a flat array from a place on."""
    place = builder.bitcast(builder.gep(data, [at], inbounds=True), _DOUBLES.as_pointer())
    return builder.load(place, align=8)


@_function(types.none, types.Array, types.intp, vec8)
def store(builder: Any, data: Any, at: Any, value: Any) -> None:
    """Write the lanes into a flat array from a place on."""
    place = builder.bitcast(builder.gep(data, [at], inbounds=True), _DOUBLES.as_pointer())
    builder.store(value, place, align=8)


@_function(mask8, types.Array, types.intp)
def load_mask(builder: Any, data: Any, at: Any) -> Any:
    """The truth values of a flat array of bool from a place on."""
    place = builder.bitcast(builder.gep(data, [at], inbounds=True), _BYTES.as_pointer())
    return builder.icmp_unsigned("!=", builder.load(place, align=1), ir.Constant(_BYTES, [0] * LANES))


@_function(types.none, types.Array, types.intp, mask8)
def store_mask(builder: Any, data: Any, at: Any, mask: Any) -> None:
    """Write truth values into a flat array of bool from a place on."""
    place = builder.bitcast(builder.gep(data, [at], inbounds=True), _BYTES.as_pointer())
    builder.store(builder.zext(mask, _BYTES), place, align=1)


@_function(types.int64, mask8)
def bits(builder: Any, mask: Any) -> Any:
    """A mask as a whole number, in which lane k is bit k."""
    return builder.zext(builder.bitcast(mask, ir.IntType(LANES)), ir.IntType(64))


@_function(mask8, types.int64)
def mask_of(builder: Any, number: Any) -> Any:
    """The mask of such a number."""
    return builder.bitcast(builder.trunc(number, ir.IntType(LANES)), _FLAGS)


@_function(mask8, mask8)
def no(builder: Any, mask: Any) -> Any:
    """Where a mask does not hold."""
    return builder.xor(mask, ir.Constant(_FLAGS, [1] * LANES))


@_function(vec8, mask8, vec8, vec8)
def select(builder: Any, mask: Any, one: Any, other: Any) -> Any:
    """One value where the mask holds, else the other."""
    return builder.select(mask, one, other)


@_function(vec8, vec8, vec8)
def minimum(builder: Any, one: Any, other: Any) -> Any:
    """The smaller one; the second, if either is no number."""
    return builder.select(builder.fcmp_ordered("<", one, other), one, other)


@_function(vec8, vec8, vec8)
def maximum(builder: Any, one: Any, other: Any) -> Any:
    """The larger one; the second, if either is no number."""
    return builder.select(builder.fcmp_ordered(">", one, other), one, other)


@_function(vec8, vec8)
def floor(builder: Any, value: Any) -> Any:
    """The whole number below."""
    return _call(builder, "llvm.floor", value)


@_function(vec8, vec8)
def magnitude(builder: Any, value: Any) -> Any:
    """Without its sign."""
    return _call(builder, "llvm.fabs", value)


@_function(vec8, vec8, vec8)
def copysign(builder: Any, value: Any, sign: Any) -> Any:
    """The one with the other's sign."""
    return _call(builder, "llvm.copysign", value, sign)


@_function(vec8, vec8)
def inverse_root(builder: Any, value: Any) -> Any:
    """One over the root of a number within the range of single precision, to 1e-14 of it.

    A root and a division in single precision, both rounded as IEEE says, and a step of Newton's: an estimate by ``vrsqrtps``
    would be as good, but every maker's processors give other bits.
    """
    ones = ir.Constant(_SINGLES, [1.0] * LANES)
    estimate = builder.fpext(
        builder.fdiv(ones, _call(builder, "llvm.sqrt", builder.fptrunc(value, _SINGLES))), _DOUBLES
    )
    half = builder.fmul(ir.Constant(_DOUBLES, [-0.5] * LANES), builder.fmul(value, estimate))
    better = _call(builder, "llvm.fmuladd", half, estimate, ir.Constant(_DOUBLES, [1.5] * LANES))
    return builder.fmul(estimate, better)


def _least(builder: Any, value: Any, how: str) -> Any:
    nothing = ir.Constant(_DOUBLES, ir.Undefined)
    width = LANES
    while width > 1:
        width //= 2
        where = [k + width if k < width else k for k in range(LANES)]
        other = builder.shuffle_vector(value, nothing, ir.Constant(ir.VectorType(_INDEX, LANES), where))
        value = builder.select(builder.fcmp_ordered(how, value, other), value, other)
    return builder.extract_element(value, ir.Constant(_INDEX, 0))


@_function(types.float64, vec8)
def least(builder: Any, value: Any) -> Any:
    """The smallest lane's number."""
    return _least(builder, value, "<")


@_function(types.float64, vec8)
def greatest(builder: Any, value: Any) -> Any:
    """The largest lane's number."""
    return _least(builder, value, ">")
