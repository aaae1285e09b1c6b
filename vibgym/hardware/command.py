"""``python -m vibgym machine``: the simulator as a machine in a process of its own."""

from __future__ import annotations

import argparse
import socket
import time

from vibgym import checks
from vibgym.config import from_text
from vibgym.hardware.driver import MachineError
from vibgym.hardware.remote import Session
from vibgym.hardware.simulated import SimulatedDriver
from vibgym.hardware.wire import Channel


def serve(arguments: argparse.Namespace) -> int:
    """Serve control loops, one after the other."""
    seed, clock = arguments.seed, None if arguments.lockstep else time.monotonic
    settings = from_text("--settings", arguments.settings)
    if not isinstance(settings, dict):
        raise checks.refuse("--settings", arguments.settings, "a JSON object")
    driver = SimulatedDriver(arguments.task, seed=seed, **settings)
    hold = checks.count("--hold", arguments.hold, least=0)
    try:
        listener = socket.create_server((arguments.host, arguments.port))
    except (OSError, OverflowError) as error:
        raise checks.refuse("--port", f"{arguments.host}:{arguments.port}", f"a free address ({error})") from None
    with listener:
        print(f"machine {arguments.task} at {arguments.host}:{listener.getsockname()[1]}", flush=True)
        while True:
            connection, address = listener.accept()
            with connection:
                try:
                    channel = Channel(connection, f"the control loop at {address[0]}")
                    print(Session(driver, channel, hold=hold, clock=clock).run(), flush=True)
                except MachineError as error:
                    print(error, flush=True)
            seed = None if seed is None else seed + 1
            driver.start(seed)
