"""The code of a kernel, from what numba writes down to what the processor runs.

**One piece.** numba optimises a function and makes machine code of it before another one calls it, and then optimises the
copy in the caller again: the deeper the calls, the longer it takes. Here a kernel that another one calls is only written down
(:class:`Unfinished`), and what Python calls is optimised in one piece with all that it calls (:class:`Whole`). That takes less
time, and the numbers do not depend on what was compiled and what was loaded: a cached kernel brings all of its callees along.

**Two halves.** Writing down is numba's work. It takes most of the time, and what comes of it is the same for all processors of
a platform; so are the first optimisations, which throw away most of what was written. What is left, LLVM's bitcode, can be
made elsewhere, and is optimised for the processor at hand. A kernel that is compiled here is read back from its bitcode, too,
so that what comes with a wheel gives the same code.
"""

from __future__ import annotations

import functools
from typing import Any

from llvmlite import binding as llvm
from numba.core import codegen


class _Portable(codegen.JITCPUCodegen):
    """Optimises for any processor of this platform."""

    def _get_host_cpu_name(self) -> str:
        return ""

    def _get_host_cpu_features(self) -> str:
        return ""


@functools.cache
def _portable() -> Any:
    return _Portable("vibgym.portable")


def _optimise(maker: Any, module: Any, **how: Any) -> None:
    passes = maker._module_pass_manager(**how)
    manager, *builder = passes if isinstance(passes, tuple) else (passes,)  # the builder came with numba 0.62
    manager.run(module, *builder)


class Unfinished(codegen.JITCodeLibrary):
    """The code of a kernel that only other kernels call: neither put together, nor optimised, nor made machine code of."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True


class Whole(codegen.JITCodeLibrary):
    """The code of a kernel that Python calls, with all that it calls, directly or not.

    Attributes:
        bitcode: of all of it, before it was optimised for this processor.
        symbols: names that its machine code defines.
    """

    bitcode: bytes
    symbols: frozenset[str]

    def finalize(self) -> None:
        # Users of a library precede it: LLVM links only symbols that are already referenced when it reaches a library.
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
        self._linking_libraries = list(reversed(order))
        super().finalize()

    def _optimize_final_module(self) -> None:
        if not hasattr(self, "bitcode"):
            _optimise(_portable(), self._final_module, opt=1, loop_vectorize=False, slp_vectorize=False)
            self._read(self._final_module.as_bitcode())
        _optimise(self._codegen, self._final_module)
        module = self._final_module
        named = (*module.functions, *module.global_variables)
        self.symbols = frozenset(each.name for each in named if not each.is_declaration)

    def _read(self, bitcode: bytes) -> None:
        self.bitcode = bitcode
        self._final_module = llvm.parse_bitcode(bitcode)
        self._final_module.name = self.name

    def serialize_using_object_code(self) -> Any:
        """What :meth:`from_object` takes, besides the maker."""
        return self.name, self._get_compiled_object(), self.bitcode, self.symbols

    @classmethod
    def _empty(cls, maker: Any, name: str) -> Whole:
        made: Any = cls(maker, name)
        made.enable_object_caching()
        return made

    @classmethod
    def from_bitcode(cls, maker: Any, name: str, bitcode: bytes) -> Whole:
        """Optimised for this processor, and made machine code of."""
        made = cls._empty(maker, name)
        made._read(bitcode)
        made._optimize_final_module()
        made._final_module.verify()
        made._finalize_final_module()
        return made

    @classmethod
    def from_object(cls, maker: Any, name: str, code: bytes, bitcode: bytes, symbols: frozenset[str]) -> Whole:
        """Machine code of this processor, as it is."""
        made = cls._empty(maker, name)
        made.bitcode, made.symbols = bitcode, symbols
        made._set_compiled_object(code)
        made._finalize_final_module()
        maker._engine._defined_symbols |= symbols
        return made
