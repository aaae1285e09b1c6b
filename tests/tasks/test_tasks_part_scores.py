"""Reward terms of each part against a plain reference; ``tests/contracts/test_reward.py`` compares them with the world's."""

import math

import numpy as np
import pytest

from tests.tasks.helpers import Scorer, made
from vibgym import Part, Surface
from vibgym.physics.contacts.hulls import all_gaps
from vibgym.scene.hulls import hulls_of
from vibgym.tasks import Align, Follow, Singulate, Sort, Start

STEEL = Part.rectangle(0.050, 0.040, friction=0.64, name="steel")
DISC = Part.disc(0.02, friction=0.58, name="disc")
MIXED = [STEEL, DISC, STEEL, DISC, STEEL]
WORLDS, STEPS = 30, 12


def scattered(generator, parts, spread=1.0):
    """Poses anywhere on the default surface."""
    low, high = np.array([0.03, 0.03, -3.0]), np.array([0.8, 0.18, 3.0])
    middle = 0.5 * (low + high)
    return middle + spread * (generator.uniform(low, high, (WORLDS, parts, 3)) - middle)


def numbers(task, pose, goal, gaps, present):
    """Return distance, turn, inside and share of the clearance of every part, as documented."""
    parts = pose.shape[1]
    away, heading_error, inside, clear = (np.zeros(pose.shape[:2]) for _ in range(4))
    for w, p in np.argwhere(present):
        x, y, heading = pose[w, p]
        gx, gy = goal[w, p, :2]
        if task.zones is not None:
            low_x, low_y, high_x, high_y = task.zones[task.kind[p]]
            gx, gy = np.clip(x, low_x, high_x), np.clip(y, low_y, high_y)
        elif not task.has_goal:
            gx, gy = x, y
        away[w, p] = math.hypot(gx - x, gy - y)
        inside[w, p] = away[w, p] == 0.0
        if task.has_heading and task.parts[p].symmetry:
            period = 2 * math.pi / task.parts[p].symmetry
            heading_error[w, p] = abs((goal[w, p, 2] - heading + period / 2) % period - period / 2)
        others = [gaps[w, p, k] for k in range(parts) if k != p and present[w, k]]
        if math.isfinite(task.apart):
            clear[w, p] = min(max(min(others, default=1.0), 0.0), task.apart) / task.apart
    return away, heading_error, inside, clear


CASES = {
    "Sort": lambda: made(Sort, Surface(), MIXED, randomize={"parts": [1, 5]}),
    "Singulate": lambda: made(Singulate, Surface(), MIXED, randomize={"parts": [1, 5]}),
    "Align": lambda: Align(Surface(), [STEEL]),
    "Follow": lambda: Follow(Surface(), [STEEL, DISC]),
}


@pytest.mark.parametrize("name", CASES)
@pytest.mark.parametrize("spread", [1.0, 0.1])
def test_terms_of_single_parts(name, spread):
    task = CASES[name]()
    parts, generator = len(task.parts), np.random.default_rng(3)
    present = generator.random((WORLDS, parts)) < (0.7 if task.MAX_PARTS != 1 and name != "Follow" else 2.0)
    present[:, 0] = True
    goal = scattered(generator, parts, spread) if task.has_goal else np.zeros((WORLDS, parts, 3))
    pose = np.where(present[..., None], scattered(generator, parts, spread), -1.0)
    scorer = Scorer(task, WORLDS, periods=2)
    scorer.begin(Start(pose, present, goal))
    episode, gaps = scorer.episode, np.empty((WORLDS, parts, parts))
    assert not episode.part_terms.any() and not episode.part_reward.any()
    all_gaps(hulls_of(task.parts), pose, gaps)
    before = numbers(task, pose, goal, gaps, present)
    weights = {term: w * (2 if of in ("time", "within") else 1) for term, (of, w) in task.TERMS.items()}
    limited, successes = 0, 0
    for step in range(STEPS):
        aim = goal if task.has_goal else pose
        near = aim + spread * np.array([0.01, 0.01, 0.1]) * generator.standard_normal((WORLDS, parts, 3))
        anywhere = scattered(generator, parts, spread)
        pose = np.where(present[..., None], np.where(generator.random((WORLDS, parts, 1)) < 0.3, anywhere, near), -1.0)
        if step > 4 and task.has_goal:
            pose = goal.copy()
        fallen = ~present | ((generator.random((WORLDS, parts)) < 0.02) & (step < 4))
        speed = generator.uniform(0.0, 0.03, (WORLDS, parts, 3))
        scorer.score(pose, speed, fallen)
        counted = np.where((present & ~fallen)[..., None], pose, [10.0, 10.0, 0.0])
        all_gaps(hulls_of(task.parts), counted, gaps)
        away, heading_error, inside, _ = now = numbers(task, pose, goal, gaps, present)
        # Fallen parts are far from the others.
        seen = present & ~fallen
        now = (*now[:3], np.where(seen, numbers(task, pose, goal, gaps, seen)[3], float(math.isfinite(task.apart))))
        slow = np.hypot(*np.moveaxis(speed, -1, 0)[:2]) < task.speed_limit
        fits = (away <= task.position_tolerance) & (heading_error <= task.heading_tolerance) & slow
        was_away, was_turned, was_inside, was_clear = before
        quantity = {
            "distance": np.clip((was_away - away) / 0.1, -1, 1),
            "approach": np.tanh(was_away / 0.01) - np.tanh(away / 0.01),
            "turn": np.clip(was_turned - heading_error, -1, 1),
            "alignment": np.tanh(was_turned / 0.15) - np.tanh(heading_error / 0.15),
            "inside": inside - was_inside,
            "within": fits.astype(float),
            "clearance": now[3] - was_clear,
            "time": -np.ones((WORLDS, parts)),
            "success": np.tile(episode.success[:, None], (1, parts)).astype(float),
            "fallen": np.where(fallen, -1.0, 0.0),
        }
        total = np.zeros((WORLDS, parts))
        for k, (term, (of, _)) in enumerate(task.TERMS.items()):
            expected = np.where(present, weights[term] * quantity[of], 0.0)
            assert episode.part_terms[..., k] == pytest.approx(expected, abs=1e-8), term
            total += expected
        assert episode.part_reward == pytest.approx(total, abs=1e-8)
        assert (episode.part_fallen == (fallen & present)).all()
        limited += int((present & (abs(quantity["distance"]) == 1.0)).sum())
        successes += int(episode.success.sum())
        before = now
    assert limited > 5 or spread < 1.0 or name == "Singulate"
    assert successes > 0 or name != "Align"
