"""Impacts: energy, closed forms, and an independent integration in small steps (V. A. Bhatt, J. Koechling, J. Appl. Mech. 62,
1995, classify what slip can do; J. B. Keller, J. Appl. Mech. 53, 1986, integrates over the normal impulse)."""

import math

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from vibgym.physics.contacts.certified.impact import Mobility, impact_impulse, mobility_of, sum_mobilities


def number(low, high):
    return st.floats(low, high, allow_subnormal=False)


@st.composite
def meetings(draw):
    """Two bodies and their contact: arguments of :func:`impact_impulse`."""

    def body():
        inverse_mass = 10.0 ** draw(number(-3, 3))
        size = 10.0 ** draw(number(-2, 0))
        slim = draw(number(0.05, 1.0))  # gyration over size
        rn, rt = size * draw(number(-1, 1)), size * draw(number(-1, 1))
        return mobility_of.py_func(inverse_mass, inverse_mass / (slim * size) ** 2, rn, rt), size

    (one, size), (other, second) = body(), body()
    mobility = one if draw(st.booleans()) else sum_mobilities.py_func(one, other)  # the other may be a wall
    half = min(size, second) * draw(st.one_of(st.just(0.0), number(0.01, 0.7)))
    approach, slip = -draw(number(0.01, 5.0)), draw(st.one_of(st.just(0.0), number(-5, 5)))
    turning = draw(st.one_of(st.just(0.0), number(-5, 5))) / max(half, 1e-3)
    assume(approach - half * abs(turning) < 0.0)
    restitution = draw(st.sampled_from([0.0, 1e-100, 0.2, 0.5, 0.9, 1.0]))
    friction = draw(st.sampled_from([0.0, 0.1, 0.3, 1.0, 3.0]))
    return mobility, approach, slip, turning, -half, half, restitution, friction


def matrix(mobility):
    nn, nt, nw, tt, tw, ww = mobility
    return np.array([[nn, nt, nw], [nt, tt, tw], [nw, tw, ww]])


def after(meeting):
    """Impulse (3,), and relative velocity before and after it (3,)."""
    mobility, *before = meeting
    impulse = np.array(impact_impulse(*meeting))
    return impulse, np.array(before[:3]), np.array(before[:3]) + matrix(mobility) @ impulse


@given(meetings())
def test_no_impact_gains_energy(meeting):
    """Impacts do not pull, stay in the friction cone, and end with a separating velocity."""
    impulse, before, then = after(meeting)
    low, high, _, friction = meeting[4:]
    change = impulse @ (before + then) / 2.0  # of kinetic energy
    assert change <= 1e-12 * abs(impulse) @ abs(before)
    assert impulse[0] > 0.0
    assert abs(impulse[1]) <= friction * impulse[0] * (1.0 + 1e-12)
    assert low * impulse[0] <= -impulse[2] + 1e-12 and -impulse[2] <= high * impulse[0] + 1e-12
    speeds = [then[0] - place * then[2] for place in (low, high)]
    assert max(speeds) >= -1e-10 * (abs(before[0]) + high * abs(before[2]) + abs(before[1]))


@given(meetings())
def test_elastic_without_friction_keeps_energy(meeting):
    *meeting, _, _ = meeting
    impulse, before, then = after((*meeting, 1.0, 0.0))
    assert impulse @ (before + then) / 2.0 == pytest.approx(0.0, abs=1e-10 * abs(impulse) @ abs(before))


def small_steps(mobility, approach, slip, restitution, friction, steps=40_000):
    """Return the impulse (2,) of an impact at a point, by small steps in the normal impulse."""
    nn, nt, _, tt, _, _ = mobility
    work, absorbed, normal, tangential = 0.0, None, 0.0, 0.0
    step = -approach / nn * 8.0 / steps * (1.0 + friction * abs(nt) / nn)
    for _ in range(100 * steps):
        ratio = -friction * np.sign(slip)
        if abs(slip) < 2.0 * step * (abs(nt) + friction * tt):  # sticking, if friction can hold it
            ratio = float(np.clip(-nt / tt, -friction, friction))
        middle = approach + 0.5 * step * (nn + ratio * nt)
        work += step * middle
        normal, tangential = normal + step, tangential + ratio * step
        approach, slip = approach + step * (nn + ratio * nt), slip + step * (nt + ratio * tt)
        if absorbed is None and approach >= 0.0:
            absorbed = work
        if absorbed is not None and work >= (1.0 - restitution**2) * absorbed:
            return np.array([normal, tangential])
    raise AssertionError("the impact has no end")


@pytest.mark.parametrize("lever", [-0.8, -0.3, 0.2, 0.6])
@pytest.mark.parametrize("slip", [-2.0, -0.1, 0.0, 0.3, 1.5])
@pytest.mark.parametrize("restitution, friction", [(0.0, 0.5), (0.5, 0.2), (0.8, 1.0), (1.0, 0.3)])
def test_against_small_steps(lever, slip, restitution, friction):
    """A slim rod on a wall: slip continues, stops, sticks or reverses, in compression and in restitution."""
    angle = 0.9
    mobility = mobility_of.py_func(1.0, 12.0, -0.5 * math.cos(angle), lever * 0.5 * math.sin(angle))
    meeting = (mobility, -1.0, slip, 0.0, 0.0, 0.0, restitution, friction)
    impulse, _, _ = after(meeting)
    assert impulse[:2] == pytest.approx(small_steps(mobility, -1.0, slip, restitution, friction), abs=1e-3)


@pytest.mark.parametrize("friction", [0.0, 0.3, 5.0])
def test_faces_stay_flat(friction):
    """A long block slides along a wall: the force moves forward until it does not rotate."""
    length, width = 0.08, 0.01
    mobility = mobility_of.py_func(1.0, 12.0 / (length**2 + width**2), -0.5 * width, 0.0)
    impulse, _, then = after((mobility, -0.3, 0.4, 0.0, -0.5 * length, 0.5 * length, 0.5, friction))
    assert then[2] == pytest.approx(0.0, abs=1e-12)
    assert then[0] == pytest.approx(0.15)
    assert then[1] == pytest.approx(0.4 - min(friction * 1.5 * 0.3, 0.4), abs=1e-12)
    assert impulse[0] == pytest.approx(0.45)


def test_faces_become_parallel():
    """One end first, then both: without restitution the normal velocity is zero afterwards."""
    mobility = mobility_of.py_func(1.0, 12.0 / 0.04**2, -0.02, 0.0)
    _, _, then = after((mobility, -0.5, 0.0, 5.0, -0.02, 0.02, 0.0, 0.0))
    assert then[[0, 2]] == pytest.approx(0.0, abs=1e-14)


def test_response():
    """Compare with the equations of a rigid body."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        mass, inertia, rn, rt = rng.uniform(0.1, 2.0, 4)
        expected = np.zeros((3, 3))
        for column, (p, q, m) in enumerate(np.eye(3)):
            spin = (rn * q - rt * p + m) / inertia
            expected[:, column] = [p / mass - spin * rt, q / mass + spin * rn, spin]
        assert matrix(Mobility(*mobility_of(1.0 / mass, 1.0 / inertia, rn, rt))) == pytest.approx(expected)
