"""Scenes with contacts on a still table: bounded overlap, and no gain of energy.

Shapes, spins up to 300 rad/s, speeds up to 5 m/s, mass ratios up to 1000, walls, restitution and friction of any kind. Overlap
is looked at wherever a step of contacts ends, not only at the end of a period; how deep parts may be in between is
tests/physics/test_approach.py's.
"""

import numpy as np
from hypothesis import assume, given
from hypothesis import strategies as st

from tests.fuzz.campaign import count, fuzz
from tests.simulation.helpers import kinetic_energy
from vibgym import Part, Simulator, Surface
from vibgym.scene.hulls import WALLS, gaps_between

DEEPEST = 0.3e-3  # m

WORLDS, PERIODS = 32, 6


@st.composite
def outlines(draw):
    """Vertices in units of the size: polygons with any corners, stars, angles."""
    form = draw(st.sampled_from(["convex", "star", "angle", "any"]))
    if form == "angle":
        arm = draw(st.floats(0.15, 0.8))
        return [[0, 0], [2, 0], [2, arm], [arm, arm], [arm, 2], [0, 2]]
    corners = draw(st.integers(3, 11))
    if form == "star":
        turn, reach = np.arange(2 * corners) * np.pi / corners, np.tile([1.0, draw(st.floats(0.3, 0.8))], corners)
    else:
        steps = [draw(st.floats(0.2, 1.0)) for _ in range(corners)]
        turn = 2.0 * np.pi * np.cumsum(steps) / np.sum(steps)
        reach = np.ones(corners) if form == "convex" else [draw(st.floats(0.4, 1.0)) for _ in range(corners)]
    return np.column_stack([reach * np.cos(turn), reach * np.sin(turn)])


@st.composite
def parts_of_a_size(draw, size):
    """A part about as large as ``size``, m."""
    properties = {
        "friction": draw(st.sampled_from([0.0, 0.3, 0.6, 1.0])),
        "restitution": draw(st.sampled_from([0.0, 0.2, 0.5, 0.9, 1.0])),
        "contact_friction": draw(st.sampled_from([0.0, 0.1, 0.3, 1.0, 2.0])),
        "mass": 10.0 ** draw(st.sampled_from([0.0, 0.0, 1.0, 2.0, 3.0])) / 100.0,
    }
    size *= draw(st.floats(0.3, 1.0))
    form = draw(st.sampled_from(["disc", "rectangle", "polygon", "polygon"]))
    if form == "disc":
        return Part.disc(size, **properties)
    if form == "rectangle":
        return Part.rectangle(2.0 * size, 2.0 * size * draw(st.floats(0.05, 1.0)), **properties)
    return Part.polygon(size * np.asarray(draw(outlines()), dtype=float), **properties)


@st.composite
def scenes(draw, **knobs):
    """Return a simulator of worlds in which parts approach one another, also closely or in a corner."""
    size = 10.0 ** draw(st.floats(-2.3, -1.3))
    parts = draw(st.lists(parts_of_a_size(size), min_size=1, max_size=6))
    walls = WALLS if len(parts) == 1 or draw(st.booleans()) else ()
    surface = Surface(16, 16, 0.05, 0.0, draw(st.sampled_from([10.0, 25.0, 25.0, 50.0])))
    simulator = Simulator(surface, parts, walls=walls, worlds=WORLDS, **knobs)
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    pose = somewhere(rng, parts, in_corner=bool(walls) and draw(st.booleans()))
    assume(pose is not None)
    velocity = rng.uniform(-1.0, 1.0, pose.shape) * [1.0, 1.0, 300.0 * 10.0 ** draw(st.floats(-2, 0))]
    if draw(st.booleans()):  # towards the middle of them all
        way = pose[..., :2].mean(axis=1, keepdims=True) - pose[..., :2]
        speed = np.hypot(velocity[..., 0], velocity[..., 1])[..., None]
        velocity[..., :2] = way / np.maximum(np.linalg.norm(way, axis=2, keepdims=True), 1e-9) * speed
    velocity[..., :2] *= 5.0 / np.sqrt(2.0) * 10.0 ** draw(st.floats(-2, 0))
    simulator.reset(pose, velocity)
    return simulator


def somewhere(rng, parts, in_corner):
    """Return poses (WORLDS, parts, 3) without overlap in little room; None after too many tries."""
    radius = max(part.radius for part in parts)
    room, margin, table = 2.0 * radius * np.sqrt(len(parts)), 1.001 * radius, 0.8
    pose, todo = np.zeros((WORLDS, len(parts), 3)), np.arange(WORLDS)
    for _ in range(200):
        low = margin if in_corner else max(0.5 * (table - room), margin)
        high = min(low + room, table - margin)
        pose[todo, :, :2] = rng.uniform(low, high, (len(todo), len(parts), 2))
        pose[todo, :, 2] = rng.uniform(-4.0, 4.0, (len(todo), len(parts)))
        todo = todo[gaps_between(parts, pose[todo]).min(axis=(1, 2)) < 1e-5]
        if not len(todo):
            return pose
        room *= 1.05
    return None


@fuzz(examples=8, seconds_share=2.0)
@given(scenes())
def test_contacts_stay_shallow_and_lose_energy(simulator):
    count("scenes", WORLDS)
    begun = energy = kinetic_energy(simulator)
    for _ in range(PERIODS):
        simulator.advance(0.0, 0.0)
        now = kinetic_energy(simulator)
        assert (now <= energy + 1e-13 * begun).all()
        energy = now
    assert simulator.deepest_overlap <= DEEPEST
    assert not simulator.diverged.any()
    assert not (simulator.walls and simulator.fallen.any())
    simulator.set_state(simulator.get_state())  # takes its own state
    count("steps with contacts", simulator.statistics["contact_steps"])


@fuzz(examples=4, seconds_share=0.5)
@given(scenes(contacts="pymunk"))
def test_contacts_by_pymunk_go_on_from_a_state(simulator):
    """Results depend on neither the batch nor the history, with any overlaps and spins."""
    count("scenes with pymunk", WORLDS)
    begun = kinetic_energy(simulator)
    simulator.advance(0.0, 0.0, PERIODS // 2)
    count("of them with over 1 % more energy", int((kinetic_energy(simulator) > 1.01 * begun).sum()))
    state = simulator.get_state()
    one = Simulator(simulator.surface, simulator.parts, walls=simulator.walls, contacts="pymunk")
    one.set_state({name: value[3:4] if isinstance(value, np.ndarray) else value for name, value in state.items()})
    simulator.advance(0.0, 0.0, PERIODS)
    for _ in range(PERIODS):
        one.advance(0.0, 0.0)
    assert np.array_equal(one.pose, simulator.pose[3:4]) and np.array_equal(one.velocity, simulator.velocity[3:4])
    assert np.isfinite(simulator.pose).all() and not simulator.diverged.any()
    count("steps with pymunk", simulator.statistics["contact_steps"])
