"""Eight doubles as one value of a compiled kernel; see :mod:`vibgym.kernels.vector`.

A value is ``<8 x double>`` in LLVM, which splits it for processors with narrower registers, or ``<WIDTH x double>``. Vector
instructions follow by construction, independently of LLVM's vectorisation of loops.

Operators round as IEEE 754 specifies; kernels that use them are compiled without fast-math (:func:`vibgym.kernels.jit.exact`).
A product that is added to something is rounded once, with the sum (fused multiply-add). The source determines which products
are fused, not LLVM. Bits are therefore the same on all processors with fused multiply-add: x86 with AVX2 or AVX-512, and ARM.
"""

from __future__ import annotations

import operator
import os
from collections.abc import Callable
from functools import partial
from itertools import product
from typing import Any

from llvmlite import binding, ir
from numba import types
from numba.core import cgutils
from numba.extending import lower_builtin, models, register_model, type_callable

LANES = 8
"""Doubles in a value."""

_REQUESTED = os.environ.get("VIBGYM_VECTOR", "")
if _REQUESTED not in ("", "4", "8"):
    raise ValueError(f"VIBGYM_VECTOR: got {_REQUESTED!r}; allowed: 4 or 8")


def _register_width() -> int:
    """Return the doubles in a register of the processor, as far as kernels use it: 4 or 8."""
    if _REQUESTED:
        return int(_REQUESTED)
    try:
        return 8 if binding.get_host_cpu_features().get("avx512f") else 4
    except RuntimeError:  # a processor that LLVM does not know
        return 4


WIDTH = _register_width()
"""Doubles in a register of the processor, 4 or 8."""

_INDEX, _BYTE = ir.IntType(32), ir.IntType(8)


