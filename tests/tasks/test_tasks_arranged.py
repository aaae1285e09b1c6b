"""Kinds and zones of Sort; scores of Sort and Singulate, of worlds and of their parts, against a plain reference."""

import math
from typing import Any

import numpy as np
import pytest

from tests.tasks.helpers import Scorer, made
from tests.tasks.test_tasks_starts import ALUMINIUM, DISC, MIXED, SIX, STEEL, SURFACE, distances
from vibgym.registration import ENVIRONMENTS
from vibgym.tasks import TASKS, Singulate, Sort

ARRANGED = {"Sort": Sort, "Singulate": Singulate}

RULE = math.sqrt(2) * 0.026
FAR = math.hypot(0.832, 0.208)


class Reference:
    """One world, written from the environment's documentation."""

    def __init__(self, task, parts, present, pose):
        self.task, self.parts, self.present, self.held = task, parts, present, 0
        self.look(pose, np.zeros((len(parts), 3)), np.zeros(len(parts), dtype=bool))

    def look(self, pose, mean_velocity, fallen):
        parts = range(len(self.parts))
        there = [k for k in parts if self.present[k]]
        lying = [k for k in there if not fallen[k]]
        between = distances([self.parts[k] for k in lying], pose[lying])
        self.gap = dict.fromkeys(parts, FAR) | {k: min(between[i].min(), FAR) for i, k in enumerate(lying)}
        self.neighbour = {k: lying[between[i].argmin()] for i, k in enumerate(lying) if len(lying) > 1}
        self.clearance = min([FAR, *(self.gap[k] for k in lying)])
        self.touching = int(np.triu(between < 1e-4).sum())
        self.way, done = {k: np.zeros(2) for k in parts}, []
        for k in there:
            if self.task.zones is not None:
                zone = self.task.zones[self.task.kind[k]]
                self.way[k] = np.clip(pose[k, :2], zone[:2], zone[2:]) - pose[k, :2]
                slow = np.hypot(*mean_velocity[k, :2]) < 0.020
                done.append(not fallen[k] and slow and not self.way[k].any())
            else:
                done.append(not fallen[k] and self.gap[k] > RULE)
        self.done, self.count = sum(done), len(there)
        sort = self.task.zones is not None
        self.distance = np.array([np.hypot(*self.way[k]) for k in there])
        self.error = self.distance.max() if sort else max(RULE - self.clearance, 0.0)
        self.inside = np.array([not self.way[k].any() for k in there], dtype=float)
        self.share = np.array([0.0 if sort else min(max(self.gap[k], 0.0) / RULE, 1.0) for k in there])

    def step(self, pose, mean_velocity, fallen, diverged):
        """Return terms of the parts that are present, whether the world succeeds, and whether its episode ends."""
        before = self.distance, self.inside, self.share
        self.look(pose, mean_velocity, fallen)
        down = fallen[self.present]
        self.held = self.held + 1 if self.done == self.count and not down.any() and not diverged else 0
        success = self.held >= 10
        terms = {
            "distance": np.clip((before[0] - self.distance) / 0.1, -1.0, 1.0),
            "inside": self.inside - before[1],
            "clearance": self.share - before[2],
            "time": np.full(self.count, -0.003),
            "success": np.full(self.count, 5.0 if success else 0.0),
            "fallen": np.where(down, -5.0, 0.0),
        }
        return terms, success, success or down.any() or diverged


def settled(task, generator, worlds):
    """Return poses (worlds, parts, 3) with most parts done: in columns of their zones, or in a wide row."""
    pose = np.zeros((worlds, len(task.parts), 3))
    for k in range(len(task.parts)):
        if task.zones is None:
            pose[:, k, :2] = 0.06 + 0.12 * k, 0.104
        else:
            zone = task.zones[task.kind[k]]
            row = list(np.flatnonzero(task.kind == task.kind[k])).index(k)
            pose[:, k, :2] = zone[0] + 0.078, 0.035 + 0.068 * row
    spread = np.array([0.004, 0.004, 2.0]) * generator.choice([0.5, 3.0], (worlds, 1, 1), p=[0.8, 0.2])
    return pose + spread * generator.standard_normal(pose.shape)


