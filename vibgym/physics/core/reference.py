"""Records handed on by reference.

A named tuple is handed from kernel to kernel by value: all its arrays are taken apart into pointers, shapes and strides, some
hundreds of numbers for the working arrays of the friction stepper, and put together again at every call, which takes longer to
compile than what the kernels do. A kernel that Python calls hands a :func:`reference` on instead: one pointer, with the same
fields. Fields that are named tuples themselves are references, too.
"""

from __future__ import annotations

import hashlib
from typing import Any

from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import impl_ret_borrowed, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.extending import intrinsic


class Reference(types.Type):
    """Type of a pointer to a record of a given type."""

    def __init__(self, record: Any) -> None:
        self.record = record
        self.offsets: dict[int, int] = {}  # of fields, in bytes, as they are asked for
        # Names of types become part of the names of functions: keep them short.
        digest = hashlib.sha256(str(record).encode()).hexdigest()[:12]
        super().__init__(name=f"Reference({record.instance_class.__name__}, {digest})")

    def field(self, index: int) -> Any:
        """Type of a field."""
        kind = self.record[index]
        return Reference(kind) if isinstance(kind, types.BaseNamedTuple) else kind


@register_default(Reference)
class _ReferenceModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: Any) -> None:
        super().__init__(manager, kind, cgutils.voidptr_t)  # the record's own type would be written out at every turn


@infer_getattr
class _Fields(AttributeTemplate):
    key = Reference

    def generic_resolve(self, kind: Any, name: str) -> Any:
        """Type of the field of that name."""
        return kind.field(kind.record.fields.index(name)) if name in kind.record.fields else None


@lower_getattr_generic(Reference)
def _read_field(context: Any, builder: Any, kind: Any, pointer: Any, name: str) -> Any:
    index = kind.record.fields.index(name)
    field = kind.field(index)
    place = cgutils.gep_inbounds(builder, pointer, _offset(context, kind, index))
    if isinstance(field, Reference):
        return place
    place = builder.bitcast(place, context.get_value_type(field).as_pointer())
    return impl_ret_borrowed(context, builder, field, builder.load(place))


def _offset(context: Any, kind: Any, index: int) -> int:
    """Of a field, in bytes."""
    if index not in kind.offsets:
        layout = context.get_value_type(kind.record)
        kind.offsets[index] = layout.get_element_offset(context.target_data, index)
    return kind.offsets[index]


def _reference(typingctx: Any, record: Any) -> Any:
    """``reference(record)`` in a kernel: good until the kernel returns."""
    if not isinstance(record, types.BaseNamedTuple):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(cgutils.alloca_once_value(builder, values[0]), cgutils.voidptr_t)

    return Reference(record)(record), generate


reference: Any = intrinsic(_reference)
