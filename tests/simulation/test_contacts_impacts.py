"""Spinning, light, heavy, thin and small parts: overlaps stay small, and walls hold; more scenes in tests/fuzz."""

import numpy as np
import pytest

from tests.simulation.helpers import STILL, SURFACE, kinetic_energy
from vibgym import Part, Simulator
from vibgym.scene.hulls import WALLS

DEEPEST = 0.3e-3  # m


def lose_energy(simulator, periods):
    """Advance, and assert that energy does not grow."""
    begun = energy = kinetic_energy(simulator)
    for _ in range(periods):
        simulator.advance(0.0, 0.0)
        now = kinetic_energy(simulator)
        assert (now <= energy + 1e-13 * begun).all()
        energy = now


ANGLE = 0.03 * np.array([[0, 0], [2, 0], [2, 0.1], [0.1, 0.1], [0.1, 2], [0, 2]])


@pytest.mark.parametrize("part", [
    Part.rectangle(0.03, 0.1e-3, friction=0.3, mass=0.01), Part.rectangle(0.03, 1e-3, friction=0.3, mass=0.01),
    Part.polygon(ANGLE, friction=0.3),
], ids=["thinnest", "thin", "angle"])  # fmt: skip
def test_walls_hold_parts_whose_centre_is_near_or_off_their_outline(part):
    rng = np.random.default_rng(0)
    simulator = Simulator(STILL, part, walls=WALLS, worlds=200)
    pose = np.column_stack([rng.uniform(0.1, 0.9, (200, 2)), rng.uniform(-3, 3, 200)])
    pose[::3, 2], pose[1::3, 2] = 0.0, 0.5 * np.pi
    simulator.reset(pose[:, None], (rng.uniform(-1, 1, (200, 3)) * [5.0, 5.0, 30.0])[:, None])
    lose_energy(simulator, 20)
    assert not simulator.fallen.any() and simulator.deepest_overlap <= DEEPEST


@pytest.mark.parametrize("radius", [0.06e-3, 0.3e-3])
def test_small_discs_can_be_restored(radius):
    disc = Part.disc(radius, friction=0.6, mass=0.01)
    simulator = Simulator(SURFACE, [disc, disc], worlds=50)
    rng = np.random.default_rng(0)
    pose = np.tile([[0.4, 0.1, 0.0], [0.4 + 4.0 * radius, 0.1, 0.0]], (50, 1, 1))
    velocity = rng.uniform(0.0, 1.0, (50, 2, 3)) * [[1.0, 0.1, 10.0], [-1.0, 0.1, 10.0]]
    simulator.reset(pose, velocity)
    for _ in range(10):
        simulator.advance(2e-4, rng.uniform(0.0, 6.0))
        simulator.set_state(simulator.get_state())
        assert simulator.deepest_overlap < 0.5 * radius
    assert simulator.statistics["contact_steps"] > 20


def test_mass_ratios_hold_up_to_the_bound():
    """A light disc between approaching heavy blocks: parts keep their order."""
    disc = Part.disc(0.01, friction=0.3, mass=1e-3, restitution=0.5)
    block = Part.rectangle(0.04, 0.04, friction=0.3, mass=2.0, restitution=0.5)
    simulator = Simulator(STILL, [block, disc, block], worlds=100)
    rng = np.random.default_rng(0)
    pose = np.tile([[0.46, 0.5, 0.0], [0.5, 0.5, 0.0], [0.54, 0.5, 0.0]], (100, 1, 1))
    velocity = rng.uniform(-1, 1, (100, 3, 3)) * [0.3, 0.0, 0.0] + [[5.0, 0, 0], [0, 0, 0], [-5.0, 0, 0]]
    simulator.reset(pose, velocity)
    lose_energy(simulator, 5)
    assert simulator.deepest_overlap <= DEEPEST
    there = simulator.pose[..., 0]
    assert (np.diff(there, axis=1) > 0.0).all()
