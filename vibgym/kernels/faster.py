"""Faster forms of functions of numba that take most of a compilation, in force while kernels compile (:func:`faster`).

numba's compiler is Python code. For our kernels a third of its time is repeated work: which variables a statement uses, which
implementation an operator has for given types, the lifetimes of variables after every pass although only the last one needs
them. The forms here return the same results, so the LLVM code is the same (``tests/kernels/test_helpers.py``).
"""

from __future__ import annotations

import contextlib
import functools
import importlib.util
import sys
from collections.abc import Iterator
from typing import Any

from numba.core import base, compiler_machinery, cpu, errors, ir, postproc, targetconfig, transforms
from numba.core.types import functions

# -- variables of a statement --------------------------------------------------------------------------------------------


def _variables(values: Any, found: list[Any]) -> list[Any]:
    """Append the variables among the values, also in instructions and containers, to the list; return it."""
    for value in values:
        kind = type(value)
        if kind is ir.Var:
            found.append(value)
        elif kind is ir.Loc or kind is str:
            continue
        elif kind is tuple or kind is list:
            _variables(value, found)
        elif kind is dict:
            _variables(value.values(), found)
        elif isinstance(value, ir.Inst):
            found += value.list_vars()
    return found


def _statement_variables(self: Any) -> list[Any]:
    return _variables(self.__dict__.values(), [])


def _expression_variables(self: Any) -> list[Any]:
    return _variables(self._kws.values(), [])


# -- lifetimes -----------------------------------------------------------------------------------------------------------

_process = postproc.PostProcessor.run


def _process_lazily(self: Any, emit_dels: bool = False, extend_lifetimes: bool = False) -> None:
    """Compute lifetimes on use, and without the variables at the start of each block, which only generators need."""
    if self.func_ir.is_generator:
        _process(self, emit_dels, extend_lifetimes)
        return
    self.func_ir.blocks = transforms.canonicalize_cfg(self.func_ir.blocks)
    self.func_ir.variable_lifetime = postproc.VariableLifetime(self.func_ir.blocks)
    self.func_ir.generator_info = None
    if emit_dels:
        self._insert_var_dels(extend_lifetimes=extend_lifetimes)


# -- results that are asked for again ------------------------------------------------------------------------------------

_resolve = functions.BaseFunction.get_call_type
_resolved: dict[Any, dict[Any, Any]] = {}


def _resolve_once(self: Any, context: Any, args: Any, kws: Any) -> Any:
    """Resolve a call of a function of numba for types of arguments, once for each set of compiler flags."""
    if kws:
        return _resolve(self, context, args, kws)
    flags = targetconfig.ConfigStack.top_or_none()
    known = _resolved.setdefault(repr(sorted(flags._values.items(), key=repr)) if flags else "", {})
    key = self, tuple(args)
    if key not in known:
        try:
            signature = _resolve(self, context, args, kws)
            known[key] = signature, self.get_impl_key(signature)
        except errors.TypingError as error:
            known[key] = error, None
    found, implementation = known[key]
    if isinstance(found, errors.TypingError):
        raise found.with_traceback(None)
    self._impl_keys[found.args] = implementation
    return found


_size = base.BaseContext.get_abi_sizeof
_sizes: dict[str, int] = {}


def _size_once(self: Any, kind: Any) -> int:
    name = str(kind)
    if name not in _sizes:
        _sizes[name] = _size(self, kind)
    return _sizes[name]


def _loaded(self: Any) -> None:
    """Add what the registries have new; numba would also import them again, and look for extensions."""
    for registry in tuple(self._registries):
        self.install_registry(registry)


def _find_blas() -> None:
    """Raise ImportError without scipy; numba would import scipy.linalg here, which kernels do not need."""
    if importlib.util.find_spec("scipy") is None:
        raise ImportError("scipy is required for linear algebra")


def _load_array_functions() -> None:
    """Import numba's module that asks for BLAS; functions that use BLAS ask again."""
    if "numba.np.arraymath" not in sys.modules:
        from numba.np import linalg

        before, linalg.ensure_blas = linalg.ensure_blas, _find_blas
        try:
            importlib.import_module("numba.np.arraymath")
        finally:
            linalg.ensure_blas = before


# -- passes --------------------------------------------------------------------------------------------------------------


_NEEDLESS = {
    "WithLifting", "InlineClosureLikes", "MakeFunctionToJitFunction", "FindLiterallyCalls", "LiteralUnroll",
    "LiteralPropagationSubPipelinePass", "NopythonRewrites", "DumpParforDiagnostics",
}  # fmt: skip
"""Passes for closures, comprehensions, array expressions and literals, which change nothing in kernels without arrays."""


class Passes(compiler_machinery.PassManager):
    """Compiler passes in order, without the events, timings and checks of each."""

    @classmethod
    def of(cls, passes: Any, allocating: bool) -> Any:
        """Return the same passes; those of a kernel that allocates no arrays without the ones for arrays and closures."""
        made = cls(passes.pipeline_name)
        made.passes = [each for each in passes.passes if allocating or each[0].__name__ not in _NEEDLESS]
        made.finalize()
        return made

    def _runPass(self, index: int, pss: Any, internal_state: Any) -> None:
        pss.analysis = self._analysis
        changed = pss.run_initialization(internal_state)
        changed |= pss.run_pass(internal_state)
        changed |= pss.run_finalizer(internal_state)
        if compiler_machinery._pass_registry.get(pss.__class__).mutates_CFG:
            if changed:
                postproc.PostProcessor(internal_state.func_ir).run()
            else:
                internal_state.func_ir.blocks = transforms.canonicalize_cfg(internal_state.func_ir.blocks)


_REPLACED = (
    (ir.Stmt, "list_vars", _statement_variables),
    (ir.Expr, "list_vars", _expression_variables),
    (postproc.PostProcessor, "run", _process_lazily),
    (functions.BaseFunction, "get_call_type", _resolve_once),
    (base.BaseContext, "get_abi_sizeof", _size_once),
    (base, "_has_loc", functools.cache(base._has_loc)),
    (cpu.CPUContext, "load_additional_registries", _loaded),
)


@contextlib.contextmanager
def faster(target_context: Any) -> Iterator[None]:
    """Replace functions of numba while the calling thread holds its compiler lock."""
    if cpu.CPUContext.load_additional_registries is _loaded:  # a kernel that another one calls
        yield
        return
    _load_array_functions()
    target_context.refresh()
    before = [getattr(owner, name) for owner, name, _ in _REPLACED]
    try:
        for owner, name, new in _REPLACED:
            setattr(owner, name, new)
        yield
    finally:
        for (owner, name, _), old in zip(_REPLACED, before):
            setattr(owner, name, old)
