"""Several parts, with certified contacts, fast ones and those by pymunk: independence, impacts, heaps, walls, falls."""

import math
from typing import NamedTuple

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import vibgym  # noqa: F401 - registers the environments
from tests.simulation.helpers import (
    ALUMINIUM,
    CORNER,
    DISC,
    L_SHAPE,
    MIXED,
    STEEL,
    STILL,
    SURFACE,
    grid,
    kinetic_energy,
    random_fields,
    simulated,
)
from vibgym import Part, Simulator
from vibgym.fields import radial, uniform
from vibgym.scene.hulls import WALLS, gaps_between

SMALL = Part.disc(0.005, friction=0.6, name="small")


class Contacts(NamedTuple):
    """One kind of contacts, and the limits of its errors."""

    name: str
    meeting: float  # m, displacement by an impact that is found within a step
    gain: float  # of energy by elastic impacts, relative
    overlap: float  # m, in heaps driven together
    rest: float  # m, at rest under a push

    def simulator(self, surface, parts, **more):
        return Simulator(surface, parts, contacts=self.name, **more)


CONTACTS = [
    Contacts("certified", meeting=2e-5, gain=1e-12, overlap=0.3e-3, rest=0.3e-3),
    Contacts("fast", meeting=2e-4, gain=1e-9, overlap=0.5e-3, rest=0.3e-3),
    # Impacts are found after up to a step of 4 ms, and act at its end. Twenty iterations end before elastic impacts of several
    # parts at a time conserve energy.
    Contacts("pymunk", meeting=4e-3, gain=0.02, overlap=2.4e-3, rest=0.3e-3),
]


@pytest.fixture(params=CONTACTS, ids=lambda contacts: contacts.name, scope="module")
def contacts(request):
    return request.param


resolved_together = pytest.mark.parametrize("contacts", CONTACTS[1:], ids=lambda contacts: contacts.name, indirect=True)
"""Contacts that resolve simultaneous impacts together, not one after another."""


def slippery(part=Part.disc, size=(0.02,), **more):
    """Return a part without friction on the table."""
    return part(*size, **{"friction": 0.0, "contact_friction": 0.0, **more})


def heap(pitch, worlds, seed, count):
    """Return poses of 12 parts around the middle, at random headings."""
    rng, k = np.random.default_rng(seed), np.arange(count)
    pose = np.zeros((worlds, count, 3))
    pose[..., 0], pose[..., 1] = 0.416 + pitch * (k % 4 - 1.5), 0.104 + pitch * (k // 4 - 1)
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, count))
    return pose


def deepest(simulator):
    """Return the smallest gap between two parts, or a part and a wall, m."""
    gap = gaps_between(simulator.parts, simulator.pose).min()
    for part, (x, y, turn) in zip(simulator.parts, simulator.pose[0]):
        c, s = math.cos(turn), math.sin(turn)
        corners = part.outline @ np.array([[c, s], [-s, c]]) + [x, y]
        low, high = corners.min(axis=0), np.array([SURFACE.width, SURFACE.depth]) - corners.max(axis=0)
        beside = dict(zip(("left", "bottom", "right", "top"), (*low, *high)))
        gap = min(gap, *(beside[wall] for wall in simulator.walls))
    return gap


# -- parts without contacts --------------------------------------------------------------------------------------------


def test_distant_parts_are_independent(contacts):
    """Every part moves as in a separate world, bit for bit, also with kinds of different step counts."""
    parts = [STEEL, SMALL, L_SHAPE, ALUMINIUM, SMALL, DISC]
    rng, worlds = np.random.default_rng(1), 24
    pose = np.zeros((worlds, 6, 3))
    pose[..., 0] = np.linspace(0.08, 0.75, 6) + rng.uniform(-0.003, 0.003, (worlds, 6))
    pose[..., 1], pose[..., 2] = rng.uniform(0.08, 0.12, (worlds, 6)), rng.uniform(-3, 3, (worlds, 6))
    velocity = rng.uniform(-1, 1, pose.shape) * [0.05, 0.05, 5.0]
    fields = random_fields(SURFACE, worlds)
    together = simulated(SURFACE, parts, pose, velocity, *fields, 3, contacts=contacts.name)
    assert together.statistics == {"free": 3 * worlds, "near": 0, "contact": 0, "contact_steps": 0}
    for k, part in enumerate(parts):
        alone = simulated(SURFACE, part, pose[:, k : k + 1], velocity[:, k : k + 1], *fields, 3)
        for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking"):
            assert (getattr(alone, name)[:, 0] == getattr(together, name)[:, k]).all(), (k, name)


