"""Identification of simulated machines: truth, linear algebra, intervals, errors."""

from __future__ import annotations

import math
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest
import yaml

from vibgym import Part, Surface
from vibgym.__main__ import main
from vibgym.identification import Camera, Excitation, Log, fit, record
from vibgym.identification.command import page, settings_text
from vibgym.identification.fit import Fit
from vibgym.identification.guess import first_estimates, starts_of
from vibgym.identification.law import applied
from vibgym.identification.plant import LOCAL
from vibgym.identification.solver import STATE_SCALE, Estimate

NOMINAL = Surface(rows=5, columns=8, max_amplitude=0.35e-3)
TRUE = replace(NOMINAL, horizontal_amplitude=2.5e-3, frequency=24.6)
PART, TRUE_PART = (Part.rectangle(0.050, 0.035, friction=mu, height=0.02, name="block") for mu in (0.58, 0.5))
CAMERA = Camera(scale=1.01, turn=0.01, x=2e-3, y=-1e-3, noise_position=2e-4, noise_heading=3e-3, dropout=0.02)


def machine(**changed):
    rng = np.random.default_rng(5)
    elements = np.stack([1.0 + 0.05 * rng.standard_normal((5, 8)), 0.08 * rng.standard_normal((5, 8))], axis=-1)
    settings = {
        "kind": "prototype", "gain": 0.9, "phase": 0.4, "dead_zone": 0.8e-4, "dead_zone_form": "soft", "latency": 2,
        "gain_spread": 0.0, "phase_spread": 0.0, "elements": elements.tolist(),
    }  # fmt: skip
    return {**settings, **changed}


def recording(seconds=32.0, actuators=None, seed=1, camera=CAMERA, excitation=None):
    settings = {"surface": NOMINAL, "actuators": "prototype", "parts": [PART]}
    return record(
        TRUE, TRUE_PART, machine() if actuators is None else actuators, camera, seconds=seconds, seed=seed, settings=settings,
        excitation=excitation or Excitation(NOMINAL, PART, seed),
    )  # fmt: skip


@pytest.fixture(scope="module")
def log():
    return recording()


@pytest.fixture(scope="module")
def fitted(log):
    return fit(log)


TRUTH = {
    "friction": 0.5, "horizontal_amplitude": 2.5e-3, "frequency": 24.6, "gain": 0.9, "phase": 0.4, "dead_zone": 0.8e-4,
    "camera_scale": 1.01, "camera_turn": 0.01, "camera_x": 2e-3, "camera_y": -1e-3, "noise_position": 2e-4,
    "noise_heading": 3e-3,
}  # fmt: skip


@pytest.mark.full
def test_estimates_agree_with_the_truth_within_their_intervals(fitted):
    assert fitted.values["latency"] == 2
    assert fitted.values["dead_zone_form"] == "soft"
    for name, true in TRUTH.items():
        low, high = fitted.intervals[name]
        half = 0.5 * (high - low)
        assert abs(fitted.values[name] - true) <= 2.0 * half + 1e-9, name  # four standard deviations
        assert low <= fitted.values[name] <= high, name
    assert abs(fitted.values["friction"] / 0.5 - 1.0) < 0.02
    assert abs(fitted.values["horizontal_amplitude"] / 2.5e-3 - 1.0) < 0.02


@pytest.mark.full
def test_gains_of_elements_are_better_than_none(fitted):
    true = np.array(machine()["elements"]) - np.array([1.0, 0.0])
    known = fitted.element_deviations[..., 0] < 0.8 * fitted.values["gain_spread"]
    assert known.sum() > 10
    error = (fitted.elements - true)[known]
    error -= error.mean(axis=0)  # the common gain is judged above
    assert (error.std(axis=0) < 0.75 * true[known].std(axis=0)).all()
    z = error / fitted.element_deviations[known]
    assert (0.5 < z.std(axis=0)).all() and (z.std(axis=0) < 1.5).all()


@pytest.mark.full
def test_correlations_are_those_of_a_covariance(fitted):
    names = list(dict.fromkeys(a for a, _ in fitted.correlation))
    matrix = np.array([[fitted.correlation[a, b] for b in names] for a in names])
    assert (np.linalg.eigvalsh(matrix) > -1e-9).all()
    np.testing.assert_allclose(np.diag(matrix), 1.0)


def prepared(log, segments):
    """Return a fit, its solver, first estimates and the parts' starts."""
    job = Fit(log, NOMINAL, (PART,), print)
    job.use_segments(segments)
    plant = job.solver.plant
    parameters = first_estimates(log, plant.segments, job.surface, job.kinds, job.sheet)[0]
    return job, job.solver, parameters, starts_of(plant.segments, parameters, job.surface)


