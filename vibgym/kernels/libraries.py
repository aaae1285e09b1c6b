"""Code libraries of kernels: from numba's LLVM IR to machine code.

**One optimisation.** numba optimises each function, generates its machine code, and optimises the copy in each caller again, so
compilation time grows with the depth of calls. Here a kernel that only kernels call is translated to LLVM IR
(:class:`UnlinkedLibrary`). A kernel that Python calls is linked with all its callees and optimised once
(:class:`LinkedLibrary`). Its results then do not depend on which callees were compiled or loaded from the cache.

**Bitcode.** Translation to IR takes most of the time, and its result is the same on all processors of a platform. So is the
first optimisation, which removes most of the IR. Its result is kept as LLVM bitcode and can be shipped. Every kernel is read
back from its bitcode before it is optimised for the processor, so shipped and compiled kernels have the same machine code.
"""

from __future__ import annotations

import functools
import hashlib
from typing import Any

from llvmlite import binding as llvm
from numba.core import codegen

from vibgym.kernels.helpers import is_helper, kernel_of


class _PortableCodegen(codegen.JITCPUCodegen):
    """Code generation for any processor of this platform."""

    def _get_host_cpu_name(self) -> str:
        return ""

    def _get_host_cpu_features(self) -> str:
        return ""


@functools.cache
def _portable_codegen() -> Any:
    return _PortableCodegen("vibgym.portable")


def _optimise(generator: Any, module: Any, **options: Any) -> None:
    passes = generator._module_pass_manager(**options)
    manager, *builder = passes if isinstance(passes, tuple) else (passes,)  # the builder came with numba 0.62
    manager.run(module, *builder)


class UnlinkedLibrary(codegen.JITCodeLibrary):
    """LLVM IR of a kernel that only other kernels call."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True


class Unit:
    """A kernel that other kernels call by its symbol; its machine code is a library of its own.

    Args:
        module, name: where the kernel is defined.
        arguments: types of its arguments.
    """

    def __init__(self, module: str, name: str, arguments: tuple[Any, ...]) -> None:
        self.job = module, name, arguments
        digest = hashlib.sha256(repr(self.job).encode()).hexdigest()[:20]
        self.symbol = f"vibgym.{name}.{digest}"

    def announce(self) -> None:
        """Have a helper process compile the unit."""
        kernel_of(self.job).prefetch(self.job[2])

    def provide(self) -> None:
        """Define the symbol, for code that is loaded after this."""
        if is_helper():  # does not run what it compiles
            llvm.add_symbol(self.symbol, 1)
        else:
            kernel_of(self.job).compile(self.job[2])


def is_unit(descriptor: Any) -> bool:
    """Return whether a function descriptor of numba is that of a unit."""
    return descriptor.mangled_name.startswith("vibgym.")


class UnitLibrary(UnlinkedLibrary):
    """Placeholder for a unit in the list of libraries that a kernel calls."""

    unit: Unit


class LinkedLibrary(codegen.JITCodeLibrary):
    """Machine code of a kernel that Python calls or of a unit, with all direct and indirect callees but units.

    Attributes:
        bitcode: of all of it, before the optimisation for this processor.
        symbols: names that the machine code defines.
        units: the units that it calls.
    """

    bitcode: bytes
    symbols: frozenset[str]
    units: tuple[Unit, ...]

    def finalize(self) -> None:
        # Callers precede callees: LLVM links only symbols that are referenced when it reaches a library.
        order: dict[Any, None] = {}
        todo = [(self, iter(self._linking_libraries))]
        while todo:
            library, rest = todo[-1]
            following = next((each for each in rest if each not in order), None)
            if following is None:
                order[library] = None
                todo.pop()
            else:
                todo.append((following, iter(following._linking_libraries)))
        del order[self]
        self._linking_libraries = [each for each in reversed(order) if not isinstance(each, UnitLibrary)]
        self.units = tuple(each.unit for each in order if isinstance(each, UnitLibrary))
        super().finalize()

    def _optimize_final_module(self) -> None:
        if not hasattr(self, "bitcode"):
            _optimise(_portable_codegen(), self._final_module, opt=1, loop_vectorize=False, slp_vectorize=False)
            self._read(self._final_module.as_bitcode())
        _optimise(self._codegen, self._final_module)
        module = self._final_module
        named = (*module.functions, *module.global_variables)
        self.symbols = frozenset(each.name for each in named if not each.is_declaration)

    def _finalize_final_module(self) -> None:
        for unit in self.units:
            unit.provide()
        super()._finalize_final_module()

    def _read(self, bitcode: bytes) -> None:
        self.bitcode = bitcode
        self._final_module = llvm.parse_bitcode(bitcode)
        self._final_module.name = self.name

    def serialize_using_object_code(self) -> Any:
        """Return the arguments of :meth:`from_object` after the first."""
        return self.name, self._get_compiled_object(), self.bitcode, self.symbols, self.unit_jobs

    @property
    def unit_jobs(self) -> tuple[Any, ...]:
        """The arguments of :class:`Unit` for each unit."""
        return tuple(each.job for each in self.units)

    @classmethod
    def empty(cls, generator: Any, name: str) -> LinkedLibrary:
        """Create a library without code."""
        made: Any = cls(generator, name)
        made.enable_object_caching()
        return made

    @classmethod
    def from_bitcode(cls, generator: Any, name: str, bitcode: bytes, units: tuple[Any, ...]) -> LinkedLibrary:
        """Optimise bitcode for this processor and generate machine code."""
        made: Any = cls.empty(generator, name)
        made.units = tuple(Unit(*each) for each in units)
        for each in made.units:
            each.announce()
        made._read(bitcode)
        made._optimize_final_module()
        made._final_module.verify()
        made._finalize_final_module()
        return made

    @classmethod
    def from_object(
        cls, generator: Any, name: str, code: bytes, bitcode: bytes, symbols: frozenset[str], units: tuple[Any, ...]
    ) -> LinkedLibrary:
        """Load machine code for this processor."""
        made: Any = cls.empty(generator, name)
        made.bitcode, made.symbols, made.units = bitcode, symbols, tuple(Unit(*each) for each in units)
        made._set_compiled_object(code)
        made._finalize_final_module()
        generator._engine._defined_symbols |= symbols
        return made
