"""Contacts by pymunk: coefficients, walls, masses, states, failures; see also test_contacts_stepped."""

import copy
import math
import pickle

import gymnasium as gym
import numpy as np
import pymunk
import pytest

import vibgym  # noqa: F401 - registers the environments
from tests.simulation.helpers import random_fields, same, snapshot
from vibgym import Part, Simulator, Surface
from vibgym.fields import radial, uniform
from vibgym.scene.hulls import WALLS

SURFACE = Surface()
STILL = Surface(20, 20, 0.05, 0.0)
STEEL = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel")
H = 0.004  # s, contact step


def by_pymunk(surface, parts, **more):
    return Simulator(surface, parts, contacts="pymunk", **more)


def disc(restitution, friction=0.0, **more):
    """Return a disc that the table does not brake."""
    return Part.disc(0.02, friction=0.0, restitution=restitution, contact_friction=friction, **more)


@pytest.mark.parametrize(
    "wall, heading", [("left", math.pi), ("right", 0.0), ("bottom", -math.pi / 2), ("top", math.pi / 2)]
)
def test_walls_have_the_coefficients_of_the_part(wall, heading):
    """Two kinds of discs: normal velocity ``-e v``, tangential change ``mu (1 + e) v``, spin ``2 mu (1 + e) v / r``."""
    kinds = [(0.2, 0.05), (0.8, 0.1)]
    simulator = by_pymunk(STILL, [disc(*kind) for kind in kinds], walls=[wall])
    normal = np.array([math.cos(heading), math.sin(heading)])
    tangent = np.array([-normal[1], normal[0]])
    for part in range(2):
        pose, velocity = np.full((2, 3), 0.5), np.zeros((2, 3))
        pose[part, :2] += 0.46 * normal
        velocity[part, :2] = 0.5 * normal + 0.4 * tangent
        simulator.reset(pose, velocity)
        simulator.advance(0.0, 0.0, 3)
        (e, mu), (vx, vy, spin) = kinds[part], simulator.velocity[0, part]
        assert [vx, vy] @ normal == pytest.approx(-0.5 * e, abs=1e-12)
        assert [vx, vy] @ tangent == pytest.approx(0.4 - mu * (1.0 + e) * 0.5, abs=1e-12)
        assert abs(spin) == pytest.approx(
            2.0 * mu * (1.0 + e) * 0.5 / 0.02, rel=0.1
        )  # the lever arm includes the overlap
        assert (simulator.velocity[0, 1 - part] == 0.0).all()


