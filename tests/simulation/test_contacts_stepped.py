"""Contacts in equal steps, fast ones and by pymunk: conservation, energy, overlap, agreement, the same bits in any batch."""

import math
from dataclasses import dataclass

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

import vibgym  # noqa: F401 - registers the environments
from tests.simulation.helpers import kinetic_energy, random_fields, same, snapshot
from vibgym import Part, Simulator, Surface
from vibgym.fields import radial, uniform
from vibgym.scene.hulls import WALLS, gaps_between

SURFACE = Surface()
STILL = Surface(20, 20, 0.05, 0.0)
STEEL = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel")
ALUMINIUM = Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=0.0945, name="aluminium")
DISC = Part.disc(0.02, friction=0.6, name="disc")
L_SHAPE = Part.polygon(
    np.array([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)]) * 1e-3, friction=0.6, name="L"
)
MIXED = [STEEL, ALUMINIUM, DISC, L_SHAPE]
CORNER = uniform(math.radians(225)).drive(SURFACE)


@dataclass
class Limits:
    """Of the errors of one kind of contacts."""

    name: str
    meeting: float  # m, displacement by an impact that is found within a step
    gain: float  # of energy by elastic impacts, relative
    overlap: float  # m, in heaps driven together
    rest: float  # m, at rest under a push
    driven: float  # m, error of two blocks driven together for half a second, five steps a period

    def simulator(self, surface, parts, **more):
        return Simulator(surface, parts, contacts=self.name, **more)


LIMITS = [
    Limits("fast", meeting=2e-4, gain=1e-9, overlap=0.5e-3, rest=0.3e-3, driven=2e-3),
    # Impacts are found after up to a step of 4 ms, and act at its end. Twenty iterations end before elastic impacts of several
    # parts at a time conserve energy.
    Limits("pymunk", meeting=4e-3, gain=0.02, overlap=2.4e-3, rest=0.3e-3, driven=2e-3),
]


@pytest.fixture(params=LIMITS, ids=lambda limits: limits.name, scope="module")
def contacts(request):
    return request.param


def slippery(part=Part.disc, size=(0.02,), **more):
    """Return a part without friction on the table."""
    return part(*size, **{"friction": 0.0, "contact_friction": 0.0, **more})


def momentum(simulator):
    mass = np.array([part.mass for part in simulator.parts]) * simulator.mass
    return (mass[..., None] * simulator.velocity[..., :2]).sum(axis=1)


def heap(pitch, worlds, seed, parts):
    """Poses of 12 parts around the middle, at random headings."""
    rng, k = np.random.default_rng(seed), np.arange(len(parts))
    pose = np.zeros((worlds, len(parts), 3))
    pose[..., 0], pose[..., 1] = 0.416 + pitch * (k % 4 - 1.5), 0.104 + pitch * (k // 4 - 1)
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (worlds, len(parts)))
    return pose


# -- impacts -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.2, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 5.0])
def test_two_bodies_head_on(contacts, restitution, ratio):
    """Velocities are those of the closed form, and positions as well, if impulses act from the time of impact on."""
    parts = [slippery(restitution=restitution, mass=0.1), slippery(restitution=restitution, mass=0.1 * ratio)]
    simulator = contacts.simulator(STILL, parts)
    simulator.reset([[0.30, 0.5, 0.0], [0.40, 0.5, 0.0]], [[0.6, 0.0, 0.0], [0.0, 0.0, 0.0]])
    simulator.advance(0.0, 0.0, 5)
    common = 0.6 / (1.0 + ratio)
    after = np.array([common - restitution * (0.6 - common), common + restitution * common])
    assert simulator.velocity[0, :, 0] == pytest.approx(after, abs=1e-12)
    left = simulator.time - 0.06 / 0.6
    assert simulator.pose[0, :, 0] == pytest.approx(np.array([0.36, 0.40]) + after * left, abs=contacts.meeting)


def test_simultaneous_impacts_are_symmetric(contacts):
    """Two discs hit a third from both sides at once; the one in the middle stays."""
    simulator = contacts.simulator(STILL, [slippery(restitution=0.5)] * 3)
    velocity = [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0], [-0.5, 0.0, 0.0]]
    simulator.reset([[0.4, 0.5, 0.0], [0.5, 0.5, 0.0], [0.6, 0.5, 0.0]], velocity)
    simulator.advance(0.0, 0.0, 6)
    assert simulator.velocity[0, :, 0] == pytest.approx([-0.25, 0.0, 0.25], abs=2e-3)
    assert abs(simulator.velocity[0, :, 0].sum()) < 1e-12


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_momentum_is_conserved_and_no_energy_gained(contacts, seed, restitution, friction):
    """Random crowds of spinning blocks and discs that slide without friction on the table."""
    rng, more = np.random.default_rng(seed), {"restitution": restitution, "contact_friction": friction}
    kinds = [slippery(**more), slippery(Part.rectangle, (0.05, 0.03), **more, mass=0.3)]
    simulator = contacts.simulator(STILL, [kinds[k] for k in rng.integers(0, 2, 12)], worlds=6)
    velocity = rng.uniform(-1, 1, (6, 12, 3)) * [0.6, 0.6, 5.0]
    simulator.reset(heap(0.062, 6, seed, simulator.parts) + [0.084, 0.396, 0.0], velocity)
    before, energy = momentum(simulator), kinetic_energy(simulator)
    for _ in range(8):
        simulator.advance(0.0, 0.0)
        now = kinetic_energy(simulator)
        assert momentum(simulator) == pytest.approx(before, abs=1e-12)
        assert (now <= energy * (1.0 + contacts.gain)).all()
        energy = now
    assert simulator.statistics["contact"] >= 6
    assert gaps_between(simulator.parts, simulator.pose).min() > -simulator.deepest_overlap - 1e-12
    assert simulator.deepest_overlap < 1.5 * contacts.meeting + contacts.overlap