def test_the_linear_algebra_is_that_of_one_dense_least_squares_problem(log):
    job, solver, parameters, starts = prepared(log, 12)
    now = Estimate(parameters, starts, np.array([3e-4, 4e-3]), job.prior(parameters))
    which = [3, 7, 20, 31]
    system = solver.linearize(which, now, True)
    step, covariance = solver.posterior(system, now)
    shared, size = len(job.names), len(step)
    rows, rest = [], []
    derivatives = solver.plant.differentiate(which, parameters, starts, elements=True)
    residuals = solver.residuals(which, now)
    for k, (segment, derivative, residual) in enumerate(zip(which, derivatives, residuals, strict=True)):
        weights, measured = solver.weights(segment, now.noise), solver.plant.segments[segment]
        full = np.zeros((*measured.pose.shape, size + LOCAL * len(which)))
        full[..., :shared] = derivative.shared
        for m, (row, column) in enumerate(measured.elements):
            at = shared + 2 * (row * NOMINAL.columns + column)
            full[..., at : at + 2] = derivative.elements[:, :, m]
        full[..., size + LOCAL * k : size + LOCAL * (k + 1)] = derivative.local * STATE_SCALE
        rows.append((full * weights[:, None]).reshape(-1, full.shape[-1]))
        rest.append((residual * weights).ravel())
    deviation = np.concatenate([now.prior.deviation, np.tile(now.prior.spread, NOMINAL.rows * NOMINAL.columns)])
    prior = np.zeros((size, size + LOCAL * len(which)))
    prior[:, :size] = np.diag(1.0 / deviation)
    away = np.concatenate([(now.prior.mean - parameters.vector()) / now.prior.deviation, np.zeros(size - shared)])
    ridge = np.zeros((LOCAL * len(which), prior.shape[1]))
    ridge[:, size:] = 1e-3 * np.eye(LOCAL * len(which))
    dense = np.concatenate([*rows, prior, ridge])
    expected, *_ = np.linalg.lstsq(dense, np.concatenate([*rest, away, np.zeros(len(ridge))]), rcond=None)
    inverse = np.linalg.inv(dense.T @ dense)[:size, :size]
    np.testing.assert_allclose(np.diag(covariance), np.diag(inverse), rtol=1e-6)
    np.testing.assert_allclose(step / np.sqrt(np.diag(inverse)), expected[:size] / np.sqrt(np.diag(inverse)), atol=1e-5)
    measured = np.concatenate(rows)
    lever = np.einsum("ij,jk,ik->i", measured, np.linalg.inv(dense.T @ dense), measured).reshape(-1, 3)
    free = [2 * len(lever) - lever[:, :2].sum(), len(lever) - lever[:, 2].sum()]
    np.testing.assert_allclose(solver.freedom(system, covariance), free, rtol=1e-6)


def test_common_gain_and_phase_can_be_exchanged_with_those_of_the_elements(log):
    job, solver, parameters, starts = prepared(log, 40)
    derivatives = solver.plant.differentiate([3], parameters, starts, elements=True)[0]
    own = derivatives.elements.sum(axis=2)
    np.testing.assert_allclose(derivatives.shared[..., job.names.index("gain")], parameters.gain * own[..., 0])
    np.testing.assert_allclose(derivatives.shared[..., job.names.index("phase")], own[..., 1])
    direct = solver.plant.differentiate([3], parameters, starts)[0]
    for name in ("gain", "phase"):
        one, other = (source.shared[..., job.names.index(name)] for source in (derivatives, direct))
        np.testing.assert_allclose(one, other, atol=0.05 * np.abs(other).max())


@pytest.mark.full
def test_a_friction_law_is_found_where_there_is_one(fitted):
    assert fitted.values["friction_law"] == "constant"
    assert fitted.parts[0].friction_law is None
    part = applied(TRUE_PART, {"kind": "stribeck", "rise": 0.4, "speed": 0.2})
    settings = {"surface": NOMINAL, "actuators": "prototype", "parts": [PART]}
    result = fit(record(TRUE, part, machine(), CAMERA, seconds=32.0, seed=1, settings=settings,
                       excitation=Excitation(NOMINAL, PART, 1)))  # fmt: skip
    assert result.values["friction_law"] == "stribeck"
    for name, true in (("rise", 0.4), ("rise_speed", 0.2), ("friction", 0.5)):
        low, high = result.intervals[name]
        assert abs(result.values[name] - true) <= high - low, name  # four standard deviations
    law = result.parts[0].friction_law
    assert law is not None
    assert (law["rise"], law["speed"]) == (result.values["rise"], result.values["rise_speed"])
    assert "required, see its rise" in "\n".join(result.notes)