def test_passing_parts_are_independent():
    """Near parts without contact move as in separate worlds, bit for bit; with certified contacts."""
    parts = [STEEL, STEEL, SMALL]
    pose = np.array([[0.3, 0.1, 0.0], [0.3, 0.143, 0.0], [0.348, 0.1, 0.0]])
    velocity = np.array([[0.1, 0.0, 0.0]] * 3)
    fields = uniform(0.0).drive(SURFACE)
    together = simulated(SURFACE, parts, pose, velocity, *fields, 4)
    assert together.statistics["near"] >= 2 and together.statistics["contact"] == 0
    for k, part in enumerate(parts):
        alone = simulated(SURFACE, part, pose[k], velocity[k], *fields, 4)
        assert (alone.pose[:, 0] == together.pose[:, k]).all()
        assert (alone.velocity[:, 0] == together.velocity[:, k]).all()


def test_statistics_add_up(contacts):
    simulator = contacts.simulator(SURFACE, MIXED * 2, worlds=9, threads=2)
    simulator.reset(grid(MIXED * 2))
    simulator.advance(*random_fields(SURFACE, 9), 7)
    counts = simulator.statistics
    assert counts["free"] + counts["near"] + counts["contact"] == 9 * 7
    assert counts["contact_steps"] > 0
    simulator.reset(grid(MIXED * 2))
    assert set(simulator.statistics.values()) == {0} and simulator.deepest_overlap == 0.0


# -- impacts -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 5.0])
def test_two_bodies_head_on(contacts, restitution, ratio):
    """Velocities are those of the closed form, and positions as well, if impacts act from the time of impact on."""
    parts = [slippery(restitution=restitution, mass=0.1), slippery(restitution=restitution, mass=0.1 * ratio)]
    pose, velocity = [[0.30, 0.5, 0.0], [0.40, 0.5, 0.0]], [[0.6, 0.0, 0.0], [0.0, 0.0, 0.0]]
    simulator = simulated(STILL, parts, pose, velocity, periods=5, contacts=contacts.name)
    common = 0.6 / (1.0 + ratio)
    after = np.array([common - restitution * (0.6 - common), common + restitution * common])
    assert simulator.velocity[0, :, 0] == pytest.approx(after, abs=1e-12)
    left = simulator.time - 0.06 / 0.6
    assert simulator.pose[0, :, 0] == pytest.approx(np.array([0.36, 0.40]) + after * left, abs=contacts.meeting)


