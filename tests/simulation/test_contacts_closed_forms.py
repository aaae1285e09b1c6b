"""Contacts against closed forms: parts without friction on a still table, with straight motion between impacts.

The solver detects a contact once shapes overlap by 2 um, and velocities may add ``contact_overlap`` before: an impact is late
by up to ``LATE`` of overlap, during which the motion is unchanged. Along the line of centres this is the only error; at an
angle the normal has rotated by overlap over tangent length. The exact result with radii that are together ``LATE`` smaller
therefore bounds the error, which the tests check; the same holds for the arms of friction.
"""

import math

import numpy as np
import pytest

from tests.simulation.helpers import kinetic_energy, simulated
from vibgym import Part, Simulator, Surface
from vibgym.fields import radial, uniform

STILL = Surface(horizontal_amplitude=0.0)
PERIOD = STILL.period
ALL_WALLS = ("left", "right", "bottom", "top")

OVERLAP = 5e-6

LATE = OVERLAP + 2e-6
"""m of overlap at an impact; at less than ``FAST``, ``LATE_AND_SLOW``: ten times as much."""

LATE_AND_SLOW = 10.0 * OVERLAP + 2e-6

FAST = 0.1  # m/s

EXACT = 1e-12


def disc(radius=0.02, **properties):
    return Part.disc(radius, **{"friction": 0.0, "contact_friction": 0.0, **properties})


def run(parts, pose, velocity, periods, **keywords):
    simulator = simulated(STILL, parts, pose, velocity, periods=periods, **{"contact_overlap": OVERLAP, **keywords})
    assert not simulator.fallen.any() and not simulator.diverged.any()
    return simulator.pose[0], simulator.velocity[0]


def blow(parts, pose, velocity, time, late=0.0, short=0.0):
    """Return pose and velocity (2, 3) of two discs that collide once, after ``time`` s.

    Radii are ``late / 2`` smaller, and the arms at which friction acts ``short``.
    """
    pose, velocity = np.array(pose, dtype=float), np.array(velocity, dtype=float)
    radii = np.array([math.sqrt(part.area / math.pi) - 0.5 * late for part in parts])
    mass = np.array([part.mass for part in parts])
    inertia = mass * [part.gyration for part in parts]
    restitution = math.sqrt(parts[0].restitution * parts[1].restitution)
    friction = math.sqrt(parts[0].contact_friction * parts[1].contact_friction)
    apart, relative = pose[1, :2] - pose[0, :2], velocity[1, :2] - velocity[0, :2]
    a, b, c = relative @ relative, apart @ relative, apart @ apart - radii.sum() ** 2
    impact_time = (-b - math.sqrt(b * b - a * c)) / a
    assert 0.0 < impact_time < time
    pose += impact_time * velocity
    normal = (pose[1, :2] - pose[0, :2]) / radii.sum()
    tangent = np.array([-normal[1], normal[0]])
    impulse = (1.0 + restitution) * -(relative @ normal) / (1.0 / mass).sum()
    # Of disc 1's surface against disc 0's.
    arms = np.array([math.sqrt(part.area / math.pi) - short for part in parts])
    slip = relative @ tangent - velocity[:, 2] @ arms
    stick = -slip / (1.0 / mass + arms**2 / inertia).sum()
    rub = np.clip(stick, -friction * impulse, friction * impulse)
    for k, sign in ((0, -1.0), (1, 1.0)):
        velocity[k, :2] += sign * (impulse * normal + rub * tangent) / mass[k]
        velocity[k, 2] -= arms[k] * rub / inertia[k]
    return pose + (time - impact_time) * velocity, velocity


def check_blow(parts, pose, velocity, periods=10):
    """Assert that the error is at most that of an impact delayed by ``LATE``."""
    measured = run(parts, pose, velocity, periods)
    exact = blow(parts, pose, velocity, periods * PERIOD)
    late = blow(parts, pose, velocity, periods * PERIOD, late=LATE)
    short = blow(parts, pose, velocity, periods * PERIOD, short=LATE)
    for got, right, *wrong in zip(measured, exact, late, short):
        bound = sum(np.abs(value - right).max() for value in wrong)
        assert np.abs(got - right).max() <= 1.05 * bound + 1e-11
    return measured


# -- two discs ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("restitution", [0.0, 0.2, 0.7, 1.0])
@pytest.mark.parametrize("ratio", [1.0, 3.0, 1000.0])
def test_head_on(restitution, ratio):
    """Velocities are exact to rounding for any masses; positions have the delay of the impact."""
    parts = [disc(restitution=restitution, mass=0.1), disc(0.015, restitution=restitution, mass=0.1 * ratio)]
    for pair in (parts, parts[::-1]):
        pose, velocity = [[0.3, 0.1, 0.2], [0.4, 0.1, 0.0]], [[0.5, 0.0, 3.0], [-0.1, 0.0, 0.0]]
        _, after = check_blow(pair, pose, velocity, 5)
        _, exact = blow(pair, pose, velocity, 5 * PERIOD)
        assert after == pytest.approx(exact, abs=0.5 * EXACT)