@pytest.mark.full
@pytest.mark.parametrize(("limit", "gain"), [(0.40e-3, 1.2), (0.34e-3, 1.2), (0.30e-3, 1.1)])
def test_the_limit_of_the_elements_may_differ_from_that_of_commands(limit, gain):
    nominal = replace(NOMINAL, max_amplitude=0.30e-3)
    settings = {"surface": nominal, "actuators": "prototype", "parts": [PART]}
    result = fit(record(replace(TRUE, max_amplitude=limit), TRUE_PART, machine(gain=gain, dead_zone=0.5e-4), CAMERA,
                       seconds=32.0, seed=1, settings=settings, excitation=Excitation(nominal, PART, 1)))  # fmt: skip
    assert result.values["friction_law"] == "constant"
    for name, true in (("friction", 0.5), ("horizontal_amplitude", 2.5e-3), ("gain", gain)):
        assert result.values[name] == pytest.approx(true, rel=0.03 if name == "gain" else 0.015), name
    expected = Surface(frequency=result.surface.frequency).max_amplitude if limit == 0.40e-3 else limit  # lift-off
    assert result.values["max_amplitude"] == result.surface.max_amplitude == pytest.approx(expected, rel=0.02)
    assert result.actuators["limit"] == 0.30e-3
    assert any("exceed the nominal" in note for note in result.notes) == (limit > 0.30e-3)


@pytest.mark.full
def test_parts_of_two_kinds_have_friction_of_their_own():
    surface = replace(NOMINAL, columns=14)
    actuators = {"kind": "prototype", "gain": 0.9, "latency": 1, "gain_spread": 0.0, "phase_spread": 0.0}
    disc, true_disc = (Part.disc(0.02, friction=mu, height=0.01, name="disc") for mu in (0.6, 0.7))
    settings = {"surface": surface, "actuators": "prototype", "parts": [PART, disc]}
    log = record(replace(TRUE, columns=14), [TRUE_PART, true_disc], actuators, CAMERA, seconds=32.0, seed=2,
                 settings=settings, excitation=Excitation(surface, [PART, disc], 2))  # fmt: skip
    result = fit(log, surface, [PART, disc])
    assert result.values["latency"] == 1
    for name, true in (("friction.block", 0.5), ("friction.disc", 0.7)):
        low, high = result.intervals[name]
        assert abs(result.values[name] - true) <= high - low, name  # four standard deviations
        assert abs(result.values[name] / true - 1.0) < 0.02
    for part in result.parts:
        assert part.friction == pytest.approx(result.values[f"friction.{part.name}"])
    assert result.values["friction_law.block"] == result.values["friction_law.disc"] == "constant"


@pytest.mark.full
def test_environments_load_the_settings_file(fitted):
    settings = yaml.safe_load(settings_text(fitted))
    env = gym.make("vibgym/Align-v0", **settings)
    env.reset(seed=0)
    env.step(env.action_space.sample())
    assert env.get_wrapper_attr("surface") == fitted.surface
    assert env.get_wrapper_attr("parts")[0].friction == pytest.approx(fitted.values["friction"])


@pytest.mark.full
def test_command_writes_page_and_settings(log, tmp_path, capsys, monkeypatch, fitted):
    # Fitted above, from the same recording.
    monkeypatch.setattr("vibgym.identification.command.fit", lambda log, report, force: fitted)
    log.save(tmp_path / "log.npz")
    assert main(["identify", str(tmp_path / "log.npz"), "--quiet"]) == 0
    assert "friction" in capsys.readouterr().out
    assert (tmp_path / "identified.html").read_text() == page(fitted, "Identification of log.npz")
    actuators = yaml.safe_load((tmp_path / "machine.yaml").read_text())["actuators"]
    assert actuators["latency"] == 2 and actuators["compensate"] is True
    (tmp_path / "bad.npz").write_text("no")
    assert main(["identify", str(tmp_path / "bad.npz")]) == 2
    assert capsys.readouterr().err.count("\n") == 1


@pytest.mark.full
def test_gaps_are_reported_and_left_out(log):
    keep = np.ones(len(log), dtype=bool)
    keep[300:317] = False
    parts = {name: getattr(log, name)[keep] for name in ("time", "amplitude", "phase", "pose", "taken")}
    result = fit(Log(**parts, settings=log.settings))
    assert "gap of 17 cycles after row 299" in result.notes
    low, high = result.intervals["friction"]
    assert abs(result.values["friction"] - 0.5) <= (high - low)


