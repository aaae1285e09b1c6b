"""How kernels are compiled, unless in plain mode.

A kernel looks different to other kernels (:class:`_Called`: typed and written down) and to Python (:class:`_Kernel`: optimised
in one piece with all that it calls); :mod:`vibgym.kernels.libraries` says why.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import logging
import math
import time
from pathlib import Path
from typing import Any

from numba.core import compiler, event, types
from numba.core import config as numba_config
from numba.core.compiler_lock import global_compiler_lock
from numba.core.registry import CPUDispatcher

from vibgym.kernels import forks as forks  # what it registers
from vibgym.kernels import options, shipped
from vibgym.kernels.by_reference import handed_on
from vibgym.kernels.cache import Cache
from vibgym.kernels.libraries import Unfinished, Whole

config: Any = numba_config

LOGGER = logging.getLogger("vibgym")


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
        state.flags.no_cfunc_wrapper = True  # nothing calls kernels by the address of a C function
        state.typingctx = _Typing(state.typingctx)
        state.library = self.library(state.targetctx.codegen(), state.func_id.func_qualname)
        return super().define_pipelines()

    def library(self, maker: Any, name: str) -> Any:
        """Where its code goes."""
        made = Whole(maker, name)
        made.enable_object_caching()
        return made


class _CalledCompiler(_Compiler):
    """Writes a kernel down for the kernels that call it."""

    def define_pipelines(self) -> Any:
        flags: Any = self.state.flags  # type: ignore[attr-defined]
        flags.no_compile = flags.no_cpython_wrapper = True
        return super().define_pipelines()

    def library(self, maker: Any, name: str) -> Any:
        """Where its code goes."""
        return Unfinished(maker, name)


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
        if not self.overloads:
            self.enable_caching()
        collecting = gc.isenabled()
        gc.disable()  # it would go through all of numba's notes again and again
        try:
            return super().compile(sig)
        finally:
            if collecting:
                gc.enable()

    def enable_caching(self) -> None:
        self._cache = Cache(self.py_func, self.imported)


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


def cache_folder() -> str | None:
    """Where kernels are kept once they are compiled, by default in their files' folders; None: nowhere."""
    if not options.CACHE:
        return None
    kernel = jit(cache_folder)
    kernel.enable_caching()
    folder = kernel._cache.cache_path
    return None if folder is None else config.CACHE_DIR or folder


class _Announcer(event.Listener):
    """Listener that warns on stderr when kernels are being compiled, since the first step then takes long.

    With a kernel cache, the warning appears once per state of the sources and versions, not once per process: a marker file in
    the cache folder records it.
    """

    announced = False

    def on_start(self, event: Any) -> None:
        if self.announced or not isinstance(event.data["dispatcher"], _Kernel):
            return
        self.announced = True
        folder, reason = cache_folder(), shipped.reason()
        if folder is not None and _marked(Path(folder), reason):
            return
        kept = "not kept" if folder is None else f"kept in {folder}"
        # A warning, so that it appears without logging configuration and at level WARNING.
        LOGGER.warning(
            "vibgym: %scompiling kernels on first use, %s per kind of scene (%s); python -m vibgym warm compiles all",
            f"{reason}: " if reason else "", options.FIRST_STEP, kept,
        )  # fmt: skip

    def on_end(self, event: Any) -> None:
        pass


def _marked(folder: Path, reason: str) -> bool:
    """Return whether the marker file of this announcement existed; create it if not."""
    package = Path(__file__).parents[1]
    digest = hashlib.sha256(repr((shipped.VERSIONS, reason)).encode())
    for path in sorted(package.rglob("*.py")):
        digest.update(path.read_bytes())
    mark = folder / f"announced-{digest.hexdigest()[:16]}"
    try:
        folder.mkdir(parents=True, exist_ok=True)
        mark.touch(exist_ok=False)
    except FileExistsError:
        return True
    except OSError:
        pass
    return False


event.register("numba:compile", _Announcer())