def test_slow_impacts():
    """Below 60 mm/s parts overlap more before the solver is called; velocities are still exact."""
    parts = [disc(restitution=1.0), disc(restitution=1.0)]
    pose, velocity = [[0.3, 0.1, 0.0], [0.345, 0.1, 0.0]], [[0.03, 0.0, 0.0], [0.0, 0.0, 0.0]]
    place, after = run(parts, pose, velocity, 10)
    exact, expected = blow(parts, pose, velocity, 10 * PERIOD)
    assert after == pytest.approx(expected, abs=EXACT)
    # Delay by overlap over speed, times the change of velocity; excess depth is corrected by half on either side.
    assert place == pytest.approx(exact, abs=1.5 * LATE_AND_SLOW)


@pytest.mark.parametrize("friction", [0.05, 0.3, 1.0, 3.0])
@pytest.mark.parametrize("spin", [0.0, 30.0, -30.0])
def test_oblique_with_friction(friction, spin):
    """Sliding during the impact, or sticking at its end: the smaller of the two impulses, and the resulting spin."""
    parts = [disc(restitution=0.6, contact_friction=friction), disc(0.03, restitution=0.6, contact_friction=friction)]
    pose, velocity = [[0.3, 0.1, 0.0], [0.4, 0.125, 0.0]], [[0.6, 0.0, spin], [0.0, 0.05, 0.0]]
    check_blow(parts, pose, velocity, 8)


# -- walls -------------------------------------------------------------------------------------------------------------

BY_WALL = {  # a position 30 mm from each wall, and the direction to it
    "left": ((0.05, 0.1), (-1.0, 0.0)),
    "right": ((STILL.width - 0.05, 0.1), (1.0, 0.0)),
    "bottom": ((0.4, 0.05), (0.0, -1.0)),
    "top": ((0.4, STILL.depth - 0.05), (0.0, 1.0)),
}


def rebound(part, friction, spin, place, towards, late=0.0, short=0.0):
    """Return pose and velocity (3,) of a 20 mm disc at 0.5 m/s towards a wall 50 mm away, 0.1 m/s along it, 5 periods later."""
    along = np.array([-towards[1], towards[0]])
    begun = 0.5 * towards + 0.1 * along
    impact_time, radius, time = (0.05 - 0.02 + late) / 0.5, 0.02 - short, 5 * PERIOD
    impulse = (1.0 + part.restitution) * 0.5  # over mass, as below
    slip = 0.1 + spin * radius  # of the disc's surface along the wall
    stick = -slip / (1.0 + radius**2 / part.gyration)
    rub = np.clip(stick, -friction * impulse, friction * impulse)
    speed, turn = begun - impulse * towards + rub * along, spin + radius * rub / part.gyration
    there = place + impact_time * begun + (time - impact_time) * speed
    return np.array([*there, impact_time * spin + (time - impact_time) * turn]), np.array([*speed, turn])


@pytest.mark.parametrize("wall", BY_WALL)
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
@pytest.mark.parametrize("friction, spin", [(0.0, 4.0), (0.1, 0.0), (3.0, 0.0), (0.2, 40.0)])
def test_disc_on_a_wall(wall, restitution, friction, spin):
    """A wall has the restitution and friction of the part that touches it."""
    place, towards = (np.array(vector) for vector in BY_WALL[wall])
    part = disc(restitution=restitution, contact_friction=friction, mass=0.03)
    parts = [part, disc(restitution=0.9, contact_friction=0.7)]
    start = [*(0.5 * towards + 0.1 * np.array([-towards[1], towards[0]])), spin]
    after = run(parts, [[*place, 0.0], [0.6, 0.1, 0.0]], [start, [0.0, 0.0, 0.0]], 5, walls=ALL_WALLS)
    scene = (part, friction, spin, place, towards)
    exact, late, short = rebound(*scene), rebound(*scene, late=LATE), rebound(*scene, short=LATE)
    for got, right, *wrong in zip(after, exact, late, short):
        bound = sum(np.abs(value - right).max() for value in wrong)
        assert np.abs(got[0] - right).max() <= 1.05 * bound + 1e-11
    assert (after[1][1] == 0.0).all()


