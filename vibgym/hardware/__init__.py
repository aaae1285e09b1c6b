"""Machines: drivers, the control loop, watchdog, records of runs; see docs/machine.md."""

from vibgym.hardware.driver import Driver, MachineError, PoseMeasurement
from vibgym.hardware.env import HardwareEnv
from vibgym.hardware.loop import ControlLoop, Outcome
from vibgym.hardware.record import Recorder, ReplayDriver
from vibgym.hardware.remote import Session, SocketDriver
from vibgym.hardware.simulated import SimulatedDriver
from vibgym.hardware.watchdog import Stopped, Watchdog

__all__ = [
    "ControlLoop", "Driver", "HardwareEnv", "MachineError", "PoseMeasurement", "Outcome", "Recorder", "ReplayDriver",
    "Session",
    "SimulatedDriver",
    "SocketDriver", "Stopped", "Watchdog",
]  # fmt: skip
