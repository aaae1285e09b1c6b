"""A machine in another process: :class:`SocketDriver` for the control loop, :class:`Session` for the machine's side."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.hardware.driver import MachineError, PoseMeasurement
from vibgym.hardware.simulated import SimulatedDriver
from vibgym.hardware.wire import Channel, Kind, floats, pack_measurement, unpack_command, unpack_measurement

GREETING = 5.0
"""s in which a control loop has to introduce itself."""

LONGEST_REASON = 500
"""Bytes of a fault's text that are reported."""

CATCHING_UP = 0.5
"""s of reading measurements that wait, after which the machine counts as too fast: long enough for those of a pause."""


class SocketDriver:
    """A machine that is reached over TCP, see :mod:`vibgym.hardware.wire`.

    Args:
        host, port: of the machine.
        timeout: s without any message after which the machine counts as dead.
        clock: s, for the limit on reading measurements that have arrived.

    Attributes:
        machine: what the machine has reported: ``rows``, ``columns``, ``parts``, ``step_time`` (s).

    Raises:
        MachineError: no connection, or another protocol or version.
    """

    def __init__(self, host: str, port: int, timeout: float = 1.0, clock: Callable[[], float] = time.monotonic) -> None:
        self._timeout, self._clock = checks.number("timeout", timeout, above=0.0), clock
        peer = f"the machine at {host}:{port}"
        try:
            connection = socket.create_connection((host, port), timeout)
        except OSError as error:
            raise MachineError(f"no connection to {peer}: {error.strerror or error}") from None
        self._channel, self._now = Channel(connection, peer), 0.0
        try:
            self._channel.send(Kind.HELLO, b"{}")
            self.machine = self._greeting()
        except MachineError:
            self._channel.close()
            raise

    def _greeting(self) -> dict[str, Any]:
        """Return the machine's properties."""
        hello = self._channel.receive(self._timeout)
        try:
            greeting = json.loads(hello.payload)
            counts = {name: int(greeting[name]) for name in ("rows", "columns", "parts")}
            return {**counts, "step_time": float(greeting["step_time"])}
        except (TypeError, ValueError, KeyError):
            raise MachineError(f"{self._channel.peer} has not sent its rows, columns, parts and step_time") from None

    def send(self, amplitude: np.ndarray, phase: np.ndarray) -> None:
        shape = (self.machine["rows"], self.machine["columns"])
        if amplitude.shape != shape:
            raise MachineError(f"the machine has {shape[0]} x {shape[1]} elements, the command {amplitude.shape}")
        self._channel.send(Kind.COMMAND, floats(amplitude, phase))

    def receive(self) -> PoseMeasurement:
        """Wait for the next measurement; of several that have arrived, return the last one."""
        number, first = 0, None
        while True:
            message = self._channel.receive(self._timeout)
            if message.kind is Kind.FAULT:
                raise MachineError(message.payload[:LONGEST_REASON].decode(errors="replace"))
            if message.kind not in (Kind.POSES, Kind.IMAGE):
                raise MachineError(f"{self._channel.peer} has sent {message.kind.name} instead of a measurement")
            if not self._channel.waiting():
                self._now, measurement = unpack_measurement(message, self.machine["parts"])
                return measurement
            number, first = number + 1, self._clock() if first is None else first
            if self._clock() - first > CATCHING_UP:
                fast = "sends measurements faster than they can be read"
                raise MachineError(f"{self._channel.peer} {fast}: {number} in {CATCHING_UP:g} s, and more are waiting")

    def now(self) -> float:
        return self._now

    def stop(self) -> None:
        self._channel.send(Kind.STOP)

    def close(self) -> None:
        self._channel.close()


class Session:
    """The machine's side of a connection: cycles of a simulated machine until the control loop disconnects.

    Args:
        driver: the machine.
        channel: to the control loop.
        hold: cycles for which the elements hold the last command; then they stop, and the machine reports a fault.
        clock, sleep: s, for cycles at the machine's rate; clock None: in lockstep, each cycle waits for its command.

    Raises:
        MachineError: another protocol or version.
    """

    def __init__(
        self,
        driver: SimulatedDriver,
        channel: Channel,
        *,
        hold: int = 3,
        clock: Callable[[], float] | None = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        self._driver, self._channel, self._hold, self._clock, self._sleep = driver, channel, hold, clock, sleep
        surface = driver.surface
        self._shape = (surface.rows, surface.columns)
        self._moving, self._held = False, 0
        # The elements must not move on while half a command has arrived.
        self._timeout = None if clock is None else (hold + 1) * driver.step_time
        if channel.receive(GREETING).kind is not Kind.HELLO:
            raise MachineError(f"{channel.peer} has not begun with HELLO")
        about = {"rows": surface.rows, "columns": surface.columns, "parts": driver.parts, "step_time": driver.step_time}
        channel.send(Kind.HELLO, json.dumps(about).encode())

    def run(self) -> str:
        """Run cycles; the elements are at rest afterwards. Return why the session has ended, one line."""
        try:
            due = self._clock() if self._clock else 0.0
            while True:
                measurement = self._driver.receive()
                self._channel.send(*pack_measurement(self._driver.now(), measurement))
                if self._clock is None:
                    self._execute()
                    continue
                due = max(due + self._driver.step_time, self._clock())  # a late simulation does not hurry afterwards
                self._sleep(max(due - self._clock(), 0.0))
                self._held += 1
                while self._channel.waiting():
                    self._execute()
                if self._moving and self._held > self._hold:
                    since = f"the machine has had no command for {self._held} cycles"
                    raise MachineError(f"{since}: its elements have stopped")
        except (MachineError, checks.Refused) as error:
            self._driver.stop()
            with contextlib.suppress(MachineError):  # the control loop may have gone
                self._channel.send(Kind.FAULT, str(error).encode())
            return str(error)
        finally:
            self._driver.stop()

    def _execute(self) -> None:
        """Execute the next message of the control loop."""
        message = self._channel.receive(self._timeout)
        if message.kind is Kind.COMMAND:
            self._driver.send(*unpack_command(message, self._shape))
            self._moving, self._held = True, 0
        elif message.kind is Kind.STOP:
            self._driver.stop()
            self._moving = False
        else:
            raise MachineError(f"{self._channel.peer} has sent {message.kind.name} instead of a command")
