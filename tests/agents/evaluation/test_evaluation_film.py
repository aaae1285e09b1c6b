"""Films of pages: what the browser reads is what was recorded, within half a tenth of a millimetre and of a degree."""

import base64
import dataclasses
import gzip
import json
import math

import numpy as np
import pytest

from agents.evaluation import films
from vibgym.rendering import Side, colours

BYTES = 25_000
"""Of a film in base64, without those whose elements all move at random."""


def read(text):
    """The mapping, with poses and goals (frames, parts, 3) in m and rad again."""
    content = json.loads(gzip.decompress(base64.b64decode(text)))
    for name in ("poses", "goals"):
        lists = content.get(name, [])
        series = [np.cumsum(each + [0] * (content["frames"] - len(each))) for each in lists]
        values = np.array(series).T.reshape(content["frames"], -1, 3)
        content[name] = values / (films.PER_METRE, films.PER_METRE, films.PER_RADIAN)
    return content


def watched(found):
    return [(place, one.film, found.scenery[place.task], one.step_time) for (place, _), one in found.rollouts.items()]


@pytest.mark.parametrize("several_parts", [False, True])
def test_poses_come_back(several_parts, request):
    results = request.getfixturevalue("several" if several_parts else "found")
    for _, each, scenery, step_time in watched(results):
        content, shown = read(films.packed(each, scenery, step_time)), films.frames_shown(each)
        assert content["frames"] == len(shown) <= films.MOST_PAGE_FRAMES
        assert shown[0] == 0 and shown[-1] == len(each.poses) - 1
        there = each.present[shown]
        for name in ("poses", "goals") if scenery.goal_size else ("poses",):
            error = content[name] - getattr(each, name)[shown]
            error[..., 2] = np.angle(np.exp(1j * error[..., 2]))
            assert np.abs(error[there]).max(axis=0) == pytest.approx([0, 0, 0], abs=1.01 * math.radians(0.05))
            assert np.abs(error[there][:, :2]).max() <= 0.51e-4
        assert content["captions"] == [each.captions[frame] for frame in shown]


def test_a_film_is_small(found, several):
    for results in (found, several):
        for trial, each, scenery, step_time in watched(results):
            assert len(films.packed(each, scenery, step_time)) < BYTES, trial


def test_elements_come_back_with_their_colours(found):
    _, each, scenery, step_time = watched(found)[1]
    content, shown = read(films.packed(each, scenery, step_time)), films.frames_shown(each)
    for k, frame in list(enumerate(shown))[:: max(1, len(shown) // 5)]:
        codes = np.array([ord(text[k if len(text) > 1 else 0]) for text in content["field"]]) - films.REST_CODE - 1
        strength = np.where(codes < 0, 0.0, (1 + codes // films.PHASES) / films.AMPLITUDES)
        phase = (codes % films.PHASES) * 2.0 * np.pi / films.PHASES
        seen = colours.element_colours(strength[:, None] * np.stack([np.cos(phase), np.sin(phase)], axis=-1))
        wanted = colours.element_colours(each.phasors[frame]).reshape(-1, 3)
        assert len(seen) == scenery.rows * scenery.columns
        # A step of the phase is 11 degrees, one of the amplitude a seventh.
        assert np.abs(seen.astype(int) - wanted).max() <= 16


def test_who_is_absent_or_waits_beside_the_table_is_not_there(several):
    each, scenery = several.rollout("Sort", "ideal", "shepherd").film, several.scenery["Sort"]
    present, poses = each.present.copy(), each.poses.copy()
    present[:, 0], present[2:4, 1], poses[5:, 2, 0], poses[1, 3] = False, False, 30.0, math.nan
    changed = dataclasses.replace(each, present=present, poses=poses)
    there = read(films.packed(changed, scenery, 0.04))["there"]
    assert set(there[0]) == {"0"} and there[1].startswith("110011")
    assert there[2].startswith("1111100") and there[3].startswith("1011")


def test_the_view_from_the_side(found):
    each, scenery = found.rollout("Align", "ideal", "pusher").film, found.scenery["Align"]
    side = Side([np.array([[0.1, 0.05, 1e-4], [0.12, 0.05, -2e-4], [0.11, 0.07, 0.0]])], np.array([[0.1, 0.126, 3e-4]]))
    tilting = dataclasses.replace(each, sides=(side,) * len(each.sides))
    plates, (bottom,) = read(films.packed(tilting, scenery, 0.04))["sides"][0]
    assert plates == [1000, 1260, 30] and bottom == [1000, 10, 1200, -20, 1100, 0]
    picture, (width, height) = films.still(tilting, scenery)
    flat = films.still(each, scenery)
    assert (width, height) == (flat[1][0], flat[1][1] + films.SIDE) and len(picture) < 40_000


def test_the_same_film_is_packed_alike(found):
    _, each, scenery, step_time = watched(found)[2]
    assert films.packed(each, scenery, step_time) == films.packed(each, scenery, step_time)
