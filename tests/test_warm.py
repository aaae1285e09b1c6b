"""After ``python -m vibgym warm`` no process compiles kernels."""

import os
import subprocess
import sys

LATER = """
import gymnasium, numpy as np, vibgym
for name in ("Rotate", "Sort"):
    for action in ("element", "field", "patch", "phasor"):
        env = gymnasium.make(f"vibgym/{name}-v0", action=action)
        env.reset(seed=0)
        env.step(env.action_space.sample())
many = gymnasium.make_vec("vibgym/Align-v0", num_envs=1000, action="field")
many.reset(seed=0)
many.step(many.action_space.sample())
for name in ("Align", "Sort"):
    for sensor in ({"kind": "pose"}, {"kind": "camera", "lines": "interlaced"}, {"kind": "camera", "statistical": True}):
        for estimator in ("none", "kalman", "model"):
            sensing = {**sensor, "estimator": estimator, "report": ["age"]}
            env = gymnasium.make(f"vibgym/{name}-v0", action="field", actuators="prototype", sensor=sensing)
            env.reset(seed=0)
            env.step(env.action_space.sample())
for name in ("Align", "Sort", "Follow"):
    for actuators in ("ideal", "prototype"):
        env = gymnasium.make(f"vibgym/{name}-v0", action="wrench", actuators=actuators)
        env.reset(seed=0)
        env.step(env.action_space.sample())
env = gymnasium.make("vibgym/Follow-v0", paths=[{"shape": "square", "centre": [0.4, 0.1], "side": 0.1}])
env.reset(seed=0)
env.step(env.action_space.sample())
gymnasium.make("vibgym/Align-v0", sensor="camera", observation="camera").reset(seed=0)
part = vibgym.Part.rectangle(0.05, 0.035, friction=0.6)
pair = vibgym.Simulator(vibgym.Surface(), [part, part], walls=["top"], worlds=3)
pair.reset([[0.10, 0.1, 0.0], [0.15, 0.1, 0.0]])
pair.advance(1e-4, 0.0, periods=2)
assert pair.statistics["contact"] > 0
disturbed = gymnasium.make("vibgym/Sort-v0", action="field", model="tilting",
    randomize={"disturbance": {"rate": 9, "tilt": 0.02}})
disturbed.reset(seed=0)
for _ in range(5):
    disturbed.step(disturbed.action_space.sample())
assert disturbed.unwrapped.core.simulator.tipping_margin.shape == (1, 6)
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.bounds import TimeBound
friction = FrictionalInverse(vibgym.Surface(), [part, part], ahead=0.02)
friction.acceleration(np.zeros((3, 2, 3)), friction.push(np.zeros((3, 2, 3)), np.ones((3, 2, 3))).push)
bound = TimeBound(vibgym.Surface(), part, position_tolerance=2e-3, heading_tolerance=0.05)
assert bound.steps([0.2, 0.1, 0.0], [0.6, 0.1, 1.0]) > 10
"""


def run(*command, **more):
    return subprocess.run([sys.executable, *command], text=True, capture_output=True, env={**os.environ, **more})


def test_nothing_is_compiled_afterwards():
    done = run("-m", "vibgym", "warm")
    assert done.returncode == 0 and "all kernels compiled in" in done.stdout and "stored in" in done.stdout
    later = run("-c", LATER)
    assert (later.returncode, later.stderr) == (0, "")


def test_without_a_cache_it_reports_an_error():
    done = run("-m", "vibgym", "warm", VIBGYM_CACHE="0")
    assert done.returncode == 1 and len(done.stderr.splitlines()) == 1 and "VIBGYM_CACHE" in done.stderr
