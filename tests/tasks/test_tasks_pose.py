"""Transport, Align and Rotate: scores against a plain reference, symmetry of headings, starts and goals."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from tests.tasks.helpers import Scorer
from vibgym import Part, Surface
from vibgym.tasks import Align, Rotate, Start, Transport

TASKS = {"Transport": Transport, "Align": Align, "Rotate": Rotate}
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
SQUARE = Part.rectangle(0.04, 0.04, friction=0.58)
DISC = Part.disc(0.02, friction=0.58)
WEDGE = Part.polygon([[0, 0], [0.06, 0], [0, 0.03]], friction=0.5)
POSITION = {"Transport": 0.005, "Align": 0.002, "Rotate": 0.005}
HEADING = {"Transport": None, "Align": math.radians(3), "Rotate": math.radians(2)}


class Reference:
    """One world, written from the environment's documentation."""

    def __init__(self, task, period, pose, goal):
        self.task, self.period, self.goal, self.held = task, period, goal, 0
        self.distance, self.turn = self.errors(pose)

    def errors(self, pose):
        distance = math.hypot(self.goal[0] - pose[0], self.goal[1] - pose[1])
        turn = self.goal[2] - pose[2]
        if self.task == "Transport" or self.period == 0:
            turn = 0.0
        elif self.task == "Align":
            turn = min(abs(turn + k * self.period) for k in range(-40, 41))
        return distance, abs(turn)

    def step(self, pose, fallen, diverged):
        before, turned = self.distance, self.turn
        self.distance, self.turn = self.errors(pose)
        inside = self.distance <= POSITION[self.task] and (
            HEADING[self.task] is None or self.turn <= HEADING[self.task]
        )
        self.held = self.held + 1 if inside and not fallen and not diverged else 0
        success = self.held >= 10
        near = lambda value, scale: math.tanh(value / scale)  # noqa: E731
        terms = {
            "distance": min(max((before - self.distance) / 0.1, -1), 1),
            "approach": near(before, 0.01) - near(self.distance, 0.01),
            "turn": min(max(turned - self.turn, -1), 1),
            "alignment": near(turned, 0.15) - near(self.turn, 0.15),
            "inside": 0.1 if inside else 0.0,
            "time": -0.02,
            "success": 5.0 if success else 0.0,
            "fallen": -5.0 if fallen else 0.0,
        }
        return terms, success, success or fallen or diverged


@pytest.mark.parametrize("part, period", [(BLOCK, math.pi), (SQUARE, math.pi / 2), (DISC, 0), (WEDGE, 2 * math.pi)],
                         ids=["block", "square", "disc", "wedge"])  # fmt: skip
@pytest.mark.parametrize("task", TASKS)
def test_score_kernel(task, part, period):
    worlds, steps = 40, 40
    generator = np.random.default_rng(1)
    made = TASKS[task](Surface(), [part])
    drawn = made.start(generator.random((worlds, made.draws)))
    start, goal, pose = drawn.pose[:, 0], drawn.goal[:, 0], drawn.pose.copy()
    scorer = Scorer(made, worlds)
    scorer.begin(drawn)
    result = scorer.episode
    period = 1 if task == "Rotate" else period
    reference = [Reference(task, period, start[k], goal[k]) for k in range(worlds)]
    seen = {"success": 0, "fallen": 0, "diverged": 0}
    for step in range(steps):
        # Mostly near the goal, within tolerance; sometimes anywhere.
        spread = np.array([0.002, 0.002, 0.02]) * generator.choice([0.3, 1.0, 3.0], (worlds, 1), p=[0.9, 0.05, 0.05])
        pose[:, 0] = goal + spread * generator.standard_normal((worlds, 3))
        if task == "Align":
            pose[:, 0, 2] += generator.integers(-3, 4, worlds) * period
        away = generator.random(worlds) < 0.01
        pose[away, 0] = made.draw(generator.random((worlds, made.draws)))[0][away]
        fallen, diverged = generator.random((worlds, 1)) < 0.01, generator.random(worlds) < 0.01
        scorer.score(pose, 0.0, fallen, diverged)
        for k in range(worlds):
            terms, success, ended = reference[k].step(pose[k, 0], fallen[k, 0], diverged[k])
            assert result.terms[k] == pytest.approx([terms[name] for name in made.TERMS], abs=1e-8), (step, k)
            assert result.reward[k] == pytest.approx(sum(terms.values()), abs=1e-8)
            assert (result.success[k], result.ended[k]) == (success, ended), (step, k)
            assert result.position_error[k] == pytest.approx(reference[k].distance, abs=1e-15)
            assert result.heading_error[k] == abs(scorer.relations.error[k, 0, 2])
            assert result.heading_error[k] == pytest.approx(reference[k].turn, abs=1e-8)
        seen["success"] += result.success.sum()
        seen["fallen"] += fallen.sum()
        seen["diverged"] += diverged.sum()
    assert min(seen.values()) > 0


