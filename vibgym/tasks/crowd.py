"""Tasks for many parts: distances to zones and between parts, and scoring, in one compiled pass over the worlds."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from vibgym.physics.collision.hulls import part_gap, place_hulls
from vibgym.physics.core.jit import jit

TERMS = ("distance", "inside", "clearance", "time", "success", "fallen")
"""Reward terms in order. Each is bounded by 1 in magnitude, but for success (5) and fallen (-5)."""

DISTANCE_SCALE = 0.1  # m of mean progress that earn the term's full reward
TIME_COST = 0.003  # a whole episode of it costs less than a fall, lest falling pays
SUCCESS_REWARD = 5.0
TOUCHING = 1e-4
"""Pairs closer than this are counted as touching, m."""


class CrowdRules(NamedTuple):
    """What the scoring kernel knows of the task."""

    zone: np.ndarray  # (parts, 4) m, of each part: x_low, y_low, x_high, y_high
    slow: float  # m/s, speed below which a part is done
    apart: float  # m, distance to the nearest other part above which a part is done; -inf: does not count
    far: float  # m, taken as the distance where there is no other part
    hold: int  # steps in a row with all parts done


class CrowdScore(NamedTuple):
    """Progress of every world, changed in place by :func:`score_crowd`."""

    present: np.ndarray  # (worlds, parts) bool, for the whole episode
    way: np.ndarray  # (worlds, parts, 2) m, from the centre to the nearest point of the part's zone; 0 inside
    gap: np.ndarray  # (worlds, parts) m, to the nearest other part; negative: overlap
    neighbour: np.ndarray  # (worlds, parts) int64, which that is; -1: none
    distance: np.ndarray  # (worlds,) m, position error
    clearance: np.ndarray  # (worlds,) m, smallest gap
    touching: np.ndarray  # (worlds,) int64, pairs in touch
    done: np.ndarray  # (worlds,) int64, parts done
    fallen: np.ndarray  # (worlds,) bool, whether a present part has fallen
    held: np.ndarray  # (worlds,) int64, steps in a row with all parts done
    success: np.ndarray  # (worlds,) bool
    ended: np.ndarray  # (worlds,) bool: success, fallen or diverged
    terms: np.ndarray  # (worlds, len(TERMS))
    reward: np.ndarray  # (worlds,)


def new_crowd_score(worlds: int, parts: int) -> CrowdScore:
    """Arrays for ``worlds`` worlds."""
    return CrowdScore(
        present=np.zeros((worlds, parts), dtype=bool),
        way=np.zeros((worlds, parts, 2)),
        gap=np.zeros((worlds, parts)),
        neighbour=np.full((worlds, parts), -1, dtype=np.int64),
        distance=np.zeros(worlds),
        clearance=np.zeros(worlds),
        touching=np.zeros(worlds, dtype=np.int64),
        done=np.zeros(worlds, dtype=np.int64),
        fallen=np.zeros(worlds, dtype=bool),
        held=np.zeros(worlds, dtype=np.int64),
        success=np.zeros(worlds, dtype=bool),
        ended=np.zeros(worlds, dtype=bool),
        terms=np.zeros((worlds, len(TERMS))),
        reward=np.zeros(worlds),
    )


@jit
def _limited(value):
    return min(max(value, -1.0), 1.0)


@jit
def measure_gaps(rules, hulls, pose, fallen, world, placed, result):
    """Nearest neighbours, clearance and touching pairs of one world; parts that have fallen are out of the way."""
    parts = pose.shape[1]
    present, gap, neighbour = result.present[world], result.gap[world], result.neighbour[world]
    for i in range(parts):
        gap[i], neighbour[i] = rules.far, -1
        if present[i] and not fallen[world, i]:
            place_hulls(hulls, i, pose[world, i, 0], pose[world, i, 1], pose[world, i, 2], placed)
    touching, clearance = 0, rules.far
    for i in range(parts):
        if not present[i] or fallen[world, i]:
            continue
        for j in range(i):
            if not present[j] or fallen[world, j]:
                continue
            dx, dy = pose[world, i, 0] - pose[world, j, 0], pose[world, i, 1] - pose[world, j, 1]
            least = math.sqrt(dx * dx + dy * dy) - hulls.radius[i] - hulls.radius[j]
            if least >= gap[i] and least >= gap[j] and least >= TOUCHING:
                continue
            between = part_gap(hulls, placed, i, j)
            if between < gap[i]:
                gap[i], neighbour[i] = between, j
            if between < gap[j]:
                gap[j], neighbour[j] = between, i
            clearance = min(clearance, between)
            touching += between < TOUCHING
    result.clearance[world], result.touching[world] = clearance, touching


@jit
def measure_crowd(rules, hulls, pose, mean_velocity, fallen, world, placed, result):
    """Write the errors of one world; start of an episode and first half of :func:`score_crowd`."""
    measure_gaps(rules, hulls, pose, fallen, world, placed, result)
    error = max(rules.apart - result.clearance[world], 0.0)
    done, down = 0, False
    for i in range(pose.shape[1]):
        wx, wy = 0.0, 0.0
        if result.present[world, i]:
            x, y = pose[world, i, 0], pose[world, i, 1]
            wx = min(max(x, rules.zone[i, 0]), rules.zone[i, 2]) - x
            wy = min(max(y, rules.zone[i, 1]), rules.zone[i, 3]) - y
            vx, vy = mean_velocity[world, i, 0], mean_velocity[world, i, 1]
            error = max(error, math.sqrt(wx * wx + wy * wy))
            slow = vx * vx + vy * vy < rules.slow * rules.slow
            if fallen[world, i]:
                down = True
            elif wx == 0.0 and wy == 0.0 and slow and result.gap[world, i] > rules.apart:
                done += 1
        result.way[world, i, 0], result.way[world, i, 1] = wx, wy
    result.distance[world] = error
    result.done[world], result.fallen[world] = done, down


@jit
def standing(rules, world, result):
    """Number of present parts, their mean distance to their zones (m), share in their zones, mean share of the clearance."""
    count, distance, inside, clearance = 0, 0.0, 0.0, 0.0
    for i in range(result.present.shape[1]):
        if result.present[world, i]:
            wx, wy = result.way[world, i, 0], result.way[world, i, 1]
            count += 1
            distance += math.sqrt(wx * wx + wy * wy)
            inside += wx == 0.0 and wy == 0.0
            if rules.apart > 0.0:
                clearance += min(max(result.gap[world, i], 0.0), rules.apart) / rules.apart
    return count, distance / count, inside / count, clearance / count


@jit
def begin_crowd(rules, hulls, pose, mean_velocity, fallen, worlds, present, result):
    """Start the episodes of ``worlds`` (index array) with the parts ``present`` (len(worlds), parts)."""
    placed = np.empty_like(hulls.corner)
    for k in range(worlds.shape[0]):
        world = worlds[k]
        result.present[world] = present[k]
        measure_crowd(rules, hulls, pose, mean_velocity, fallen, world, placed, result)
        result.held[world] = 0
        result.success[world] = False
        result.ended[world] = False
        result.terms[world] = 0.0
        result.reward[world] = 0.0


@jit
def score_crowd(rules, hulls, pose, mean_velocity, fallen, diverged, result):
    """Score one step of every world against the one before: errors, success, reward terms and their sum."""
    placed = np.empty_like(hulls.corner)
    for world in range(pose.shape[0]):
        _, distance_before, inside_before, clearance_before = standing(rules, world, result)
        measure_crowd(rules, hulls, pose, mean_velocity, fallen, world, placed, result)
        count, distance, inside, clearance = standing(rules, world, result)
        down = result.fallen[world]
        sound = not (down or diverged[world])
        result.held[world] = result.held[world] + 1 if sound and result.done[world] == count else 0
        success = result.held[world] >= rules.hold
        result.success[world] = success
        result.ended[world] = success or not sound
        terms = result.terms[world]
        terms[0] = _limited((distance_before - distance) / DISTANCE_SCALE)
        terms[1] = inside - inside_before
        terms[2] = clearance - clearance_before
        terms[3] = -TIME_COST
        terms[4] = SUCCESS_REWARD if success else 0.0
        terms[5] = -SUCCESS_REWARD if down else 0.0
        total = 0.0
        for k in range(terms.shape[0]):
            total += terms[k]
        result.reward[world] = total
