"""gym-pusht in a process of its own, in the environment made by ``make peers``."""

from __future__ import annotations

import json
import subprocess
from pathlib import Path
from typing import Any

import numpy as np

from studies.benchmarks.peers import PYTHON

WORKER = Path(__file__).with_name("peer_worker.py")


class Peer:
    """One environment of gym-pusht.

    Args:
        python: interpreter with gym-pusht.
    """

    def __init__(self, python: Path = PYTHON) -> None:
        pipe: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        self._process = subprocess.Popen([python, WORKER], **pipe)

    def __enter__(self) -> Peer:
        return self

    def __exit__(self, *_: object) -> None:
        self._process.communicate()

    def ask(self, command: str, *arguments: Any) -> Any:
        """Return the answer to a request, see ``peer_worker.py``."""
        assert self._process.stdin is not None and self._process.stdout is not None
        self._process.stdin.write(json.dumps([command, *arguments]) + "\n")
        self._process.stdin.flush()
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"gym-pusht ended during {command!r}")
        return json.loads(answer)

    def steps(self, actions: np.ndarray) -> np.ndarray:
        """Take control periods with actions (periods, 2); return states and coverage after each, (periods, 8)."""
        return np.array(self.ask("steps", actions.tolist()))
