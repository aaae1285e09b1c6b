"""Compilation of kernels, unless in plain mode.

Each kernel has two dispatchers: :class:`_Callee` for calls from other kernels, which stops at LLVM IR, and :class:`_Kernel` for
calls from Python, which links and optimises a kernel with all its callees (see :mod:`vibgym.kernels.libraries`).
"""

from __future__ import annotations

import functools
import gc
import inspect
import logging
import math
import os
import timeit
from typing import Any

from llvmlite.binding import add_symbol, ffi
from numba.core import compiler, funcdesc, types
from numba.core import config as numba_config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.typing.templates import signature

from vibgym.kernels import helpers, options
from vibgym.kernels.cache import Cache, version_mismatch
from vibgym.kernels.faster import Passes, faster
from vibgym.kernels.libraries import LinkedLibrary, Unit, UnitLibrary, UnlinkedLibrary
from vibgym.kernels.pointers import argument_type, known_layouts
from vibgym.kernels.sources import note

config: Any = numba_config

LOGGER = logging.getLogger("vibgym")


PACE = 0.84
"""Time to compile a byte of Python code, over that of the loop in :func:`_announce`."""


class _TypingContext:
    """A typing context that caches the types of operators: numba resolves each of them several times."""

    known: dict[Any, Any] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: Any, named: Any) -> Any:
        """Return the signature of a call."""
        scalar = getattr(function, "__module__", None) == "_operator" or all(
            isinstance(each, (types.Number, types.Boolean)) for each in arguments
        )
        if named or not scalar:
            return self._context.resolve_function_type(function, arguments, named)
        key = function, tuple(arguments)
        if key not in self.known:
            self.known[key] = self._context.resolve_function_type(function, arguments, named)
        return self.known[key]


class _KernelCompiler(compiler.Compiler):
    """Pipeline for a kernel."""

    new_library: Any = LinkedLibrary.empty

    def define_pipelines(self) -> Any:
        state: Any = self.state
        state.flags.no_cfunc_wrapper = True  # kernels are not called by the address of a C function
        state.typingctx = _TypingContext(state.typingctx)
        state.library = self.new_library(state.targetctx.codegen(), state.func_id.func_qualname)
        return [Passes.of(each, allocating=bool(state.flags.nrt)) for each in super().define_pipelines()]


class _EntryCompiler(_KernelCompiler):
    """Pipeline for a kernel that Python calls and whose file, in the wheel or the cache, is missing or damaged."""

    def define_pipelines(self) -> Any:
        _announce()
        return super().define_pipelines()


class _CalleeCompiler(_KernelCompiler):
    """Pipeline for a kernel that other kernels call."""

    new_library = UnlinkedLibrary

    def define_pipelines(self) -> Any:
        flags: Any = self.state.flags  # type: ignore[attr-defined]
        flags.no_compile = flags.no_cpython_wrapper = True
        return super().define_pipelines()


class _UnitCompiler(_KernelCompiler):
    """Pipeline for a unit, whose function has the name of the unit's symbol."""

    def define_pipelines(self) -> Any:
        state: Any = self.state
        state.flags.no_compile = state.flags.no_cpython_wrapper = True
        function, mangler = state.func_id, state.targetctx.mangler
        unit = Unit(function.modname, function.func_qualname, tuple(state.args))

        def named(name: str, kinds: Any, **more: Any) -> str:
            return (
                unit.symbol if name == f"{function.modname}.{function.func_qualname}" else mangler(name, kinds, **more)
            )

        state.targetctx.mangler = named
        return super().define_pipelines()


