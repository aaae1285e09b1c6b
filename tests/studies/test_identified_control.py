"""Control of hidden machines: a small run of the command."""

import json
import sys

import numpy as np

from studies.benchmarks import identified_control as study
from vibgym.identification import Fitted


def test_the_control_loop_knows_what_it_is_given():
    """With the true parameters and an exact camera the machine is known: both worlds have the same goal, and Align succeeds."""
    machine = study.drawn(3)
    known = study.known_of(machine.surface, machine.parts, machine.actuators, machine.camera)
    took = study.times("Align", "pose", machine, known, range(2))
    assert np.isfinite(took).all() and took.max() < 5.0
    shifted = known._replace(camera=study.Camera(x=machine.camera.x + 0.01))
    assert np.isnan(study.times("Align", "pose", machine, shifted, [0])).all()  # success is that of the true poses


def test_rows_compare_episodes_that_both_solve():
    times = {"identified": [2.0, 1.1, np.nan], "true": [2.0, 1.0, 1.0], "nominal": [np.nan]}
    assert study.row(times) == ["66.7 %, 1.55 s", "100.0 %, 1.00 s", "0.0 %, –", "+3.3 %", "+3.3 %"]


def test_a_small_run_prints_and_stores(monkeypatch, capsys, tmp_path):
    machine = study.drawn(1)

    def fitted(log, force):
        zeros = np.zeros((8, 32, 2))
        names = ("camera_scale", "camera_turn", "camera_x", "camera_y", "noise_position", "noise_heading")
        values = {name: machine.truth[name] for name in names}
        parts = tuple(machine.parts)
        return Fitted(values, {}, {}, machine.surface, machine.actuators, parts, zeros, zeros, {}, [], zeros, {})

    monkeypatch.setattr(study, "fit", fitted)
    chosen = "--machines 1 --tasks Align --policies local_field --seconds 1 --episodes 2 --nominal 1 --first-seed 0"
    options = chosen.split()
    monkeypatch.setattr(sys, "argv", ["study", *options, "--output", str(tmp_path)])
    study.main()
    (line,) = [other for other in capsys.readouterr().out.splitlines() if "`local_field`" in other]
    assert line.count("100.0 %") >= 2 and "+0.0 %" in line
    (path,) = tmp_path.glob("*.json")
    assert set(json.loads(path.read_text())) == set(study.knowledge(machine, fitted(None, force=True)))
    monkeypatch.setattr(study, "fit", None)  # stored results are reused
    study.main()
    assert line in capsys.readouterr().out
