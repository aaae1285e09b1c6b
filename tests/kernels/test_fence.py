"""Three modules use more of numba than ``njit``, and one of them undocumented interfaces."""

import ast
from pathlib import Path

import pytest

import vibgym

ROOT = Path(vibgym.__file__).parents[1]
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
            names += [each.name for each in node.names]
        elif isinstance(node, ast.ImportFrom) and node.module:
            names += [f"{node.module}.{each.name}" for each in node.names]
        elif isinstance(node, ast.Attribute) and isinstance(node.value, ast.Name):
            names.append(f"{node.value.id}.{node.attr}")
    return [name for name in names if any(name == each or name.startswith(f"{each}.") for each in PRIVATE)]


@pytest.mark.parametrize("package", ["vibgym", "agents", "studies"])
def test_no_other_package_uses_private_interfaces(package):
    files = [file for file in (ROOT / package).rglob("*.py") if "kernels" not in file.relative_to(ROOT).parts]
    assert len(files) > 20
    assert {str(file): found for file in files if (found := private_names(file))} == {}


def test_one_module_uses_undocumented_interfaces():
    folder = ROOT / "vibgym" / "kernels"
    found = {file.stem: private_names(file) for file in folder.glob("*.py")}
    assert {name for name, names in found.items() if names} == {"linking", "pointers", "vec8"}
    assert {name for name, names in found.items() if set(names) - DOCUMENTED} == {"linking"}
    listed = (ROOT / "docs" / "numba.md").read_text(encoding="utf-8")
    assert all(name in listed for name in ("linking.py", "pointers.py", "vec8.py"))
