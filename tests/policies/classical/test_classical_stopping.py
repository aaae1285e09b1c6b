"""Braking curves and set speeds: closed forms near rest, and stopping on the planar simulator."""

import math

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, DISC, FRESH, STEEL, SURFACE, info_of
from vibgym import Part, Simulator
from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.physics.core.drive import cartesian_drive
from vibgym.policies.classical.pose_law import (
    INSIDE,
    PoseLaw,
    StoppingCurve,
    allowed_turn,
    fastest_spin,
    landing_speed,
    speed_at,
    time_left,
    turning_push,
)
from vibgym.policies.measures import Measures
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout

STEP = SURFACE.period
LONG = Part.rectangle(0.080, 0.020, friction=0.58)


def curve_for(part, push, top, turning):
    return StoppingCurve(FrictionalInverse(SURFACE, part), np.array([push]), np.array([top]), turning)


def even_curve(braking, top=14.0):
    """Return the curve of a part with constant deceleration."""
    curve = object.__new__(StoppingCurve)
    curve.speed = np.linspace(0.0, top, 4001)[:, None]
    curve.displacement = curve.speed**2 / (2.0 * braking)
    return curve


# -- curves ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [ALUMINIUM, STEEL, DISC])
@pytest.mark.parametrize("turning, speed", [(False, 0.02), (True, 0.5)])
def test_deceleration_is_constant_near_rest(part, turning, speed):
    """Compare with v^2 / (2 a), a = mu g / 2 times the push, over the radius of gyration for rotations."""
    rate = 0.8 * 0.5 * part.friction * SURFACE.full_scale / (math.sqrt(part.gyration) if turning else 1.0)
    without_friction = speed**2 / (2.0 * rate)  # which helps: 0.07 m/s^2 at half of the speed
    assert 0.94 * without_friction < curve_for(part, 0.8, speed, turning).displacement[-1, 0] < without_friction


@pytest.mark.parametrize("turning, top", [(False, 0.3), (True, 14.0)])
def test_speeds_grow_with_distance_and_push(turning, top):
    weak, strong = (curve_for(ALUMINIUM, push, top, turning) for push in (0.6, 0.8))

    def speeds(curve, displacement):
        return np.array(
            [speed_at(curve.displacement, curve.speed, 0, 1e9, distance) for distance in np.atleast_1d(displacement)]
        )

    end = weak.displacement[-1, 0]
    displacement = np.linspace(0.0, 1.5 * end, 300)
    slow, fast = speeds(weak, displacement), speeds(strong, displacement)
    assert (np.diff(slow) >= 0.0).all() and slow[0] == 0.0 and slow[-1] == top
    assert (fast[1:-150] > slow[1:-150]).all()
    # Friction grows with speed, so speeds grow faster than the root of the distance.
    assert speeds(weak, end)[0] > 2.05 * speeds(weak, 0.25 * end)[0]


def test_every_part_has_its_own_curve():
    info = info_of("Sort")
    process = FrictionalInverse(info.surface, info.parts)
    n = len(info.parts)
    both = StoppingCurve(process, np.full(n, 0.7), np.full(n, 10.0), True)
    for k, part in enumerate(info.parts):
        np.testing.assert_array_equal(both.displacement[:, k], curve_for(part, 0.7, 10.0, True).displacement[:, 0])


# -- landings ----------------------------------------------------------------------------------------------------------


STRENGTH = 130.0
"""rad/s^2, of bodies without friction."""


def landed(over, left, trusted=0.95, top=14.0):
    """Return the remaining displacement at the ends of steps, for bodies from rest and a share of their strength."""
    curve = even_curve(trusted * STRENGTH, top)
    now, kept = np.zeros_like(left), [left]
    for _ in range(60):
        toward = np.sign(left)
        speed = toward * landing_speed(curve, 36.0, STEP, over, np.abs(left)[:, None], (toward * now)[:, None])[:, 0]
        after = now + np.clip(speed - now, -STRENGTH * STEP, STRENGTH * STEP)
        left, now = left - 0.5 * STEP * (now + after), after
        kept.append(left)
    return np.array(kept)


