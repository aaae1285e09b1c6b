"""How kernels are compiled, decided at import.

====================  ================================================================================================
``PRIVATE``           by :mod:`vibgym.kernels.compiler`, which needs numba's private interfaces: fastest compilation, kernels in
                      wheels
``PUBLIC``            by ``numba.njit`` (:mod:`vibgym.kernels.public`): up to 4 % slower, compiles four to six times as long
``INTERPRETED``       not compiled (:mod:`vibgym.kernels.interpreted`): slow, for a debugger; ``NUMBA_DISABLE_JIT=1``
====================  ================================================================================================

The second is chosen with ``VIBGYM_PLAIN_NUMBA=1``, and where the installed numba is not among those tested or lacks an
interface; a warning then names the reason. ``VIBGYM_PLAIN_NUMBA=0`` tries the private interfaces of an untested numba.
"""

from __future__ import annotations

import functools
import importlib
import logging
import os
from typing import Any

import numba

PRIVATE, PUBLIC, INTERPRETED = "private", "public", "interpreted"

SWITCH = "VIBGYM_PLAIN_NUMBA"

TESTED = (0, 61), (0, 68)
"""First and last version of numba whose private interfaces have been tested."""

NEEDED = {
    "numba.core.base": ("BaseContext.get_abi_sizeof", "_has_loc"),
    "numba.core.caching": (
        "CompileResultCacheImpl.reduce", "CompileResultCacheImpl.rebuild", "FunctionCache._index_key",
        "FunctionCache.load_overload", "FunctionCache.save_overload", "IndexDataCacheFile._data_path",
        "IndexDataCacheFile._dump", "IndexDataCacheFile._load_data", "IndexDataCacheFile._load_index",
        "IndexDataCacheFile.load", "IndexDataCacheFile.save",
    ),
    "numba.core.codegen": (
        "JITCPUCodegen._get_host_cpu_features", "JITCPUCodegen._get_host_cpu_name", "JITCPUCodegen._module_pass_manager",
        "JITCodeLibrary._finalize_final_module", "JITCodeLibrary._get_compiled_object",
        "JITCodeLibrary._optimize_final_module", "JITCodeLibrary._optimize_functions",
        "JITCodeLibrary._set_compiled_object", "JITCodeLibrary.enable_object_caching", "JITCodeLibrary.finalize",
        "JITCodeLibrary.serialize_using_object_code",
    ),
    "numba.core.compiler": ("CompileResult._rebuild", "Compiler.define_pipelines", "compile_result"),
    "numba.core.compiler_lock": ("global_compiler_lock.acquire", "global_compiler_lock.release"),
    "numba.core.compiler_machinery": ("PassManager._runPass", "_pass_registry.get"),
    "numba.core.cpu": ("CPUContext.load_additional_registries",),
    "numba.core.funcdesc": ("FunctionDescriptor",),
    "numba.core.ir": ("Expr.list_vars", "Stmt.list_vars"),
    "numba.core.postproc": ("PostProcessor._insert_var_dels", "PostProcessor.run", "VariableLifetime"),
    "numba.core.registry": (
        "CPUDispatcher.add_overload", "CPUDispatcher.compile", "CPUDispatcher.enable_caching",
        "CPUDispatcher.get_call_template",
    ),
    "numba.core.serialize": ("dumps",),
    "numba.core.targetconfig": ("ConfigStack.top_or_none",),
    "numba.core.transforms": ("canonicalize_cfg",),
    "numba.core.types.functions": ("BaseFunction.get_call_type",),
    "llvmlite.binding": ("add_symbol", "ffi.lib._lock._lock.acquire", "get_process_triple", "parse_bitcode"),
}  # fmt: skip
"""Private names by module."""


def missing(needed: dict[str, tuple[str, ...]] = NEEDED) -> list[str]:
    """Return the names that the installed numba and llvmlite lack."""
    lacking = []
    for module, names in needed.items():
        try:
            found: Any = importlib.import_module(module)
        except ImportError:
            lacking.append(module)
            continue
        for name in names:
            try:
                functools.reduce(getattr, name.split("."), found)
            except AttributeError:
                lacking.append(f"{module}.{name}")
    return lacking


def decide() -> tuple[str, str]:
    """Return how kernels are compiled, and why not by the private interfaces."""
    asked = os.environ.get(SWITCH, "")
    if numba.config.DISABLE_JIT:  # type: ignore[attr-defined]
        return INTERPRETED, "NUMBA_DISABLE_JIT is set"
    if asked not in ("", "0"):
        return PUBLIC, f"{SWITCH} is set"
    if not asked and not TESTED[0] <= numba.version_info.short <= TESTED[1]:  # type: ignore[attr-defined]
        return PUBLIC, f"numba {numba.__version__} is untested; {SWITCH}=0 tries its private interfaces"
    lacking = missing()
    if lacking:
        return PUBLIC, f"numba {numba.__version__} lacks {', '.join(lacking)}"
    return PRIVATE, ""


MODE, REASON = decide()

if MODE == PUBLIC:
    logging.getLogger("vibgym").warning(
        "vibgym: %s: kernels are compiled by numba's public interface, which takes four to six times as long, once",
        REASON,
    )
elif MODE == INTERPRETED:
    logging.getLogger("vibgym").warning("vibgym: %s: kernels are not compiled, and slow", REASON)