@pytest.mark.full
def test_a_recording_without_small_amplitudes_does_not_identify_the_dead_zone():
    class Strong(Excitation):
        def command(self, pose):
            amplitude, phase = super().command(pose)
            return np.where(amplitude > 0.0, np.maximum(amplitude, 2.6e-4), 0.0), phase

    result = fit(recording(16.0, excitation=Strong(NOMINAL, PART, 1)))
    assert "dead_zone" in result.unidentified
    assert "friction" not in result.unidentified


def some(log, rows, **changed):
    parts = {name: getattr(log, name)[rows] for name in ("time", "amplitude", "phase", "pose", "taken")}
    return Log(**{**parts, "settings": log.settings, **changed})


def seen(log, change):
    """Return a recording with other measurements."""
    return some(log, slice(None), pose=np.stack(change(*np.moveaxis(log.pose, -1, 0)), axis=-1))


@pytest.mark.full
@pytest.mark.parametrize(
    "fault", ["the fit has not converged", "noise_heading is 4.17 rad", "noise_position is 0.031 m"]
)
def test_a_result_that_is_not_to_be_used_is_refused_unless_forced(log, fitted, monkeypatch, tmp_path, capsys, fault):
    name, _, value = fault.partition(" is ")

    def run(job):
        if not value:
            job.faults.append(fault)
            return fitted
        return replace(fitted, values={**fitted.values, name: float(value.split()[0])})

    monkeypatch.setattr(Fit, "run", run)
    with pytest.raises(ValueError, match=fault):
        fit(log)
    assert fault in fit(log, force=True).notes[-1]
    log.save(tmp_path / "log.npz")
    assert main(["identify", str(tmp_path / "log.npz"), "--quiet"]) == 2
    assert fault in capsys.readouterr().err and not (tmp_path / "machine.yaml").exists()
    assert main(["identify", str(tmp_path / "log.npz"), "--quiet", "--force"]) == 0
    assert fault in capsys.readouterr().out and (tmp_path / "machine.yaml").exists()


@pytest.mark.full
def test_a_fit_that_leaves_the_range_of_the_model_names_units_and_axes(log):
    with pytest.raises(ValueError, match="check units, axes and nominal settings"):
        fit(seen(log, lambda x, y, h: (x, y, -h)))


@pytest.mark.parametrize(("change", "message"), [
    (lambda log: (log, Surface(), None), "commands for 5 x 8 elements"),
    (lambda log: (log, replace(NOMINAL, element_size=0.03), None), "0.026 m"),
    (lambda log: (log, replace(NOMINAL, max_amplitude=1e-4), None), "amplitude"),
    (lambda log: (log, None, [PART, PART]), "parts must be"),
    (lambda log: (log, replace(NOMINAL, frequency=15.0), None), "log.time"),
    (lambda log: (some(log, slice(0, 100)), None, None), "record longer"),
    (lambda log: (some(log, slice(None), amplitude=0.0 * log.amplitude), None, None), "too little excitation"),
    (lambda log: (some(log, slice(None), pose=math.nan * log.pose), None, None), "stretches"),
    (lambda log: (seen(log, lambda x, y, h: (1e3 * x, 1e3 * y, h)), None, None), "log.pose must be in m, on the table of"),
    (lambda log: (seen(log, lambda x, y, h: (x - 0.104, y - 0.065, h)), None, None), "on the table of 0.208 x 0.13 m"),
    (lambda log: (seen(log, lambda x, y, h: (x, y, np.degrees(h))), None, None), "headings in rad"),
    (lambda log: (some(log, slice(None), phase=np.degrees(log.phase)), None, None), "log.phase must be in [-2 pi, 2 pi]"),
    (lambda log: (seen(log, lambda x, y, h: (x, 0.13 - y, -h)), None, None), "if y is mirrored"),
    (lambda log: (seen(log, lambda x, y, h: (0.208 - x, y, np.pi - h)), None, None), "if x is mirrored"),
])  # fmt: skip
def test_unsuitable_recordings_are_refused(log, change, message):
    recorded, surface, parts = change(log)
    with pytest.raises(ValueError) as error:
        fit(recorded, surface, parts)
    assert message in str(error.value)
    assert "\n" not in str(error.value)


def test_a_known_camera_is_corrected():
    pose = np.random.default_rng(3).uniform([0.0, 0.0, -3.0], [0.2, 0.1, 3.0], (4, 2, 3))
    seen = CAMERA.measured(pose, TRUE)
    assert np.abs(seen - pose).max() > 1e-3
    np.testing.assert_allclose(CAMERA.corrected(seen, TRUE), pose, atol=1e-15)
