"""A machine in another process: the protocol, its errors, and the machine's own watchdog."""

import contextlib
import json
import re
import socket
import struct
import subprocess
import sys
import threading

import numpy as np
import pytest

from tests.commands import said_in_one_line
from tests.hardware.helpers import PROTOTYPE, SENSOR, Faulty
from vibgym.__main__ import main
from vibgym.hardware import ControlLoop, MachineError, PoseMeasurement, Session, SimulatedDriver, SocketDriver
from vibgym.hardware.wire import (
    HEADER,
    MAGIC,
    VERSION,
    Channel,
    Kind,
    Message,
    floats,
    pack_measurement,
    unpack_measurement,
)

HELLO = {"rows": 8, "columns": 32, "parts": 1, "step_time": 0.04}
SETTINGS = {"actuators": PROTOTYPE, "sensor": SENSOR}


def served(serve):
    """Run ``serve(connection)`` for one connection in a thread; returns the port and the thread."""
    listener = socket.create_server(("127.0.0.1", 0))

    def run():
        with listener, listener.accept()[0] as connection:
            serve(connection)

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    return listener.getsockname()[1], thread


def message(kind, payload=b"", magic=MAGIC, version=VERSION):
    return HEADER.pack(magic, version, kind, len(payload)) + payload


@contextlib.contextmanager
def connected(*answers, hello=None, **settings):
    """Yield a driver whose machine greets it, sends these bytes, and reads until the driver closes the connection."""

    def serve(connection):
        connection.sendall(message(Kind.HELLO, json.dumps(HELLO).encode()) if hello is None else hello)
        with contextlib.suppress(OSError):
            for answer in answers:
                connection.sendall(answer)
            while connection.recv(4096):
                pass

    port, thread = served(serve)
    driver = SocketDriver("127.0.0.1", port, **{"timeout": 60.0, **settings})
    yield driver
    driver.close()
    thread.join(60.0)


def test_a_machine_over_a_socket_gives_the_same_commands_as_in_this_process():
    near = Faulty(action="velocity", **SETTINGS)
    expected = ControlLoop(near, "Align", "pose", action="velocity", **SETTINGS).run(30, seed=5, beyond=True)
    machine, ended = Faulty(**SETTINGS), []
    machine.surface, machine.parts, machine.step_time = machine.inner.surface, 1, 0.04
    port, thread = served(lambda sock: ended.append(Session(machine, Channel(sock, "the loop"), clock=None).run()))
    driver = SocketDriver("127.0.0.1", port, timeout=60.0)
    assert driver.machine == HELLO
    outcome = ControlLoop(driver, "Align", "pose", action="velocity", **SETTINGS).run(30, seed=5, beyond=True)
    driver.close()
    thread.join(60.0)
    assert outcome.reason == expected.reason == "cycle limit"
    np.testing.assert_array_equal(machine.sent, near.sent)
    assert ended == ["the loop has closed the connection"] and not machine.amplitude.any()


