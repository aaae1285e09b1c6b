"""Three modules use more of numba than ``njit``, and one of them undocumented interfaces."""

import ast
from pathlib import Path

import vibgym

ROOT = Path(vibgym.__file__).parents[1]
PACKAGES = ("vibgym", "agents", "studies")
PRIVATE = ("numba.core", "numba.np", "numba.extending", "llvmlite")
DOCUMENTED = {
    "llvmlite.binding", "llvmlite.ir", "numba.core.cgutils", "numba.core.imputils.impl_ret_borrowed",
    "numba.core.typing.templates.AttributeTemplate",
    *(f"numba.extending.{name}" for name in (
        "infer_getattr", "intrinsic", "lower_builtin", "lower_cast", "lower_getattr_generic", "models", "register_model",
        "type_callable",
    )),
}  # fmt: skip
"""What numba's and llvmlite's manuals describe, and two helpers for attributes that they do not."""


def private_names(file):
    """Return the private names that a file imports, or accesses through ``numba``."""
    tree, names = ast.parse(file.read_text(encoding="utf-8")), []
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            names += [name.name for name in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"{node.module}.{name.name}" for name in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            names.append(f"{node.value.id}.{node.attr}")
    return [name for name in names if any(name == private or name.startswith(f"{private}.") for private in PRIVATE)]


def test_one_module_uses_undocumented_interfaces():
    kernels = ROOT / "vibgym" / "kernels"
    files = {file: private_names(file) for package in PACKAGES for file in (ROOT / package).rglob("*.py")}
    assert {file.stem for file, names in files.items() if names} == {"linking", "pointers", "vec8"}
    assert {file for file, names in files.items() if set(names) - DOCUMENTED} == {kernels / "linking.py"}
