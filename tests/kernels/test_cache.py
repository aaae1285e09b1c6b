"""The cache of compiled kernels: invalidation by changed sources, damaged files, missing folders, announcement."""

import importlib.util
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import pytest

import vibgym
from vibgym.kernels import cache, jit

ROOT = Path(vibgym.__file__).parent

PROBE = """
import sys; sys.path.insert(0, {folder!r})
import numpy as np, vibgym
assert vibgym.__file__.startswith({folder!r})
from vibgym.physics.core.drive import all_phasors, field_drive
from vibgym.physics.contacts.hulls import wall_gap
phasors = np.zeros((1, 2, 2, 2))
{between}
all_phasors(field_drive(np.ones((1, 6), np.float32), np.zeros((1, 1, 2)), 0.026, 0.05, 10.0), phasors)
all_phasors(field_drive(np.ones((1, 6), np.float32), np.zeros((1, 1, 2)), 0.026, 0.05, 10.0), phasors)
print(float(phasors.sum()))
"""


@pytest.fixture
def run(tmp_path):
    """Return a copy of the package, and a function that runs the probe with it and returns its result and lines on stderr."""
    package = tmp_path / "vibgym"
    shutil.copytree(ROOT, package, ignore=shutil.ignore_patterns("__pycache__"))

    def once(between="", **more):
        environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONDONTWRITEBYTECODE": "1", **more}
        code = PROBE.format(folder=str(tmp_path), between=between)
        done = subprocess.run(
            [sys.executable, "-c", code], text=True, env=environment, cwd=tmp_path, capture_output=True, check=True
        )
        return float(done.stdout), done.stderr.splitlines()

    return package, once


def test_kernels_are_compiled_and_announced_once_until_a_callee_changes(run):
    package, once = run
    for path in package.rglob("*.py"):  # as those of image builds and of shared folders, whose clocks may be ahead
        os.utime(path, (time.time() + 86_400,) * 2)
    first, lines = once()
    assert len(lines) == 1
    assert "compiling kernels" in lines[0] and str(package.parent / "cache") in lines[0]
    cached = {path.name for path in (package.parent / "cache").rglob("*.nbc")}
    assert len(cached) == 1 and once() == (first, [])
    for path in package.rglob("*.py"):  # as a checkout does
        path.touch()
    assert once() == (first, [])
    assert {path.name for path in (package.parent / "cache").rglob("*.nbc")} == cached
    file = package / "physics" / "core" / "drive.py"
    text = file.read_text()
    result = "return first * scale, second * scale"
    assert text.count(result) == 1
    file.write_text(text.replace(result, "return 2.0 * first * scale, second * scale"))
    assert abs(once()[0] - first) > 1e-6


def test_a_file_that_is_edited_after_its_import(run):
    """The next process must not load the kernel that was compiled from the text before."""
    package, once = run
    file = package / "physics" / "core" / "drive.py"
    edit = f"""
import pathlib; file = pathlib.Path({str(file)!r})
file.write_text(file.read_text().replace("return first * scale, second", "return 2.0 * first * scale, second"))"""
    first, _ = once(between=edit)
    assert abs(once()[0] - first) > 1e-6


def test_all_direct_and_indirect_imports_count(tmp_path):
    """Constants of other files are compiled into kernels."""
    folder = tmp_path / "mine"
    folder.mkdir()
    texts = {
        "__init__": "", "a": "from mine.b import X\nfrom vibgym.physics.core.drive import FIELD\n",
        "b": "from mine.c import X\n", "c": "X = 1\n", "d": "from mine.a import X\n",
    }  # fmt: skip
    for name, text in texts.items():
        (folder / f"{name}.py").write_text(text)

    def stamp():
        for cached in (cache.sources, cache._imports, cache._digest):
            cached.cache_clear()
        return cache.sources(str(folder / "a.py"), "mine.a")

    first = stamp()
    (folder / "d.py").write_text("X = 2\n")
    assert stamp() == first
    (folder / "c.py").write_text("X = 2\n")
    assert stamp() != first


