"""How kernels are compiled: the same results by numba's private and public interfaces, and without compilation."""

import json
import os
import subprocess
import sys

import numba
import numpy as np
import pytest

from vibgym.kernels import jit

SCENES = """
import gymnasium, json, numpy as np, sys
from vibgym import Part, Simulator, Surface

BLOCK, DISC = Part.rectangle(0.05, 0.04, friction=0.6), Part.disc(0.02, friction=0.6)


def simulated(parts, pose, velocity=None, walls=(), periods=3, **settings):
    surface = Surface()
    simulator = Simulator(surface, parts, walls=walls, threads=1, **settings)
    simulator.reset(pose, velocity)
    random = np.random.default_rng(0)
    shape = surface.rows, surface.columns
    simulator.advance(random.uniform(0.0, surface.max_amplitude, shape), random.uniform(-3.0, 3.0, shape), periods)
    return [*simulator.pose.ravel().tolist(), *simulator.velocity.ravel().tolist(), simulator.statistics["contact"]]


def played(name, steps=3, **settings):
    env = gymnasium.make(name, **settings)
    observation, _ = env.reset(seed=1)
    env.action_space.seed(1)
    numbers = []
    for _ in range(steps):
        observation, reward, *_ = env.step(env.action_space.sample())
        numbers += [*np.ravel(observation).tolist(), float(reward)]
    return numbers


def sticking():
    return simulated(Part.rectangle(0.06, 0.05, friction=1.5), [0.2, 0.1, 0.3])


def planar():
    return simulated(BLOCK, [0.2, 0.1, 0.1], [0.05, 0.0, 1.0])


def averaged():
    return simulated(Part.rectangle(0.05, 0.04, friction=0.3), [0.2, 0.1, 0.1], model="averaged")


def contacts():
    pose = [[[0.027, 0.1, 0.05], [0.0725, 0.11, 0.0]]]  # nothing in it hangs on the last bit
    return simulated([BLOCK, DISC], pose, [[[-0.1, 0.0, 0.0], [-0.1, 0.0, 0.0]]], ["left"])


def environment():
    return played("vibgym/Align-v0")


def several():
    return played("vibgym/Sort-v0", action="phasor")


def hardware():
    return played("vibgym/Align-v0", actuators="prototype", sensor={"kind": "pose", "estimator": "kalman"})


found = {name: globals()[name]() for name in sys.argv[1:]}
print(json.dumps(found))
"""

SMALL, LARGE = ["planar"], ["contacts"]
ALL = ["sticking", "planar", "averaged", "contacts", "environment", "several", "hardware"]


def numbers_of(scenes, **environment):
    """Return the result of each scene in a process with these environment variables, and its stderr."""
    command = [sys.executable, "-W", "ignore", "-c", SCENES, *scenes]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module")
def expected():
    return numbers_of(ALL)[0]


def check(measured, expected):
    for name, numbers in measured.items():
        assert np.allclose(numbers, expected[name], rtol=0.0, atol=1e-9), name


def test_without_compilation(expected):
    measured, messages = numbers_of(ALL, NUMBA_DISABLE_JIT="1")
    check(measured, expected)
    assert expected["contacts"][-1] > 0 and len(messages.splitlines()) == 1 and "NUMBA_DISABLE_JIT" in messages


@pytest.mark.parametrize(
    "scenes, level",
    [pytest.param(SMALL, "1", id="small"), pytest.param(LARGE, "3", id="large", marks=pytest.mark.full)],
)
def test_plain_numba(expected, tmp_path, scenes, level):
    settings = {"VIBGYM_PLAIN_NUMBA": "1", "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_OPT": level}
    for _ in range(2):
        measured, messages = numbers_of(scenes, **settings)
        check(measured, expected)
        assert len(messages.splitlines()) == 1 and "VIBGYM_PLAIN_NUMBA" in messages
    kept = list(tmp_path.rglob("*.nbc"))
    assert kept and all(path.relative_to(tmp_path).parts[0].startswith("plain-") for path in kept)


@pytest.mark.parametrize("code, plain, expected, warning", [
    ("import vibgym.simulation, sys; print('vibgym.kernels.linking' in sys.modules)", "1", "False\n", ""),
    ("from numba.core.caching import IndexDataCacheFile; del IndexDataCacheFile.flush; "
     "import vibgym.kernels.jit as jit; print(jit.MODE)", "", "plain\n", "flush"),
], ids=["as requested", "without an interface"])  # fmt: skip
def test_plain_numba_needs_no_private_interface(code, plain, expected, warning):
    settings = {**os.environ, "VIBGYM_PLAIN_NUMBA": plain}
    done = subprocess.run([sys.executable, "-c", code], env=settings, capture_output=True, text=True, check=True)
    assert done.stdout == expected and warning in done.stderr and len(done.stderr.splitlines()) <= 1


@pytest.mark.parametrize("version", [(0, 60), (0, 69), (1, 0)])
def test_an_untested_numba_is_used_plainly(monkeypatch, version):
    monkeypatch.delenv("VIBGYM_PLAIN_NUMBA", raising=False)
    monkeypatch.setattr(numba, "version_info", numba.version_info._replace(short=version))
    mode, reason = jit.decide()
    assert mode == jit.PLAIN and numba.__version__ in reason
    monkeypatch.setenv("VIBGYM_PLAIN_NUMBA", "0")
    assert jit.decide() == (jit.LINKED, "")


FORK = """
import os, threading, time
import numpy as np, vibgym
from vibgym.kernels import linking
from vibgym.kernels.jit import jit

@jit
def double(x):
    return 2.0 * x

compiling = threading.Event()
announce = linking.announce

def slowly(folder):
    compiling.set()
    time.sleep(0.5)
    announce(folder)

linking.announce = slowly
thread = threading.Thread(target=double, args=(1,))
thread.start()
compiling.wait()
child = os.fork()
if not child:
    os._exit(int(double(2.0)))
print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))
thread.join()
"""


@pytest.mark.skipif(not hasattr(os, "fork"), reason="no fork")
def test_a_fork_while_another_thread_compiles():
    settings = {**os.environ, "VIBGYM_CACHE": "0", "VIBGYM_PLAIN_NUMBA": ""}
    done = subprocess.run([sys.executable, "-c", FORK], env=settings, capture_output=True, text=True, timeout=120)
    assert done.stdout == "4\n", done.stderr
