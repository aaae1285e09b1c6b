"""The one decorator every kernel uses: how kernels are compiled, once and fast, and where the result is kept.

``error_model="numpy"`` lets divisions vectorise. The fast-math flags allow contraction and reassociation but keep NaN and
infinity meaningful in comparisons. ``math.isfinite`` is no such guard: it looks at ``x - x``, and reassociation turns
``(a + b) - (a + b)`` into zero. Write ``abs(a + b) < math.inf``. Kernels release the GIL: the simulator runs blocks of worlds
in threads.

**One piece.** numba optimises a function and makes machine code of it before another one calls it, and then optimises the
copy in the caller again: the deeper the calls, the longer it takes. Here a kernel that another one calls is only typed and
written down (:class:`_Called`), and what Python calls is optimised in one piece with all that it calls. That takes less time,
and the numbers do not depend on what was compiled and what was loaded: a cached kernel brings all of its callees along.

**Cache.** numba caches a kernel by the file that holds it and does not notice when a kernel or a constant of another file has
changed: it would go on with the old physics. So the version of a cached kernel also holds a digest of that file and of all
that it imports, directly or not, from its own package and from this one (:func:`sources`). A file of the cache also holds a
digest of its own content: one that a crash or a full disk has cut short is not loaded but written anew. ``VIBGYM_CACHE=0``
switches the cache off, and ``NUMBA_CACHE_DIR`` says where it is.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import logging
import math
import os
import pickle
import re
import time
from pathlib import Path
from typing import Any

from numba.core import codegen, compiler, event, types
from numba.core import config as numba_config
from numba.core.caching import IndexDataCacheFile
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from vibgym._numba.reference import handed_on

config: Any = numba_config

LOGGER = logging.getLogger("vibgym")

FAST_MATH = {"contract", "reassoc", "arcp", "nsz", "afn"}

OPTIONS: Any = {"nopython": True, "error_model": "numpy", "fastmath": FAST_MATH, "nogil": True}

CACHE = os.environ.get("VIBGYM_CACHE", "1") != "0"

FIRST_STEP = "10 to 40 s"
"""What the kernels of an environment take to compile (studies/benchmarks/cold_start.py)."""


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
        if CACHE and not self.overloads:
            self.enable_caching()
        collecting = gc.isenabled()
        gc.disable()  # it would go through all of numba's notes again and again
        try:
            return super().compile(sig)
        except OSError as error:  # from the cache: a full disk, a file that may not be read
            _warn_about_cache(str(error))
            self._cache.disable()
            return super().compile(sig)
        finally:
            if collecting:
                gc.enable()

    def enable_caching(self) -> None:
        try:
            super().enable_caching()
        except RuntimeError:  # numba has found no folder that it may write to
            _warn_about_cache("no folder that may be written")
            return
        # numba has no public way to say what else a kernel depends on. Were these names to change, the error says so here.
        cache = self._cache
        own: Any = _Files(cache.cache_path, cache._impl.filename_base, cache._cache_file._source_stamp)
        # The version is looked at before anything else is read, which may no longer be readable.
        where = self.py_func.__code__.co_filename, self.py_func.__module__
        own._version = f"{own._version} {sources(*where)}"
        cache._cache_file = own
        if last_edit(*where) > self.imported:  # what is compiled is older than what the version tells of
            cache.disable()


def _kernel(function: Any, **more: Any) -> Any:
    if config.DISABLE_JIT:
        return function
    kernel = _Kernel(py_func=function, targetoptions={**OPTIONS, **more}, pipeline_class=_Compiler)
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


# -- the cache ---------------------------------------------------------------------------------------------------------

_IMPORT = re.compile(r"^(?:from|import) ([\w.]+)(?: import (\([^)]*\)|.*))?", re.MULTILINE)


@functools.cache
def _imported(file: str, module: str) -> tuple[Path, ...]:
    """A module's file and all files that it imports, directly or not, from its own package and from this one."""
    own, name = Path(file), module.partition(".")[0]
    depth = module.count(".") + (own.name == "__init__.py")
    roots = {__name__.partition(".")[0]: Path(__file__).parents[__name__.count(".")], name: own.parents[depth]}
    found, todo = {own}, [own]
    while todo:
        for imported, names in _IMPORT.findall(todo.pop().read_text(encoding="utf-8")):
            first = imported.partition(".")[0]
            if first not in roots:
                continue
            for each in (imported, *(f"{imported}.{one}" for one in re.findall(r"\w+", names))):
                path = roots[first].joinpath(*each.split("."))
                new = {path.with_suffix(".py"), path / "__init__.py"} - found
                todo += [one for one in new if one.is_file()]
                found |= new
    return tuple(path for path in sorted(found) if path.is_file())


@functools.cache
def sources(file: str, module: str) -> str:
    """Digest of what :func:`_imported` finds."""
    digest = hashlib.sha256()
    for path in _imported(file, module):
        digest.update(path.read_bytes())
    return digest.hexdigest()


@functools.cache
def last_edit(file: str, module: str) -> float:
    """When the youngest of these files was written."""
    return max(path.stat().st_mtime for path in _imported(file, module))


class _Files(IndexDataCacheFile):
    """A kernel's files in the cache, each with a digest of its content: numba would trust whatever it can unpickle.

    Damaged ones count as missing, and are then written anew.
    """

    _index_path: str
    _source_stamp: Any
    _version: str

    def load(self, key: Any) -> Any:
        """The kernel's code; None: not there."""
        try:
            return super().load(key)
        except OSError:
            raise
        except Exception as error:  # of a damaged pickle, anything
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return None

    def _dump(self, obj: Any) -> bytes:
        data: bytes = super()._dump(obj)  # type: ignore[misc]
        return hashlib.sha256(data).digest() + data

    def _load_index(self) -> Any:
        try:
            with open(self._index_path, "rb") as file:
                if pickle.load(file) != self._version:
                    return {}
                stamp, overloads = _undamaged(file.read())
        except FileNotFoundError:
            return {}
        except OSError:
            raise
        except Exception as error:
            _warn_about_damage(self._index_path, f"{type(error).__name__}: {error}")
            return {}
        return overloads if stamp == self._source_stamp else {}

    def _load_data(self, name: str) -> Any:
        return _undamaged(Path(self._index_path).with_name(name).read_bytes())


def _undamaged(data: bytes) -> Any:
    size = hashlib.sha256().digest_size
    if hashlib.sha256(data[size:]).digest() != data[:size]:
        raise ValueError("the content does not match its digest")
    return pickle.loads(data[size:])


_damaged: set[str] = set()


def _warn_about_damage(path: str, reason: str) -> None:
    if not _damaged:  # one line, however many files a full disk has cut short
        LOGGER.warning("vibgym: damaged files of compiled kernels are written anew, the first %s (%s)", path, reason)
    _damaged.add(path)


@functools.cache
def _warn_about_cache(reason: str) -> None:
    LOGGER.warning(
        "vibgym: compiled kernels cannot be kept (%s) and are compiled anew by every process; set NUMBA_CACHE_DIR to a folder "
        "that may be written",
        reason,
    )


def cache_folder(kernel: Any = None) -> str | None:
    """Where a kernel is kept once it is compiled, by default one of this file's package; None: nowhere."""
    if not CACHE:
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
            "vibgym: compiling kernels, once for this processor: the first step takes %s (%s)", FIRST_STEP, kept
        )

    def on_end(self, event: Any) -> None:
        pass


event.register("numba:compile", _Announcer())
