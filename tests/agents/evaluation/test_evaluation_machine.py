"""Hardware in words: what is said follows from the settings, and nothing is said of what does nothing."""

import pytest

from agents.evaluation import machine
from vibgym import Surface
from vibgym.actuators import ACTUATORS, Actuators

SURFACE = Surface()
OFF = {"kind": "prototype", "dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}

ACTUATOR_CASES = {
    "hard": ({"dead_zone_mm": 0.1}, "hard dead zone of 0.1 mm", "less than 0.1 mm does not move at all"),
    "soft": ({"dead_zone": 2e-4, "dead_zone_form": "soft"}, "soft dead zone of 0.2 mm", "0.2 mm moves less than told"),
    "limit": ({"limit": 2.5e-4}, "at most 0.25 mm", "more than 0.25 mm."),
    "latency": ({"latency": 2}, "latency of 2 periods (80 ms)", "takes effect 2 periods (80 ms) late."),
    "gain": ({"gain_spread": 0.1}, "spread of 10 %", "off in amplitude by 10 % (standard deviation, drawn anew"),
    "phase": ({"phase_spread_deg": 3, "seed": 4}, "spread of 3°", "off in phase by 3° (standard deviation, drawn the"),
    "bandwidth": ({"bandwidth": 12.5}, "lag (12.5 Hz)", "lag (first order, 12.5 Hz)"),
    "resolution": ({"resolution": 2e-6}, "steps of 2 µm", "multiples of 2 µm"),
    "share": ({"dead": 0.02}, "2 % of the elements dead", "2 % of the elements, drawn at random, can never move."),
    "list": ({"stuck": [[0, 1, 1e-4, 0.0]]}, "1 of 256 elements stuck", "1 of 256 elements can only move"),
}
SENSOR_CASES = {
    "noise": ({"noise": [1e-4, 0.0]}, "noise of 0.1 mm", "off by 0.1 mm (standard deviation"),
    "both": ({"noise": {"position_mm": 0.2, "heading_deg": 0.4}}, "noise of 0.2 mm and 0.4°", "off by 0.2 mm and 0.4°"),
    "bias": ({"noise": 0.0, "bias": 1e-3}, "bias of 1 mm", "share an error of 1 mm"),
    "delay": ({"noise": 0.0, "delay": 1}, "measured 1 period (40 ms) late", "1 period (40 ms) old"),
    "dropout": ({"noise": 0.0, "dropout": 0.1}, "10 % of measurements missing", "10 % of the measurements"),
    "rate": ({"noise": 0.0, "rate": 12.5}, "12.5 measurements a second", "12.5 measurements in a second"),
    "model": ({"noise": 0.0, "estimator": "model"}, "model estimator", "A model estimator stands between"),
    "kalman": ({"noise": 0.0, "estimator": {"kind": "kalman"}}, "Kalman estimator", "A Kalman filter stands between"),
    "own": ({"noise": 0.0, "estimator": "mine"}, "mine estimator", "An estimator of kind mine stands between"),
    "told": ({"noise": 0.0, "tell": ["age", "sigma"]}, "tells age and sigma", "Observations also tell age and sigma"),
    "none": ({"noise": 0.0, "estimator": "none"}, "ideal", machine.IDEAL[1]),
}


@pytest.mark.parametrize("case", ACTUATOR_CASES)
def test_actuators(case):
    settings, short, sentence = ACTUATOR_CASES[case]
    off = {key: value for key, value in OFF.items() if f"{key}_mm" not in settings and f"{key}_deg" not in settings}
    environment = {"actuators": {**off, **settings}}
    assert machine.summary(environment, SURFACE) == short
    first, *others = machine.sentences(environment, SURFACE)
    assert sentence in first and others == [machine.IDEAL[1]]


@pytest.mark.parametrize("case", SENSOR_CASES)
def test_sensor(case):
    settings, short, sentence = SENSOR_CASES[case]
    environment = {"sensor": {"kind": "pose", **settings}}
    assert machine.summary(environment, SURFACE) == short
    first, *others = machine.sentences(environment, SURFACE)
    assert first == machine.IDEAL[0] and len(others) == 1 and sentence in others[0]


CAMERA_CASES = {
    "usual": ({}, "camera, 752 x 285 pixels, grey-level edges", "An image has 752 x 285 pixels."),
    "statistics": (
        {"statistical": True, "lines": "all"}, "statistics of a camera, 752 x 570 pixels, grey-level edges",
        "off as those of a camera are; no images are made.",
    ),
    "interlaced": (
        {"lines": "interlaced", "edge": "threshold"}, "camera, interlaced lines, whole pixels", "taken 20 ms before the others",
    ),
    "unusual": (
        {"lens_mm": 5, "tilt_deg": [1, 0], "noise": 3}, "camera, 752 x 285 pixels, grey-level edges, a tilt of 1 and 0°, "
        "a focal length of 5 mm, a noise of 3 grey levels", "The camera has a focal length of 5 mm.",
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CAMERA_CASES)
def test_camera(case):
    settings, short, sentence = CAMERA_CASES[case]
    environment = {"sensor": {"kind": "camera", **settings}}
    assert machine.summary(environment, SURFACE) == short
    assert sentence in " ".join(machine.sentences(environment, SURFACE))


def test_ideal():
    for environment in ({}, {"actuators": "ideal", "sensor": {"kind": "ideal"}}, {"actuators": OFF}):
        assert tuple(machine.sentences(environment, SURFACE)) == machine.IDEAL
        assert machine.summary(environment, SURFACE) == "ideal"


def test_defaults_are_spoken_of():
    environment = {"actuators": "prototype", "sensor": "pose"}
    assert machine.summary(environment, SURFACE) == (
        "hard dead zone of 0.1 mm, spread of 5 % and 5°, latency of 1 period (40 ms), noise of 0.1 mm and 0.2°"
    )
    assert len(machine.sentences(environment, SURFACE)) == 4


def test_what_is_drawn_for_every_episode():
    drawn = {"friction": [0.9, 1.1], "dead_zone": [5e-5, 1.5e-4], "incline_deg": [0.0, 0.5], "parts": [1, 3]}
    found = machine.sentences({"randomize": drawn}, SURFACE)[2:]
    assert (
        machine.sentences({"randomize": {"incline": 0.01}}, SURFACE)[2]
        == "Drawn anew for every episode: incline up to 0.573°."
    )
    assert found == [
        "Drawn anew for every episode: friction 90 to 110 %.",
        "Drawn anew for every episode: dead zone 0.05 to 0.15 mm.",
        "Drawn anew for every episode: incline 0 to 0.5°.",
        "Drawn anew for every episode: parts 1 to 3.",
    ]


def test_rigid_parts_that_are_struck_on_patches():
    struck = {"patches": [0.7, 1.3], "disturbance": {"rate": 0.25, "tilt_deg": [0.5, 3.0]}}
    environment = {"model": {"kind": "tilting", "ramp_mm": 1.0}, "randomize": struck}
    assert machine.sentences(environment, SURFACE)[2:] == [
        "Parts are rigid bodies: they rock where plates stand at different heights (restitution 0.2, plates' edges blended "
        "over 1 mm).",
        "Drawn anew for every episode: friction of each element 70 to 130 %.",
        "Every part is struck about 15 times a minute, as hard as a tilt of 0.5 to 3°.",
    ]
    assert machine.summary({"model": "planar"}, SURFACE) == "ideal"
    assert (
        "as hard as a tilt of 3°."
        in machine.sentences({"randomize": {"disturbance": {"rate": 1, "tilt_deg": 3}}}, SURFACE)[2]
    )


def test_actuators_of_ones_own(monkeypatch):
    class Coarse(Actuators):
        def __init__(self, *scene, least=1e-4, **base):
            super().__init__(*scene, **base)

        def realise(self, phasors):
            pass

    monkeypatch.setitem(ACTUATORS._items, "coarse", Coarse)
    found = machine.sentences({"actuators": {"kind": "coarse", "least": 2e-4, "latency": 1}}, SURFACE)
    assert found[:2] == [
        "The actuators are of kind coarse (least 0.0002).",
        "A command takes effect 1 period (40 ms) late.",
    ]
    assert machine.sentences({"actuators": "coarse"}, SURFACE) == [
        "The actuators are of kind coarse.",
        machine.IDEAL[1],
    ]
