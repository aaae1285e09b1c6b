"""Recordings: what is kept, and what is refused."""

from __future__ import annotations

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.identification import Log

N = 6


def values(**changed):
    surface = Surface(rows=2, columns=3)
    rng = np.random.default_rng(0)
    found = {
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
    return {**found, **changed}


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
    settings = dict(values()["settings"])
    del settings[name]
    return settings


@pytest.mark.parametrize(
    ("changed", "name"),
    [
        (at("time", 3, 7.0), "log.time"),
        (at("taken", 3, 7.0), "log.taken"),
        (at("time", 3, np.nan), "log.time"),
        (at("taken", 3, np.nan), "log.taken"),
        (at("amplitude", (0, 0, 0), -1e-4), "log.amplitude"),
        ({"amplitude": np.zeros((N, 3, 2))}, "log.amplitude"),
        ({"amplitude": np.zeros((1, 2, 3))}, "log.amplitude"),
        ({"phase": np.zeros((N, 2, 4))}, "log.phase"),
        (at("phase", 0, np.inf), "log.phase"),
        ({"pose": np.zeros((N, 2, 3))}, "log.pose"),
        (at("pose", (0, 0, 1), np.nan), "log.pose"),
        (at("pose", (0, 0, 1), np.inf), "log.pose"),
        ({"taken": np.zeros(N + 1)}, "log.taken"),
        ({"time": np.zeros(1)}, "log.time"),
        ({"settings": None}, "log.settings"),
        ({"settings": without("surface")}, "surface"),
        ({"settings": {**without("surface"), "surface": {"rows": 0}}}, "rows"),
        ({"settings": {**without("parts"), "parts": []}}, "parts"),
        ({"settings": {**without("parts"), "parts": ["block"]}}, "parts"),
        ({"settings": {**values()["settings"], "f": print}}, "log.settings"),
    ],
)
def test_bad_values_are_refused(changed, name):
    with pytest.raises(ValueError) as error:
        Log(**values(**changed))
    assert name in str(error.value)
    assert "\n" not in str(error.value)


def test_bad_files_are_refused(tmp_path):
    other = tmp_path / "other.npz"
    np.savez(other, time=np.zeros(3))
    text = tmp_path / "log.txt"
    text.write_text("no")
    pickled = tmp_path / "pickled.npz"
    np.savez(pickled, **{**values(), "settings": np.array({"a": 1}, dtype=object)})
    for path, message in (
        (other, "amplitude"),
        (text, "log.txt"),
        (tmp_path / "none.npz", "none.npz"),
        (pickled, "pickled"),
    ):
        with pytest.raises(ValueError, match=message):
            Log.load(path)
