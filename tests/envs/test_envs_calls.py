"""A step stays short: the number of the package's functions that one step of a single environment enters."""

import sys
from pathlib import Path

import numpy as np

import vibgym
from tests.envs.helpers import single

PACKAGE = str(Path(vibgym.__file__).parent)
MAX_CALLS, MAX_FILES = 20, 10


def test_a_step_enters_few_functions():
    env = single("Align", action="field").unwrapped
    env.reset(seed=0)
    action = np.zeros(env.action_space.shape, dtype=np.float32)
    env.step(action)
    calls = []

    def note(frame, event, _):
        if event == "call" and frame.f_code.co_filename.startswith(PACKAGE):
            calls.append(f"{Path(frame.f_code.co_filename).name}:{frame.f_code.co_name}")

    before = sys.getprofile()
    sys.setprofile(note)
    try:
        env.step(action)
    finally:
        sys.setprofile(before)
    assert len(calls) <= MAX_CALLS, calls
    assert len({each.partition(":")[0] for each in calls}) <= MAX_FILES, calls