def test_a_fast_disc_between_walls():
    """At 3 m/s it crosses the table's width many times, does not pass a wall and does not count as fallen."""
    small = disc(0.008, restitution=1.0)
    for y in np.linspace(0.02, 0.18, 9):
        place, after = run([small], [[0.4, y, 0.0]], [[0.0, 3.0, 0.0]], 25, walls=ALL_WALLS)
        assert abs(after[0, 1]) == pytest.approx(3.0, abs=EXACT)
        room = STILL.depth - 0.016
        travelled = (y - 0.008 + 3.0 * 25 * PERIOD) % (2.0 * room)
        exact = 0.008 + min(travelled, 2.0 * room - travelled)
        blows = int((y - 0.008 + 3.0 * 25 * PERIOD) // room)
        assert place[0, 1] == pytest.approx(exact, abs=2.0 * LATE * blows + EXACT)


# -- blocks ------------------------------------------------------------------------------------------------------------


def block(length, width, **properties):
    return Part.rectangle(length, width, **{"friction": 0.0, "contact_friction": 0.0, **properties})


@pytest.mark.parametrize("restitution", [0.0, 0.3, 1.0])
@pytest.mark.parametrize("friction", [0.0, 0.5])
def test_face_to_face(restitution, friction):
    """Two corners touch simultaneously and share the impulse, without rotation."""
    parts = [
        block(length, 0.04, restitution=restitution, contact_friction=friction, height=height)
        for length, height in ((0.05, 0.01), (0.03, 0.002))
    ]
    pose, velocity = [[0.3, 0.1, 0.0], [0.4, 0.1, 0.0]], [[0.4, 0.0, 0.0], [-0.2, 0.0, 0.0]]
    place, after = run(parts, pose, velocity, 6)
    mass = np.array([part.mass for part in parts])
    impulse = (1.0 + restitution) * 0.6 / (1.0 / mass).sum()
    # Two contacts, resolved by iterations: not exact to rounding.
    assert after[:, 0] == pytest.approx([0.4 - impulse / mass[0], -0.2 + impulse / mass[1]], abs=1e-5)
    assert np.abs(after[:, 1]).max() < 1e-5 and np.abs(after[:, 2]).max() < 5e-4
    assert np.abs(place[:, 1] - 0.1).max() < 1e-6 and np.abs(place[:, 2]).max() < 1e-4
    if restitution == 0.0:
        assert place[1, 0] - place[0, 0] == pytest.approx(0.04, abs=LATE)


@pytest.mark.parametrize("lever", [0.0, 0.008, -0.015])
@pytest.mark.parametrize("restitution", [0.0, 0.5, 1.0])
def test_disc_on_a_face_off_centre(lever, restitution):
    """One contact with a lever arm: (1 + e) u / (1/m1 + 1/m2 + b^2 / I2)."""
    parts = [disc(restitution=restitution), block(0.03, 0.05, restitution=restitution)]
    pose, velocity = [[0.3, 0.1 + lever, 0.0], [0.4, 0.1, 0.0]], [[0.5, 0.0, 0.0], [0.0, 0.0, 0.0]]
    # Until just after the impact: the face then rotates, and without rebound would keep touching.
    _, after = run(parts, pose, velocity, 4)
    mass, inertia = parts[1].mass, parts[1].mass * parts[1].gyration
    impulse = (1.0 + restitution) * 0.5 / (1.0 / parts[0].mass + 1.0 / mass + lever**2 / inertia)
    if restitution > 0.0 or lever == 0.0:
        assert after[0] == pytest.approx([0.5 - impulse / parts[0].mass, 0.0, 0.0], abs=1e-10)
        assert after[1] == pytest.approx([impulse / mass, 0.0, -lever * impulse / inertia], abs=1e-8)


# -- Newton's cradle ---------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("gap", [0.0, 1e-6, 1e-4])
@pytest.mark.parametrize("count", [1, 2, 5, 9])
def test_cradle(gap, count):
    """Equal discs in a row, e = 1: all stop but the last, which leaves with the whole velocity."""
    parts = [disc(restitution=1.0)] * (count + 1)
    row = [[0.1, 0.1, 0.0]] + [[0.16 + k * (0.04 + gap), 0.1, 0.0] for k in range(count)]
    place, after = run(parts, row, [[0.5, 0.0, 0.0]] + [[0.0, 0.0, 0.0]] * count, 6)
    assert after[-1] == pytest.approx([0.5, 0.0, 0.0], abs=EXACT)
    assert after[:-1] == pytest.approx(0.0, abs=EXACT)
    # Every disc moves by its gap, and by the overlap at which the solver detects contacts.
    where = row[-1][0] + 0.5 * (6 * PERIOD - (0.02 + (count - 1) * gap) / 0.5)
    assert place[-1, 0] == pytest.approx(where, abs=(count + 1) * LATE)
    assert place[1:-1, 0] == pytest.approx(np.array(row)[1:-1, 0] + gap, abs=(count + 1) * LATE)


# -- conservation -----------------------------------------------------------------------------------------------------


def test_energy_of_elastic_discs_is_conserved():
    """Hundreds of impacts between discs and walls: exact to rounding, except below 10 mm/s, without rebound."""
    parts = [disc(radius, restitution=1.0) for radius in (0.01, 0.012, 0.008, 0.015, 0.01, 0.009)]
    small, worlds, rng = Surface(rows=4, columns=6, horizontal_amplitude=0.0), 8, np.random.default_rng(1)
    simulator = Simulator(small, parts, worlds=worlds, walls=ALL_WALLS)
    pose = [[0.026 + 0.05 * (k % 3), 0.03 + 0.045 * (k // 3), 0.0] for k in range(len(parts))]
    simulator.reset(pose, rng.normal(size=(worlds, len(parts), 3)) * [0.3, 0.3, 10.0])
    begun = kinetic_energy(simulator)
    for _ in range(5):
        simulator.advance(0.0, 0.0, 20)
        share = kinetic_energy(simulator) / begun
        assert (share <= 1.0 + EXACT).all() and (share > 1.0 - 2e-3).all()
        assert np.median(np.abs(share - 1.0)) <= EXACT
    assert simulator.statistics["contact_steps"] > 100 * worlds
    assert not simulator.fallen.any()


# -- convergence -------------------------------------------------------------------------------------------------------


def pressed(contact_steps):
    """Return poses (worlds, 3) of a block pushed against the left wall by the vibrating table, after 10 periods."""
    surface = Surface()
    part = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004)
    scene = [[[0.0252, y, 0.0]] for y in HEIGHTS], None, *uniform(math.pi).drive(surface), 10
    settings = {"walls": ["left"], "contact_steps": contact_steps, "contact_overlap": 2e-6}
    return simulated(surface, part, *scene, **settings).pose[:, 0]


HEIGHTS = (0.12, 0.121, 0.122, 0.123)


def test_a_part_pushed_against_a_wall_converges():
    """Normal to the wall: within the uncorrected overlap, and less with shorter steps. Along it, where impacts determine
    the effect of friction, within 8 % of the displacement."""
    finest = pressed(1280)
    apart = np.array([np.abs(pressed(steps) - finest) for steps in (10, 40, 160, 640)])
    off = apart[..., 0].max(axis=1).tolist()
    assert off == sorted(off, reverse=True) and off[0] < 5e-5 and off[-1] < 5e-6
    assert apart[..., 1].max() < 0.08 * np.abs(finest[:, 1] - HEIGHTS).min()


def test_overlap_converges():
    """The error of an oblique impact is proportional to the allowed overlap."""
    parts = [disc(restitution=0.6, contact_friction=0.3), disc(0.03, restitution=0.6, contact_friction=0.3)]
    pose, velocity = [[0.3, 0.1, 0.0], [0.4, 0.14, 0.0]], [[0.6, 0.0, 0.0], [0.0, 0.05, 0.0]]
    _, exact = blow(parts, pose, velocity, 5 * PERIOD)
    errors = []
    for overlap in (1e-4, 3e-5, 1e-5, 3e-6):
        _, after = run(parts, pose, velocity, 5, contact_overlap=overlap)
        _, late = blow(parts, pose, velocity, 5 * PERIOD, late=overlap + 2e-6)
        errors.append(np.abs(after - exact)[:, :2].max())
        assert errors[-1] <= 1.1 * np.abs(late - exact)[:, :2].max()
    assert errors == sorted(errors, reverse=True) and errors[-1] < 0.1 * errors[0]


def test_second_order_while_contacts_last():
    """Two squares in touch are driven together: with a quarter of the step, less than an eighth of the error."""
    parts = [Part.rectangle(0.05, 0.05, friction=mu) for mu in (0.58, 0.4)]
    heading = np.linspace(-0.5, 0.5, 16)
    pose = np.zeros((16, 2, 3))
    pose[:, :, 2] = heading[:, None]
    for slot, side in enumerate((-0.025, 0.025)):
        pose[:, slot, 0], pose[:, slot, 1] = 0.416 + side * np.cos(heading), 0.104 + side * np.sin(heading)
    scene = pose, None, *radial(0.416, 0.104).drive(Surface()), 4
    finest = simulated(Surface(), parts, *scene, contact_steps=640).pose
    error = {}
    for steps in (10, 20, 80):
        off = simulated(Surface(), parts, *scene, contact_steps=steps).pose - finest
        error[steps] = np.median(np.linalg.norm(off[..., :2], axis=-1))
    assert error[10] < 5e-5 and error[80] < error[20] / 8.0
