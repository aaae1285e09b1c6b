"""Fixtures and settings of all tests."""

import os
import signal
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from filelock import FileLock
from hypothesis import settings

from vibgym.envs import VibgymVectorEnv
from vibgym.envs.vector import seeds_from
from vibgym.kernels import jit
from vibgym.kernels.cache import announce

# No deadline: kernels compile on first use. Derandomized, so that runs are reproducible.
settings.register_profile("vibgym", deadline=None, derandomize=True, max_examples=100)
settings.load_profile("vibgym")

ROOT = Path(__file__).parent.parent


@pytest.fixture(scope="session", autouse=True)
def _announcement():
    """Announce compilation before all tests, so that no test's standard error depends on which test compiles first."""
    if jit.MODE == jit.LINKED:
        from vibgym.kernels.linking import default_folder

        announce(default_folder())


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Build the documentation site as ``make docs`` does, once for all workers; return its directory."""
    base = tmp_path_factory.getbasetemp()
    directory = (base.parent if "PYTEST_XDIST_WORKER" in os.environ else base) / "site"
    with FileLock(f"{directory}.lock"):
        if not (directory / "built").exists():
            command = [str(Path(sys.executable).parent / "sphinx-build"), "-W", "--keep-going", "-q", "-b", "html"]
            command += ["-d", f"{directory}-doctrees", str(ROOT / "docs"), str(directory)]
            done = subprocess.run(command, cwd=ROOT, capture_output=True, text=True)
            assert done.returncode == 0, done.stderr[-4000:]
            (directory / "built").touch()
    return directory


@pytest.fixture
def interruptible():
    """Restore the handling of SIGINT, which shells disable in background jobs."""
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    yield
    signal.signal(signal.SIGINT, before)


@pytest.fixture
def resets(monkeypatch):
    """Record all seeded resets of batches: number of worlds, seeds, and a digest of each start."""
    records, reset = [], VibgymVectorEnv.reset

    def recorded(self, *, seed=None, options=None):
        observation, info = reset(self, seed=seed, options=options)
        seeds = [seed for seed in seeds_from(seed, self.num_envs) if seed is not None]
        values = observation.values() if isinstance(observation, dict) else [observation]
        rows = np.concatenate([np.reshape(value, (self.num_envs, -1)) for value in values], axis=1)
        if seeds:
            records.append((self.num_envs, seeds, [row.tobytes() for row in rows]))
        return observation, info

    monkeypatch.setattr(VibgymVectorEnv, "reset", recorded)
    return records
