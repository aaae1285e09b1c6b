"""How kernels are compiled, unless in plain mode.

**One piece.** numba optimises a function and makes machine code of it before another one calls it, and then optimises the
copy in the caller again: the deeper the calls, the longer it takes. Here a kernel that another one calls is only typed and
written down (:class:`_Called`), and what Python calls is optimised in one piece with all that it calls. That takes less time,
and the numbers do not depend on what was compiled and what was loaded: a cached kernel brings all of its callees along.
"""

from __future__ import annotations

import functools
import gc
import logging
import math
import time
from typing import Any

from numba.core import codegen, compiler, event, types
from numba.core import config as numba_config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from vibgym._numba import options
from vibgym._numba.by_reference import handed_on
from vibgym._numba.cache import Files
from vibgym._numba.sources import last_edit, sources
from vibgym._numba.vec8 import WIDTH

config: Any = numba_config

LOGGER = logging.getLogger("vibgym")


class _Unfinished(codegen.JITCodeLibrary):
    """The code of a kernel that only other kernels call: neither put together, nor optimised, nor made machine code of."""

    def _optimize_functions(self, ll_module: Any) -> None:
        ll_module.data_layout = self._codegen._data_layout

    def finalize(self) -> None:
        self._finalized = True


class _Whole(codegen.JITCodeLibrary):
    """The code of a kernel that Python calls, with all that it calls, directly or not."""

    def finalize(self) -> None:
        libraries = dict.fromkeys(self._linking_libraries)
        todo = list(libraries)
        while todo:
            for each in todo.pop()._linking_libraries:
                if each not in libraries:
                    libraries[each] = None
                    todo.append(each)
        self._linking_libraries = list(libraries)
        super().finalize()


class _Typing:
    """A typing context that remembers what operators yield: numba asks again for every plus sign, several times."""

    known: dict[Any, Any] = {}

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def resolve_function_type(self, function: Any, arguments: Any, named: Any) -> Any:
        """Signature of a call."""
        plain = getattr(function, "__module__", None) == "_operator" or all(
            isinstance(each, (types.Number, types.Boolean)) for each in arguments
        )
        if named or not plain:
            return self._context.resolve_function_type(function, arguments, named)
        key = function, tuple(arguments)
        if key not in self.known:
            self.known[key] = self._context.resolve_function_type(function, arguments, named)
        return self.known[key]


class _Compiler(compiler.Compiler):
    """Compiles a kernel that Python calls."""

    def define_pipelines(self) -> Any:
        state: Any = self.state
        state.typingctx = _Typing(state.typingctx)
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()

    def library(self, maker: Any, name: str) -> Any:
        """Where its code goes."""
        made = _Whole(maker, name)
        made.enable_object_caching()
        return made


class _CalledCompiler(_Compiler):
    """Writes a kernel down for the kernels that call it."""

    def define_pipelines(self) -> Any:
        flags: Any = self.state.flags  # type: ignore[attr-defined]
        flags.no_compile = flags.no_cpython_wrapper = flags.no_cfunc_wrapper = True
        return super().define_pipelines()

    def library(self, maker: Any, name: str) -> Any:
        """Where its code goes."""
        return _Unfinished(maker, name)


class _Called(CPUDispatcher):
    """A kernel as other kernels see it."""

    def get_call_template(self, args: Any, kws: Any) -> Any:
        # numba would compile a kernel for True and once more for False, and hand records on by value.
        return super().get_call_template(tuple(handed_on(types.unliteral(each)) for each in args), kws)

    def add_overload(self, cres: Any) -> None:
        # There is no machine code whose address could stand for this overload; any object can.
        cres = cres._replace(entry_point=object())
        self.targetctx.insert_user_function(cres.entry_point, cres.fndesc, [cres.library])
        self.overloads[tuple(cres.signature.args)] = cres


