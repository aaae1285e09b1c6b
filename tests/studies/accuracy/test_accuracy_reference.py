"""The reference against closed forms, against itself at tighter tolerance, and against the planar model."""

import math

import numpy as np
import pytest

from studies.accuracy.contact import COARSE, FINE, Contact, Cutter
from studies.accuracy.limit_surface import escape, load
from studies.accuracy.reference import integrate
from vibgym import Part, Surface

G = 9.81
OMEGA = 2 * math.pi * 25.0
STILL = Surface(horizontal_amplitude=0.0)
THRESHOLD = 0.6 * G / OMEGA**2  # m: horizontal amplitude at which a_h w^2 = mu g
BLOCK = Part.rectangle(0.050, 0.035, friction=0.6)
L_SHAPE = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.03], [0.03, 0.03], [0.03, 0.06], [0, 0.06]], friction=0.6)


def one(**properties):
    return Surface(rows=1, columns=1, element_size=4.0, **properties)


def random_field(surface, seed):
    rng = np.random.default_rng(seed)
    shape = (surface.rows, surface.columns)
    return rng.uniform(0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


# -- area integrals ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("twist", [
    [0.4, 0.1, 0.0],
    [0.4, 0.1, 3.0],
    [0.1, -0.2, 300.0],
    [0.0025, 0.0, 0.1],
    [0.2, 0.0, 0.2 / 0.67],
])  # fmt: skip
@pytest.mark.parametrize("part", [BLOCK, L_SHAPE], ids=["block", "L"])
def test_friction_over_a_cut_area_equals_a_dense_sum(part, twist):
    """The slip centre lies far away, inside, on the centre of mass, near an edge, just this side of the closed form's end."""
    surface = Surface()
    x, y, heading, n = 0.3, 0.1, 0.7, 700
    c, s = math.cos(heading), math.sin(heading)
    low, high = part.outline.min(axis=0), part.outline.max(axis=0)
    u, v = np.meshgrid(*(low[k] + (np.arange(n) + 0.5) / n * (high[k] - low[k]) for k in range(2)))
    inside = np.full(u.shape, True)
    if part is L_SHAPE:
        corner = part.outline[np.argmin(np.hypot(*part.outline.T))]  # the one that points inwards
        inside = (u < corner[0]) | (v < corner[1])
    u, v = u[inside], v[inside]
    rx, ry = c * u - s * v, s * u + c * v
    row, column = ((y + ry) // surface.element_size).astype(int), ((x + rx) // surface.element_size).astype(int)
    pressure = np.random.default_rng(1).uniform(0, 1, (surface.rows, surface.columns))
    ux, uy = twist[0] - twist[2] * ry, twist[1] + twist[2] * rx
    stress = pressure[row, column] / np.hypot(ux, uy) / len(u)
    dense = [(stress * ux).sum(), (stress * uy).sum(), (stress * (rx * uy - ry * ux)).sum() / part.radius]
    for cubature, within in ((FINE, 1e-13), (COARSE, 1e-6)):
        contact = Cutter(surface, part, cubature).cut(x, y, heading)
        assert contact.area.sum() == pytest.approx(part.area, rel=1e-12)
        got = contact.wrench(np.array(twist), pressure[contact.element[:, 0], contact.element[:, 1]]) / part.area
        got[2] /= part.radius
        assert np.abs(got - dense).max() < 5e-4
        best = Cutter(surface, part, FINE._replace(far=60.0, order=12)).cut(x, y, heading)
        exact = best.wrench(np.array(twist), pressure[best.element[:, 0], best.element[:, 1]]) / part.area
        exact[2] /= part.radius
        away = math.hypot(*twist[:2]) / max(abs(twist[2]), 1e-9) / part.radius  # of the slip centre, in radii
        # The closed form's terms are by the square of this larger than what is left of them, and so is their rounding.
        rounding = np.finfo(float).eps * away**2 if FINE.far < away < 60.0 else 0.0
        assert np.abs(got - exact).max() < within + rounding


def test_a_disc_about_its_centre_and_a_clockwise_ring():
    disc = Part.disc(0.02, friction=0.5)
    for ring in (disc.outline, disc.outline[::-1]):
        contact = Contact([ring], np.zeros((1, 2), int), 0.02)
        force_x, force_y, torque = contact.wrench(np.array([0.0, 0.0, 7.0]), np.array([1 / disc.area]))
        assert torque == pytest.approx(
            2 / 3 * 0.02, rel=2 * (2 * math.pi / 64) ** 4
        )  # of a polygon with the disc's area
        assert abs(force_x) + abs(force_y) < 1e-13


@pytest.mark.parametrize("pose, depth", [
    ([0.4, 0.1, 0.0], 0.0175),  # all of it rests: half the width
    ([0.01, 0.1, 0.0], 0.01),  # over the left border
    ([0.4, 0.208 + 0.003, 0.0], -0.003),
    ([2.0, 0.1, 0.0], -BLOCK.radius),
])  # fmt: skip
def test_support(pose, depth):
    assert Cutter(Surface(), BLOCK).support(*pose) == pytest.approx(depth, abs=1e-12)


# -- limit surface -----------------------------------------------------------------------------------------------------


def grip(pressure):
    contact = Cutter(Surface(), BLOCK).cut(0.3, 0.1, 0.7)
    k = math.sqrt(BLOCK.gyration)
    loads = pressure(len(contact.area)) / contact.area.sum()

    def wrench(xi):
        return contact.wrench(np.array([xi[0], xi[1], xi[2] / k]), loads) / np.array([1.0, 1.0, k])

    return wrench


def test_load_and_escape():
    """Even pressure: force over mu p. Uneven: no twist asks for more than the one found, and the escape solves its equation."""
    got, twist = load(grip(lambda n: np.full(n, 5.0)), np.array([3.0, -4.0, 0.0]))
    assert got == pytest.approx(1.0, rel=1e-12) and twist == pytest.approx([0.6, -0.8, 0.0], abs=1e-6)
    wrench = grip(lambda n: np.linspace(1.0, 9.0, n))
    needed = np.array([4.0, 2.0, 0.5])
    size, twist = load(wrench, needed)
    rng = np.random.default_rng(2)
    for xi in rng.normal(size=(300, 3)):
        assert needed @ xi <= size * (wrench(xi) @ xi) * (1 + 1e-12)
    assert load(wrench, needed / size)[0] == pytest.approx(1.0, abs=1e-12)
    out = needed * 1.3 / size
    eta = escape(wrench, out, twist)
    assert np.linalg.norm(eta) > 0.1
    assert eta + wrench(eta) == pytest.approx(out, abs=1e-7)
    assert (escape(wrench, needed * 0.9 / size, twist) == 0.0).all()


# -- a still table -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("share, ends", [(0.0, True), (0.5, True), (-0.5, True), (1.2, False)])
def test_friction_stops_a_part_unless_the_incline_is_more(share, ends):
    """After v^2 / (2 (mu g - b)), where it stays; slip below the threshold counts as none."""
    incline = [share * 0.6 * G, 0.0]
    run = integrate(STILL, BLOCK, [0.4, 0.1, 0.3], [0.1, 0, 0], 0, 0, 2, incline=incline)
    braking = 0.6 * G - incline[0]
    way = 0.1**2 / (2 * braking) if ends else 0.1 * 0.08 - 0.5 * braking * 0.08**2
    assert run.pose[-1] == pytest.approx([0.4 + way, 0.1, 0.3], abs=1e-12)
    assert run.sticking[-1] == ends and (not ends or (run.velocity[-1] == 0).all())
    assert run.switches == pytest.approx(np.array([[0.1 / braking, 1.0]] * ends).reshape(-1, 2), abs=2e-9)


def test_an_inclined_table_lets_go_of_what_rests_where_static_friction_ends():
    part = Part.rectangle(0.05, 0.035, friction=0.5, static_friction=0.6)
    for share, held in ((0.999, True), (1.001, False)):
        run = integrate(
            STILL, part, [0.4, 0.1, 0.3], [0, 0, 0], 0, 0, 1, incline=[0.0, -share * 0.6 * G], estimate=False
        )
        way = 0.0 if held else 0.5 * (share * 0.6 - 0.5) * G * 0.04**2
        assert run.pose[-1] == pytest.approx([0.4, 0.1 - way, 0.3], abs=1e-9)


def test_spinning_disc():
    """Torque (2/3) mu m g r stops w r^2 / 2 after 3 w r / (4 mu g); 64 corners instead of a circle change it by 1e-5."""
    disc = Part.disc(0.022, friction=0.6)
    run = integrate(STILL, disc, [0.4, 0.1, 0], [0, 0, 20.0], 0, 0, 2)
    assert run.switches[0, 0] == pytest.approx(3 * 20 * 0.022 / (4 * 0.6 * G), rel=2e-5)
    assert run.pose[-1, :2] == pytest.approx([0.4, 0.1], abs=1e-12)


@pytest.mark.parametrize("ratio", [0.2, 3.0])
def test_sliding_and_spinning_end_at_once(ratio):
    """With v / (w r) towards 0.653 whatever it was (Farkas et al., PRL 90, 248302, 2003), from either side."""
    disc = Part.disc(0.022, friction=0.6)
    velocity = [0.3, 0.0, 0.3 / ratio / 0.022]
    ends = integrate(STILL, disc, [0.4, 0.1, 0], velocity, 0, 0, 6, estimate=False).switches[0, 0]
    shares = []
    for gap in (3e-2, 3e-4):
        surface = Surface(
            horizontal_amplitude=0.0, frequency=1.0 / (ends * (1 - gap))
        )  # a period ends just before the stop
        late = integrate(surface, disc, [0.4, 0.1, 0], velocity, 0, 0, 1, estimate=False).velocity[-1]
        shares.append(math.hypot(late[0], late[1]) / (late[2] * 0.022) - 0.653)
    assert abs(shares[1]) < 0.5 * abs(shares[0]) and abs(shares[1]) < 0.1
    assert np.sign(shares).tolist() == [np.sign(ratio - 0.653)] * 2


def test_without_friction_nothing_changes_it():
    ice = Part.rectangle(0.05, 0.035, friction=0.0)
    run = integrate(Surface(), ice, [0.4, 0.1, 0.3], [0.3, -0.1, 2.0], *random_field(Surface(), 1), 3)
    assert run.pose[-1] == pytest.approx([0.4 + 0.3 * 0.12, 0.1 - 0.1 * 0.12, 0.3 + 0.24], abs=1e-12)
    assert run.velocity[-1] == pytest.approx([0.3, -0.1, 2.0], abs=1e-12)


# -- sliding on the moving table ---------------------------------------------------------------------------------------


def test_steady_velocity():
    surface, (friction, speed, direction) = one(), (0.9, 0.30359, 14.94)
    start = [speed * math.cos(math.radians(direction)), speed * math.sin(math.radians(direction)), 0.0]
    periods = round(12 / friction)  # what is left of the start decays with mu g / (a_h w)
    run = integrate(
        surface, Part.rectangle(0.05, 0.035, friction=friction), [1, 1, 0], start, surface.lift_off_amplitude,
        1.5 * math.pi, periods, tolerance=1e-7, estimate=False,
    )  # fmt: skip
    x, y = (run.pose[-1, :2] - run.pose[-2, :2]) / surface.period
    assert math.hypot(x, y) == pytest.approx(speed, abs=1e-5)
    assert math.degrees(math.atan2(y, x)) == pytest.approx(direction, abs=0.01)


def test_it_circles_on_elements_at_rest():
    """With radius mu g / w^2, lagging the table by arccos(a_o / a_h): the state repeats from the first period on."""
    surface = Surface()
    start = surface.idle_velocity(0.6)
    run = integrate(surface, BLOCK, [0.4, 0.1, 0.3], [*start, 0.0], 0, 0, 3)
    assert np.hypot(*start) == pytest.approx(0.6 * G / OMEGA)
    assert np.abs(run.velocity - [*start, 0.0]).max() < 1e-9
    assert np.abs(run.pose - run.pose[0]).max() < 1e-11
    assert not run.sticking.any() and not len(run.switches)


# -- falling -----------------------------------------------------------------------------------------------------------


def test_it_falls_when_its_centre_crosses_the_border():
    ice = Part.rectangle(0.05, 0.035, friction=0.0)
    run = integrate(Surface(), ice, [0.03, 0.1, 0.0], [-0.5, 0.1, 0.0], 0, 0, 3)
    assert run.fallen and run.fall_time == pytest.approx(0.06, abs=1e-9)
    assert run.pose[-1] == pytest.approx([0.0, 0.106, 0.0], abs=1e-9)
    assert (run.velocity[-1] == 0).all() and not run.sticking[-1]


def test_an_l_shape_falls_when_one_arm_has_left():
    """Until the lower arm is off, its far end holds the hull up; then only the upright arm rests, beside the centre of mass."""
    ice = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.005], [0.005, 0.005], [0.005, 0.06], [0, 0.06]], friction=0.0)
    run = integrate(Surface(), ice, [0.4, 0.03, 0.0], [0.0, -0.5, 0.0], 0, 0, 2)
    edge = -ice.outline[:, 1].min() - 0.005
    assert run.fallen and edge > 0.005
    assert run.pose[-1] == pytest.approx([0.4, edge, 0.0], abs=1e-9)
    assert run.fall_time == pytest.approx((0.03 - edge) / 0.5, abs=1e-9)


