"""Only ``vibgym/kernels`` uses numba's private interfaces, and its plain mode uses none."""

import ast
from pathlib import Path

import pytest

import vibgym

ROOT = Path(vibgym.__file__).parents[1]
PRIVATE = ("numba.core", "numba.np", "numba.extending", "llvmlite")
PLAIN = ("jit", "options", "plain", "reference", "sources", "vector")


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
    files = [file for file in (ROOT / package).rglob("*.py") if "kernels" not in file.parts]
    assert len(files) > 20
    assert {str(file): found for file in files if (found := private_names(file))} == {}


def test_plain_mode_uses_no_private_interfaces():
    folder = ROOT / "vibgym" / "kernels"
    assert {name: private_names(folder / f"{name}.py") for name in PLAIN} == {name: [] for name in PLAIN}
    assert private_names(folder / "compiler.py") and private_names(folder / "pointers.py")  # the check detects them
    listed = (ROOT / "docs" / "numba.md").read_text(encoding="utf-8")
    for file in folder.glob("*.py"):
        assert not private_names(file) or f"`{file.name}`" in listed, file.name