def test_a_killed_machine_stops_the_control_loop(tmp_path):
    command = [sys.executable, "-m", "vibgym", "machine", "Align", "--port", "0", "--seed", "5", "--lockstep"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    try:
        port = int(re.search(r":(\d+)$", process.stdout.readline().strip()).group(1))
        driver = SocketDriver("127.0.0.1", port, timeout=60.0)
        machine, cycles = driver.receive, []

        def receive():
            cycles.append(1)
            if len(cycles) == 6:
                process.kill()
                process.wait()
            return machine()

        driver.receive = receive
        outcome = ControlLoop(driver, "Align", "pose", action="velocity").run(60, seed=5, beyond=True)
        assert re.fullmatch(r"the machine at 127\.0\.0\.1:\d+ has closed the connection", outcome.reason)
        assert outcome.cycles in (5, 6)
    finally:
        process.kill()
        process.communicate()


def test_a_machine_that_is_silent_stops_the_control_loop():
    with connected(timeout=0.05) as driver:
        outcome = ControlLoop(driver, "Align", "pose", action="velocity").run(9)
    assert outcome.cycles == 0 and outcome.reason.endswith("has sent nothing for 0.05 s")


@pytest.mark.parametrize(("hello", "reason"), [
    (message(Kind.HELLO, b"{}", version=2), "has version 2 of the protocol, this side has version 1"),
    (b"HTTP/1.1 400 Bad Request\r\n", "does not speak this protocol"), (message(99), "kind 99"),
    (message(Kind.HELLO, b"{}"), "has not sent its rows, columns, parts and step_time"),
    (message(Kind.POSES, b"[1]"), "has not sent its rows, columns, parts and step_time"),
    (HEADER.pack(MAGIC, VERSION, Kind.HELLO, 2**31), "2147483648 bytes"),
])  # fmt: skip
def test_another_protocol_or_version_is_one_clear_error(hello, reason):
    with pytest.raises(MachineError, match=re.escape(reason)) as error, connected(hello=hello):
        pass
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("answer", "reason"), [
    (message(Kind.POSES, floats(np.zeros(4))), "POSES has a payload of 32 bytes"),
    (message(Kind.POSES, b"123"), "POSES has a payload of 3 bytes"),
    (message(Kind.IMAGE, struct.pack("<ddII", 0.0, 0.0, 4, 5) + b"123"), "IMAGE has a payload of 27 bytes"),
    (message(Kind.COMMAND), "COMMAND instead of a measurement"), (message(Kind.FAULT, b"too\nhot"), "too hot"),
    (message(Kind.FAULT, b"\x1b[2Jhot\x07\x00"), r"\x1b[2Jhot\x07\x00"),
])  # fmt: skip
def test_bad_messages_stop_the_control_loop(answer, reason):
    with connected(answer) as driver:
        outcome = ControlLoop(driver, "Align", "pose", action="velocity").run(9)
    assert reason in outcome.reason and outcome.reason.isprintable()


def test_of_several_measurements_the_last_one_counts():
    measurements = [PoseMeasurement(np.full((1, 3), float(k)), 0.04 * k) for k in range(5)]
    sent = b"".join(message(*pack_measurement(measurement.taken, measurement)) for measurement in measurements)
    with connected(sent) as driver:
        received = driver.receive()
        while driver.now() < 0.15:  # a slow loopback may deliver the last ones later
            received = driver.receive()
        assert driver.now() == received.taken == 0.16 and received.pose.tolist() == [[4.0, 4.0, 4.0]]


@pytest.mark.parametrize(("changes", "reason"), [
    ({"rows": 4, "columns": 4}, "driver.machine['rows'] must be 8, that of the environment, got 4"),
    ({"columns": 31}, "driver.machine['columns'] must be 32"), ({"parts": 3}, "driver.machine['parts'] must be 1"),
    ({"step_time": 0.02}, "driver.machine['step_time'] must be 0.04, that of the environment, got 0.02"),
    ({"step_time": float("nan")}, "driver.machine['step_time'] must be 0.04"),
])  # fmt: skip
def test_a_machine_that_differs_from_the_environment_is_refused(changes, reason):
    hello = message(Kind.HELLO, json.dumps({**HELLO, **changes}).encode())
    with connected(hello=hello) as driver, pytest.raises(ValueError, match=re.escape(reason)):
        ControlLoop(driver, "Align", "pose", action="velocity")


def test_a_machine_that_sends_faster_than_can_be_read_stops_the_control_loop():
    block = 500 * message(*pack_measurement(0.04, PoseMeasurement(np.zeros((1, 3)), 0.04)))
    with connected(*[block] * 2000, clock=iter(np.arange(0.0, 1e6, 0.1)).__next__) as driver:
        with pytest.raises(MachineError, match=r"faster than they can be read: \d+ in 0\.5 s, and more are waiting"):
            for _ in range(10_000):  # the thread may be late with some blocks
                driver.receive()


def test_measurements_pass_unchanged():
    rng = np.random.default_rng(0)
    pose, image = rng.normal(size=(3, 3)), rng.integers(0, 255, (5, 7), np.uint8)
    pose[1] = np.nan
    for original in (PoseMeasurement(pose, 1.0 / 3.0), PoseMeasurement(None, 0.1, image)):
        now, received = unpack_measurement(Message(*pack_measurement(2.0 / 3.0, original)), 3)
        assert (now, received.taken) == (2.0 / 3.0, original.taken)
        sent = "pose" if original.image is None else "image"
        np.testing.assert_array_equal(getattr(received, sent), getattr(original, sent))


