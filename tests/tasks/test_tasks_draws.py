"""Starts and goals that the tasks draw."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from vibgym import Part, Surface
from vibgym.tasks import Align, Rotate, Transport

TASKS = {"Transport": Transport, "Align": Align, "Rotate": Rotate}
PARTS = [
    Part.rectangle(0.050, 0.035, friction=0.58),
    Part.disc(0.1, friction=0.5),  # just fits
    Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05]], friction=0.5),
]
SURFACES = [Surface(), Surface(rows=32, columns=8)]
BELOW_ONE = np.nextafter(1.0, 0.0)
uniforms = st.lists(
    st.one_of(st.sampled_from([0.0, 0.5, BELOW_ONE]), st.floats(0.0, BELOW_ONE)), min_size=6, max_size=6
)


def outline_at(part, pose):
    cosine, sine = math.cos(pose[2]), math.sin(pose[2])
    return pose[:2] + part.outline @ np.array([[cosine, sine], [-sine, cosine]])


def drawn(task, surface, part, numbers):
    made = TASKS[task](surface, [part])
    start, goal = made.draw(np.array([numbers[: made.draws]]))
    assert start.shape == goal.shape == (1, 3)
    return start[0], goal[0]


@pytest.mark.parametrize("part", PARTS, ids=lambda part: part.name)
@pytest.mark.parametrize("surface", SURFACES, ids=["wide", "tall"])
@pytest.mark.parametrize("task", TASKS)
@given(numbers=uniforms)
def test_the_part_is_wholly_on_the_surface_at_start_and_goal(task, surface, part, numbers):
    for pose in drawn(task, surface, part, numbers):
        corners = outline_at(part, pose)
        assert np.isfinite(pose).all()
        assert (corners >= -1e-12).all() and (corners <= [surface.width + 1e-12, surface.depth + 1e-12]).all()


@given(numbers=uniforms)
def test_headings_and_turns_are_in_their_ranges(numbers):
    part, surface = PARTS[0], SURFACES[0]
    for task in TASKS:
        start, goal = drawn(task, surface, part, numbers)
        assert -math.pi <= start[2] <= math.pi
        if task == "Align":
            assert -math.pi <= goal[2] <= math.pi
        if task == "Rotate":
            assert (goal[:2] == start[:2]).all()
            assert abs(goal[2] - start[2]) <= 2 * math.pi + 1e-12


@pytest.mark.parametrize("task", TASKS)
def test_draws_fill_their_ranges(task):
    made = TASKS[task](Surface(), [PARTS[0]])
    start, goal = made.draw(np.random.default_rng(0).random((20_000, made.draws)))
    radius = PARTS[0].radius
    low, high = np.array([radius, radius]), np.array([0.832 - radius, 0.208 - radius])
    for poses in (start, goal):
        for axis in range(2):
            share = np.histogram(poses[:, axis], 10, (low[axis], high[axis]))[0] / len(poses)
            assert share == pytest.approx(0.1, abs=0.015)  # 7 standard deviations
    assert np.histogram(start[:, 2], 10, (-math.pi, math.pi))[0] / len(start) == pytest.approx(0.1, abs=0.015)
    turn = goal[:, 2] - start[:, 2]
    if task == "Rotate":
        assert np.histogram(turn, 10, (-2 * math.pi, 2 * math.pi))[0] / len(turn) == pytest.approx(0.1, abs=0.015)
    columns = {"Transport": [*start.T, *goal.T[:2]], "Align": [*start.T, *goal.T], "Rotate": [*start.T, turn]}[task]
    assert np.corrcoef(columns) == pytest.approx(np.eye(made.draws), abs=0.05)  # all numbers differ


@pytest.mark.parametrize("task", TASKS)
def test_parts_without_room_are_refused(task):
    with pytest.raises(ValueError, match="parts"):
        TASKS[task](Surface(), [Part.disc(0.105, friction=0.5)])