@resolved_together
def test_simultaneous_impacts_are_symmetric(contacts):
    """Two discs hit a third from both sides at once; the one in the middle stays."""
    pose = [[0.4, 0.5, 0.0], [0.5, 0.5, 0.0], [0.6, 0.5, 0.0]]
    velocity = [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]]
    parts = [slippery(restitution=0.5)] * 3
    simulator = simulated(STILL, parts, pose, velocity, periods=6, contacts=contacts.name)
    assert simulator.velocity[0, :, 0] == pytest.approx([-0.25, 0.0, 0.25], abs=2e-3)
    assert abs(simulator.velocity[0, :, 0].sum()) < 1e-12


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.sampled_from([0.0, 0.2, 0.7]), st.floats(0.0, 1.0))
def test_momentum_is_conserved_and_no_energy_gained(contacts, seed, restitution, friction):
    """Random crowds of spinning discs and blocks that slide without friction on the table."""
    rng, more = np.random.default_rng(seed), {"restitution": restitution, "contact_friction": friction}
    kinds = [slippery(**more), slippery(Part.rectangle, (0.05, 0.03), **more, mass=0.3)]
    simulator = contacts.simulator(STILL, [kinds[k] for k in rng.integers(0, 2, 12)], worlds=6)
    mass = np.array([part.mass for part in simulator.parts])
    inertia = mass * [part.gyration for part in simulator.parts]

    def moments():
        """Return momentum (worlds, 2), and angular momentum about the origin, (worlds,)."""
        x, y, vx, vy, spin = *simulator.pose[..., :2].transpose(2, 0, 1), *simulator.velocity.transpose(2, 0, 1)
        return mass @ simulator.velocity[..., :2], (mass * (x * vy - y * vx) + inertia * spin).sum(axis=1)

    simulator.reset(heap(0.062, 6, seed, 12) + [0.084, 0.396, 0.0], rng.uniform(-1, 1, (6, 12, 3)) * [0.6, 0.6, 5.0])
    (before, angular), energy = moments(), kinetic_energy(simulator)
    scale = (mass * np.hypot(simulator.velocity[..., 0], simulator.velocity[..., 1])).sum(axis=1)
    for _ in range(8):
        simulator.advance(0.0, 0.0)
        (momentum, turning), now = moments(), kinetic_energy(simulator)
        assert momentum == pytest.approx(before, abs=1e-12)
        # Forces act on two overlapping surfaces, so there may be a torque with that arm.
        arm = simulator.deepest_overlap if contacts.name == "certified" else math.inf
        assert (np.abs(turning - angular) <= arm * scale + 1e-12).all()
        assert (now <= energy * (1.0 + contacts.gain)).all()
        energy = now
    assert simulator.statistics["contact"] >= 6
    assert gaps_between(simulator.parts, simulator.pose).min() > -simulator.deepest_overlap - 1e-12
    assert simulator.deepest_overlap < 1.5 * contacts.meeting + contacts.overlap


# -- heaps and walls ---------------------------------------------------------------------------------------------------