class Vec(types.Type):
    """Type of a value of 8 or ``WIDTH`` doubles."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(name=f"Vec{lanes}")


class Mask(types.Type):
    """Type of the result of a comparison: 8 or ``WIDTH`` truth values."""

    def __init__(self, lanes: int) -> None:
        self.lanes = lanes
        super().__init__(name=f"Mask{lanes}")


VEC = {lanes: Vec(lanes) for lanes in {WIDTH, LANES}}
MASK = {lanes: Mask(lanes) for lanes in {WIDTH, LANES}}


@register_model(Vec)
class _VecModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.DoubleType(), kind.lanes))


@register_model(Mask)
class _MaskModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, ir.VectorType(ir.IntType(1), kind.lanes))


def _broadcast(builder: Any, number: Any, lanes: int) -> Any:
    undefined = ir.Constant(ir.VectorType(ir.DoubleType(), lanes), ir.Undefined)
    first = builder.insert_element(undefined, number, ir.Constant(_INDEX, 0))
    return builder.shuffle_vector(first, undefined, ir.Constant(ir.VectorType(_INDEX, lanes), [0] * lanes))


# -- registration with numba -------------------------------------------------------------------------------------------

_ANY_VEC, _ANY_MASK = "Vec", "Mask"
"""Types with as many lanes as the other arguments have."""

_BY_LANES = {_ANY_VEC: VEC, _ANY_MASK: MASK}


def _fits(argument: Any, kind: Any) -> bool:
    if kind == types.Array:
        return isinstance(argument, kind) and argument.ndim == 1 and argument.layout == "C"
    return argument == kind or (not isinstance(kind, Mask) and isinstance(argument, types.Number))


def _register(function: Any, generate: Callable[..., Any], result: Any, kinds: tuple[Any, ...]) -> None:
    """Register the typing and code generation of a function; a number as an argument stands for itself in every lane."""
    wide = any(kind in _BY_LANES for kind in kinds)

    def of(kind: Any, lanes: int) -> Any:
        return _BY_LANES[kind][lanes] if kind in _BY_LANES else kind

    def typed(*args: Any) -> Any:
        lanes = next((argument.lanes for argument in args if isinstance(argument, (Vec, Mask))), 0)
        if wide and not lanes:
            return None
        wanted = [of(kind, lanes) for kind in kinds]
        if not all(map(_fits, args, wanted)):
            return None
        # Arrays and numbers in place of vectors keep their types.
        kept = (isinstance(k, Vec) or k == types.Array for k in wanted)
        return of(result, lanes)(*(types.unliteral(a) if keep else k for a, k, keep in zip(args, wanted, kept)))

    # numba matches the number of arguments with the signature of this function.
    typing: Any = (None, lambda a: typed(a), lambda a, b: typed(a, b), lambda a, b, c: typed(a, b, c))[len(kinds)]
    type_callable(function)(lambda context: typing)

    def lower(context: Any, builder: Any, made: Any, values: Any) -> Any:
        lanes = next((argument.lanes for argument in made.args if isinstance(argument, (Vec, Mask))), 0)

        def passed(kind: Any, argument: Any, value: Any) -> Any:
            if isinstance(argument, types.Array):
                return context.make_array(argument)(context, builder, value).data
            if kind == _ANY_VEC and isinstance(argument, types.Number):
                return _broadcast(builder, context.cast(builder, value, argument, types.float64), lanes)
            return value

        operands = map(passed, kinds, made.args, values)
        value = generate(builder, *operands)
        return context.get_dummy_value() if result == types.none else value

    for lanes in VEC if wide else (LANES,):
        forms = ((of(kind, lanes), types.Number) if kind == _ANY_VEC else (of(kind, lanes),) for kind in kinds)
        for form in product(*forms):
            if not wide or any(isinstance(kind, (Vec, Mask)) for kind in form):
                lower_builtin(function, *form)(lower)


def _function(result: Any, *kinds: Any) -> Callable[[Callable[..., Any]], Any]:
    """Decorate a code generator: kernels call the function by its name."""

    def decorate(generate: Callable[..., Any]) -> Any:
        _register(generate, generate, result, kinds)
        return generate

    return decorate


def _call(builder: Any, name: str, *arguments: Any) -> Any:
    """Call an LLVM intrinsic whose arguments and result are vectors of one type."""
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
    _register(_operator, _generate, _ANY_VEC, (_ANY_VEC, _ANY_VEC))
for _operator, _how in ((operator.lt, "<"), (operator.le, "<="), (operator.gt, ">"), (operator.ge, ">=")):
    _register(_operator, _compare(_how), _ANY_MASK, (_ANY_VEC, _ANY_VEC))
_register(operator.neg, lambda builder, value: builder.fneg(value), _ANY_VEC, (_ANY_VEC,))
_register(operator.and_, lambda builder, one, other: builder.and_(one, other), _ANY_MASK, (_ANY_MASK, _ANY_MASK))
_register(operator.or_, lambda builder, one, other: builder.or_(one, other), _ANY_MASK, (_ANY_MASK, _ANY_MASK))


# -- functions ---------------------------------------------------------------------------------------------------------


def _place(builder: Any, data: Any, at: Any, kind: Any) -> Any:
    return builder.bitcast(builder.gep(data, [at], inbounds=True), kind.as_pointer())


def _loader(lanes: int) -> Any:
    @_function(VEC[lanes], types.Array, types.intp)
    def load(builder: Any, data: Any, at: Any) -> Any:
        """Load consecutive items of a flat array."""
        return builder.load(_place(builder, data, at, ir.VectorType(ir.DoubleType(), lanes)), align=8)

    return load


def _broadcaster(lanes: int) -> Any:
    @_function(VEC[lanes], types.float64)
    def broadcast(builder: Any, number: Any) -> Any:
        """Set all lanes to a number."""
        return _broadcast(builder, number, lanes)

    return broadcast


def _masker(lanes: int) -> Any:
    @_function(MASK[lanes], types.int64)
    def mask_of(builder: Any, number: Any) -> Any:
        """Convert an integer to a mask: lane k is bit k."""
        return builder.bitcast(builder.trunc(number, ir.IntType(lanes)), ir.VectorType(ir.IntType(1), lanes))

    return mask_of


load, load_register = _loader(LANES), _loader(WIDTH)
broadcast, broadcast_register = _broadcaster(LANES), _broadcaster(WIDTH)
mask_of, mask_register = _masker(LANES), _masker(WIDTH)


@_function(_ANY_VEC, _ANY_VEC, types.Array, types.intp)
def load_like(builder: Any, value: Any, data: Any, at: Any) -> Any:
    """Load as many consecutive items of a flat array as a value has lanes."""
    return builder.load(_place(builder, data, at, value.type), align=8)


@_function(types.none, types.Array, types.intp, _ANY_VEC)
def store(builder: Any, data: Any, at: Any, value: Any) -> None:
    """Store the lanes in consecutive items of a flat array."""
    builder.store(value, _place(builder, data, at, value.type), align=8)


@_function(MASK[LANES], types.Array, types.intp)
def load_mask(builder: Any, data: Any, at: Any) -> Any:
    """Load consecutive items of a flat array of bool."""
    kind = ir.VectorType(_BYTE, LANES)
    return builder.icmp_unsigned("!=", builder.load(_place(builder, data, at, kind), align=1), _constant(kind, 0))


@_function(types.none, types.Array, types.intp, _ANY_MASK)
def store_mask(builder: Any, data: Any, at: Any, mask: Any) -> None:
    """Store a mask in consecutive items of a flat array of bool."""
    kind = ir.VectorType(_BYTE, mask.type.count)
    builder.store(builder.zext(mask, kind), _place(builder, data, at, kind), align=1)


@_function(types.int64, _ANY_MASK)
def bits(builder: Any, mask: Any) -> Any:
    """Convert a mask to an integer: bit k is lane k."""
    return builder.zext(builder.bitcast(mask, ir.IntType(mask.type.count)), ir.IntType(64))


@_function(_ANY_MASK, _ANY_MASK)
def logical_not(builder: Any, mask: Any) -> Any:
    """Invert a mask."""
    return builder.xor(mask, _constant(mask.type, 1))


@_function(_ANY_VEC, _ANY_MASK, _ANY_VEC, _ANY_VEC)
def select(builder: Any, mask: Any, one: Any, other: Any) -> Any:
    """Select lanes of ``one`` where the mask holds, else of ``other``."""
    return builder.select(mask, one, other)


def _intrinsic(name: str, arguments: int) -> Any:
    """Return the kernel function of an LLVM intrinsic."""

    @_function(_ANY_VEC, *[_ANY_VEC] * arguments)
    def generate(builder: Any, *values: Any) -> Any:
        return _call(builder, name, *values)

    return generate


floor, absolute, copysign = _intrinsic("llvm.floor", 1), _intrinsic("llvm.fabs", 1), _intrinsic("llvm.copysign", 2)
sqrt = _intrinsic("llvm.sqrt", 1)  # IEEE rounding; the bits of estimates such as ``vrsqrtps`` depend on the processor


def _extremum(how: str) -> tuple[Any, Any]:
    """Return the function that selects lanes by a comparison, the second if either is NaN, and the reduction over lanes."""

    def choose(builder: Any, one: Any, other: Any) -> Any:
        return builder.select(builder.fcmp_ordered(how, one, other), one, other)

    lane_by_lane = _function(_ANY_VEC, _ANY_VEC, _ANY_VEC)(choose)

    @_function(types.float64, _ANY_VEC)
    def over_lanes(builder: Any, value: Any) -> Any:
        return _reduce(builder, value, partial(choose, builder))

    return lane_by_lane, over_lanes


def _reduce(builder: Any, value: Any, combine: Callable[[Any, Any], Any]) -> Any:
    lanes = width = value.type.count
    undefined = ir.Constant(value.type, ir.Undefined)
    while width > 1:
        width //= 2
        where = [k + width if k < width else k for k in range(lanes)]
        other = builder.shuffle_vector(value, undefined, ir.Constant(ir.VectorType(_INDEX, lanes), where))
        value = combine(value, other)
    return builder.extract_element(value, ir.Constant(_INDEX, 0))


@_function(types.float64, _ANY_VEC)
def lane_sum(builder: Any, value: Any) -> Any:
    """Sum the lanes, in pairs."""
    return _reduce(builder, value, builder.fadd)


minimum, lane_minimum = _extremum("<")
maximum, lane_maximum = _extremum(">")
