"""Processes that compile kernels in parallel, units, and faster functions of numba."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

import vibgym
from vibgym.kernels import helpers

KERNELS = """
import numpy as np
from vibgym.kernels.jit import borrowing, jit, unit

@borrowing
def root(x):
    return np.sqrt(max(x, 0.5)) + 1.0 / x ** 2

@unit
def roots(values, found):
    for k in range(len(values)):
        found[k] = root(values[k])

@unit
def twice(values, found):
    roots(values, found)
    for k in range(len(values)):
        found[k] *= 2.0

@borrowing
def add_roots(values, found):
    roots(values, found)
    twice(found, values)
    return values[0], found[0]

@jit
def total(values):
    found = np.zeros(len(values))
    for k, each in enumerate(values):
        found[k] = 2.0 * each + root(each)
    return found.sum()

@unit
def wrong(values):
    return 1.0
"""

PROBE = """
import os, sys, time
import numpy as np
from vibgym.kernels import cache, helpers, jit
import mine
helpers._helpers = helpers.Helpers({limit})
values, found = np.linspace(1.0, 2.0, 5), np.zeros(5)

def run():
    return [float(each).hex() for each in (*mine.add_roots(values.copy(), found), mine.total(values))]

def misses():
    return sum(sum(each.stats.cache_misses.values()) for each in (mine.add_roots, mine.roots, mine.twice, mine.total))

def done():
    until = time.time() + 60.0
    while helpers.waiting() and time.time() < until:
        time.sleep(0.05)
    return not helpers.waiting()

{code}
"""


@pytest.fixture
def probe(tmp_path):
    """Return a function that runs code with the kernels above in a new process and returns the lines that it prints."""
    (tmp_path / "mine.py").write_text(KERNELS)

    def once(code, limit=1, **more):
        paths = os.pathsep.join([str(tmp_path), str(Path(vibgym.__file__).parents[1])])
        environment = {"NUMBA_CACHE_DIR": str(tmp_path / "cache"), "PYTHONPATH": paths, "PYTHONHASHSEED": "0", **more}
        command = [sys.executable, "-c", PROBE.format(limit=limit, code=code)]
        result = subprocess.run(command, text=True, env={**os.environ, **environment}, capture_output=True, timeout=300)
        assert result.returncode == 0, result.stderr
        return result.stdout.splitlines()

    return once


RESULT = "print(run())"
ANNOUNCE = "jit.prefetch(mine.add_roots, values, found); jit.prefetch(mine.total, values)"


@pytest.fixture
def alone(probe):
    """Return the result without helpers."""
    (found,) = probe(RESULT, limit=0, VIBGYM_CACHE="0")
    return found


def test_helpers_compile_announced_kernels_and_the_units_that_they_call(probe, alone):
    lines = probe(f"{ANNOUNCE}\nprint(done())\n{RESULT}\nprint(misses(), mine.roots.stats.cache_hits)")
    assert lines[:2] == ["True", alone] and lines[2].startswith("0 ")
    assert probe(f"{RESULT}; print(misses())") == [alone, "0"]  # from the cache


def test_units_are_shared_and_compiled_in_the_order_of_calls(probe, alone):
    assert probe(f"{RESULT}\nprint(misses())", limit=0) == [alone, "4"]
    assert probe(f"{ANNOUNCE}\n{RESULT}", VIBGYM_CACHE="0") == [alone]


@pytest.mark.parametrize("harm", [
    "helpers._helpers._processes[0].kill()", "helpers._helpers._processes[0].kill(); done()",
    "helpers._helpers._processes[0].stdin.raw.close()", "sys.executable = 'missing'",
], ids=["killed", "gone", "closed", "missing"])  # fmt: skip
def test_without_the_helper_this_process_compiles(probe, alone, harm):
    before, after = (harm, "") if "missing" in harm else ("", harm)
    assert probe(f"{before}\n{ANNOUNCE}\n{after}\n{RESULT}") == [alone]


def test_errors_of_helpers_are_logged(probe):
    lines = probe(
        "import logging\nlogging.basicConfig(level=10, stream=sys.stdout)\njit.prefetch(mine.wrong, values)\ndone()"
    )
    assert any("a helper could not compile mine.wrong" in each for each in lines)
    assert any("units return nothing" in each for each in lines)


@pytest.mark.skipif(not hasattr(os, "fork"), reason="fork")
def test_a_forked_process_leaves_the_helpers_to_its_parent(probe, alone):
    fork = "child = os.fork()\nif child == 0:\n    print(run(), flush=True)\n    os._exit(0)\nos.waitpid(child, 0)"
    assert probe(f"{ANNOUNCE}\n{fork}\n{RESULT}") == [alone, alone]


def test_helpers_end_with_this_process(probe):
    (number,) = probe(f"{ANNOUNCE}\nprint(helpers._helpers._processes[0].pid, flush=True)\nos.kill(os.getpid(), 0)")
    if Path("/proc").is_dir():
        status = Path(f"/proc/{number}/status")
        assert not status.exists() or "zombie" in status.read_text()


def test_units_return_nothing(probe):
    code = (
        "try:\n    mine.wrong.compile((mine.wrong.typeof_pyval(values),))\nexcept TypeError as error:\n    print(error)"
    )
    (line,) = probe(code)
    assert "units return nothing" in line


IR = """
import contextlib, hashlib, re
from vibgym.kernels import compiler, libraries
if {slow}:
    compiler.faster, compiler.Passes.of = lambda _: contextlib.nullcontext(), classmethod(lambda _, passes, **__: passes)
