"""Plug-ins: the import contract covers the whole core."""

import tomllib
from pathlib import Path

import vibgym

PACKAGE = Path(vibgym.__file__).parent


def test_the_contract_names_every_module_of_the_core():
    settings = tomllib.loads((PACKAGE.parent / "pyproject.toml").read_text(encoding="utf-8"))
    contracts = settings["tool"]["importlinter"]["contracts"]
    (named,) = (each["source_modules"] for each in contracts if each.get("forbidden_modules") == ["vibgym.plugins"])
    modules = {
        path.parent if path.name == "__init__.py" else path.with_suffix("") for path in PACKAGE.glob("*/__init__.py")
    }
    modules |= {path.with_suffix("") for path in PACKAGE.glob("*.py")} - {PACKAGE / "__init__"}
    assert {f"vibgym.{path.name}" for path in modules} - {"vibgym.plugins"} == set(named)
