"""Run the first example of the README with the installed wheel; fail if it compiles kernels that the wheel should contain.

cibuildwheel runs this file in the environment of each wheel that it builds, outside of the checkout.
"""

import os
import subprocess
import sys
import tempfile
from pathlib import Path

EXAMPLE = Path(__file__).parents[2] / "examples" / "first_steps.py"

with tempfile.TemporaryDirectory() as folder:
    variables = {**os.environ, "NUMBA_CACHE_DIR": str(Path(folder, "kernels"))}  # empty: all kernels are the wheel's
    command = [sys.executable, str(EXAMPLE), str(Path(folder, "picture.png"))]
    done = subprocess.run(command, cwd=folder, env=variables, capture_output=True, text=True)
print(done.stdout, done.stderr)
sys.exit(done.returncode or "compiling" in done.stderr)
