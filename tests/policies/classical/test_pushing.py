"""The pushing rule: effect of pushes, paths of the pushers, and results."""

import math

import numpy as np
import pytest

from tests.policies.helpers import info_of, measurement
from vibgym.policies.classical.pushing import (
    BARRED,
    CLOSEST,
    FURTHEST,
    NEARBY,
    Outline,
    PushingPolicy,
    choose_pairs,
    rotation,
)
from vibgym.registration import TEE
from vibgym.scene.parts import Part, part_from

RADIUS = 0.02


def rule(**settings):
    return PushingPolicy(info_of("PushAny"), PushingPolicy.Settings(**settings))


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


def test_plans_lead_to_the_chosen_places():
    policy, rng, worlds = rule(), np.random.default_rng(2), 50
    measured = measurement(policy.info, worlds, centre=np.array([0.416, 0.104]))
    angle = rng.uniform(-math.pi, math.pi, (worlds, 2))
    measured.centre[:, policy.pushers] += 0.07 * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    measured.heading[:, policy.pushed] = rng.uniform(-3.0, 3.0, worlds)
    measured.displacement[:, policy.pushed] = rng.normal(size=(worlds, 2)) * 0.05
    _, plan, left = policy.velocities(measured)
    place = measured.centre[:, policy.pushers] + NEARBY * np.arctanh(plan[..., :2])
    heading, centre = measured.heading[:, policy.pushed], measured.centre[:, policy.pushed]
    places = centre[:, None] + np.einsum("bij,nj->bni", rotation(heading), policy.outline.place)
    away = np.hypot(*np.moveaxis(places[:, None] - place[:, :, None], -1, 0))
    assert away.min(axis=-1).max() < 1e-9
    normals = np.einsum("bij,nj->bni", rotation(heading), policy.outline.effect[:, :2])
    best = away.argmin(axis=-1)
    assert plan[..., 4:6] == pytest.approx(np.take_along_axis(normals, best[..., None], axis=1))
    assert np.arctanh(plan[..., 7]) == pytest.approx(policy.outline.effect[best, 2])
    assert np.abs(plan).max() <= 1.0 and (plan[..., 6] >= 0.0).all()
    away_left = CLOSEST * (FURTHEST / CLOSEST) ** (0.5 * (left[:, 3:] + 1.0))  # m
    gone, turned = left[:, :2] * away_left, left[:, 2] * away_left[:, 0] / policy.outline.gyration
    assert gone == pytest.approx(measured.displacement[:, policy.pushed], abs=1e-9)
    assert turned == pytest.approx(measured.heading_error[:, policy.pushed], abs=1e-9)
    assert np.abs(left).max() <= 1.0


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


def test_paths_are_the_shortest_round_a_disc():
    """Straight where the place is in sight, else the closed form of tangent and arc; never shorter than the straight line."""
    policy = rule()
    radius = float(policy.outline.round.mean())
    at = np.tile([[0.2, 0.0], [0.09, 0.03]], (1, 1, 1))
    here, there = np.arctan2(at[..., 1], at[..., 0]), np.hypot(*policy.outline.place.T)
    short = np.angle(np.exp(1j * (policy.outline.direction - here[..., None])))
    sweeps = np.stack([short, short - np.copysign(2.0 * math.pi, short)], axis=2)
    middle = np.array([[0.416, 0.104]])
    lengths = policy.travel(at, here, sweeps, middle, np.eye(2)[None])
    lengths -= BARRED * policy.barred(here, sweeps, middle, np.eye(2)[None])
    direct = np.hypot(*(at[0, :, None] - policy.outline.place).transpose(2, 0, 1))
    assert (lengths >= direct[:, None] - 1e-9).all()
    for k in range(2):
        away = float(np.hypot(*at[0, k]))
        in_sight = np.abs(short[0, k]) < math.acos(radius / away)
        assert in_sight.any() and not in_sight.all()
        assert lengths[0, k, 0, in_sight] == pytest.approx(direct[k, in_sight])
        behind = ~in_sight
        tangent = math.sqrt(away**2 - radius**2)
        arc = radius * (np.abs(short[0, k, behind]) - math.acos(radius / away))
        assert lengths[0, k, 0, behind] == pytest.approx(tangent + arc + np.abs(there - radius)[behind])
    assert (lengths[:, :, 1] >= lengths[:, :, 0] - 1e-9).all()  # the other way round is longer


