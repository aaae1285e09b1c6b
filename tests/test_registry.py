"""Registries: built-in and user-defined names, and plug-ins by entry points."""

import subprocess
import sys
from importlib import metadata

import pytest

from vibgym import registry
from vibgym.registry import Registry

GROUP = "vibgym.test"


@pytest.fixture
def installed(monkeypatch):
    """A plug-in package with three entry points, one of which cannot be imported."""
    points = [
        metadata.EntryPoint("ordered", "collections:OrderedDict", GROUP),
        metadata.EntryPoint("broken", "no_such_package:Thing", GROUP),
        metadata.EntryPoint("own", "collections:Counter", GROUP),
    ]
    monkeypatch.setattr(metadata, "entry_points", lambda group: [each for each in points if each.group == group])
    registry._entry_points.cache_clear()
    yield
    registry._entry_points.cache_clear()


def test_plug_ins_are_listed_and_imported_on_use(installed):
    from collections import OrderedDict

    names = Registry("thing", {"own": dict}, GROUP)
    assert list(names) == ["own", "ordered", "broken"] and len(names) == 3
    assert names["own"] is dict, "an entry point replaces nothing"
    assert names.choose("thing", "ordered") is OrderedDict
    with pytest.raises(ValueError, match="no_such_package"):
        names.choose("thing", "broken")
    with pytest.raises(ValueError, match="ordered"):
        names.choose("thing", "order")
    with pytest.raises(ValueError, match="ordered"):
        names.register("ordered", dict)
    assert "ordered" not in Registry("thing", {"own": dict})


def test_environments_without_plug_ins_read_no_metadata_and_import_none():
    code = """
import sys
import gymnasium
import vibgym
from vibgym import registry

registry._entry_points = lambda group: sys.exit("entry points are read")
gymnasium.make("vibgym/Align-v0", sensor="pose")
assert not [name for name in sys.modules if name.startswith("vibgym.plugins")]
"""
    subprocess.run([sys.executable, "-c", code], check=True)
