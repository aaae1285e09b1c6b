"""Contacts by pymunk: coefficients, walls, masses, an interruption, thin parts; see also test_contacts_crowds."""

import math
from functools import partial

import numpy as np
import pymunk
import pytest

from tests.simulation.helpers import STEEL, STILL, SURFACE, same, simulated, snapshot
from vibgym import Part, Simulator
from vibgym.fields import radial, uniform
from vibgym.scene.hulls import WALLS

NEAR = [[0.3, 0.5, 0.0], [0.36, 0.5, 0.0]]
by_pymunk = partial(simulated, STILL, contacts="pymunk")


def disc(restitution, friction=0.0, **more):
    """Return a disc that the table does not brake."""
    return Part.disc(0.02, friction=0.0, restitution=restitution, contact_friction=friction, **more)


@pytest.mark.parametrize(
    "wall, heading", [("left", math.pi), ("right", 0.0), ("bottom", -math.pi / 2), ("top", math.pi / 2)]
)
def test_walls_have_the_coefficients_of_the_part(wall, heading):
    """Two kinds of discs: normal velocity ``-e v``, tangential change ``mu (1 + e) v``, spin ``2 mu (1 + e) v / r``."""
    kinds = [(0.2, 0.05), (0.8, 0.1)]
    normal = np.array([math.cos(heading), math.sin(heading)])
    tangent = np.array([-normal[1], normal[0]])
    for part in range(2):
        pose, velocity = np.full((2, 3), 0.5), np.zeros((2, 3))
        pose[part, :2] += 0.46 * normal
        velocity[part, :2] = 0.5 * normal + 0.4 * tangent
        simulator = by_pymunk([disc(*kind) for kind in kinds], pose, velocity, periods=3, walls=[wall])
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
    straight = by_pymunk([disc(0.9), disc(0.4)], NEAR, [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]], periods=3)
    assert straight.velocity[0, :, 0] == pytest.approx([0.25 * (1.0 - e), 0.25 * (1.0 + e)], abs=1e-12)
    spinning = [[0.5, 0.0, 100.0], [0.0, 0.0, 0.0]]
    spun = by_pymunk([disc(0.9, 0.04), disc(0.4, 0.09)], NEAR, spinning, periods=3)
    assert abs(spun.velocity[0, :, 1]) == pytest.approx(mu * 0.25 * (1.0 + e), abs=1e-12)


def test_drawn_masses():
    """Masses of a world's conditions, set between periods: elastic impact of discs of 1 and 3 times their mass."""
    velocity, conditions = [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]], {"mass": [[1.0, 1.0], [1.0, 3.0]]}
    simulator = by_pymunk([disc(1.0)] * 2, [NEAR] * 2, velocity, periods=3, conditions=conditions)
    assert simulator.velocity[:, :, 0] == pytest.approx(np.array([[0.0, 0.5], [-0.25, 0.25]]), abs=1e-12)


def test_a_hit_part_reaches_one_that_was_far_away():
    """In the same period: all parts of a world advance together where any are near."""
    heavy = Part.disc(0.02, friction=0.0, restitution=1.0, mass=0.1, contact_friction=0.0)
    light = Part.disc(0.02, friction=0.0, restitution=1.0, mass=0.01, contact_friction=0.0)
    pose = [[0.2, 0.5, 0.0], [0.245, 0.5, 0.0], [0.32, 0.5, 0.0]]
    simulator = by_pymunk([heavy, light, light], pose, [[1.5, 0.0, 0.0], [0.0] * 3, [0.0] * 3])
    assert simulator.velocity[0, 2, 0] > 2.5  # closed form: nearly twice the velocity of the heavy one


def test_an_interrupted_step_leaves_no_trace(monkeypatch):
    """Ctrl-C within a space's step: afterwards a restored state goes on as before."""
    fields = radial(0.416, 0.104).drive(SURFACE)
    simulator, sound = (Simulator(SURFACE, [STEEL] * 2, contacts="pymunk") for _ in range(2))
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
    for sim in (simulator, sound):
        sim.set_state(state)
        sim.advance(*fields, 5)
    assert same(snapshot(simulator), snapshot(sound))


def test_a_part_falls_while_others_touch():
    """It has no contacts from then on, and the others go on."""
    parts = [STEEL] * 3
    pose, fields = [[0.01, 0.06, 0.0], [0.065, 0.06, 0.0], [0.12, 0.06, 0.0]], uniform(math.pi).drive(SURFACE)
    velocity = [[-0.4, 0.0, 0.0]] * 3
    simulator = simulated(SURFACE, parts, pose, velocity, *fields, 3, walls=["bottom"], contacts="pymunk")
    assert simulator.fallen[0].tolist() == [True, False, False]
    fallen = simulator.pose[0, 0]
    simulator.advance(*fields, 60)
    assert simulator.fallen.all() and (simulator.pose[0, 0] == fallen).all()
    assert np.isfinite(simulator.pose).all() and not simulator.diverged.any()


def test_thin_parts_take_shorter_steps():
    """A sheet of 0.1 mm is pressed against a wall by a block."""
    sheet = Part.rectangle(0.05, 1e-4, friction=0.6, mass=0.002)
    scene = [[0.01, 0.1, math.pi / 2], [0.06, 0.1, 0.0]], None, *uniform(math.pi).drive(SURFACE), 15
    simulator = simulated(SURFACE, [sheet, STEEL], *scene, walls=WALLS, contacts="pymunk")
    assert simulator.statistics["contact_steps"] > 0 and simulator.deepest_overlap < 0.05e-3
    assert 0.0 < simulator.pose[0, 0, 0] < simulator.pose[0, 1, 0] - 0.019