def test_a_pusher_at_its_place_has_no_way_to_go():
    policy = rule()
    outline = policy.outline
    for k in range(0, len(outline.place), 7):
        at = np.array([[outline.place[k], outline.place[k]]])
        here = np.arctan2(at[..., 1], at[..., 0])
        short = np.angle(np.exp(1j * (outline.direction - here[..., None])))
        sweeps = np.stack([short, short], axis=2)
        cost = policy.travel(at, here, sweeps, np.array([[0.416, 0.104]]), np.eye(2)[None])
        assert cost[0, :, 0, k] == pytest.approx(0.0, abs=1e-7)


@pytest.mark.parametrize(("early", "first"), [(0.01, 1), (0.9, 0)])
def test_the_longer_path_counts_less_if_the_first_to_arrive_can_push_alone(early, first):
    """Both pairs give exactly the wanted motion. Point 0 does so alone, but is farther away than point 1."""
    effect = np.array([[1.0, 0.0, 0.0], [0.96, 0.28, 0.0], [0.96, -0.28, 0.0]])
    along = effect[:, :1].T.copy()
    cost = np.full((1, 2, 2, 3), 9.0)
    cost[0, 0, :, :2], cost[0, 1, :, 2] = [0.10, 0.05], 0.30
    chosen, push, sweep = np.zeros((1, 2), dtype=np.int64), np.zeros((1, 2)), np.zeros((1, 2))
    choose_pairs(
        along, along, effect @ effect.T, ~np.eye(3, dtype=bool), np.ones((1, 3), dtype=bool), cost, np.zeros((1, 2, 2, 3)),
        np.array([math.pi]), 1.0, 0.2, early, 0.97, chosen, push, sweep,
    )  # fmt: skip
    assert chosen[0].tolist() == [first, 2]


def test_one_disc_pushes_before_the_other_is_there_if_that_helps():
    """The first disc stands at its place, the other one is on its way; 200 wanted motions."""
    policy, rng, worlds = rule(travel=1e-6), np.random.default_rng(1), 200
    outline, middle = policy.outline, np.array([0.416, 0.104])
    motion = rng.normal(size=(worlds, 3)) * [0.05, 0.05, 1.0]
    left = motion * [1.0, 1.0, outline.gyration]
    direction = left / np.linalg.norm(left, axis=1, keepdims=True)
    straight = np.tile(np.eye(2), (worlds, 1, 1))
    at = np.tile([[0.2, 0.0], [-0.2, 0.0]], (worlds, 1, 1))
    chosen, push, _ = policy.choose(direction, at, np.tile(middle, (worlds, 1)), straight)
    at[:, 0] = outline.place[chosen[:, 0]]
    again = policy.choose(direction, at, np.tile(middle, (worlds, 1)), straight)[0]
    same = (again == chosen).all(axis=1) & (push[:, 0] > 0.0)
    assert same.sum() > 50

    measured = measurement(policy.info, worlds, centre=middle)
    measured.centre[:, policy.pushers] += at
    measured.displacement[:, policy.pushed], measured.heading_error[:, policy.pushed] = motion[:, :2], motion[:, 2]
    inward = outline.effect[chosen[:, 0], :2]
    pushes = (policy.velocities(measured)[0][:, 0] * inward).sum(axis=1) > 0.0
    effect = outline.effect[chosen[:, 0]]
    helps = (effect * direction).sum(axis=1) / np.linalg.norm(effect, axis=1) > policy.settings.useful
    alone = push[:, 1] == 0.0
    assert pushes[same].tolist() == (helps | alone)[same].tolist()
    assert 10 < pushes[same].sum() < same.sum() - 10