class _Kernel(CPUDispatcher):
    """A kernel as Python sees it."""

    _cache: Any

    imported = math.inf
    """When Python read the kernel's file, and those that it imports."""

    @functools.cached_property
    def called(self) -> _Called:
        """The same for other kernels."""
        return _Called(py_func=self.py_func, targetoptions=self.targetoptions, pipeline_class=_CalledCompiler)

    @property
    def _numba_type_(self) -> Any:
        return types.Dispatcher(self.called)

    @global_compiler_lock  # or a second thread reads the cache while the first is about to say what its version is
    def compile(self, sig: Any) -> Any:
        if options.CACHE and not self.overloads:
            self.enable_caching()
        collecting = gc.isenabled()
        gc.disable()  # it would go through all of numba's notes again and again
        try:
            return super().compile(sig)
        except OSError as error:  # from the cache: a full disk, a file that may not be read
            options.warn_about_cache(str(error))
            self._cache.disable()
            return super().compile(sig)
        finally:
            if collecting:
                gc.enable()

    def enable_caching(self) -> None:
        try:
            super().enable_caching()
        except RuntimeError:  # numba has found no folder that it may write to
            options.warn_about_cache("no folder that may be written")
            return
        # numba has no public way to say what else a kernel depends on. Were these names to change, the error says so here.
        cache = self._cache
        own: Any = Files(cache.cache_path, cache._impl.filename_base, cache._cache_file._source_stamp)
        # The version is looked at before anything else is read, which may no longer be readable.
        where = self.py_func.__code__.co_filename, self.py_func.__module__
        own._version = f"{own._version} {sources(*where)} {WIDTH}"
        cache._cache_file = own
        if last_edit(*where) > self.imported:  # what is compiled is older than what the version tells of
            cache.disable()


def _kernel(function: Any, **more: Any) -> Any:
    if config.DISABLE_JIT:
        return function
    kernel = _Kernel(
        py_func=function, targetoptions={"nopython": True, **options.OPTIONS, **more}, pipeline_class=_Compiler
    )
    kernel.imported = time.time()
    return kernel


def jit(function: Any) -> Any:
    """Compile ``function`` in nopython mode with the project's options."""
    return _kernel(function)


def borrowing(function: Any) -> Any:
    """Like :func:`jit`, for functions that only look at arrays which their callers hold: without reference counts.

    That is faster, to compile as well: counts stand at every turn and are atomic. Such a function cannot make arrays.
    """
    return _kernel(function, _nrt=False)


def inlined(function: Any) -> Any:
    """Like :func:`borrowing`, for functions that must be compiled into their caller's loop so that it can be vectorised."""
    return _kernel(function, _nrt=False, forceinline=True)


def exact(function: Any) -> Any:
    """Like :func:`borrowing`, but without fast-math: numbers are rounded as the source says, on every processor alike."""
    return _kernel(function, _nrt=False, fastmath=False)


def exact_inlined(function: Any) -> Any:
    """Like :func:`exact`, for functions that are to become part of their caller."""
    return _kernel(function, _nrt=False, fastmath=False, forceinline=True)


def cache_folder(kernel: Any = None) -> str | None:
    """Where a kernel is kept once it is compiled, by default one of this file's package; None: nowhere."""
    if not options.CACHE:
        return None
    if kernel is None:
        kernel = jit(cache_folder)
        kernel.enable_caching()
    folder = getattr(kernel._cache, "cache_path", None)
    return None if folder is None else config.CACHE_DIR or folder


class _Announcer(event.Listener):
    """Says on stderr, once a process, that kernels are being compiled: the first step would look as if it hung."""

    said = False

    def on_start(self, event: Any) -> None:
        kernel = event.data["dispatcher"]
        if self.said or not isinstance(kernel, _Kernel):
            return
        self.said = True
        folder = cache_folder(kernel)
        kept = "not kept" if folder is None else f"kept in {folder}"
        # A warning, so that it shows where nobody has configured logging, and where only warnings show.
        LOGGER.warning(
            "vibgym: compiling kernels that this kind of scene is the first to need: the first step takes %s (%s); "
            "python -m vibgym warm compiles those of all kinds at once",
            options.FIRST_STEP, kept,
        )  # fmt: skip

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Announcer())
