"""What leans on numba's private parts stays in ``vibgym/kernels``, and its plain mode leans on none."""

import ast
from pathlib import Path

import pytest

import vibgym

ROOT = Path(vibgym.__file__).parents[1]
PRIVATE = ("numba.core", "numba.np", "numba.extending", "llvmlite")
PLAIN = ("foreign", "jit", "one_lane", "options", "plain", "reference", "sources", "vector")


def private_parts(file):
    """Private names that a file imports, or reaches through ``numba``."""
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
def test_nothing_else_leans_on_private_parts(package):
    files = [file for file in (ROOT / package).rglob("*.py") if "kernels" not in file.parts]
    assert len(files) > 20
    assert {str(file): found for file in files if (found := private_parts(file))} == {}


def test_the_plain_mode_leans_on_none():
    folder = ROOT / "vibgym" / "kernels"
    assert {name: private_parts(folder / f"{name}.py") for name in PLAIN} == {name: [] for name in PLAIN}
    assert private_parts(folder / "compiler.py") and private_parts(folder / "by_reference.py")  # so it would be seen
    listed = (ROOT / "docs" / "numba.md").read_text(encoding="utf-8")
    for file in folder.glob("*.py"):
        assert not private_parts(file) or f"`{file.name}`" in listed, file.name