def test_coefficients_of_two_parts_are_geometric_means():
    """As with certified contacts."""
    e, mu = 0.6, 0.06
    straight = by_pymunk(STILL, [disc(0.9), disc(0.4)])
    straight.reset([[0.3, 0.5, 0.0], [0.36, 0.5, 0.0]], [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    straight.advance(0.0, 0.0, 3)
    assert straight.velocity[0, :, 0] == pytest.approx([0.25 * (1.0 - e), 0.25 * (1.0 + e)], abs=1e-12)
    spun = by_pymunk(STILL, [disc(0.9, 0.04), disc(0.4, 0.09)])
    spun.reset([[0.3, 0.5, 0.0], [0.36, 0.5, 0.0]], [[0.5, 0.0, 100.0], [0.0, 0.0, 0.0]])
    spun.advance(0.0, 0.0, 3)
    assert abs(spun.velocity[0, :, 1]) == pytest.approx(mu * 0.25 * (1.0 + e), abs=1e-12)


def test_drawn_masses():
    """Masses of a world's conditions, set between periods: elastic impact of discs of 1 and 3 times their mass."""
    simulator = by_pymunk(STILL, [disc(1.0)] * 2, worlds=2)
    simulator.reset([[0.3, 0.5, 0.0], [0.36, 0.5, 0.0]], [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]])
    simulator.set_conditions([1], mass=[[1.0, 3.0]])
    simulator.advance(0.0, 0.0, 3)
    assert simulator.velocity[:, :, 0] == pytest.approx(np.array([[0.0, 0.5], [-0.25, 0.25]]), abs=1e-12)


def test_a_hit_part_reaches_one_that_was_far_away():
    """In the same period: all parts of a world advance together where any are near."""
    heavy = Part.disc(0.02, friction=0.0, restitution=1.0, mass=0.1, contact_friction=0.0)
    light = Part.disc(0.02, friction=0.0, restitution=1.0, mass=0.01, contact_friction=0.0)
    simulator = by_pymunk(STILL, [heavy, light, light])
    simulator.reset([[0.2, 0.5, 0.0], [0.245, 0.5, 0.0], [0.32, 0.5, 0.0]], [[1.5, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    simulator.advance(0.0, 0.0)
    assert simulator.velocity[0, 2, 0] > 2.5  # closed form: nearly twice the velocity of the heavy one


@pytest.mark.parametrize("speed", [0.3, 0.8])
def test_a_state_in_the_middle_of_an_impact_is_restored(speed):
    """Overlaps by impacts may be deeper than with certified contacts; the state goes on bit for bit, also in a copy."""
    fields = radial(0.416, 0.104).drive(SURFACE)
    deepest = 0.0
    for shift in np.linspace(0.0, 8e-3, 9):
        simulator = by_pymunk(SURFACE, [STEEL] * 3, walls=WALLS)
        velocity = [[speed, 0.0, 0.0], [-speed, 0.0, 1.0], [-speed, 0.1, 0.0]]
        simulator.reset([[0.39 - shift, 0.1, 0.0], [0.45, 0.1, 0.1], [0.51, 0.11, 0.0]], velocity)
        simulator.advance(*fields)
        state, others = simulator.get_state(), [by_pymunk(SURFACE, [STEEL] * 3, walls=WALLS)]
        others += [copy.deepcopy(simulator), pickle.loads(pickle.dumps(simulator))]
        others[0].set_state(state)
        for other in (simulator, *others):
            other.advance(*fields, 3)
            assert same(snapshot(other), snapshot(simulator))
        deepest = max(deepest, simulator.deepest_overlap)
    assert deepest > 0.4 * speed * H


def test_parts_far_apart_need_no_space(monkeypatch):
    simulator = by_pymunk(SURFACE, [STEEL] * 2)
    simulator.reset([[0.2, 0.1, 0.0], [0.6, 0.1, 0.0]])
    monkeypatch.setattr(pymunk, "Space", None)
    simulator.advance(*random_fields(SURFACE, 1), 3)
    assert simulator.statistics == {"free": 3, "near": 0, "contact": 0, "contact_steps": 0}


def test_an_interrupted_step_leaves_no_trace(monkeypatch):
    """Ctrl-C within a space's step: afterwards a restored state goes on as before."""
    fields = radial(0.416, 0.104).drive(SURFACE)
    simulator, sound = (by_pymunk(SURFACE, [STEEL] * 2) for _ in range(2))
    simulator.reset([[0.39, 0.1, 0.0], [0.45, 0.1, 0.3]])
    simulator.advance(*fields, 2)
    state, step, calls = simulator.get_state(), pymunk.Space.step, []

    def interrupted(space, h):
        calls.append(h)
        step(space, h)
        if len(calls) == 4:
            raise KeyboardInterrupt

    with monkeypatch.context() as patched:
        patched.setattr(pymunk.Space, "step", interrupted)
        with pytest.raises(KeyboardInterrupt):
            simulator.advance(*fields, 5)
    for each in (simulator, sound):
        each.set_state(state)
        each.advance(*fields, 5)
    assert same(snapshot(simulator), snapshot(sound))


def test_a_part_falls_while_others_touch():
    """It has no contacts from then on, and the others go on."""
    parts = [STEEL] * 3
    simulator = by_pymunk(SURFACE, parts, walls=["bottom"])
    simulator.reset([[0.01, 0.06, 0.0], [0.065, 0.06, 0.0], [0.12, 0.06, 0.0]], [[-0.4, 0.0, 0.0]] * 3)
    simulator.advance(*uniform(math.pi).drive(SURFACE), 3)
    assert simulator.fallen[0].tolist() == [True, False, False]
    fallen = simulator.pose[0, 0]
    simulator.advance(*uniform(math.pi).drive(SURFACE), 60)
    assert simulator.fallen.all() and (simulator.pose[0, 0] == fallen).all()
    assert np.isfinite(simulator.pose).all() and not simulator.diverged.any()


def test_thin_parts_take_shorter_steps():
    """A sheet of 0.1 mm is pressed against a wall by a block."""
    sheet = Part.rectangle(0.05, 1e-4, friction=0.6, mass=0.002)
    simulator = by_pymunk(SURFACE, [sheet, STEEL], walls=WALLS)
    simulator.reset([[0.01, 0.1, math.pi / 2], [0.06, 0.1, 0.0]])
    simulator.advance(*uniform(math.pi).drive(SURFACE), 15)
    assert simulator.statistics["contact_steps"] > 0 and simulator.deepest_overlap < 0.05e-3
    assert 0.0 < simulator.pose[0, 0, 0] < simulator.pose[0, 1, 0] - 0.019


@pytest.mark.parametrize(
    "parts, more, message",
    [
        ([Part.rectangle(0.05, 9e-5, friction=0.6), STEEL], {}, r"0.09 mm wide.*|at least 0\.1 mm wide"),
        ([Part.disc(0.01, friction=0.6, mass=1e-4), Part.disc(0.03, friction=0.6, mass=0.5)], {}, "ratio of at most 2000"),
        ([disc(0.01 * k) for k in range(32)], {}, r"parts must be parts with at most 31 such pairs.*got '32 different pairs"),
    ],
)  # fmt: skip
def test_refusals(parts, more, message):
    with pytest.raises(ValueError, match=message) as refused:
        by_pymunk(SURFACE, parts, **more)
    assert len(str(refused.value).splitlines()) == 1


def test_drawn_masses_beyond_the_range_are_refused():
    simulator = by_pymunk(SURFACE, [STEEL] * 2)
    simulator.reset([[0.2, 0.1, 0.0], [0.6, 0.1, 0.0]])
    with pytest.raises(ValueError, match="mass must be masses with a ratio of at most 2000"):
        simulator.set_conditions([0], mass=[[0.01, 100.0]])


@pytest.mark.parametrize("name", sorted(name for name in gym.registry if name.startswith("vibgym/")))
def test_every_environment(name):
    """With one part and no walls there are no contacts to choose; elsewhere a batch has the bits of single environments."""
    more = {"model": {"kind": "planar", "contacts": "pymunk"}}
    if (
        not gym.make(name).unwrapped.core.simulator.hulls.owner[2:].size
        and not gym.make(name).unwrapped.core.simulator.walls
    ):
        with pytest.raises(ValueError, match="contacts requires several parts or walls"):
            gym.make(name, **more)
        return
    batch, alone = gym.make_vec(name, num_envs=2, **more), gym.make(name, **more)
    seen, (one, _) = batch.reset(seed=7)[0], alone.reset(seed=8)
    rng = np.random.default_rng(0)
    for _ in range(4):
        assert (one == seen[1]).all() and np.isfinite(seen).all()
        action = rng.uniform(-1, 1, batch.action_space.shape).astype(np.float32)
        (seen, *_), (one, *_) = batch.step(action), alone.step(action[1])
