"""Protocol between a control loop and a machine in another process, over a stream socket.

Every message is a header of 12 bytes and a payload; all numbers are little-endian, floats have 64 bits:

    4 bytes "VIBM", uint16 version, uint16 kind (:class:`Kind`), uint32 length of the payload in bytes

Both sides send ``HELLO`` first. The machine then sends ``POSES`` or ``IMAGE`` in every cycle, and the control loop answers
with ``COMMAND``, or ``STOP``.
"""

from __future__ import annotations

import select
import socket
import struct
from enum import IntEnum
from typing import NamedTuple

import numpy as np

from vibgym.hardware.driver import MachineError, PoseMeasurement

VERSION = 1

MAGIC = b"VIBM"
HEADER = struct.Struct("<4sHHI")
TIMES = struct.Struct("<dd")
SIZE = struct.Struct("<II")

MAX_BYTES = 1 << 26
"""Longest payload: an image of 64 million pixels."""


class Kind(IntEnum):
    """Kinds of messages, and their payloads."""

    HELLO = 1  # JSON: of the machine, "rows", "columns", "parts", "step_time" (s); of the control loop, {}
    COMMAND = 2  # amplitudes (rows x columns, m), phases (rows x columns, rad)
    POSES = 3  # now, taken (s, the machine's clock), poses (parts x 3: m, m, rad; nan: not measured)
    IMAGE = 4  # now, taken (s), uint32 lines, uint32 columns, pixels (lines x columns bytes)
    STOP = 5  # empty
    FAULT = 6  # UTF-8, one line: why the machine has stopped; it then closes the connection


class Message(NamedTuple):
    """A message."""

    kind: Kind
    payload: bytes


class Channel:
    """Messages over a connected stream socket.

    Args:
        connection: the socket; closed by :meth:`close`.
        peer: name of the other side, for errors.
    """

    def __init__(self, connection: socket.socket, peer: str) -> None:
        self._socket, self.peer = connection, peer
        if connection.family in (socket.AF_INET, socket.AF_INET6):
            connection.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)

    def send(self, kind: Kind, *payload: bytes) -> None:
        """Send a message.

        Raises:
            MachineError: the connection is broken.
        """
        content = b"".join(payload)
        try:
            self._socket.sendall(HEADER.pack(MAGIC, VERSION, kind, len(content)) + content)
        except OSError as error:
            raise self._broken(error) from None

    def receive(self, timeout: float | None) -> Message:
        """Wait for the next message.

        Args:
            timeout: s without any data; None: no limit.

        Raises:
            MachineError: no data for that time, a broken connection, or a message of another protocol or version.
        """
        magic, version, kind, length = HEADER.unpack(self._read(HEADER.size, timeout))
        if magic != MAGIC:
            wrong = f"a message begins with {magic!r}, not {MAGIC!r}"
            raise MachineError(f"{self.peer} does not speak this protocol: {wrong}")
        if version != VERSION:
            raise MachineError(f"{self.peer} has version {version} of the protocol, this side has version {VERSION}")
        if kind not in set(Kind) or length > MAX_BYTES:
            undefined = f"a message of kind {kind} with {length} bytes, which is not defined"
            raise MachineError(f"{self.peer} has sent {undefined}")
        return Message(Kind(kind), self._read(length, timeout))

    def waiting(self) -> bool:
        """Return whether data has arrived."""
        return bool(select.select([self._socket], [], [], 0.0)[0])

    def close(self) -> None:
        """Close the socket."""
        self._socket.close()

    def _read(self, size: int, timeout: float | None) -> bytes:
        parts, missing = [], size
        try:
            self._socket.settimeout(timeout)
            while missing:
                part = self._socket.recv(missing)
                if not part:
                    raise MachineError(f"{self.peer} has closed the connection")
                parts.append(part)
                missing -= len(part)
        except TimeoutError:
            raise MachineError(f"{self.peer} has sent nothing for {timeout:g} s") from None
        except OSError as error:
            raise self._broken(error) from None
        return b"".join(parts)

    def _broken(self, error: OSError) -> MachineError:
        if isinstance(error, ConnectionError):  # reset, broken pipe
            return MachineError(f"{self.peer} has closed the connection")
        return MachineError(f"connection to {self.peer}: {error.strerror or error}")


def floats(*arrays: np.ndarray) -> bytes:
    """Return arrays as 64-bit floats."""
    return b"".join(np.ascontiguousarray(array, dtype="<f8").tobytes() for array in arrays)


def pack_measurement(now: float, measurement: PoseMeasurement) -> tuple[Kind, bytes]:
    """Return kind and payload of a measurement."""
    times = TIMES.pack(now, measurement.taken)
    if measurement.pose is not None:
        return Kind.POSES, times + floats(measurement.pose)
    image = np.ascontiguousarray(measurement.image, dtype=np.uint8)
    return Kind.IMAGE, times + SIZE.pack(*image.shape) + image.tobytes()


def unpack_measurement(message: Message, parts: int) -> tuple[float, PoseMeasurement]:
    """Return the machine's time (s) and the measurement of a message.

    Raises:
        MachineError: a payload of the wrong length.
    """
    payload = message.payload
    try:
        now, taken = TIMES.unpack_from(payload)
        if message.kind is Kind.POSES:
            pose = np.frombuffer(payload, "<f8", offset=TIMES.size).reshape(parts, 3)
            return now, PoseMeasurement(pose.astype(np.float64), taken)
        shape = SIZE.unpack_from(payload, TIMES.size)
        image = np.frombuffer(payload, np.uint8, offset=TIMES.size + SIZE.size).reshape(shape)
        return now, PoseMeasurement(None, taken, image)
    except (struct.error, ValueError):
        size = f"a payload of {len(payload)} bytes, which does not fit"
        raise MachineError(f"a message {message.kind.name} has {size}") from None


def unpack_command(message: Message, shape: tuple[int, int]) -> np.ndarray:
    """Return amplitude and phase (2, rows, columns) of a command.

    Raises:
        MachineError: a payload of the wrong length.
    """
    if len(message.payload) != 16 * shape[0] * shape[1]:
        raise MachineError(f"a COMMAND for {shape[0]} x {shape[1]} elements has {len(message.payload)} bytes")
    return np.frombuffer(message.payload, "<f8").reshape(2, *shape).astype(np.float64)