# -- sticking ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("fraction", [0.2, 0.999, 1.0])
def test_below_the_threshold_and_on_it_it_moves_with_the_table(fraction):
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    run = integrate(surface, BLOCK, [0.4, 0.1, 0.3], [0, surface.table_speed, 0], 0, 0, 2)
    assert run.sticking.all() and run.switches.tolist() == [[0.0, 1.0]]
    assert np.abs(run.pose - [0.4, 0.1, 0.3]).max() < 1e-15 * 100


@pytest.mark.parametrize("fraction", [0.3, 0.9])
def test_it_is_caught_from_rest(fraction):
    """Slip falls at least by (1 - fraction) mu g per second from fraction mu g / w, at most by (1 + fraction) of it."""
    surface = Surface(horizontal_amplitude=fraction * THRESHOLD)
    run = integrate(surface, BLOCK, [0.4, 0.1, 0.3], [0, 0, 0], 0, 0, 2)
    ((when, begins),) = run.switches
    assert begins == 1.0 and fraction / (1 + fraction) / OMEGA <= when <= fraction / (1 - fraction) / OMEGA
    assert run.velocity[-1] == pytest.approx([0, surface.table_speed, 0], abs=1e-15)
    assert run.error.max() < 1e-9


@pytest.mark.parametrize("friction", [0.6, 0.5])
def test_release_when_the_element_falls_away(friction):
    """a_h w^2 = mu_0 (g + A cos wt) gives the instant: cos wt = (1.3 - 1) / 0.5, whatever mu is then."""
    surface = one(horizontal_amplitude=1.3 * THRESHOLD)
    part = Part.rectangle(0.05, 0.035, friction=friction, static_friction=0.6)
    run = integrate(
        surface, part, [2, 2, 0.3], [0, surface.table_speed, 0], 0.5 * surface.lift_off_amplitude, math.pi, 1
    )
    assert run.switches[1] == pytest.approx([math.acos(0.6) / OMEGA, 0.0], abs=1e-11)
    assert not run.sticking[-1] and run.error.max() < 1e-8


