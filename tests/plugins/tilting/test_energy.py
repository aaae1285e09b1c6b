"""Energy balance of a rigid part, step by step, in a process with plain Python kernels."""

import json
import os
import subprocess
import sys

import pytest

from studies.tilting.energy import PLAIN

WATCH = """
import json, math, sys
from studies.tilting.energy import balance
cases = [("steel_block", 1.0, 5.0, 0.0), ("steel_block", 0.5, 3.0, 1.0), ("disc", 1.0, 5.0, 1.0), ("disc", 0.25, 1.0, 0.2)]
print(json.dumps([balance(name, share, math.radians(tilt), e, 2)._asdict() for name, share, tilt, e in cases]))
"""


@pytest.fixture(scope="module")
def balances():
    command = [sys.executable, "-W", "ignore", "-c", WATCH]
    done = subprocess.run(command, env={**os.environ, **PLAIN}, capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return json.loads(done.stdout)


@pytest.mark.parametrize("case", range(4))
def test_energy_grows_by_no_more_than_the_work_of_table_and_plates(balances, case):
    """On random fields, tilted, at any restitution, the excess energy over any sequence of steps lifts the part by less
    than ten micrometres."""
    each = balances[case]
    assert each["given"] > 0.1 and each["lost"] > 0.1
    assert each["most"] < 9.81 * 1e-5
