"""Import of the package, and plug-ins of registries by entry points."""

import subprocess
import sys
from collections import OrderedDict
from importlib import metadata

import pytest

import vibgym
from vibgym import registry
from vibgym.registry import Registry

IMPORTS = """
import sys, threading
import gymnasium, numba

HEAVY = (
    "torch", "matplotlib", "pygame", "stable_baselines3", "scipy", "pandas", "PIL", "jinja2", "tensorboard", "safetensors",
    "tqdm", "rich", "vibgym.hardware", "vibgym.identification", "vibgym.plugins",
)
before = {name for name in HEAVY if name in sys.modules}
import vibgym

assert threading.active_count() == 1
from vibgym import registry

registry._entry_points = lambda group: sys.exit("entry points are read")
import vibgym.fields, vibgym.config, vibgym.tasks, vibgym.envs, vibgym.policies.task_info, vibgym.policies.registry

print("imported", file=sys.stderr)
gymnasium.make("vibgym/Align-v0", sensor="pose").reset(seed=0)
print({name for name in HEAVY if name in sys.modules} - before)
"""

EXPECTED = "vibgym: compiling kernels", "vibgym: VIBGYM_PLAIN_NUMBA is set"
"""Beginnings of lines on stderr at the first reset."""


def test_imports_and_environments_need_no_extra_no_plug_in_and_no_thread():
    done = subprocess.run([sys.executable, "-W", "error", "-c", IMPORTS], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (0, "set()\n"), done.stderr
    first, *later = done.stderr.splitlines()
    assert first == "imported" and all(line.startswith(EXPECTED) for line in later)


def test_public_names_exist_and_have_docstrings():
    assert set(vibgym.__all__) >= {"Part", "Simulator", "Surface"}
    assert all(getattr(vibgym, name).__doc__ for name in vibgym.__all__)


def test_plug_ins_are_listed_and_imported_on_use(monkeypatch):
    """Of a package with three entry points, one of which cannot be imported."""
    group = "vibgym.test"
    targets = {"ordered": "collections:OrderedDict", "broken": "no_such_package:Thing", "own": "collections:Counter"}
    points = [metadata.EntryPoint(name, target, group) for name, target in targets.items()]
    monkeypatch.setattr(metadata, "entry_points", lambda group: [point for point in points if point.group == group])
    names = Registry("thing", {"own": dict}, group)
    try:
        assert list(names) == ["own", "ordered", "broken"] and len(names) == 3
        assert names["own"] is dict, "an entry point replaces nothing"
        assert names.choose("thing", "ordered") is OrderedDict
        for refuse, reason in (
            (lambda: names.choose("thing", "broken"), "no_such_package"),
            (lambda: names.choose("thing", "order"), "ordered"),
            (lambda: names.register("ordered", dict), "ordered"),
            (lambda: names.register("two words", dict), "two words"),
            (lambda: names.register("four", 4), "thing"),
        ):
            with pytest.raises(ValueError, match=reason):
                refuse()
        assert "ordered" not in Registry("thing", {"own": dict})
    finally:
        registry._entry_points.cache_clear()
