"""Processes that answer requests: other packages, and other versions of vibgym, measured in turn with this one."""

from __future__ import annotations

import contextlib
import json
import os
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any


class Worker:
    """A process that answers each line of JSON on its stdin, ``[name, arguments...]``, with one on its stdout.

    Args:
        command: program and arguments.
        cwd: working directory.
        variables: environment variables in addition to those of this process.
    """

    def __init__(self, *command: object, cwd: Path | None = None, variables: Mapping[str, str] | None = None) -> None:
        pipe: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
        words, environment = [str(word) for word in command], {**os.environ, **(variables or {})}
        self._process = subprocess.Popen(words, cwd=cwd, env=environment, **pipe)

    def __enter__(self) -> Worker:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the process."""
        with contextlib.suppress(BrokenPipeError):
            self._process.communicate()

    def ask(self, *request: Any) -> Any:
        """Return the answer to a request."""
        self.send(*request)
        return self.receive()

    def send(self, *request: Any) -> None:
        """Send a request, whose answer :meth:`receive` returns."""
        assert self._process.stdin is not None
        with contextlib.suppress(BrokenPipeError):  # receive() raises
            self._process.stdin.write(json.dumps(request) + "\n")
            self._process.stdin.flush()

    def receive(self) -> Any:
        """Return the answer to the last request.

        Raises:
            RuntimeError: the process has ended.
        """
        assert self._process.stdout is not None
        answer = self._process.stdout.readline()
        if not answer:
            raise RuntimeError(f"a process ended without an answer: {self._process.args}")
        return json.loads(answer)
