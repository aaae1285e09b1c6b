"""Records of a driver identify the machine behind it."""

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.hardware import SimulatedDriver
from vibgym.hardware.record import Recorder
from vibgym.identification import Excitation, Log, fit


@pytest.mark.full
def test_the_record_of_a_driver_identifies_its_machine(tmp_path):
    surface, block = Surface(), Part.rectangle(0.05, 0.035, friction=0.52, height=0.02)
    machine = {"kind": "prototype", "gain": 0.9, "latency": 1, "dead_zone": 0.0}
    driver = SimulatedDriver("Align", seed=1, parts=[block], actuators=machine, sensor={"kind": "pose", "delay": 0})
    nominal = {"surface": {}, "actuators": "prototype", "parts": [block.to_dict()]}
    recorder = Recorder(tmp_path / "run.npz", nominal, (surface.rows, surface.columns), 1)
    excitation = Excitation(surface, [block], seed=0)
    for _ in range(900):
        measured = driver.receive()
        amplitude, phase = excitation.command(np.array(measured.pose))
        driver.send(amplitude, phase)
        recorder.add(driver.now(), amplitude, phase, measured.pose, measured.taken)
    path = recorder.save()
    assert path is not None
    nominal_block = Part.rectangle(0.05, 0.035, friction=0.6, height=0.02)
    found = fit(Log.load(path), surface, [nominal_block])
    assert found.values["latency"] == 1
    assert found.values["friction"] == pytest.approx(0.52, rel=0.02)
    assert found.values["gain"] == pytest.approx(0.9, rel=0.02)
    assert found.values["horizontal_amplitude"] == pytest.approx(surface.horizontal_amplitude, rel=0.01)
