"""Excitation, simulated recordings, and the files of recordings."""

from __future__ import annotations

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.identification import Camera, Excitation, Log, record

BLOCK = Part.rectangle(0.050, 0.035, friction=0.58, height=0.02)
DISC = Part.disc(0.02, friction=0.7)


def test_commands_are_valid_and_follow_from_the_seed():
    surface = Surface()
    first, second = (Excitation(surface, [BLOCK, DISC], 4) for _ in range(2))
    for pose in (first.start, first.start + 0.01, np.full((2, 3), np.nan)):
        amplitude, phase = first.command(pose)
        assert np.isfinite(phase).all()
        np.testing.assert_array_equal(second.command(pose), (amplitude, phase))
        assert amplitude.shape == phase.shape == (8, 32)
        assert (amplitude >= 0.0).all() and (amplitude <= surface.max_amplitude).all()


@pytest.mark.parametrize("seed", range(4))
def test_parts_stay_on_the_surface_and_apart(seed):
    actuators = {"kind": "prototype", "latency": 3, "phase": 0.6 * (-1) ** seed, "gain": 1.1}
    camera = Camera(noise_position=3e-4, dropout=0.05)
    log = record(Surface(), [BLOCK, BLOCK], actuators, camera, seconds=24.0, seed=seed)
    pose = log.pose[np.isfinite(log.pose[..., 0]).all(axis=1)]
    assert (pose[..., :2] > 0.0).all() and (pose[..., 0] < 0.832).all() and (pose[..., 1] < 0.208).all()
    assert np.hypot(*(pose[:, 0] - pose[:, 1])[:, :2].T).min() > 2.0 * BLOCK.radius
    assert np.ptp(pose[..., 0], axis=0).min() > 0.15  # they do move


def test_without_room_parts_are_refused():
    with pytest.raises(ValueError, match="side by side"):
        Excitation(Surface(), [BLOCK] * 12)


class Constant:
    """Uniform command along +x."""

    start = np.array([[0.1, 0.1, 0.0]])

    def command(self, pose):
        return np.full((8, 32), 2e-4), np.full((8, 32), -0.5 * np.pi)


def test_a_recording_has_latency_and_the_map_of_the_camera():
    camera = Camera(scale=1.02, turn=0.02, x=3e-3, y=-2e-3)
    actuators = {"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0}
    exact, late, seen = (
        record(Surface(), BLOCK, {**actuators, "latency": latency}, *cameras, seconds=1.0, excitation=Constant())
        for latency, cameras in ((0, ()), (5, ()), (0, (camera,)))
    )
    np.testing.assert_allclose(late.pose[5:, 0, :2] - exact.pose[:-5, 0, :2], 0.0, atol=2e-5)
    middle = np.array([0.416, 0.104])
    turn = np.array([[np.cos(0.02), -np.sin(0.02)], [np.sin(0.02), np.cos(0.02)]])
    expected = middle + [3e-3, -2e-3] + 1.02 * (exact.pose[:, 0, :2] - middle) @ turn.T
    np.testing.assert_allclose(seen.pose[:, 0, :2], expected, atol=1e-12)
    np.testing.assert_allclose(seen.pose[:, 0, 2], exact.pose[:, 0, 2] + 0.02, atol=1e-12)
    np.testing.assert_allclose(seen.taken - seen.time, 0.04, atol=1e-12)


# -- files -------------------------------------------------------------------------------------------------------------

N = 6


def values(**changed):
    surface = Surface(rows=2, columns=3)
    rng = np.random.default_rng(0)
    content = {
        "time": 7.0 + 0.04 * np.arange(N),
        "amplitude": rng.uniform(0.0, 3e-4, (N, 2, 3)),
        "phase": rng.uniform(-3.0, 3.0, (N, 2, 3)),
        "pose": rng.uniform(0.0, 0.05, (N, 1, 3)),
        "taken": 7.04 + 0.04 * np.arange(N),
        "settings": {
            "surface": surface,
            "actuators": "prototype",
            "parts": [Part.disc(0.02, friction=0.6)],
            "who": "a",
        },
    }
    return {**content, **changed}


def at(name, index, value):
    array = values()[name].copy()
    array[index] = value
    return {name: array}


def test_a_file_returns_the_same_recording(tmp_path):
    log = Log(**values(**at("pose", 2, np.nan)))
    log.save(tmp_path / "log.npz")
    again = Log.load(tmp_path / "log.npz")
    for name in ("time", "amplitude", "phase", "pose", "taken"):
        np.testing.assert_array_equal(getattr(again, name), getattr(log, name))
    assert again.settings == log.settings
    assert again.settings["who"] == "a"
    assert again.surface == Surface(rows=2, columns=3)
    assert again.parts[0].same_as(Part.disc(0.02, friction=0.6))


def test_gaps_are_kept():
    time = values()["time"]
    time[3:] += 1.0
    assert len(Log(**values(time=time, taken=time + 0.04))) == N


def without(name):
    return {key: value for key, value in values()["settings"].items() if key != name}


@pytest.mark.parametrize(("changed", "name"), [
    (at("time", 3, 7.0), "log.time"), (at("time", 3, np.nan), "log.time"), ({"time": np.zeros(1)}, "log.time"),
    (at("taken", 3, 7.0), "log.taken"), (at("taken", 3, np.nan), "log.taken"), ({"taken": np.zeros(N + 1)}, "log.taken"),
    (at("amplitude", (0, 0, 0), -1e-4), "log.amplitude"), ({"amplitude": np.zeros((N, 3, 2))}, "log.amplitude"),
    ({"amplitude": np.zeros((1, 2, 3))}, "log.amplitude"), ({"phase": np.zeros((N, 2, 4))}, "log.phase"),
    (at("phase", 0, np.inf), "log.phase"), ({"pose": np.zeros((N, 2, 3))}, "log.pose"),
    (at("pose", (0, 0, 1), np.nan), "log.pose"), (at("pose", (0, 0, 1), np.inf), "log.pose"),
    ({"settings": None}, "log.settings"), ({"settings": without("surface")}, "surface"),
    ({"settings": {**without("surface"), "surface": {"rows": 0}}}, "rows"),
    ({"settings": {**without("parts"), "parts": []}}, "parts"),
    ({"settings": {**without("parts"), "parts": ["block"]}}, "parts"),
    ({"settings": {**values()["settings"], "f": print}}, "log.settings"),
])  # fmt: skip
def test_bad_values_are_refused(changed, name):
    with pytest.raises(ValueError, match=rf"^[^\n]*{name}[^\n]*$"):
        Log(**values(**changed))


def test_bad_files_are_refused(tmp_path):
    other = tmp_path / "other.npz"
    np.savez(other, time=np.zeros(3))
    text = tmp_path / "log.txt"
    text.write_text("no")
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, **{**values(), "settings": np.array({"a": 1}, dtype=object)})
    for path, message in ((other, "amplitude"), (text, "log.txt"), (tmp_path / "none", "none"), (pickled, "pickled")):
        with pytest.raises(ValueError, match=message):
            Log.load(path)