@pytest.mark.parametrize("over", [0.0, 0.0175])
@pytest.mark.parametrize("top", [14.0, 100.0])
def test_bodies_stop_with_little_overshoot(over, top):
    """Overshoot is less than an eighth of a step's braking, the effect of finite steps."""
    start = np.linspace(0.05, 6.0, 400)
    left = landed(over, start, top=top)
    assert np.abs(left[-1]).max() < 1e-9 and left.min() >= -STRENGTH * STEP**2 / 8.0
    np.testing.assert_array_equal(landed(over, -start, top=top), -left)


def test_a_tolerance_saves_time_and_is_kept():
    start, allowed = np.linspace(0.05, 6.0, 400), 0.035
    first = []
    for over in (0.0, 0.5 * allowed):
        inside = np.abs(landed(over, start)) <= allowed
        first.append(inside.argmax(axis=0))
        assert (inside.cumsum(axis=0)[first[-1] + 9, np.arange(400)] == 10).all()  # at the ends of ten steps in a row
    assert (first[1] <= first[0]).all() and (first[1] < first[0]).mean() > 0.05


def test_hardly_more_than_the_least_time():
    """Compare with bang-bang control, ``2 sqrt(d / a)``, with whole steps and a reserve of a twentieth of the strength."""
    start = np.linspace(0.5, 6.0, 400)
    arrived = STEP * (np.abs(landed(0.0, start, top=100.0)) <= 0.01).argmax(axis=0)
    assert (arrived - 2.0 * np.sqrt((start - 0.01) / STRENGTH)).max() <= 3.0 * STEP


def test_bodies_that_would_leave_the_tolerance_are_reversed():
    def landing(over, left, now):
        return landing_speed(even_curve(130.0), 36.0, STEP, over, np.array([[left]]), np.array([[now]]))[0, 0]

    speed = landing(0.02, 0.014, 2.0)
    assert speed < 0.0 and 0.014 - 0.5 * STEP * (2.0 + speed) == pytest.approx(-INSIDE * 0.02, abs=1e-9)
    # Not faster than it can decelerate within the tolerance.
    assert landing(0.02, 0.0, 9.0) == pytest.approx(-2.0 * 0.02 / STEP)
    assert landing(0.0, 0.0, 9.0) == 0.0


def test_time_left_of_a_body_that_speeds_up_cruises_and_brakes():
    curve = even_curve(4.0, 0.3)
    gain, displacement = np.array([2.0]), np.array([[0.0], [0.01], [0.5]])
    least = np.sqrt(2.0 * 0.01 * (1.0 / 2.0 + 1.0 / 4.0))
    cruise = 0.3 / 2.0 + 0.3 / 4.0 + (0.5 - 0.3**2 / 4.0 - 0.3**2 / 8.0) / 0.3
    np.testing.assert_allclose(
        time_left(displacement, 0.0 * displacement, gain, curve)[:, 0], [0.0, least, cruise], rtol=1e-12
    )
    assert time_left(displacement[2:], 0.3 + 0.0 * displacement[2:], gain, curve) == pytest.approx(
        0.3 / 4.0 + (0.5 - 0.3**2 / 8.0) / 0.3
    )


# -- rotation ----------------------------------------------------------------------------------------------------------


def test_the_reach_bounds_turning_pushes():
    info, random = info_of("Rotate"), np.random.default_rng(4)
    allocator = Allocator(info.surface, info.parts, info.hardware)
    pose = np.column_stack(
        [random.uniform(0.1, 0.7, 60), random.uniform(0.06, 0.15, 60), random.uniform(-3.0, 3.0, 60)]
    )
    pose, present = pose[:, None], np.ones((60, 1), dtype=bool)
    wanted = np.zeros((60, 1, 3))
    wanted[..., 2] = 3.0
    reach = allocator.reach(pose)
    got = allocator.effect(pose, present, allocator.pushes(pose, present, wanted))
    assert (got[..., 2] <= reach + 1e-12).all() and (got[..., 2] >= 0.97 * reach).all()
    assert turning_push(info)[0] == pytest.approx(reach.mean(), rel=0.03)


def test_reach_of_a_small_disc_on_a_corner():
    """A quarter on each of four: shares 1/4, centroids at 4 r sqrt(2) / (3 pi) over the radius of gyration r / sqrt(2)."""
    disc = Part.disc(0.008, friction=0.5)
    info = info_of("Rotate")
    allocator = Allocator(info.surface, (disc,), info.hardware)
    corner = SURFACE.element_size * np.array([8.0, 4.0])
    assert allocator.reach(np.array([[[*corner, 0.2]]]))[0, 0] == pytest.approx(8.0 / (3.0 * math.pi), rel=2e-3)
    # No torque in the middle of an element.
    middle = SURFACE.element_size * np.array([8.5, 4.5])
    assert allocator.reach(np.array([[[*middle, 0.2]]]))[0, 0] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("part", [ALUMINIUM, STEEL, LONG], ids=["aluminium", "steel", "long"])