class Clock:
    """A clock that advances when somebody sleeps."""

    def __init__(self):
        self.time = 0.0

    def __call__(self):
        return self.time

    def sleep(self, seconds):
        self.time += seconds


def session(*messages, cycles=None, hold=3):
    """Run a session whose control loop has sent all its messages in advance; returns the machine, clock, reason and answers."""
    here, there = socket.socketpair()
    machine, clock = SimulatedDriver("Align", seed=5), Clock()
    here.sendall(b"".join((message(Kind.HELLO, b"{}"), *messages)))
    if cycles is not None:
        measured, count = machine.receive, []

        def receive():
            count.append(1)
            if len(count) > cycles:
                here.shutdown(socket.SHUT_WR)
            return measured()

        machine.receive = receive
    with here, there:
        reason = Session(machine, Channel(there, "the loop"), hold=hold, clock=clock, sleep=clock.sleep).run()
        answers, channel = [], Channel(here, "the machine")
        while channel.waiting():
            answers.append(channel.receive(60.0))
    return machine, clock, reason, answers


def command(amplitude, shape=(8, 32)):
    return message(Kind.COMMAND, floats(np.full(shape, amplitude), np.zeros(shape)))


@pytest.mark.parametrize("hold", [0, 3])
def test_a_machine_holds_the_last_command_for_some_cycles_and_then_stops_its_elements(hold):
    machine, clock, reason, answers = session(command(1e-4), hold=hold)
    assert reason == f"the machine has had no command for {hold + 1} cycles: its elements have stopped"
    assert not machine.env.core.action.amplitude.any()
    # A first cycle without a command yet, the one that begins with the command, and those that hold it.
    assert [answer.kind for answer in answers] == [Kind.HELLO, *[Kind.POSES] * (1 + hold + 1), Kind.FAULT]
    assert answers[-1].payload.decode() == reason
    poses = [unpack_measurement(answer, 1)[1].pose for answer in answers[1:-1]]
    assert all((a != b).any() for a, b in zip(poses, poses[1:], strict=False))  # the part moves until the stop


def test_a_machine_at_rest_waits_for_commands_without_end():
    machine, clock, reason, answers = session(command(1e-4), message(Kind.STOP), cycles=50)
    assert reason == "the loop has closed the connection"
    assert len(answers) >= 50 and all(answer.kind is Kind.POSES for answer in answers[1:-1])
    assert clock.time == pytest.approx(50 * 0.04, abs=0.05)


@pytest.mark.parametrize(("bad", "reason"), [
    (command(1e-2), "amplitude must be numbers in [0, 0.0003975"),
    (command(1e-4, (8, 31)), "a COMMAND for 8 x 32 elements has 3968 bytes"),
    (message(Kind.POSES), "the loop has sent POSES instead of a command"),
    (message(Kind.STOP, version=7), "the loop has version 7 of the protocol"),
    (command(1e-4)[:-1], "the loop has sent nothing for 0.16 s"),
])  # fmt: skip
def test_a_bad_message_stops_the_machine(bad, reason):
    machine, _, text, _ = session(command(1e-4), bad)
    assert reason in text and not machine.env.core.action.amplitude.any()


def test_commands_of_another_machine_are_refused():
    with connected() as driver, pytest.raises(MachineError, match="8 x 32 elements"):
        driver.send(np.zeros((8, 31)), np.zeros((8, 31)))
    with socket.create_server(("127.0.0.1", 0)) as listener:
        port = listener.getsockname()[1]
    with pytest.raises(MachineError, match="no connection"):
        SocketDriver("127.0.0.1", port, timeout=60.0)


@pytest.mark.parametrize(
    "arguments", [["Alien"], ["Align", "--settings", "{"], ["Align", "--settings", "[1]"], ["Align", "--hold", "-1"]]
)
def test_bad_arguments_of_the_command_are_one_line(arguments, capsys):
    assert main(["machine", *arguments]) == 2
    said_in_one_line(capsys)