class _Callee(CPUDispatcher):
    """Dispatcher of a kernel for other kernels."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        # numba would compile a kernel separately for True and for False, and pass records by value.
        return super().get_call_template(tuple(argument_type(types.unliteral(each)) for each in args), kws)

    def add_overload(self, cres: Any) -> None:
        # No machine code whose address could identify this overload exists; any object can.
        cres = cres._replace(entry_point=object())
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


class _UnitCallee(_Callee):
    """Dispatcher of a unit for kernels that call it: the call needs no more than the symbol and the types."""

    kernel: Any

    def compile(self, sig: Any) -> Any:
        arguments = tuple(sig)
        if arguments not in self.overloads:
            unit = Unit(self.py_func.__module__, self.py_func.__qualname__, arguments)
            self.kernel.prefetch(arguments)
            target: Any = self.targetctx
            library = UnitLibrary(target.codegen(), unit.symbol)
            library.unit = unit
            names = tuple(inspect.signature(self.py_func).parameters)
            described = funcdesc.FunctionDescriptor(
                True, *unit.job[:2], unit.symbol, "", None, types.none, None, names, (),
                mangler=lambda *_, **__: unit.symbol, argtypes=arguments,
            )  # fmt: skip
            kinds = signature(types.none, *arguments)
            self.add_overload(
                compiler.compile_result(signature=kinds, fndesc=described, library=library, objectmode=False)
            )
        return self.overloads[arguments].entry_point


class _Kernel(CPUDispatcher):
    """Dispatcher of a kernel for Python."""

    _cache: Any

    @functools.cached_property
    def callee(self) -> _Callee:
        """Dispatcher for other kernels."""
        return _Callee(py_func=self.py_func, targetoptions=self.targetoptions, pipeline_class=_CalleeCompiler)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.callee)

    @global_compiler_lock  # a second thread must not read the cache before the first has set its version
    def compile(self, sig: Any) -> Any:
        arguments = tuple(sig)
        if arguments not in self.overloads and not self._cached(arguments):
            if not self._cache.ships(arguments):
                _announce(self)
            helpers.claim(self._job(arguments), _compile_job)
        collecting = gc.isenabled()
        gc.disable()  # it would traverse all of numba's objects again and again
        try:
            with faster(self.targetctx):
                return super().compile(sig)
        finally:
            if collecting:
                if not gc.get_freeze_count():  # the next collection would traverse all objects of the compilation
                    gc.freeze()
                    gc.unfreeze()
                gc.enable()

    @global_compiler_lock
    def prefetch(self, arguments: tuple[Any, ...], first: bool = False) -> None:
        """Have a helper process compile the kernel for arguments of these types, unless it is in the cache."""
        if arguments not in self.overloads and not self._cached(arguments):
            layouts = known_layouts() if self._cache.stores else None
            helpers.submit(self._job(arguments), math.inf if first else _size(self), layouts)

    def _job(self, arguments: tuple[Any, ...]) -> helpers.Job:
        return self.py_func.__module__, self.py_func.__qualname__, arguments

    def _cached(self, arguments: tuple[Any, ...]) -> bool:
        if not isinstance(self._cache, Cache):
            self.enable_caching()
        return self._cache.contains(arguments, self.targetctx)

    def enable_caching(self) -> None:
        self._cache = Cache(self.py_func)


class _UnitKernel(_Kernel):
    """Dispatcher of a unit: compiles and loads it."""

    @functools.cached_property
    def callee(self) -> _Callee:
        made = _UnitCallee(py_func=self.py_func, targetoptions=self.targetoptions, pipeline_class=_CalleeCompiler)
        made.kernel = self
        return made

    def add_overload(self, cres: Any) -> None:
        if cres.signature.return_type != types.none:
            raise TypeError(f"{self.py_func.__qualname__}: units return nothing, got {cres.signature.return_type}")
        address = cres.library.get_pointer_to_function(cres.fndesc.mangled_name)
        add_symbol(cres.fndesc.mangled_name, address)
        self.overloads[tuple(cres.signature.args)] = cres


@functools.cache
def _called(function: _Kernel) -> frozenset[_Kernel]:
    """Return a kernel and those that it calls, directly or indirectly."""
    found, todo = {function}, [function]
    while todo:
        called = todo.pop().py_func
        names = map(called.__globals__.get, called.__code__.co_names)
        new = {each for each in names if isinstance(each, _Kernel)} - found
        found |= new
        todo += new
    return frozenset(found)


def _size(*functions: _Kernel) -> int:
    """Return the bytes of Python code of kernels with all that they call, which determines how long they compile."""
    return sum(len(each.py_func.__code__.co_code) for each in frozenset().union(*map(_called, functions)))


def _compile_job(job: helpers.Job) -> None:
    helpers.kernel_of(job).compile(job[2])


def prefetch(function: Any, *arguments: Any, first: bool = False) -> None:
    """Have a helper process compile a kernel that will be called with such arguments, unless it is in the cache.

    ``first``: before others, for kernels that share most functions with a large one: together they take less time.
    """
    if isinstance(function, _Kernel):
        function.prefetch(tuple(function.typeof_pyval(each) for each in arguments), first)


def kernel(function: Any, unit: bool = False, **more: Any) -> Any:
    """Compile a function in nopython mode with the project's options and more; as a unit if ``unit``."""
    if config.DISABLE_JIT:
        return function
    settings = {"nopython": True, **options.OPTIONS, **more}
    made = (
        _UnitKernel(py_func=function, targetoptions=settings, pipeline_class=_UnitCompiler)
        if unit
        else _Kernel(py_func=function, targetoptions=settings, pipeline_class=_EntryCompiler)
    )
    note(function.__code__.co_filename, function.__module__)
    return made


def cache_folder() -> str | None:
    """Return the folder of the kernel cache, by default next to the source files; None if kernels are not cached."""
    if not options.CACHE:
        return None
    folder = Cache(cache_folder).cache_path
    return None if folder is None else config.CACHE_DIR or folder


_announced = False


def _announce(*functions: _Kernel) -> None:
    """Warn on stderr, once per process, that kernels are compiled, and how long these and announced ones may take."""
    global _announced
    if _announced or helpers.is_helper():
        return
    _announced = True
    folder, reason = cache_folder(), version_mismatch()
    wanted = {*functions, *map(helpers.kernel_of, helpers.waiting())}
    loop = min(timeit.repeat("sum(len(str(number)) for number in range(2_000))", number=1, repeat=10))
    seconds = PACE * _size(*wanted) * loop / helpers.speedup()
    # A warning, so that it appears without logging configuration and at level WARNING.
    LOGGER.warning(
        "vibgym: %scompiling kernels on first use, about %.0f s (%s); python -m vibgym warm compiles all",
        f"{reason}: " if reason else "", max(seconds, 1.0), "not kept" if folder is None else f"kept in {folder}",
    )  # fmt: skip


# A process that forks waits until no other thread compiles. Otherwise the child would inherit numba's and llvmlite's locks in
# the locked state, without the thread that holds them, and wait forever at its first kernel.


def _acquire_locks() -> None:
    global_compiler_lock.acquire()
    ffi.lib._lock._lock.acquire()


def _release_locks() -> None:
    ffi.lib._lock._lock.release()
    global_compiler_lock.release()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(before=_acquire_locks, after_in_parent=_release_locks, after_in_child=_release_locks)