def test_a_spinning_part_stops_within_the_predicted_angle(part):
    """On the planar simulator at the limit: as predicted in the mean, and within a seventh at any position."""
    info = info_of("Rotate", parts=[part])
    push, random, n = turning_push(info), np.random.default_rng(3), 24
    process = FrictionalInverse(SURFACE, part)
    top = fastest_spin(process, push)
    curve = StoppingCurve(process, push, top, True)
    allocator = Allocator(SURFACE, (part,), info.hardware)
    simulator, spin = Simulator(SURFACE, part, worlds=n), np.linspace(0.4, 0.85, n) * top
    pose = np.column_stack([0.41 + random.uniform(0.0, 0.026, (n, 1)), 0.1 + random.uniform(0.0, 0.026, (n, 1)),
                            random.uniform(0.0, 3.0, (n, 1))])  # fmt: skip
    idle = np.tile(SURFACE.idle_velocity(part.friction), (n, 1))
    simulator.reset(pose[:, None], np.column_stack([idle, spin])[:, None])
    furthest = pose[:, 2]
    for _ in range(4):
        now = simulator.pose.copy()
        now[:, 0, 2] += 0.5 * STEP * np.maximum(simulator.velocity[:, 0, 2] - 2.0, 0.0)
        wanted = np.zeros((n, 1, 3))
        wanted[..., 2] = -3.0
        pushes = allocator.pushes(now, np.ones((n, 1), dtype=bool), wanted) * SURFACE.full_scale
        simulator.advance_drive(cartesian_drive(-pushes[..., 1], -pushes[..., 0]), 1)
        furthest = np.maximum(furthest, simulator.pose[:, 0, 2])
        if (simulator.velocity[:, 0, 2] < 0.0).all():
            break
    displacement = np.array([np.interp(rate, curve.speed[:, 0], curve.displacement[:, 0]) for rate in spin])
    turned = furthest - pose[:, 2]
    assert (turned <= 1.15 * displacement).all() and turned.sum() == pytest.approx(displacement.sum(), rel=0.08)


@pytest.mark.parametrize("part", [ALUMINIUM, DISC, LONG], ids=["aluminium", "disc", "long"])
def test_friction_balances_the_push_at_the_largest_spin(part):
    process, push = FrictionalInverse(SURFACE, part), np.array([0.6])
    spin = fastest_spin(process, push)[0]
    full = np.array([[[0.0, 0.0, push[0]]]])
    more = [process.acceleration(np.array([[[0.0, 0.0, k * spin]]]), full)[0][0, 0, 2] for k in (0.98, 1.0, 1.02)]
    assert more[0] > 0.0 > more[2] and abs(more[1]) < 1e-6


def test_tolerances_are_used_where_headings_count_and_goals_stay():
    assert allowed_turn(info_of("Rotate")) == pytest.approx(math.radians(2.0))
    assert allowed_turn(info_of("Align")) == pytest.approx(math.radians(3.0))
    for name in ("Transport", "Sort", "Follow"):
        assert allowed_turn(info_of(name)) == 0.0


def test_rotation_times_are_near_the_bound():
    """The whole chain on ideal hardware: at most a step above the bound in the median, and two in nearly all episodes."""
    policy = make_policy({"kind": "local_field", "law": "pose"}, info_of("Rotate"))
    result = rollout(policy, "Rotate", seeds=range(FRESH, FRESH + 80), keep=Measures)
    steps = np.rint((result.time_to_goal - result.bound) / result.step_time)
    assert result.success.all() and steps.min() >= 0.0
    assert np.median(result.time_over_bound) <= 1.06 and (steps <= 2.0).mean() >= 0.9


def test_the_controller_decelerates_rotations_within_the_limits():
    law, info = PoseLaw(info_of("Rotate")), info_of("Rotate")
    strongest = info.plant.turn_push[0]
    braking = law.turn_curve.speed[1, 0] ** 2 / (2.0 * law.turn_curve.displacement[1, 0])
    assert 0.7 * strongest < braking < 0.85 * strongest
