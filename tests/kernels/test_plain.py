"""``VIBGYM_PLAIN_NUMBA=1``: the same results on numba's public interface alone."""

import json
import os
import subprocess
import sys

import numpy as np
import pytest

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


def foreign():
    from vibgym.physics.contacts.solver import add_bodies
    from vibgym.simulation.contact_space import ContactSpace, impact_properties_of

    space = ContactSpace(Surface(), [BLOCK, DISC], [])
    solver, factor = space.solver, np.array([2.0, 3.0])
    add_bodies(solver, solver.spaces[0], impact_properties_of([BLOCK, DISC]), factor, np.arange(2), 2)
    return [body.mass for body in space._bodies]


def environment():
    return played("vibgym/Align-v0")


def several():
    return played("vibgym/Sort-v0", action="phasor")


def hardware():
    return played("vibgym/Align-v0", actuators="prototype", sensor={"kind": "pose", "estimator": "kalman"})


found = {name: globals()[name]() for name in sys.argv[1:]}
print(json.dumps(found))
"""

PYTHON = ["sticking", "planar", "averaged", "contacts", "foreign", "environment", "several", "hardware"]
COMPILED = ["foreign", "planar"]  # others take minutes


def numbers_of(scenes, **environment):
    """Return the result of each scene in a process with these environment variables, and its stderr."""
    command = [sys.executable, "-W", "ignore", "-c", SCENES, *scenes]
    done = subprocess.run(command, env={**os.environ, **environment}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout), done.stderr


@pytest.fixture(scope="module")
def expected():
    return numbers_of(PYTHON)[0]


def check(found, expected):
    for name, numbers in found.items():
        assert np.allclose(numbers, expected[name], rtol=0.0, atol=1e-9), name


def test_as_plain_python(expected):
    """Without compilation, the mode only determines how records and foreign functions are passed."""
    found, messages = numbers_of(PYTHON, VIBGYM_PLAIN_NUMBA="1", NUMBA_DISABLE_JIT="1")
    check(found, expected)
    assert expected["contacts"][-1] > 0 and len(messages.splitlines()) == 1 and "VIBGYM_PLAIN_NUMBA" in messages


def test_compiled_by_the_public_decorator_alone(expected, tmp_path):
    # The test covers how kernels are passed, independent of LLVM's expensive optimisations.
    settings = {"VIBGYM_PLAIN_NUMBA": "1", "NUMBA_CACHE_DIR": str(tmp_path), "NUMBA_OPT": "1"}
    for _ in range(2):
        check(numbers_of(COMPILED, **settings)[0], expected)
    kept = list(tmp_path.rglob("*.nbc"))
    assert kept and all(path.relative_to(tmp_path).parts[0].startswith("plain-") for path in kept)


def test_the_private_modules_are_not_even_imported():
    code = "import vibgym.simulation, sys; print([name for name in sys.modules if name.startswith('vibgym.kernels.')])"
    done = subprocess.run(
        [sys.executable, "-c", code], env={**os.environ, "VIBGYM_PLAIN_NUMBA": "1"}, capture_output=True, text=True
    )
    for name in ("compiler", "cache", "pointers", "vec8"):
        assert f"'vibgym.kernels.{name}'" not in done.stdout
    assert "'vibgym.kernels.plain'" in done.stdout