# -- heaps -------------------------------------------------------------------------------------------------------------


@settings(max_examples=12, deadline=None)
@given(st.integers(0, 2**32 - 1), st.floats(0.062, 0.075), st.booleans())
def test_overlap_in_a_heap_driven_together(contacts, seed, pitch, mixed):
    parts = [MIXED[k % 4] for k in range(12)] if mixed else [ALUMINIUM] * 12
    simulator = contacts.simulator(SURFACE, parts, worlds=4)
    pose = heap(max(pitch, 0.066 if mixed else pitch), 4, seed, parts)
    assume(gaps_between(parts, pose).min() >= 0.0)
    simulator.reset(pose)
    for _ in range(25):
        simulator.advance(*radial(0.416, 0.104).drive(SURFACE))
        assert gaps_between(parts, simulator.pose).min() > -contacts.overlap
    assert simulator.statistics["contact"] > 80 and not simulator.diverged.any()
    assert simulator.deepest_overlap < contacts.overlap


def test_overlap_by_random_fields_in_dense_crowds(contacts):
    """Random fields for three seconds between walls: hits from all sides."""
    parts = [MIXED[k % 4] for k in range(28)]
    k = np.arange(28)
    simulator = contacts.simulator(SURFACE, parts, worlds=8, walls=WALLS)
    simulator.reset(np.column_stack([0.05 + (k % 10) * 0.072, 0.035 + (k // 10) * 0.068, np.zeros(28)]))
    for step in range(75):
        simulator.advance(*random_fields(SURFACE, 8, seed=step // 5))
        assert gaps_between(parts, simulator.pose).min() > -contacts.overlap
    assert not simulator.fallen.any()


def test_a_pile_stays_at_rest_and_holds_under_push(contacts):
    """14 s of full push towards a corner: no part passes a wall or another one; on a table at rest nothing moves."""
    parts = [MIXED[k % 4] for k in range(12)]
    simulator, k = contacts.simulator(SURFACE, parts, walls=WALLS), np.arange(12)
    simulator.reset(np.column_stack([0.05 + (k % 4) * 0.072, 0.035 + (k // 4) * 0.068, np.zeros(12)]))
    simulator.advance(*CORNER, 200)
    settled = simulator.pose
    for _ in range(6):
        simulator.advance(*CORNER, 25)
        assert gaps_between(parts, simulator.pose).min() > -contacts.rest
    assert not simulator.fallen.any()
    assert (
        np.abs(simulator.pose - settled)[..., :2].max() < 3e-3
    )  # the table's motion shakes the pile, as with certified contacts
    rest = contacts.simulator(STILL, parts, walls=WALLS)
    rest.reset(simulator.pose)
    rest.advance(0.0, 0.0, 25)
    assert np.abs(rest.pose - simulator.pose)[..., :2].max() < 1e-4
    assert (rest.velocity == 0.0).all()


# -- agreement with certified contacts -----------------------------------------------------------------------------------


def driven_together(**knobs):
    """Return positions of two blocks in 32 worlds after 12 periods in a radial field."""
    worlds = 32
    simulator = Simulator(SURFACE, [ALUMINIUM, STEEL], worlds=worlds, **knobs)
    pose = np.tile([[0.35, 0.104, 0.2], [0.47, 0.104, -0.1]], (worlds, 1, 1))
    pose[:, :, 2] += np.linspace(-1.0, 1.0, worlds)[:, None]
    simulator.reset(pose)
    simulator.advance(*radial(0.416, 0.104).drive(SURFACE), periods=12)
    return simulator.pose[..., :2]


def test_convergence_to_certified_contacts(contacts):
    reference = driven_together(contact_steps=320)
    error = {
        steps: np.median(
            np.linalg.norm(driven_together(contacts=contacts.name, contact_steps=steps) - reference, axis=-1)
        )
        for steps in (5, 20, 160)
    }
    assert error[5] < contacts.driven
    assert error[160] < 0.5 * error[20] < 0.5 * error[5]


def test_parts_without_near_ones_move_as_alone(contacts):
    """Bit for bit, as with certified contacts."""
    fields = random_fields(SURFACE, 8)
    pose = np.tile([[0.15, 0.1, 0.2], [0.65, 0.1, 0.1]], (8, 1, 1))
    found = []
    for name in (contacts.name, "certified"):
        simulator = Simulator(SURFACE, [STEEL, DISC], worlds=8, contacts=name)
        simulator.reset(pose)
        simulator.advance(*fields, 3)
        found.append(snapshot(simulator))
    assert same(*found)


# -- bits, states, falls -------------------------------------------------------------------------------------------------

WORLDS = 48


def crowd(contacts, index, threads=1, periods=6):
    """Return worlds of a crowd of mixed parts after some periods."""
    index, rng = np.asarray(index), np.random.default_rng(4)
    pose = heap(0.068, WORLDS, 1, MIXED * 3) + [0.0, 0.005, 0.0]
    velocity = rng.uniform(-1, 1, pose.shape) * [0.1, 0.1, 1.0]
    velocity[:, 8:] *= 8.0
    amplitude, phase = random_fields(SURFACE, WORLDS)
    simulator = contacts.simulator(SURFACE, MIXED * 3, worlds=len(index), walls=["left", "bottom"], threads=threads)
    simulator.reset(pose[index], velocity[index])
    simulator.advance(amplitude[index], phase[index], periods)
    return simulator


@pytest.fixture(scope="module")
def whole(contacts):
    simulator = crowd(contacts, range(WORLDS))
    assert simulator.statistics["contact"] > 3 * WORLDS and simulator.fallen.any()
    return snapshot(simulator)


@pytest.mark.parametrize("threads", [1, 2, 3])
@pytest.mark.parametrize(
    "index",
    [[5], [47, 3], [7] * 9, range(WORLDS), np.random.default_rng(5).permutation(WORLDS)],
    ids=["one", "two", "repeated", "all", "permuted"],
)
def test_worlds_in_other_batches(contacts, whole, index, threads):
    expected = {name: value[list(index)] if value.ndim else value for name, value in whole.items()}
    assert same(snapshot(crowd(contacts, index, threads)), expected)


def test_states_are_complete(contacts):
    original = crowd(contacts, range(4), periods=5)
    state, fields = original.get_state(), random_fields(SURFACE, 4, seed=9)
    other = crowd(contacts, [0, 0, 0, 0], periods=2)
    other.set_state(state)
    original.advance(*fields, 4)
    for _ in range(4):
        other.advance(*fields)
    assert same(snapshot(original), snapshot(other))


def test_a_diverged_world_keeps_its_last_state(contacts):
    simulator, sound = crowd(contacts, range(3), periods=2), crowd(contacts, range(3), periods=2)
    simulator.state.velocity[1, 3, 0] = math.nan
    before = simulator.pose[1]
    for each in (simulator, sound):
        each.advance(*random_fields(SURFACE, 3, seed=6), 3)
    assert simulator.diverged.tolist() == [False, True, False]
    assert np.isfinite(simulator.pose).all() and (simulator.pose[1] == before).all()
    assert same(snapshot(simulator, [0, 2]), snapshot(sound, [0, 2]))


def test_fallen_parts_have_no_contacts(contacts):
    fields, pose = uniform(math.pi).drive(SURFACE), [[0.02, 0.1, 0.0], [0.15, 0.1, 0.0]]
    simulator = contacts.simulator(SURFACE, [STEEL, STEEL])
    simulator.reset(pose)
    state = simulator.get_state()
    state["fallen"][0, 0] = True
    simulator.set_state(state)
    simulator.advance(*fields, 40)
    assert simulator.fallen.all() and simulator.statistics["contact"] == 0
    assert (simulator.pose[0, 0] == pose[0]).all()


def test_a_heavy_part_pushes_a_light_one_against_a_wall(contacts):
    heavy = Part.rectangle(0.05, 0.04, friction=0.6, mass=1.0)
    light = Part.rectangle(0.03, 0.03, friction=0.6, mass=0.01)
    simulator = contacts.simulator(SURFACE, [light, heavy], walls=WALLS)
    simulator.reset([[0.016, 0.1, 0.0], [0.056, 0.1, 0.0]])
    simulator.advance(*uniform(math.pi).drive(SURFACE), 50)
    assert gaps_between(simulator.parts, simulator.pose).min() > -0.5e-3
    assert simulator.pose[0, 0, 0] > 0.0145 and not simulator.fallen.any()


# -- environments and errors ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["Pack", "Push", "Feed", "FeedHeaps"])
def test_environments(contacts, name):
    """Pinned and undriven parts, walls, arrivals and departures: batch and single environments agree."""
    more = {"model": {"kind": "planar", "contacts": contacts.name}}
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
    state = batch.unwrapped.get_state()
    batch.unwrapped.set_state(state)


@pytest.mark.parametrize(
    "parts, knobs, message",
    [
        ([DISC] * 2, {"contacts": "fast", "contact_overlap": 1e-5}, "contact_overlap requires contacts='certified'"),
        ([DISC], {"contacts": "fast"}, "contacts requires several parts or walls"),
    ],
)
def test_errors(parts, knobs, message):
    with pytest.raises(ValueError, match=message):
        Simulator(SURFACE, parts, **knobs)