def step_by_step(surface, part, pose, amplitude, phase, steps):
    """Pose after a period, from the table's velocity, by implicit steps of slip that know of no events: Moreau's scheme.

    Each step solves ``slip' = slip + h (needed - friction(slip'))`` at once, whether that ends in slip or in none.
    """
    h, k = surface.period / steps, math.sqrt(part.gyration)
    pose, slip, cutter = np.array(pose), np.zeros(3), Cutter(surface, part)

    def table(t):
        return surface.table_speed * np.array([-math.sin(OMEGA * t), math.cos(OMEGA * t), 0.0])

    for step in range(steps):
        t, after = step * h, (step + 1) * h
        contact = cutter.cut(*pose)
        row, column = contact.element.T
        middle = OMEGA * (t + 0.5 * h)
        normal = G - amplitude[row, column] * OMEGA**2 * np.cos(middle + phase[row, column])
        pressure = h * part.friction * normal / contact.area.sum()

        def grip(xi, contact=contact, pressure=pressure):
            return contact.wrench(xi / [1, 1, k], pressure) / [1, 1, k]

        wanted = slip + table(after) - table(t)
        before, (size, twist) = slip, load(grip, wanted)
        slip = escape(grip, wanted, twist) if size > 1.0 else np.zeros(3)
        lag = 0.5 * h * (before + slip) / [1, 1, k]
        shift = surface.horizontal_amplitude * np.array(
            [math.cos(OMEGA * after) - math.cos(OMEGA * t), math.sin(OMEGA * after) - math.sin(OMEGA * t), 0.0]
        )
        pose = pose + shift - lag
    return pose