def test_overlap_by_random_fields_in_dense_crowds(contacts):
    """Random fields for three seconds between walls: hits from all sides."""
    parts = [MIXED[k % 4] for k in range(28)]
    simulator = contacts.simulator(SURFACE, parts, worlds=4, walls=WALLS)
    simulator.reset(grid(parts))
    for step in range(75):
        simulator.advance(*random_fields(SURFACE, 4, seed=step // 5))
        assert gaps_between(parts, simulator.pose).min() > -contacts.overlap
    assert simulator.deepest_overlap < contacts.overlap
    assert not simulator.fallen.any() and not simulator.diverged.any()


def test_a_pile_stays_at_rest_and_holds_under_push(contacts):
    """14 s of full push towards a corner: no part passes a wall or another one; on a table at rest nothing moves.

    The long run is ``python -m studies.benchmarks.pile``.
    """
    parts = [MIXED[k % 4] for k in range(12)]
    simulator = contacts.simulator(SURFACE, parts, walls=WALLS)
    simulator.reset(grid(parts))
    simulator.advance(*CORNER, 200)
    settled = simulator.pose
    for _ in range(6):
        simulator.advance(*CORNER, 25)
        assert deepest(simulator) > -contacts.rest
        assert np.hypot(*simulator.velocity[0, :, :2].T).max() < 2.0 * SURFACE.table_speed
    assert not simulator.fallen.any() and not simulator.diverged.any()
    # The table's motion shakes the pile.
    assert np.abs(simulator.pose - settled)[..., :2].max() < 3e-3
    rest = simulated(STILL, parts, simulator.pose, periods=25, walls=WALLS, contacts=contacts.name)
    assert np.abs(rest.pose - simulator.pose)[..., :2].max() < 1e-4
    assert (rest.velocity == 0.0).all()


@pytest.mark.parametrize("direction, wall", [(0, "right"), (90, "top"), (180, "left"), (270, "bottom"), (45, "right")])
def test_walls_hold_parts(contacts, direction, wall):
    """Under full push towards a wall for two seconds no part falls or overlaps a wall; without it they fall."""
    start = [[0.2, 0.05, 0.3], [0.4, 0.1, 0.2], [0.6, 0.15, 0.0], [0.7, 0.06, 2.0]]
    fields = uniform(math.radians(direction)).drive(SURFACE)
    closed = contacts.simulator(SURFACE, MIXED, walls=WALLS)
    closed.reset(start)
    for _ in range(10):
        closed.advance(*fields, 5)
        assert not closed.fallen.any() and not closed.diverged.any()
        assert deepest(closed) > -contacts.overlap
    others = [name for name in WALLS if name != wall]
    opened = simulated(SURFACE, MIXED, start, None, *fields, 60, walls=others, contacts=contacts.name)
    assert opened.fallen.any()


def test_a_heavy_part_pushes_a_light_one_against_a_wall(contacts):
    heavy = Part.rectangle(0.05, 0.04, friction=0.6, mass=1.0)
    light = Part.rectangle(0.03, 0.03, friction=0.6, mass=0.01)
    scene = [[0.016, 0.1, 0.0], [0.056, 0.1, 0.0]], None, *uniform(math.pi).drive(SURFACE), 50
    simulator = simulated(SURFACE, [light, heavy], *scene, walls=WALLS, contacts=contacts.name)
    assert gaps_between(simulator.parts, simulator.pose).min() > -0.5e-3
    assert simulator.pose[0, 0, 0] > 0.0145 and not simulator.fallen.any()


def test_fallen_parts_have_no_contacts(contacts):
    """Others move as without the fallen part, also through its position, bit for bit."""
    fields = uniform(math.pi).drive(SURFACE)
    pose = np.array([[0.7, 0.1, 0.0], [0.08, 0.1, 0.1], [0.127, 0.1, 0.0]])
    far, fell = (contacts.simulator(SURFACE, [STEEL, DISC, STEEL]) for _ in range(2))
    far.reset(pose, [[0.0] * 3, [0.0] * 3, [-0.1, 0.0, 0.0]])
    state = far.get_state()
    state["pose"][0, 0], state["fallen"][0, 0] = [0.02, 0.1, 0.0], True
    fell.set_state(state)
    for _ in range(30):
        for simulator in (far, fell):
            simulator.advance(*fields)
        assert (fell.pose[0, 0] == [0.02, 0.1, 0.0]).all() and (fell.velocity[0, 0] == 0.0).all()
        for name in ("pose", "velocity", "fallen", "sticking"):
            assert (getattr(fell, name)[:, 1:] == getattr(far, name)[:, 1:]).all()
    assert fell.statistics == far.statistics and fell.statistics["contact"] > 0  # the two have collided
    assert fell.fallen[0, 1] and not far.fallen[0, 0]  # over the border, through the position of the first one


# -- agreement with certified contacts -----------------------------------------------------------------------------------


def driven_together(**knobs):
    """Return positions of two blocks in 32 worlds after 12 periods in a radial field."""
    pose = np.tile([[0.35, 0.104, 0.2], [0.47, 0.104, -0.1]], (32, 1, 1))
    pose[:, :, 2] += np.linspace(-1.0, 1.0, 32)[:, None]
    scene = pose, None, *radial(0.416, 0.104).drive(SURFACE), 12
    return simulated(SURFACE, [ALUMINIUM, STEEL], *scene, **knobs).pose[..., :2]


@pytest.mark.parametrize("name", ["fast", "pymunk"])
def test_convergence_to_certified_contacts(name):
    reference, error = driven_together(contact_steps=320), {}
    for steps in (5, 20, 160):
        away = driven_together(contacts=name, contact_steps=steps) - reference
        error[steps] = np.median(np.linalg.norm(away, axis=-1))
    assert error[5] < 2e-3  # m, in half a second
    assert error[160] < 0.5 * error[20] < 0.5 * error[5]


@pytest.mark.parametrize("kind", ["fast", "pymunk"])
@pytest.mark.parametrize("name", ["Pack", "Push", "Feed", "FeedHeaps"])
def test_environments(kind, name):
    """Pinned and undriven parts, walls, arrivals and departures: batch and single environments agree."""
    more = {"model": {"kind": "planar", "contacts": kind}}
    batch = gym.make_vec(f"vibgym/{name}-v0", num_envs=3, **more)
    alone = gym.make(f"vibgym/{name}-v0", **more)
    batch.reset(seed=7)
    alone.reset(seed=8)
    rng = np.random.default_rng(0)
    for _ in range(30):
        action = rng.uniform(-1, 1, batch.action_space.shape).astype(np.float32)
        seen, reward, *_ = batch.step(action)
        one, value, ended, cut, _ = alone.step(action[1])
        assert (one == seen[1]).all() and value == reward[1] and np.isfinite(seen).all()
        if ended or cut:
            break
    batch.unwrapped.set_state(batch.unwrapped.get_state())
