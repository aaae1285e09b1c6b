"""Compilation by numba's private interfaces: each kernel that Python calls is linked with all its callees and optimised once.

numba optimises each function, generates its machine code, and optimises the copy in each caller again, so that compilation
takes longer the deeper calls are nested. Here each kernel has two dispatchers: :class:`_Callee` for calls from other kernels,
which stops at LLVM IR, and :class:`_Kernel` for calls from Python, which links the IR of all direct and indirect callees.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import hashlib
import importlib
import operator
import os
import pickle
from typing import Any

from llvmlite.binding import ffi
from numba.core import caching, codegen, compiler, compiler_machinery, postproc, transforms, types
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher
from numba.core.serialize import dumps

from vibgym.kernels.cache import CACHE, announce, warn_about_cache, warn_about_damage
from vibgym.kernels.pointers import argument_type

for _owner, _names in (  # importing this module fails where numba lacks one
    (codegen.JITCodeLibrary, ("_optimize_functions", "enable_object_caching", "finalize")),
    (caching.FunctionCache, ("_guard_against_spurious_io_errors",)),
    (caching.IndexDataCacheFile, ("flush", "load", "save")),
    (compiler.Compiler, ("define_pipelines",)),
    (compiler_machinery, ("PassManager._runPass", "_pass_registry.get")),
    (CPUDispatcher, ("add_overload", "compile", "get_call_template")),
):
    operator.attrgetter(*_names)(_owner)


class _UnlinkedLibrary(codegen.JITCodeLibrary):
    """LLVM IR of a kernel that only other kernels call."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True


class _LinkedLibrary(codegen.JITCodeLibrary):
    """Machine code of a kernel that Python calls, with all direct and indirect callees."""

    def finalize(self) -> None:
        # Callers precede callees: LLVM links only symbols that are referenced when it reaches a library.
        order: dict[Any, None] = {}

        def visit(library: Any) -> None:
            for linked in library._linking_libraries:
                if linked not in order:
                    visit(linked)
                    order[linked] = None

        visit(self)
        self._linking_libraries = list(reversed(order))
        super().finalize()


class _Passes(compiler_machinery.PassManager):
    """The passes of a pipeline, without the timings and checks of each."""

    NEEDLESS = {
        "WithLifting", "InlineClosureLikes", "MakeFunctionToJitFunction", "FindLiterallyCalls", "LiteralUnroll",
        "LiteralPropagationSubPipelinePass", "NopythonRewrites", "DumpParforDiagnostics",
    }  # fmt: skip
    """Passes for closures, comprehensions, array expressions and literals, which change nothing in kernels without arrays."""

    def __init__(self, pipeline: Any, allocating: bool) -> None:
        super().__init__(pipeline.pipeline_name)
        self.passes = [step for step in pipeline.passes if allocating or step[0].__name__ not in self.NEEDLESS]
        self.finalize()

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        changed = pss.run_initialization(internal_state)
        changed |= pss.run_pass(internal_state)
        changed |= pss.run_finalizer(internal_state)
        if changed and compiler_machinery._pass_registry.get(pss.__class__).mutates_CFG:
            postproc.PostProcessor(internal_state.func_ir).run()
        else:
            internal_state.func_ir.blocks = transforms.canonicalize_cfg(internal_state.func_ir.blocks)


class _CalleeCompiler(compiler.Compiler):
    """Pipeline for a kernel that other kernels call."""

    linked = False

    def define_pipelines(self) -> Any:
        if self.linked:
            announce(default_folder())
        state: Any = self.state
        state.flags.no_cfunc_wrapper = True  # kernels are not called by the address of a C function
        state.flags.no_compile = state.flags.no_cpython_wrapper = not self.linked
        new_library = _LinkedLibrary if self.linked else _UnlinkedLibrary
        state.library = new_library(state.targetctx.codegen(), state.func_id.func_qualname)
        state.library.enable_object_caching()
        return [_Passes(pipeline, allocating=bool(state.flags.nrt)) for pipeline in super().define_pipelines()]


class _KernelCompiler(_CalleeCompiler):
    """Pipeline for a kernel that Python calls."""

    linked = True