texts, read = {{}}, libraries.LinkedLibrary._read
def note(self, bitcode):
    read(self, bitcode)
    text = re.sub("numba.dynamic.globals.[0-9a-f]+", "", str(self._final_module))
    texts[self.name] = hashlib.sha256(re.sub(r"v\\\\d+(?=B\\\\d+c)", "", text).encode()).hexdigest()
libraries.LinkedLibrary._read = note
run()
print(texts)
"""


def test_faster_functions_of_numba_yield_the_same_code(probe):
    fast, slow = (probe(IR.format(slow=slow), limit=0, VIBGYM_CACHE="0") for slow in (False, True))
    assert fast == slow and all(name in fast[0] for name in ("add_roots", "roots", "twice", "total"))


SCENE = """
from vibgym.kernels import compiler
announced, compiled = set(), set()
def prefetch(self, arguments, first=False):
    announced.add(self.py_func.__name__)
compiler._Kernel.prefetch, load = prefetch, compiler._Kernel.compile
def compile(self, sig):
    if not isinstance(self, compiler._UnitKernel):  # those that compile a caller announce its units
        compiled.add(self.py_func.__name__)
    return load(self, sig)
compiler._Kernel.compile = compile
import gymnasium
made = gymnasium.make("vibgym/{name}-v0", **{settings})
made.reset(seed=0)
made.step(made.action_space.sample())
print(sorted(compiled - announced))
"""

FIRST = {"all_finite", "copy_finite", "scatter_starts", "report_worlds"}
"""Kernels that are called before a helper could compile them, and small ones."""


@pytest.mark.parametrize("name, settings", [
    ("Rotate", {}), ("Sort", {}), ("Sort", {"model": {"kind": "planar", "contacts": "fast"}}),
    ("Rotate", {"model": "tilting"}), ("Sort", {"model": "tilting"}),
], ids=["one part", "several", "fast contacts", "rigid", "rigid parts"])  # fmt: skip
def test_scenes_announce_their_kernels(probe, name, settings):
    (names,) = probe(SCENE.format(name=name, settings=settings), NUMBA_CACHE_DIR=os.environ.get("NUMBA_CACHE_DIR", ""))
    assert set(eval(names)) - FIRST == set()


def test_announced_kernels_count_for_the_expected_time_without_helpers():
    alone, job = helpers.Helpers(0), ("mine", "roots", ())
    alone.submit(job, 1.0, b"")
    assert alone.waiting() == [job]
    alone.claim(job, None)
    assert alone.waiting() == []


ANNOUNCED = """
import os
import gymnasium, vibgym
from vibgym.kernels import compiler, helpers

def stop(*functions):
    print(len(helpers.waiting()), flush=True)
    os._exit(0)

compiler._announce = stop
env = gymnasium.make("vibgym/Align-v0")
env.reset(seed=0)
env.step(env.action_space.sample())
"""


@pytest.mark.parametrize("alone", [{"VIBGYM_HELPERS": "0"}, {"VIBGYM_CACHE": "0"}])
def test_the_expected_time_is_that_of_all_kernels_of_a_scene(alone, tmp_path):
    """Not that of the first kernel, about 1 s, where no helper compiles the others."""
    environment = {**os.environ, "NUMBA_CACHE_DIR": str(tmp_path), **alone}
    done = subprocess.run(
        [sys.executable, "-c", ANNOUNCED], text=True, env=environment, capture_output=True, check=True
    )
    assert int(done.stdout) >= 3
