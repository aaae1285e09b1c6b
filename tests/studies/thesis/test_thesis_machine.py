"""The fit of the thesis's machine: closed forms, bounds, and parameters of synthetic measurements."""

from dataclasses import replace

import numpy as np
import pytest

from studies.thesis import machine_fit
from studies.thesis.machine import Machine, predictions, steps, top_speed
from studies.thesis.machine_fit import QUICK, SHARED, STRIBECK, evaluate, fit, placed, point_of
from studies.thesis.measurements import BOX, EXPERIMENTS, MEASUREMENTS, ThesisMeasurement

WEAK = Machine(rise=0.8, speed=0.3, shape=2.0, gain=0.8, reach=None)


def test_residuals_are_distances_to_the_measured_range():
    between = ThesisMeasurement("steps", "a range", 10.0, 20.0, 2.0, "mm", "", "")
    assert [between.residual(value) for value in (8.0, 10.0, 15.0, 26.0)] == [-1.0, 0.0, 0.0, 3.0]
    assert ThesisMeasurement("steps", "a bound", -np.inf, 5.0, 1.0, "mm", "", "").residual(-100.0) == 0.0


def test_no_constant_coefficient_reaches_the_top_speed():
    """At most 0.7192 of the table's speed (eq. 3.41): 317 mm/s anywhere in the box, 345 mm/s are measured."""
    box = {name: BOX[name] for name in ("horizontal_amplitude", "frequency")}
    most = 0.7192e3 * 2.0 * np.pi * box["horizontal_amplitude"].high * box["frequency"].high
    assert most < MEASUREMENTS["top"].low - MEASUREMENTS["top"].error
    for friction in (BOX["friction"].low, BOX["friction"].high):
        fastest = Machine(friction, horizontal_amplitude=2.75e-3, frequency=25.5, gain=1.1)
        assert 0.99 * most < top_speed(fastest)["top"] < most
    assert top_speed(Machine(top_frequency=28.7))["top"] == pytest.approx(350.0, abs=1.0)


def test_the_nominal_machine_reproduces_all_but_top_speed_and_steps():
    nominal = evaluate(Machine(), ("friction", "steady", "top speed", "squeeze"))
    assert nominal.worst == "top" and nominal.residuals[list(nominal.predicted).index("top")] < -8.0
    assert np.abs(np.delete(nominal.residuals, list(nominal.predicted).index("top"))).max() < 0.1
    assert set(predictions(Machine(), ("steps",))) == {k for k, v in MEASUREMENTS.items() if v.experiment == "steps"}


def test_fits_recover_the_parameters_of_synthetic_measurements(monkeypatch):
    """Also the constant fit to a machine with falling friction fails, at the top speed."""
    measured = predictions(WEAK, QUICK)
    synthetic = {
        name: replace_bounds(MEASUREMENTS[name], value) for name, value in measured.items() if name != "steady 0.08"
    }
    monkeypatch.setattr("studies.thesis.machine.MEASUREMENTS", {**MEASUREMENTS, **synthetic})
    start = Machine(rise=0.5, speed=0.35, gain=0.9, reach=None)
    names = ("friction", "gain", "rise", "speed")
    point = np.array([1.2, 1.7, 1.4, 1.1])
    assert point_of(placed(start, names, point), names) == pytest.approx(point)
    fitted = fit(start, names, QUICK, evaluations=40)
    assert fitted.largest < 0.05
    for name in names:
        assert getattr(fitted.machine, name) == pytest.approx(getattr(WEAK, name), rel=0.02)
    constant = fit(Machine(reach=None), SHARED, QUICK)
    assert constant.worst == "top" and constant.largest > 2.0


def replace_bounds(measured, value):
    return measured._replace(low=value, high=value, error=0.2 * measured.error)


def test_fits_of_steps_recover_set_position_and_limit(monkeypatch):
    true = Machine(form="soft", step=0.29, limit=0.26e-3)
    synthetic = {name: replace_bounds(MEASUREMENTS[name], value) for name, value in steps(true).items()}
    monkeypatch.setattr("studies.thesis.machine.MEASUREMENTS", {**MEASUREMENTS, **synthetic})
    fitted = fit(replace(true, step=0.3, limit=0.25e-3), ("step", "limit"), ("steps",), evaluations=6)
    assert fitted.machine.step == pytest.approx(true.step, rel=5e-3)
    assert fitted.machine.limit == pytest.approx(true.limit, rel=2e-2)


def test_the_command_prints_all_tables(tmp_path, monkeypatch, capsys):
    """With starts in place of fits."""
    for name, fewer in (("COVERING", 4), ("STARTS", 1), ("SAMPLES", 1), ("LATENCIES", (1,)), ("FORMS", ("soft",)),
                        ("GAINS", (1.0,)), ("SUBSETS", (QUICK,))):  # fmt: skip
        monkeypatch.setattr(machine_fit, name, fewer)
    monkeypatch.setattr(machine_fit, "fit", lambda start, _, experiments, **settings: evaluate(start, experiments))
    monkeypatch.setattr("sys.argv", ["machine_fit", "--output", str(tmp_path)])
    machine_fit.main()
    printed = capsys.readouterr().out
    assert all(measured.what in printed for measured in MEASUREMENTS.values())
    assert all(model.label in printed for model in machine_fit.MODELS.values())
    assert len(list(tmp_path.glob("*.json"))) == 1 + len(machine_fit.MODELS) + 1 + 3 + 1
    assert {measured.experiment for measured in MEASUREMENTS.values()} == set(EXPERIMENTS)
    assert set(STRIBECK) < set(BOX)
