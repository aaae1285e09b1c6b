"""Processes of entries with code: the evaluator steps the environment, and the process of an entry returns actions.

Messages to the process are pickled. Its answers are not: they are texts in JSON and plain float64 values of a known number.
The process is separate, but no sandbox: it runs with the rights of the user.
"""

from __future__ import annotations

import contextlib
import importlib.util
import json
import logging
import multiprocessing
import os
import pickle
import sys
import threading
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.envs.actions import ACTIONS
from vibgym.envs.observations import OBSERVATIONS
from vibgym.imports import import_user_modules, user_modules
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo

ANSWER_SECONDS = 300.0
"""s that an answer may take: the actions of all worlds for one step, or the start of a policy."""

MAX_TEXT = 4096
"""Most bytes of an answer in JSON."""


class EntryProcess:
    """Process in which the code of an entry runs; it starts with the first question, and again after a failure.

    Args:
        name: of the entry.
        module: Python file that registers its policy.
        content: argument of :func:`vibgym.policies.registry.make_policy`.
    """

    def __init__(self, name: str, module: Path, content: Any) -> None:
        self.name, self.started = name, 0
        self._module, self._content = module.absolute(), content
        self._process: Any = None
        self._connection: Any = None

    def ask(self, question: tuple[Any, ...], longest: int = MAX_TEXT) -> bytes:
        """Return the answer to a question, of at most ``longest`` bytes.

        Raises:
            ValueError: the process ends, takes longer than :data:`ANSWER_SECONDS`, or answers more.
        """
        if self._process is None:
            self._start()
        connection, sent, answers = self._connection, pickle.dumps(question), list[bytes]()

        def exchange() -> None:
            with contextlib.suppress(OSError, EOFError):  # no answer
                connection.send_bytes(sent)
                answers.append(connection.recv_bytes(longest))

        # The exchange has a thread, since a process can also stop reading, or within an answer.
        asking = threading.Thread(target=exchange, daemon=True)
        asking.start()
        asking.join(ANSWER_SECONDS)
        if answers:
            return answers[0]
        slow = asking.is_alive()
        self.stop()
        reason = f"gives no answer within {ANSWER_SECONDS:g} s" if slow else "ends, or answers too much"
        raise checks.conflict(f"code of entry {self.name!r}: its process {reason}")

    def _start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self._connection, other = context.Pipe()
        arguments = (other, str(self._module), self._content, user_modules())
        self._process = context.Process(target=serve, args=arguments, daemon=True)
        self._process.start()
        self.started += 1
        other.close()

    def stop(self) -> None:
        """End the process."""
        if self._process is not None:
            self._process.kill()
            self._process.join()
            self._process = None


class EntryPolicy:
    """Policy whose actions come from the process of an entry; making it raises ValueError if its code fails.

    Attributes:
        failure: why it cannot act; None while it can. Its actions are zero from then on.
    """

    def __init__(self, process: EntryProcess, info: TaskInfo, seed: int) -> None:
        self.failure: str | None = None
        self._process, self._info, self._seed = process, info, seed
        self._make()
        self._size = ACTIONS[self.action](info.surface, info.parts).size

    def _make(self) -> None:
        process = self._process
        made = self._read(process.ask(("make", self._info, self._seed)))
        self.action = checks.choice(f"action of entry {process.name!r}", made.get("action"), tuple(ACTIONS))
        self.observation = checks.choice(
            f"observation of entry {process.name!r}", made.get("observation"), tuple(OBSERVATIONS)
        )
        self._number = checks.count("number of the policy", made.get("number"), least=0)
        self._started = process.started

    def _read(self, answer: bytes) -> dict[str, Any]:
        """Return an answer in JSON; raise ValueError for one that is an error."""
        try:
            content = json.loads(answer)
        except (ValueError, RecursionError):
            content = None
        if not isinstance(content, dict) or "error" in content:
            reason = content.get("error") if isinstance(content, dict) else "an answer that cannot be read"
            raise checks.conflict(f"code of entry {self._process.name!r}: {reason}")
        return content

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions (batch, n) for a batch of observations; the state is kept by the process."""
        first = next(iter(observation.values())) if isinstance(observation, dict) else observation
        if self.failure is None:
            try:
                question = (observation, state is None, episode_start, deterministic)
                return self._actions(question, len(first)), True
            except checks.Refused as error:
                self.failure = str(error)
                logging.getLogger("vibgym").warning("%s: %s", self._info.name, error)
        return np.zeros((len(first), self._size), dtype=np.float32), True

    def _actions(self, question: tuple[Any, ...], worlds: int) -> np.ndarray:
        if self._started != self._process.started:
            self._make()
        expected = 8 * worlds * self._size
        answer = self._process.ask(("act", self._number, *question), max(expected, MAX_TEXT))
        if answer[:1] == b"{" and len(answer) != expected:
            self._read(answer)
        actions = np.frombuffer(answer[: len(answer) // 8 * 8], dtype=np.float64)
        if len(answer) != expected or not np.isfinite(actions).all():
            got = f"{len(actions)} values" if len(answer) != expected else "NaN or infinity"
            allowed = f"{worlds} x {self._size} finite numbers"
            raise checks.refuse(f"actions of entry {self._process.name!r}", got, allowed)
        return actions.reshape(worlds, self._size)


def serve(connection: Connection, module: str, content: Any, imports: tuple[str, ...]) -> None:
    """Run the code of an entry: answer questions until the connection closes. Its output is discarded."""
    for number in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), number)
    sys.dont_write_bytecode = True  # the folder does not change
    sys.path.insert(0, str(Path(module).parent))
    policies, states, loaded = list[Any](), list[Any](), False
    while True:
        try:
            kind, *question = connection.recv()
        except (EOFError, OSError):
            return
        try:
            if not loaded:
                import_user_modules(imports)
                spec = importlib.util.spec_from_file_location("entry", module)
                assert spec is not None and spec.loader is not None
                sys.modules["entry"] = code = importlib.util.module_from_spec(spec)
                spec.loader.exec_module(code)
                loaded = True
            if kind == "make":
                policy = make_policy(content, *question)
                policies.append(policy)
                states.append(None)
                made = {"action": policy.action, "observation": policy.observation, "number": len(policies) - 1}
                connection.send_bytes(json.dumps(made).encode())
            else:
                number, observation, first, start, deterministic = question
                state = None if first else states[number]
                action, states[number] = policies[number].predict(observation, state, start, deterministic)
                connection.send_bytes(np.ascontiguousarray(action, dtype=np.float64).tobytes())
        except Exception as error:
            text = str(error) if isinstance(error, checks.Refused) else f"{type(error).__name__}: {error}"
            connection.send_bytes(json.dumps({"error": text[: MAX_TEXT // 8]}).encode())
