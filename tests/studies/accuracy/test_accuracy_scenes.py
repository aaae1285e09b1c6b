"""Scenes from mappings: what they draw, what they refuse, and when a run counts as a success."""

import math

import numpy as np
import pytest

from studies.accuracy.candidates import prepare_model
from studies.accuracy.scenes import first_periods, scenes_from

GOOD = {"name": "one", "worlds": 5, "periods": 6, "settle": 2, "drive": {"kind": "random", "every": 2}}


def scene(**changes):
    settings = {key: value for key, value in {**GOOD, **changes}.items() if value is not None}
    return scenes_from([settings])[0]


@pytest.mark.parametrize("changes, name", [
    ({"drive": None}, "scenes.0.drive"),
    ({"drive": {"kind": "uniform", "amplitude": 1.0}}, "scenes.0.drive.amplitude"),
    ({"settle": 6}, "scenes.0.settle"),
    ({"settle": 3}, "scenes.0.drive.every"),
    ({"part": "brick"}, "scenes.0.part"),
    ({"surface": {"rows": -3}}, "scenes.0.surface"),
    ({"start": {"x": [0.0, 7.0]}}, "scenes.0.start.x"),
    ({"start": {"spin": [2.0, 1.0]}}, "scenes.0.start.spin"),
    ({"settle": 0, "drive": {"kind": "fields", "fields": [{"kind": "squeeze", "x": 0.1, "y": 0.1}]}},
     "scenes.0.drive.fields.0.angle"),
])  # fmt: skip
def test_scenes_that_do_not_fit_together(changes, name):
    with pytest.raises(ValueError) as caught:
        scene(**changes)
    line = str(caught.value)
    assert "scenes.0" in line and name.rpartition(".")[2] in line and "\n" not in line


def test_names_are_unique():
    with pytest.raises(ValueError, match=r"scenes\.1\.name"):
        scenes_from([GOOD, GOOD])


def test_drives_last_as_long_as_asked_for():
    changing, held = scene(periods=7), scene(drive={"kind": "random"})
    assert [segment.periods for segment in changing.segments] == [2, 2, 2, 1] and changing.periods == 7
    assert not changing.held and held.held
    assert [segment.periods for segment in held.segments] == [2, 4] and held.segments[0].amplitude is held.segments[
        1
    ].amplitude
    assert (changing.segments[0].phase != changing.segments[1].phase).all()
    again = scene(periods=7)
    assert (again.segments[3].amplitude == changing.segments[3].amplitude).all() and (again.pose == changing.pose).all()
    assert (scene(seed=1).pose[:, 0] != changing.pose[:, 0]).all()


def test_random_phasors_fill_the_ring_evenly():
    """Of an even density in a ring, the square of the radius is even: its mean is the middle of the squares."""
    drawn = scene(worlds=60, drive={"kind": "random", "strength": 0.9, "least_strength": 0.5}).segments[0].amplitude
    share = drawn / scene().surface.max_amplitude
    assert share.min() >= 0.5 and share.max() <= 0.9
    assert np.mean(share**2) == pytest.approx((0.25 + 0.81) / 2, abs=5e-3)
    assert scene(drive={"kind": "random", "least_strength": 1.0}).segments[0].amplitude.min() == pytest.approx(
        scene().surface.max_amplitude
    )


def test_starts():
    still = scene(start={"velocity": "rest", "spin": [3.0, 3.0], "x": [0.2, 0.2], "heading_deg": [90, 90]})
    assert still.velocity.tolist() == [[0.0, 0.0, 3.0]] * 5
    assert still.pose[:, 0].tolist() == [0.2] * 5 and still.pose[:, 2] == pytest.approx(math.pi / 2)
    assert np.abs(still.pose[:, 1] - 0.104).max() <= 0.026
    idle = scene()
    assert idle.velocity[0, :2] == pytest.approx(idle.surface.idle_velocity(idle.part.friction))


def test_a_beginning_is_the_beginning():
    """The first periods of a scene end where the whole one was after so many."""
    whole = scene(settle=0, periods=5)
    short = first_periods(whole, 3, 2)
    assert short.worlds == 2 and [segment.periods for segment in short.segments] == [2, 1]
    settled = prepare_model(scene(settle=2, periods=5), "planar", {})().settled
    assert (prepare_model(first_periods(whole, 2, 5), "planar", {})().pose == settled).all()


def test_sliding_is_known():
    assert scene().slides and not scene(surface={"horizontal_amplitude": 3e-4}).slides