def test_without_a_cache(run):
    package, once = run
    for _ in range(2):
        (line,) = once(VIBGYM_CACHE="0")[1]
        assert "compiling kernels" in line and "not kept" in line
    assert not (package.parent / "cache").exists()


@pytest.mark.parametrize("kind, damage", [
    ("*.nbc", lambda content: content[: len(content) // 2]), ("*.nbc", lambda content: b""),
    ("*.nbc", lambda content: content[:500] + bytes(40) + content[540:]), ("*.nbi", lambda content: content[:60]),
    ("*.nbi", lambda content: b"\x80garbage"), ("*.nb[ci]", lambda content: content[:60]),
], ids=["half", "empty", "other bytes", "half index", "garbage index", "both"])  # fmt: skip
def test_a_damaged_cache_is_rebuilt_with_one_warning(tmp_path, monkeypatch, caplog, kind, damage):
    monkeypatch.setattr(jit.config, "CACHE_DIR", str(tmp_path / "cache"))
    (tmp_path / "mine.py").write_text(
        "from vibgym.kernels.jit import jit\n\n\n@jit\ndef twice(x):\n    return 2.0 * x\n"
    )

    def once():
        """Return the result, the cache hits and the messages, as in a new process."""
        caplog.clear()
        spec = importlib.util.spec_from_file_location("mine", tmp_path / "mine.py")
        module = importlib.util.module_from_spec(spec)
        spec.loader.exec_module(module)
        result = module.twice(3.0)
        return result, sum(module.twice.stats.cache_hits.values()), [record.getMessage() for record in caplog.records]

    assert once()[:2] == (6.0, 0) and once() == (6.0, 1, [])
    for path in (tmp_path / "cache").rglob(kind):
        path.write_bytes(damage(path.read_bytes()))
    *again, lines = once()
    assert again == [6.0, 0]
    (line,) = (other for other in lines if "compiling" not in other)
    assert "damaged" in line and str(tmp_path / "cache") in line
    assert once() == (6.0, 1, [])


def test_without_a_writable_folder(run):
    """A warning instead of numba's RuntimeError ("no locator available")."""
    package, once = run
    for folder in (package, *(path for path in package.rglob("*") if path.is_dir())):
        (folder / "__pycache__").write_text("a file where a folder should be")
    nowhere = str(package.parent / "file")
    Path(nowhere).write_text("")
    first, lines = once(NUMBA_CACHE_DIR=f"{nowhere}/cache", XDG_CACHE_HOME=nowhere, HOME=nowhere)
    assert [("cannot be kept" in line, "compiling kernels" in line) for line in lines] == [(True, False), (False, True)]
    assert "NUMBA_CACHE_DIR" in lines[0] and "not kept" in lines[1]
    assert first == once()[0]


TOGETHER = """
import itertools, sys, threading, time
sys.path.insert(0, {folder!r})
from vibgym.kernels import linking
from mine import double
files, turn = linking._Files, itertools.count(1)
linking._Files = lambda *arguments, **more: (time.sleep(0.3 * next(turn)), files(*arguments, **more))[1]
threads = [threading.Thread(target=double, args=(1.0,)) for _ in range(int(sys.argv[1]))]
for thread in threads:
    thread.start()
for thread in threads:
    thread.join()
print(sum(double.stats.cache_hits.values()), sum(double.stats.cache_misses.values()))
"""


def test_threads_that_load_a_kernel_concurrently(tmp_path):
    """The second thread must not read the cache before the first has set its version."""
    (tmp_path / "mine.py").write_text(
        "from vibgym.kernels.jit import jit\n\n\n@jit\ndef double(x):\n    return 2.0 * x\n"
    )
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": str(ROOT.parent)}

    def run_threads(number):
        command = [sys.executable, "-c", TOGETHER.format(folder=str(tmp_path)), str(number)]
        return subprocess.run(command, text=True, env=environment, capture_output=True, check=True).stdout.split()

    assert run_threads(1) == ["0", "1"]
    hits, misses = run_threads(4)
    assert misses == "0" and int(hits) > 0