def test_stick_and_slip_on_uneven_elements_against_steps_without_events():
    surface = Surface(horizontal_amplitude=0.95 * THRESHOLD)
    amplitude, phase = random_field(surface, 1)
    start = np.array([0.4, 0.1, 0.3])
    run = integrate(surface, BLOCK, start, [0, surface.table_speed, 0], amplitude, phase, 1)
    assert run.switches[:, 1].tolist()[:3] == [1, 0, 1]  # it lets go and is caught again
    coarse, fine = (step_by_step(surface, BLOCK, start, amplitude, phase, n) for n in (150, 300))
    moved = np.abs(run.pose[-1] - start)
    assert (moved > [1e-6, 1e-6, 1e-5]).all()
    off, half = coarse - run.pose[-1], fine - run.pose[-1]
    assert (np.abs(half) < 0.65 * np.abs(off)).all()  # the steps are of first order and end where the reference is
    assert (np.abs(2 * half - off) < 3e-3 * moved).all()


# -- its own error -----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("spin, share", [(3.0, 1.0), (30.0, 1.0), (0.0, 0.3)])
def test_the_error_it_states_is_honest(spin, share):
    """A run at a thousandth of the tolerance lies within it, and it is small."""
    surface = Surface(horizontal_amplitude=2.7e-3 * share)
    amplitude, phase = random_field(surface, 21)
    arguments = (surface, L_SHAPE, [0.35, 0.1, 0.5], [0, 0, spin], amplitude, phase, 3)
    for tolerance in (1e-6, 1e-8):
        run = integrate(*arguments, tolerance=tolerance)
        exact = integrate(*arguments, tolerance=1e-3 * tolerance, estimate=False)
        actual = np.abs(exact.pose - run.pose).max(axis=0)
        assert (actual <= run.error.max(axis=0) + 1e-12).all(), (actual, run.error)
        assert run.error.max() < 0.1 * tolerance**0.5
