"""Records handed on by reference, unless in plain mode.

A named tuple is handed from kernel to kernel by value: all its arrays are taken apart into pointers, shapes and strides, some
hundreds of numbers for the working arrays of the friction stepper, and put together again at every call, which takes longer to
compile than what the kernels do. A kernel that Python calls hands a :func:`reference` on instead: one pointer, with the same
fields. Fields that are named tuples themselves are references, too.

Python takes its time as well to take a record apart whenever it calls a kernel. One that stays the same is written down in
memory once, as kernels see it (:class:`Pinned`); kernels are given its address.
"""

from __future__ import annotations

import hashlib
import struct
from typing import Any, Generic, TypeVar

import numpy as np
from llvmlite import ir
from numba.core import cgutils, types
from numba.core.datamodel import models
from numba.core.datamodel.registry import register_default
from numba.core.imputils import impl_ret_borrowed, lower_cast, lower_getattr_generic
from numba.core.typing.templates import AttributeTemplate, infer_getattr
from numba.core.typing.typeof import typeof
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
    if isinstance(kind.record[index], types.BaseNamedTuple):
        return place
    place = builder.bitcast(place, context.get_value_type(field).as_pointer())
    return impl_ret_borrowed(context, builder, field, builder.load(place))


def _offset(context: Any, kind: Any, index: int) -> int:
    """Of a field, in bytes."""
    if index not in kind.offsets:
        layout = context.get_value_type(kind.record)
        if isinstance(layout, ir.ArrayType):  # fields that are all of one type
            kind.offsets[index] = index * layout.element.get_abi_size(context.target_data)
        else:
            kind.offsets[index] = layout.get_element_offset(context.target_data, index)
    return kind.offsets[index]


def handed_on(kind: Any) -> Any:
    """As what a value is handed from kernel to kernel: records with arrays or records in them by reference."""
    large = isinstance(kind, types.BaseNamedTuple) and any(
        isinstance(each, (types.Array, types.BaseNamedTuple, Reference))
        for each in tuple(kind)  # type: ignore[arg-type]
    )
    return Reference(kind) if large else kind


@lower_cast(types.BaseNamedTuple, Reference)
def _hand_on(context: Any, builder: Any, record: Any, kind: Any, value: Any) -> Any:
    return builder.bitcast(cgutils.alloca_once_value(builder, value), cgutils.voidptr_t)


def _reference(typingctx: Any, record: Any) -> Any:
    """``reference(record)`` in a kernel: good until the kernel returns."""
    if not isinstance(record, types.BaseNamedTuple):
        return None

    def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
        return builder.bitcast(cgutils.alloca_once_value(builder, values[0]), cgutils.voidptr_t)

    return Reference(record)(record), generate


reference: Any = intrinsic(_reference)


Record = TypeVar("Record")


class Layout(Generic[Record]):
    """What all pinned records of a kind look like; the first one says it.

    Args:
        name, module: where this object is found.

    Attributes:
        at: ``at(address)`` in a kernel is a reference to the record that is pinned there.
    """

    def __init__(self, name: str, module: str) -> None:
        self.name, self.__module__ = name, module
        self.record: Any = None  # its numba type

        def at(typingctx: Any, address: Any) -> Any:
            def generate(context: Any, builder: Any, signature: Any, values: Any) -> Any:
                return builder.inttoptr(values[0], cgutils.voidptr_t)

            return Reference(self.record)(types.int64), generate

        self.at: Any = intrinsic(at)

    def none(self, record: Record) -> int:
        """Address that stands for no record."""
        return 0

    def __reduce__(self) -> str:
        """Copies and pickles are this object: it stands under its name in its module."""
        return self.name


class Pinned(Generic[Record]):
    """A record of integers, floats, arrays and such records that stays where it is in memory, with what its arrays hold.

    Attributes:
        record: itself, for Python.
        address: for kernels, see :attr:`Layout.at`. Keep this object while it is in use.
    """

    def __init__(self, layout: Layout[Record], record: Record) -> None:
        kind = typeof(record)
        layout.record = layout.record or kind
        if kind != layout.record:
            raise TypeError(f"{layout.name}: got {kind}; allowed: {layout.record}")
        fields = [_written(kind[k], value) for k, value in enumerate(record)]  # type: ignore[arg-type, index]
        self._memory = np.frombuffer(bytearray(b"".join(fields)), dtype=np.int64)
        self._places = np.cumsum([0, *(len(each) // 8 for each in fields)]).tolist()
        self.layout, self.record, self.address = layout, record, self._memory.ctypes.data

    def put(self, record: Record) -> None:
        """Let another record of the kind stand here: what is the same object as before is not written again."""
        fields: Any = record
        for k, (value, old) in enumerate(zip(fields, self.record, strict=True)):  # type: ignore[arg-type]
            if value is not old:
                self._write(k, value, old)
        self.record = record

    def _write(self, k: int, value: Any, old: Any) -> None:
        """Write field ``k``, which was ``old``."""
        at, kind = self._places[k], self.layout.record[k]
        if isinstance(value, np.ndarray) and value.shape == old.shape and value.dtype == old.dtype:
            if value.flags.carray and kind.layout == "C":  # an array in the place of one like it: only the pointer
                self._memory[at + _DATA] = value.__array_interface__["data"][0]
                return
        if typeof(value) != kind:
            raise TypeError(f"{self.layout.name}: got {typeof(value)}; allowed: {kind}")
        self._memory[at : self._places[k + 1]] = np.frombuffer(_written(kind, value), dtype=np.int64)

    def __reduce__(self) -> Any:
        """Copies and pickles are pinned anew: the address is this object's own."""
        return Pinned, (self.layout, self.record)


_DATA = 4
"""Which of the eight-byte words of an array in memory is the address of what it holds; see :func:`_written`."""


def _written(kind: Any, value: Any) -> bytes:
    """A value as it lies in memory: everything takes eight bytes or several times that."""
    if isinstance(kind, types.BaseNamedTuple):
        return b"".join(_written(kind[k], field) for k, field in enumerate(value))  # type: ignore[index]
    if isinstance(kind, types.Array):
        numbers = (0, 0, value.size, value.itemsize, value.ctypes.data, *value.shape, *value.strides)
        return struct.pack(f"={len(numbers)}q", *numbers)
    if kind == types.int64:
        return struct.pack("=q", value)
    if kind == types.float64:
        return struct.pack("=d", value)
    raise TypeError(f"pinned records hold int64, float64, arrays and records; got {kind}")
