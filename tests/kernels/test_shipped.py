"""Kernels in the wheel: same bits as compiled ones, on any processor; unusable files are reported."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

import vibgym
from vibgym.kernels import cache

KERNELS = """
import numpy as np
from vibgym.kernels.jit import borrowing, jit

@borrowing
def root(x):
    return np.sqrt(x) + 1.0 / x

@jit
def total(values):
    result = 0.0
    for each in values:
        result += root(each)
    return result
"""

PROBE = """
import json, os, sys
from pathlib import Path
from vibgym.kernels import cache, libraries
cache.SHIPPED = Path({folder!r})
{before}
import numpy as np
from mine import total
values = np.linspace(1.0, 2.0, 1001)
found = total(values)
print(float(found).hex(), sum(total.stats.cache_misses.values()))
{after}
"""

FORK = """
import multiprocessing, threading, time
begun, optimise = threading.Event(), libraries._optimise
def slow(*arguments, **more):
    begun.set()
    time.sleep(0.3)
    optimise(*arguments, **more)
libraries._optimise = slow
def child():
    os._exit(0 if total(values.astype(np.float32)) > 0.0 else 1)
thread = threading.Thread(target=total, args=(values.astype(np.float32),))
thread.start()
begun.wait()
process = multiprocessing.get_context("fork").Process(target=child)
process.start()
process.join(60)
print(process.exitcode)
process.kill()
"""


class Runner:
    """Runs the probe in new processes, with the kernels in a folder."""

    def __init__(self, folder):
        self.folder = folder
        (folder / "mine.py").write_text(KERNELS)

    def start(self, before="", after="", cache="cache", **more):
        paths = [str(self.folder), str(Path(vibgym.__file__).parents[1])]
        environment = {"NUMBA_CACHE_DIR": str(self.folder / cache), "PYTHONPATH": os.pathsep.join(paths), **more}
        code = PROBE.format(folder=str(self.folder / "shipped"), before=before, after=after)
        pipes = {"stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
        return subprocess.Popen([sys.executable, "-c", code], text=True, env={**os.environ, **environment}, **pipes)

    def finish(self, process):
        output, errors = process.communicate(timeout=120)
        assert process.returncode == 0, errors
        return output.split(), errors.splitlines()

    def __call__(self, *arguments, **more):
        """Return the words that the probe prints, and the lines on stderr."""
        return self.finish(self.start(*arguments, **more))


COLLECT = "cache.collect(cache.SHIPPED)"


@pytest.fixture(scope="module")
def compiled(tmp_path_factory):
    """Return a folder with the kernel as wheels contain it, and the compiled kernel's result."""
    run = Runner(tmp_path_factory.mktemp("first"))
    (number, misses), _ = run(COLLECT)
    assert misses == "1"
    return run.folder, number


@pytest.fixture
def run(compiled, tmp_path):
    shutil.copytree(compiled[0] / "shipped", tmp_path / "shipped")
    return Runner(tmp_path)


def test_shipped_and_compiled_kernels_have_the_same_bits(run, compiled):
    ready = [compiled[1], "0"], []
    assert run() == ready
    (file,) = run.folder.glob("shipped/total-*")
    file.unlink()
    assert run(COLLECT) == ready  # from the cache, which contains the bitcode, too
    shutil.rmtree(run.folder / "cache")
    assert file.exists() and run() == ready


def test_any_processor_of_the_platform(run):
    """x86-64 without AVX: the result of a kernel compiled for it."""
    processor = {"NUMBA_CPU_NAME": "generic", "NUMBA_CPU_FEATURES": ""}
    found, lines = run(**processor)
    assert found[1] == "0" and lines == []
    shutil.rmtree(run.folder / "shipped")
    assert run(**processor, cache="other")[0] == [found[0], "1"]


def test_bitcode_of_another_version_is_reported(run):
    (file,) = run.folder.glob("shipped/versions-*")
    file.write_text(file.read_text().replace(cache.VERSIONS["numba"], "0.1"))
    for kernel in run.folder.glob("shipped/total-*"):
        kernel.unlink()
    found, (line,) = run()
    assert found[1] == "1" and "compiling" in line
    assert f"target numba 0.1, this is numba {cache.VERSIONS['numba']}" in line


@pytest.mark.parametrize("damage", [
    lambda content: content[:1000], lambda content: b"", lambda content: content[:-40] + bytes(40),
    lambda content: cache.with_digest((("total", b"BC\xc0\xde garbage"), *cache.checked(content)[1:])),
], ids=["cut", "empty", "other bytes", "not LLVM's"])  # fmt: skip
def test_damaged_bitcode_is_reported_and_compiled(run, compiled, damage, monkeypatch):
    monkeypatch.syspath_prepend(run.folder)
    (file,) = run.folder.glob("shipped/total-*")
    file.write_bytes(damage(file.read_bytes()))
    found, (line, other) = run()
    assert found == [compiled[1], "1"] and str(file) in line and "damaged" in line and "compiling" in other


def test_without_a_cache_every_process_optimises_the_bitcode(run, compiled):
    (run.folder / "cache").write_text("a file where a folder should be")
    (run.folder / "__pycache__").write_text("")
    nowhere = {"XDG_CACHE_HOME": str(run.folder / "cache"), "HOME": str(run.folder / "cache")}
    found, (line,) = run(cache="cache/in/it", **nowhere)
    assert found == [compiled[1], "0"] and "cannot be kept" in line
    assert run(cache="cache/in/it", VIBGYM_CACHE="0") == ([compiled[1], "0"], [])


def test_concurrent_processes(run, compiled):
    for each in [run.start() for _ in range(3)]:
        assert run.finish(each) == ([compiled[1], "0"], [])
    (run.folder / "shipped").rename(run.folder / "elsewhere")
    assert run() == ([compiled[1], "0"], []) and not list(run.folder.glob("cache/**/*.tmp.*"))


def test_a_fork_waits_for_the_kernel_that_another_thread_compiles(run):
    assert run(after=FORK)[0][2] == "0"


def test_a_file_replaced_by_another_process_counts_as_missing(tmp_path):
    """Two processes that add to an index at the same time may choose the same name."""
    files = cache._Files(str(tmp_path), "kernel", "stamp")
    files.save("ours", 1)
    (ours,) = tmp_path.glob("*.nbc")
    files.save("theirs", 2)
    (theirs,) = set(tmp_path.glob("*.nbc")) - {ours}
    assert (files.load("ours"), files.load("theirs")) == (1, 2)
    ours.write_bytes(theirs.read_bytes())
    assert files.load("ours") is None