def heading_error(task, part, goal_heading, heading):
    scorer = Scorer(TASKS[task](Surface(), [part]), 1)
    there = np.ones((1, 1), dtype=bool)
    scorer.begin(Start(np.array([[[0.4, 0.1, heading]]]), there, np.array([[[0.4, 0.1, goal_heading]]])))
    return scorer.relations.error[0, 0, 2]


@pytest.mark.parametrize("part, symmetry", [(BLOCK, 2), (SQUARE, 4), (WEDGE, 1)], ids=["block", "square", "wedge"])
@given(goal=st.floats(-4, 4), heading=st.floats(-50, 50), turns=st.integers(-9, 9))
def test_align_counts_headings_modulo_the_parts_symmetry(part, symmetry, goal, heading, turns):
    period = 2 * math.pi / symmetry
    error = heading_error("Align", part, goal, heading)
    assert abs(error) <= period / 2 + 1e-12
    remainder = (goal - heading - error) / period
    assert remainder == pytest.approx(round(remainder), abs=1e-9)
    again = heading_error("Align", part, goal, heading + turns * period)
    assert min(abs(again - error), period - abs(again - error)) < 1e-9


@pytest.mark.parametrize("part", [BLOCK, DISC], ids=["block", "disc"])
@given(goal=st.floats(-10, 10), heading=st.floats(-50, 50))
def test_rotate_does_not_wrap(part, goal, heading):
    assert heading_error("Rotate", part, goal, heading) == goal - heading


@pytest.mark.parametrize("periods", [1, 4])
def test_hold_and_time_count_periods_not_steps(periods):
    """With four periods a step, the third step at the goal is the twelfth period, with the cost of twelve steps of one."""
    task = Align(Surface(), [BLOCK])
    start = task.start(np.full((1, task.draws), 0.3))
    scorer, cost = Scorer(task, 1, periods), 0.0
    scorer.begin(start)
    for step in range(periods, 13, periods):
        scorer.score(start.goal)
        cost += scorer.episode.terms[0, list(task.TERMS).index("time")]
        assert scorer.episode.success[0] == (step >= 10)
    assert cost == pytest.approx(-0.24)


# -- starts and goals ----------------------------------------------------------------------------------------------------

BELOW_ONE = np.nextafter(1.0, 0.0)
UNIFORM = st.one_of(st.sampled_from([0.0, 0.5, BELOW_ONE]), st.floats(0.0, BELOW_ONE))


@pytest.mark.parametrize("part", [BLOCK, Part.disc(0.1, friction=0.5), WEDGE], ids=["block", "just fits", "wedge"])
@pytest.mark.parametrize("surface", [Surface(), Surface(rows=32, columns=8)], ids=["wide", "tall"])
@pytest.mark.parametrize("task", TASKS)
@given(numbers=st.lists(UNIFORM, min_size=6, max_size=6))
def test_the_part_is_wholly_on_the_surface_at_start_and_goal(task, surface, part, numbers):
    made = TASKS[task](surface, [part])
    (start,), (goal,) = made.draw(np.array([numbers[: made.draws]]))
    assert -math.pi <= start[2] <= math.pi and (task != "Align" or -math.pi <= goal[2] <= math.pi)
    if task == "Rotate":
        assert (goal[:2] == start[:2]).all() and abs(goal[2] - start[2]) <= 2 * math.pi + 1e-12
    for x, y, heading in (start, goal):
        cosine, sine = math.cos(heading), math.sin(heading)
        corners = [x, y] + part.outline @ np.array([[cosine, sine], [-sine, cosine]])
        assert (corners >= -1e-12).all() and (corners <= [surface.width + 1e-12, surface.depth + 1e-12]).all()


@pytest.mark.parametrize("task", TASKS)
def test_draws_fill_their_ranges(task):
    made = TASKS[task](Surface(), [BLOCK])
    start, goal = made.draw(np.random.default_rng(0).random((20_000, made.draws)))
    radius = BLOCK.radius
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
