"""References to records in compiled kernels, see :mod:`vibgym.kernels.reference`.

A reference is one pointer with the fields of a named tuple.
Fields that are named tuples themselves are references, too.
"""

from __future__ import annotations

import hashlib
from typing import Any

from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.imputils import impl_ret_borrowed
from numba.core.typing.templates import AttributeTemplate
from numba.extending import infer_getattr, intrinsic, lower_cast, lower_getattr_generic, models, register_model


class Reference(types.Type):
    """Type of a pointer to a record of a given type."""

    def __init__(self, record: Any) -> None:
        self.record = record
        self.offsets: dict[int, int] = {}  # of fields, bytes; filled on use
        # Names of types become part of the names of functions: keep them short.
        digest = hashlib.sha256(str(record).encode()).hexdigest()[:12]
        super().__init__(name=f"Reference({record.instance_class.__name__}, {digest})")

    def field(self, index: int) -> Any:
        """Return the type of a field."""
        kind = self.record[index]
        return Reference(kind) if isinstance(kind, types.BaseNamedTuple) else kind


@register_model(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(
            manager, kind, cgutils.voidptr_t
        )  # a pointer to the record's own type would spell out all fields


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, kind: Any, name: str) -> Any:
        return kind.field(kind.record.fields.index(name)) if name in kind.record.fields else None


@lower_getattr_generic(Reference)
def _read_field(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    index = kind.record.fields.index(name)
    field = kind.field(index)
    place = cgutils.gep_inbounds(builder, pointer, _offset(context, kind, index))
    if isinstance(kind.record[index], types.BaseNamedTuple):
        return place
    place = builder.bitcast(place, context.get_value_type(field).as_pointer())
    return impl_ret_borrowed(context, builder, field, builder.load(place))


def _offset(context: Any, kind: Any, index: int) -> int:
    """Return the offset of a field, bytes."""
    if index not in kind.offsets:
        layout = context.get_value_type(kind.record)
        if isinstance(layout, ir.ArrayType):  # all fields have the same type
            kind.offsets[index] = index * layout.element.get_abi_size(context.target_data)
        else:
            kind.offsets[index] = layout.get_element_offset(context.target_data, index)
    return kind.offsets[index]


def argument_type(kind: Any) -> Any:
    """Return the type that a kernel passes to another one: a reference for records that contain arrays or records."""
    large = isinstance(kind, types.BaseNamedTuple) and any(
        isinstance(member, (types.Array, types.BaseNamedTuple, Reference))
        for member in tuple(kind)  # type: ignore[arg-type]
    )
    return Reference(kind) if large else kind


def _store_on_stack(builder: Any, value: Any) -> Any:
    return builder.bitcast(cgutils.alloca_once_value(builder, value), cgutils.voidptr_t)


@lower_cast(types.BaseNamedTuple, Reference)
def _cast_to_reference(context: Any, builder: Any, record: Any, kind: Any, value: Any) -> Any:
    return _store_on_stack(builder, value)


def _reference(typingctx: Any, record: Any) -> Any:
    """``reference(record)`` in a kernel; valid until the kernel returns."""
    if not isinstance(record, types.BaseNamedTuple):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return _store_on_stack(builder, values[0])

    return Reference(record)(record), generate


reference: Any = intrinsic(_reference)


def reader(layout: Any) -> Any:
    """Return the function that makes a reference of an address in a kernel, for a ``Layout``."""

    def at(typingctx: Any, address: Any) -> Any:
        def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
            return builder.inttoptr(values[0], cgutils.voidptr_t)

        return Reference(layout.record)(types.int64), generate

    return intrinsic(at)
