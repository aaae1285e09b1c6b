"""Fast, spinning, light, heavy, thin and small parts: overlaps stay small, impacts lose energy, walls hold."""

import numpy as np
import pytest

from tests.simulation.helpers import kinetic_energy
from vibgym import Part, Simulator, Surface
from vibgym.scene.hulls import WALLS, gaps_between

STILL = Surface(20, 20, 0.05, 0.0, 25.0)
WIDE = Surface(80, 80, 0.05, 0.0, 25.0)
DEEPEST = 0.3e-3  # m


def lose_energy(simulator, periods):
    """Advance, and assert that energy does not grow; returns the share that is left."""
    begun = energy = kinetic_energy(simulator)
    for _ in range(periods):
        simulator.advance(0.0, 0.0)
        now = kinetic_energy(simulator)
        assert (now <= energy + 1e-13 * begun).all()
        energy = now
    return energy / begun


def two_at_one_another(part, worlds, speed, spin, seed=0, other=None):
    """Return worlds in which two parts approach at any angle."""
    rng = np.random.default_rng(seed)
    simulator = Simulator(WIDE, [part, other or part], worlds=worlds)
    apart = 1.01 * part.radius
    pose, velocity = np.full((worlds, 2, 3), 2.0), rng.uniform(-1, 1, (worlds, 2, 3)) * [0.2 * speed, 0.3 * speed, spin]
    pose[:, 0, 0] -= apart
    pose[:, 1, 0] += apart
    pose[:, :, 2] = rng.uniform(-3, 3, (worlds, 2))
    velocity[:, 0, 0] += 0.8 * speed
    velocity[:, 1, 0] -= 0.8 * speed
    simulator.reset(pose, velocity)
    return simulator


# -- spin --------------------------------------------------------------------------------------------------------------


def test_two_spinning_blocks():
    """Corners on circles would overlap by 1.35 mm if only closing speeds limited the steps."""
    block = Part.rectangle(0.16, 0.16, friction=0.5)
    simulator = Simulator(STILL, [block, block])
    simulator.reset(
        [[0.3965, 0.4712, 0.153], [0.6035, 0.5288, -2.3058]], [[0.146, 0.077, -62.706], [-0.146, -0.077, -66.115]]
    )
    simulator.advance(0.0, 0.0)
    assert simulator.statistics["contact_steps"] > 0
    assert simulator.deepest_overlap <= DEEPEST
    assert gaps_between(simulator.parts, simulator.pose)[0, 0, 1] >= -simulator.deepest_overlap


def test_a_corner_turns_into_a_wall_that_the_part_leaves():
    """The centre moves away from the wall, but a corner turns into it within the step."""
    bar = Part.rectangle(0.012, 0.001, friction=0.0)
    simulator = Simulator(STILL, bar, walls=WALLS, worlds=200)
    rng = np.random.default_rng(3)
    turn = rng.uniform(1.1, 2.0, 200)
    reach = 0.006 * np.abs(np.cos(turn)) + 0.0005 * np.abs(np.sin(turn))
    pose = np.column_stack([reach + rng.uniform(0.0, 0.003, 200), np.full(200, 0.5), turn])
    velocity = np.column_stack(
        [rng.uniform(0, 3, 200), np.zeros(200), rng.choice([-1, 1], 200) * rng.uniform(200, 1500, 200)]
    )
    simulator.reset(pose[:, None], velocity[:, None])
    lose_energy(simulator, 2)
    assert simulator.statistics["contact_steps"] > 50
    assert simulator.deepest_overlap <= DEEPEST


# -- energy ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("length, width, restitution, friction", [
    (0.05, 0.04, 1.0, 0.3),
    (0.05, 0.04, 0.9, 1.0),
    (0.1, 0.004, 0.8, 1.0),
    (0.05, 0.04, 1.0, 0.0),
    (0.08, 0.01, 0.2, 3.0),
])  # fmt: skip
@pytest.mark.parametrize("ratio", [1.0, 1000.0])
def test_no_impact_gains_energy(length, width, restitution, friction, ratio):
    """Newton's ratio of velocities gains up to 60 % in one of these impacts; friction does not hide it."""
    properties = {"friction": 0.0, "restitution": restitution, "contact_friction": friction}
    parts = [Part.rectangle(length, width, mass=mass, **properties) for mass in (0.1, 0.1 * ratio)]
    simulator = two_at_one_another(parts[0], 300, 1.5, 20.0, other=parts[1])
    left = lose_energy(simulator, 6)
    assert simulator.statistics["contact_steps"] > 200 and not simulator.fallen.any()
    if restitution == 1.0 and friction == 0.0:
        # Repeated impacts of two bodies, and those below 10 mm/s, lose a little energy.
        assert np.median(left) == pytest.approx(1.0, abs=1e-12) and left.min() > 0.9
    if friction > 0.0 and ratio == 1.0:
        assert left.min() < 0.9


# -- walls -------------------------------------------------------------------------------------------------------------


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


# -- small, heavy and thin parts -----------------------------------------------------------------------------------------


@pytest.mark.parametrize("radius", [0.06e-3, 0.3e-3])
def test_small_discs_can_be_restored(radius):
    disc = Part.disc(radius, friction=0.6, mass=0.01)
    simulator = Simulator(Surface(), [disc, disc], worlds=50)
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


def test_ratios_beyond_the_bound_are_refused():
    light, heavy = (
        Part.disc(0.01, friction=0.5, mass=mass, name=name) for mass, name in ((1e-3, "pea"), (3.0, "anvil"))
    )
    with pytest.raises(ValueError, match=r"parts"):
        Simulator(STILL, [light, heavy])
    assert Simulator(STILL, heavy, walls=WALLS).worlds == 1  # a wall does not count as a part


def test_thin_parts_are_refused_where_parts_may_touch():
    foil = Part.rectangle(0.05, 0.05e-3, friction=0.5, name="foil")
    angle = Part.polygon([[0, 0], [0.05, 0], [0.05, 1e-5]], friction=0.5, name="edge")
    for part in (foil, angle):
        with pytest.raises(ValueError, match="parts"):
            Simulator(STILL, part, walls=["left"])
        assert Simulator(STILL, part).worlds == 1
