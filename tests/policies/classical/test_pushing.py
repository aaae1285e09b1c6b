"""The pushing rule: effect of pushes, paths of the pushers, and results."""

import math

import numpy as np
import pytest

from tests.envs.helpers import single
from vibgym.config import part_from
from vibgym.policies import TaskInfo
from vibgym.policies.classical.pushing import Outline, PushingPolicy
from vibgym.registration import TEE
from vibgym.scene.parts import Part

RADIUS = 0.02


def rule(task="PushAny", **settings):
    return PushingPolicy(TaskInfo.of(single(task)), **settings)


def test_a_disc_is_pushed_along_its_radius_and_never_turned():
    outline = Outline(Part.disc(0.03, friction=0.2), RADIUS)
    # The outline is a polygon of many sides.
    assert np.hypot(*outline.place.T) == pytest.approx(0.03 + RADIUS, rel=2e-3)
    assert outline.effect[:, :2] == pytest.approx(-outline.place / np.hypot(*outline.place.T)[:, None], abs=0.05)
    assert np.abs(outline.effect[:, 2]).max() < 0.03
    assert outline.round == pytest.approx(0.03 + RADIUS, rel=3e-3)


def test_a_rectangle_is_turned_by_the_lever_of_a_push():
    """Quasi-static (Mason, 1986): a unit force at a lever turns by lever over gyration, in units of the radius of gyration."""
    part = Part.rectangle(0.08, 0.03, friction=0.2)
    outline = Outline(part, RADIUS)
    top = outline.place[:, 1] > 0.015 + RADIUS - 1e-9
    assert top.sum() == 20
    assert outline.effect[top, :2] == pytest.approx(np.tile([0.0, -1.0], (20, 1)), abs=1e-12)
    assert outline.effect[top, 2] == pytest.approx(-outline.place[top, 0] / math.sqrt(part.gyration))
    assert outline.round[0] == pytest.approx(0.04 + RADIUS, rel=1e-2)
    assert outline.round[18] == pytest.approx(0.015 + RADIUS, rel=1e-2)


def test_push_points_are_outside_of_the_part():
    part = part_from(TEE, "tee")
    outline = Outline(part, RADIUS)
    from_outline = np.inf
    for a, b in zip(part.outline, np.roll(part.outline, -1, axis=0), strict=True):
        share = np.clip(((outline.place - a) @ (b - a)) / ((b - a) @ (b - a)), 0.0, 1.0)
        from_outline = np.minimum(from_outline, np.hypot(*(outline.place - a - share[:, None] * (b - a)).T))
    assert from_outline.min() > RADIUS - 0.0015  # a quarter of the points' spacing


def test_pushers_do_not_pass_each_other():
    policy, rng = rule(), np.random.default_rng(0)
    angle = rng.uniform(-math.pi, math.pi, (200, 2))
    at = 0.08 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    direction = rng.normal(size=(200, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    middle, straight = np.tile([0.416, 0.104], (200, 1)), np.tile(np.eye(2), (200, 1, 1))
    chosen, push, sweep = policy.choose(direction, at, middle, straight)
    arrived = angle + sweep
    where = policy.outline.direction[chosen]
    assert np.cos(arrived - where) == pytest.approx(1.0)
    before = np.mod(angle[:, 1] - angle[:, 0], 2.0 * math.pi)
    after = before + sweep[:, 1] - sweep[:, 0]
    assert ((after > 0.0) & (after < 2.0 * math.pi)).all()
    assert (push >= 0.0).all() and (push.max(axis=1) > 0.0).all()
    # The pushed part moves towards its goal.
    twist = np.einsum("bk,bkj->bj", push, policy.outline.effect[chosen])
    assert (np.einsum("bj,bj->b", twist, direction) > 0.0).all()


def test_paths_avoid_borders():
    policy = rule()
    part_near_border = np.array([[0.416, 0.045]])
    at = np.array([[[0.09, 0.0], [-0.09, 0.0]]])
    under = np.array([[[-math.pi + 0.2, math.pi - 0.2]]])
    sweeps = np.stack([under, -under], axis=2)[:, [0, 0]]
    barred = policy.barred(np.arctan2(at[..., 1], at[..., 0]), sweeps, part_near_border, np.eye(2)[None])
    assert barred.shape == (1, 2, 2, 2)
    assert barred[0, 0, 0].tolist() == [True, False]  # clockwise from the right: below the part, without room


def test_bad_settings_are_refused():
    with pytest.raises(ValueError, match="speed"):
        rule(speed=-1.0)