@pytest.mark.parametrize("parts", [SIX, MIXED, [STEEL, DISC]], ids=["six", "mixed", "two"])
@pytest.mark.parametrize("name", ARRANGED)
def test_score_kernel(name, parts):
    worlds, steps = 30, 40
    generator = np.random.default_rng(2)
    task = made(ARRANGED[name], SURFACE, parts, randomize={"parts": [1, len(parts)]})
    whole = made(Sort, SURFACE, parts, start="crowded") if name == "Sort" else Singulate(SURFACE, parts)
    start = task.start(generator.random((worlds, task.draws)))
    scorer = Scorer(task, worlds)
    scorer.begin(start)
    result = scorer.episode
    reference = [Reference(task, parts, start.present[k], start.pose[k]) for k in range(worlds)]
    seen = {"success": 0, "fallen": 0, "diverged": 0, "touching": 0, "alone": 0}
    base = settled(task, generator, worlds)
    for step in range(steps):
        pose = base + np.array([2e-4, 2e-4, 0.02]) * generator.standard_normal(base.shape)
        away = generator.random(worlds) < 0.02
        pose[away] = whole.start(generator.random((worlds, whole.draws))).pose[away]
        velocity = generator.choice([0.005, 0.03], (worlds, 1, 1), p=[0.98, 0.02]) * generator.standard_normal(
            pose.shape
        )
        fallen = ~start.present | (generator.random(start.present.shape) < 0.003)
        diverged = generator.random(worlds) < 0.01
        scorer.score(pose, velocity, fallen, diverged)
        for k in range(worlds):
            terms, success, ended = reference[k].step(pose[k], velocity[k], fallen[k], diverged[k])
            where = (step, k)
            assert list(terms) == list(task.TERMS)
            overlap = reference[k].clearance <= 0.0  # shapely detects overlaps, but not their depth
            of_world = [values.min() if name == "fallen" else values.mean() for name, values in terms.items()]
            assert result.terms[k] == pytest.approx(of_world, abs=1e-9), where
            assert result.reward[k] == pytest.approx(math.fsum(of_world), abs=1e-9)
            of_parts = np.zeros((len(parts), len(terms)))
            of_parts[start.present[k]] = np.stack(list(terms.values()), axis=1)
            assert result.part_terms[k] == pytest.approx(of_parts, abs=1e-9), where
            assert result.part_reward[k] == pytest.approx(of_parts.sum(axis=1), abs=1e-9)
            assert (result.part_fallen[k] == (start.present[k] & fallen[k])).all()
            assert (result.success[k], result.ended[k]) == (success, ended), where
            assert result.fallen[k] == (start.present[k] & fallen[k]).any()
            assert (result.parts_done[k], result.touching[k]) == (reference[k].done, reference[k].touching), where
            assert result.done[k].sum() == reference[k].done
            way = np.array(list(reference[k].way.values()))
            assert scorer.relations.error[k, :, :2] == pytest.approx(way, abs=1e-12)
            if overlap:
                assert result.clearance[k] <= 1e-12
            else:
                assert result.position_error[k] == pytest.approx(reference[k].error, abs=1e-9)
                assert result.clearance[k] == pytest.approx(reference[k].clearance, abs=1e-9)
                assert scorer.relations.gap[k] == pytest.approx(list(reference[k].gap.values()), abs=1e-9)
                near = {p: int(other) for p, other in enumerate(scorer.relations.neighbour[k]) if other >= 0}
                for p, other in reference[k].neighbour.items():  # or another one at the same distance
                    pair = [p, near[p]]
                    between = distances([parts[q] for q in pair], pose[k, pair])[0, 1]
                    assert between == pytest.approx(reference[k].gap[p], abs=1e-9), (other, where)
                assert near.keys() == reference[k].neighbour.keys()
            seen["touching"] += reference[k].touching
            seen["alone"] += reference[k].count == 1
        seen["success"] += result.success.sum()
        seen["fallen"] += result.fallen.sum()
        seen["diverged"] += diverged.sum()
    assert min(seen.values()) > 0


