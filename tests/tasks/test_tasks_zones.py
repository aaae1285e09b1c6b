"""Kinds, zones and room, and bad input."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tasks.helpers import made
from tests.tasks.test_tasks_starts import ALUMINIUM, DISC, ELL, SIX, STEEL, SURFACE
from vibgym import Part, Surface
from vibgym.tasks import Singulate, Sort

WIDTH, HEIGHT, COLUMN = 0.832, 0.208, 0.026


def test_default_zones_are_six_columns_at_the_ends_and_in_the_middle():
    task = Sort(SURFACE, [STEEL, DISC, ALUMINIUM, STEEL])
    assert task.kinds == ("steel", "disc", "aluminium") and task.kind.tolist() == [0, 1, 2, 0]
    columns = task.zones[:, [0, 2]] / COLUMN
    assert columns == pytest.approx(np.array([[0, 6], [26, 32], [13, 19]]))
    assert task.zones[:, [1, 3]] == pytest.approx(np.array([[0, HEIGHT]] * 3))
    assert task.rules(1).zone == pytest.approx(task.zones[[0, 1, 2, 0]])
    assert task.rules(1).slow == 0.020 and task.rules(1).hold == 10


def test_custom_zones():
    zones = {"steel": [0.4, 0.0, WIDTH, 0.208], "aluminium": (0, 0, 0.3, 0.2)}
    task = made(Sort, SURFACE, SIX, zones=zones)
    assert task.zones.tolist() == [[0.4, 0.0, WIDTH, 0.208], [0.0, 0.0, 0.3, 0.2]]
    halves = {"steel": [0, 0, 0.416, HEIGHT], "aluminium": [0.416, 0, 32 * 0.026, HEIGHT]}  # share a border
    assert made(Sort, SURFACE, SIX, zones=halves).zones.shape == (2, 4)


def test_singulate_has_no_zones():
    task = Singulate(SURFACE, SIX)
    assert task.zones is None and task.apart == pytest.approx(0.036770, abs=1e-6)
    assert (task.rules(1).zone[:, :2] == -np.inf).all() and (task.rules(1).zone[:, 2:] == np.inf).all()


LEFT, RIGHT = [0.0, 0.0, 0.156, HEIGHT], [0.676, 0.0, WIDTH, HEIGHT]
FOUR_KINDS = [STEEL, ALUMINIUM, DISC, ELL]
BAD = [
    ({"zones": {"steel": LEFT, "aluminium": RIGHT, "gold": LEFT}}, r"zones"),
    ({"zones": {"steel": LEFT}}, r"zones"),
    ({"zones": {"steel": LEFT[:3], "aluminium": RIGHT}}, r"zones\.steel"),
    ({"zones": {"steel": [0.156, 0, 0, 0.2], "aluminium": RIGHT}}, r"zones\.steel"),
    ({"zones": {"steel": [-0.001, 0, 0.2, 0.2], "aluminium": RIGHT}}, r"zones\.steel"),
    ({"zones": {"steel": LEFT, "aluminium": [0.155, 0, WIDTH, 0.2]}}, r"zones\.aluminium"),
    ({"zones": {"steel": [0, 0, 0.13, 0.1], "aluminium": RIGHT}}, r"zones\.steel"),
    ({"parts": FOUR_KINDS}, r"parts"),
    ({"parts": [STEEL] * 37}, r"parts"),
    ({"parts": [Part.disc(0.105, friction=0.5)]}, r"parts"),
    ({"parts": SIX, "start": "piled"}, r"start"),
    ({"slots": 5}, r"slots"),
    ({"randomize": {"parts": [4, 3]}}, r"randomize\.parts"),
    ({"randomize": {"parts": [1, 7]}}, r"randomize\.parts"),
]  # fmt: skip


@pytest.mark.parametrize("settings, words", BAD, ids=lambda each: str(each)[:60])
def test_bad_settings(settings, words):
    settings = {"parts": SIX, **settings}
    with pytest.raises(ValueError, match=words) as error:
        made(Sort, SURFACE, settings.pop("parts"), **settings)
    assert "\n" not in str(error.value)


def test_surfaces_too_small():
    with pytest.raises(ValueError, match=r"zones"):
        Sort(Surface(columns=11), SIX)
    with pytest.raises(ValueError, match=r"parts"):
        Sort(Surface(rows=6, columns=6), SIX)
    with pytest.raises(ValueError, match=r"parts"):
        Singulate(SURFACE, [STEEL] * 17)


def test_room_is_required_for_simultaneous_parts_only():
    task = made(Sort, SURFACE, [STEEL] * 40, zones={"steel": [0, 0, WIDTH, HEIGHT]}, randomize={"parts": [1, 30]})
    assert len(task.parts) == 40
    narrow = {"steel": [0, 0, 0.13, 0.1], "aluminium": RIGHT}  # room for two
    assert made(Sort, SURFACE, SIX, zones=narrow, randomize={"parts": [1, 2]}).starts.most == 2


@given(st.integers(1, 12), st.integers(1, 3))
def test_kinds_are_names_in_order_of_appearance(count, kinds):
    pool = [STEEL, DISC, ALUMINIUM][:kinds]
    parts = [pool[(7 * k + 1) % kinds] for k in range(count)]
    task = made(Sort, SURFACE, parts, zones={part.name: [0.27 * k, 0, 0.27 * (k + 1), HEIGHT] for k, part in enumerate(pool)
                                       if part in parts})  # fmt: skip
    assert [task.kinds[kind] for kind in task.kind] == [part.name for part in parts]
    first_seen = [task.kind.tolist().index(kind) for kind in range(len(task.kinds))]
    assert first_seen == sorted(first_seen)