class _Callee(CPUDispatcher):
    """Dispatcher of a kernel for other kernels."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        # numba would compile a kernel separately for True and for False, and pass records by value.
        return super().get_call_template(tuple(argument_type(types.unliteral(argument)) for argument in args), kws)

    def add_overload(self, cres: Any) -> None:
        # No machine code whose address could identify this overload exists; any object can.
        cres = cres._replace(entry_point=object())
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


class _Kernel(CPUDispatcher):
    """Dispatcher of a kernel for Python."""

    state: str

    @functools.cached_property
    def callee(self) -> _Callee:
        return _Callee(py_func=self.py_func, targetoptions=self.targetoptions, pipeline_class=_CalleeCompiler)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.callee)

    @global_compiler_lock
    def compile(self, sig: Any) -> Any:
        if self.state and not isinstance(self._cache, _Cache):
            try:
                self._cache: Any = _Cache(self.py_func, self.state)
            except RuntimeError:  # numba has found no writable folder
                warn_about_cache("no folder that may be written")
        _import_array_functions()
        collecting = gc.isenabled()
        gc.disable()  # it would traverse all of numba's objects again and again
        try:
            return super().compile(sig)
        finally:
            if collecting:
                gc.enable()


class _Cache(caching.FunctionCache):
    """Kernels on disk: numba's files, whose version contains a digest of the sources and whose content has a digest."""

    def __init__(self, function: Any, state: str) -> None:
        super().__init__(function)
        # No stamp: that of older numba is the file's time, which a checkout changes.
        self._cache_file: Any = _Files(self._cache_path, self._impl.filename_base, source_stamp="")
        self._cache_file._version += f" {state}"

    @contextlib.contextmanager
    def _guard_against_spurious_io_errors(self) -> Any:
        try:
            yield
        except OSError as error:  # a full disk, a folder that is not writable
            warn_about_cache(str(error))
            self.disable()


class _Files(caching.IndexDataCacheFile):
    """A kernel's index and data files; damaged files, and data of another kernel, count as missing.

    Crashes and full disks truncate files, and two processes that add to an index at the same time may choose the same name.
    """

    def save(self, key: Any, data: Any) -> None:
        content = dumps(data)
        super().save(key, (self._digest(key, content), content))

    def load(self, key: Any) -> Any:
        try:
            digest, content = super().load(key) or ("", None)
            if content is None:
                return None
            if digest != self._digest(key, content):
                raise ValueError("the content does not match its digest")
            return pickle.loads(content)
        except Exception as error:  # a damaged pickle may raise anything
            warn_about_damage(self._cache_path, error)
            self.flush()
            return None

    def _digest(self, key: Any, content: bytes) -> str:
        return hashlib.sha256(f"{self._version} {key}".encode() + content).hexdigest()


def kernel(function: Any, options: dict[str, Any], state: str) -> Any:
    """Compile a function, when it is called, with options of numba; ``state``: digest of its sources, empty: not cached."""
    made = _Kernel(py_func=function, targetoptions={"nopython": True, **options}, pipeline_class=_KernelCompiler)
    made.state = state
    return made


def default_folder() -> str | None:
    """Return numba's folder for kernels of this file; None if kernels are not cached, or no folder may be written."""
    try:
        return _Cache(default_folder, "").cache_path if CACHE else None
    except RuntimeError:
        return None


@functools.cache
def _import_array_functions() -> None:
    """Import numba's functions of arrays without scipy.linalg, which they would import, and which kernels do not need."""
    from numba.np import linalg

    before, linalg.ensure_blas = linalg.ensure_blas, lambda: None
    try:
        importlib.import_module("numba.np.arraymath")
    finally:
        linalg.ensure_blas = before


# A process that forks waits until no other thread compiles. Otherwise the child would inherit numba's and llvmlite's locks in
# the locked state, without the thread that holds them, and wait forever at its first kernel.
_LOCKS = global_compiler_lock, ffi.lib._lock._lock


def _acquire_locks() -> None:
    for lock in _LOCKS:
        lock.acquire()


def _release_locks() -> None:
    for lock in reversed(_LOCKS):
        lock.release()


if hasattr(os, "register_at_fork"):  # not on Windows, which has no fork
    os.register_at_fork(before=_acquire_locks, after_in_parent=_release_locks, after_in_child=_release_locks)
