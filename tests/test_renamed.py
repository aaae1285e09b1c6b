"""Old names of modules import the new modules, with a warning."""

import importlib
import importlib.util
import sys

import pytest

import vibgym
from vibgym import _renamed


def test_old_name_of_a_package_imports_the_same_modules(monkeypatch):
    monkeypatch.setitem(_renamed.RENAMED, "vibgym.old_scene", "vibgym.scene")
    specification = vibgym.scene.__spec__
    try:
        with pytest.warns(DeprecationWarning, match=r"vibgym\.old_scene\.parts has moved to vibgym\.scene\.parts"):
            old = importlib.import_module("vibgym.old_scene.parts")
        assert old.Part is vibgym.Part and sys.modules["vibgym.old_scene"] is vibgym.scene
        assert vibgym.scene.__spec__ is specification
    finally:
        for name in ("vibgym.old_scene", "vibgym.old_scene.parts"):
            sys.modules.pop(name, None)


@pytest.mark.parametrize("new", _renamed.RENAMED.values())
def test_new_names_exist(new):
    assert importlib.util.find_spec(new) is not None