def scored(task, pose, steps=1, **state: Any):
    """Return the scorer after steps at one pose (parts, 3)."""
    scorer = Scorer(task, 1)
    start = task.start(np.full((1, task.draws), 0.5))._replace(pose=pose[None], present=np.ones((1, len(pose)), bool))
    scorer.begin(start)
    for _ in range(steps):
        scorer.score(pose[None], **state)
    return scorer


@pytest.mark.parametrize("speed, x, done", [(0.0199, 0.05, 2), (0.0201, 0.05, 0), (0.0, 0.1559, 2), (0.0, 0.1561, 1)])
def test_sort_requires_slow_parts_with_their_centres_in_zones(speed, x, done):
    pose = np.array([[x, 0.1, 0.0], [0.78, 0.1, 0.0]])
    for direction in (0.3, 2.0):
        moving = speed * np.array([math.cos(direction), math.sin(direction), 1e6])  # at any spin
        result = scored(Sort(SURFACE, [STEEL, ALUMINIUM]), pose, mean_velocity=moving).episode
        assert result.parts_done[0] == done
        assert result.position_error[0] == pytest.approx(max(x - 0.156, 0.0), abs=1e-12)


@pytest.mark.parametrize("beyond, success", [(1e-6, True), (-1e-6, False)])
def test_singulate_requires_more_than_an_elements_diagonal(beyond, success):
    task = Singulate(SURFACE, [STEEL, ALUMINIUM, STEEL])
    pose = np.array([[0.1, 0.1, 0.0], [0.15 + RULE + beyond, 0.1, 0.0], [0.6, 0.1, 0.0]])
    assert not scored(task, pose, steps=9).episode.success[0]
    result = scored(task, pose, steps=10).episode
    assert result.success[0] == success and result.parts_done[0] == (3 if success else 1)
    assert result.position_error[0] == pytest.approx(max(-beyond, 0.0), abs=1e-12)


def test_kinds_are_in_order_and_zones_are_six_columns_wide():
    task = Sort(SURFACE, [STEEL, DISC, ALUMINIUM, STEEL])
    assert task.kinds == ("steel", "disc", "aluminium") and task.kind.tolist() == [0, 1, 2, 0]
    assert task.zones[:, [0, 2]] / 0.026 == pytest.approx(np.array([[0, 6], [26, 32], [13, 19]]))
    assert task.zones[:, [1, 3]] == pytest.approx(np.array([[0, 0.208]] * 3))
    assert task.rules(1).zone == pytest.approx(task.zones[[0, 1, 2, 0]])
    assert task.rules(1).slow == 0.020 and task.rules(1).hold == 10


def test_custom_zones():
    zones = {"steel": [0.4, 0.0, 0.832, 0.208], "aluminium": (0, 0, 0.3, 0.2)}
    assert made(Sort, SURFACE, SIX, zones=zones).zones.tolist() == [[0.4, 0.0, 0.832, 0.208], [0.0, 0.0, 0.3, 0.2]]


def test_singulate_has_no_zones():
    task = Singulate(SURFACE, SIX)
    assert task.zones is None and task.apart == pytest.approx(0.036770, abs=1e-6)
    assert (task.rules(1).zone[:, :2] == -np.inf).all() and (task.rules(1).zone[:, 2:] == np.inf).all()


def test_a_whole_episode_costs_less_than_a_fall():
    """Otherwise falling off the table would have a higher return."""
    for limit, settings in ENVIRONMENTS.values():
        cost = TASKS[settings["task"]].TERMS
        assert limit * cost.get("time", ("time", 0.0))[1] <= cost["fallen"][1]
