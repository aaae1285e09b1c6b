"""Allocation through a dead zone: feasibility, distance from the optimum, and results on the simulator."""

import dataclasses
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from tests.allocation.averaged_model import mean_acceleration
from tests.allocation.test_allocation_cut import cut
from tests.policies.helpers import ALUMINIUM, DISC, STEEL, SURFACE, info_of
from vibgym import Part, Simulator
from vibgym.actuators import DataSheet
from vibgym.allocation.allocator import MARGIN, POWERS, Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.allocation.projections import DAMPING, SPREAD

MIN = 0.25
THERE = np.ones((1, 1), dtype=bool)


def sheet(least=MIN, most=1.0, form="hard"):
    """Return an allocator for elements with these smallest and largest amplitudes, over the surface's largest."""
    largest = SURFACE.max_amplitude
    width = least / (1.0 + MARGIN) if form == "hard" else least
    return DataSheet(most * largest, dead_zone=width * largest, dead_zone_form=form)


def allocator(*parts, least=MIN, most=1.0):
    return Allocator(SURFACE, parts, sheet(least, most))


def error(parts, pose, push, wanted):
    """Return the missing effect (parts, 3) of one world, and the expected error that the allocation minimises."""
    made, spread = np.zeros((len(parts), 3)), 0.0
    push = push.reshape(-1, 2)
    for part, element, share, lever in zip(*cut(parts, pose), strict=True):
        x, y = lever / math.sqrt(parts[part].gyration)
        c, s = push[element]
        made[part] += share * c, share * s, x * s - y * c
        spread += SPREAD**2 * (share**2 + x * x + y * y) * (c * c + s * s)
    missing = wanted - made
    return missing, (missing**2).sum() + spread


targets = st.tuples(st.floats(0.0, 1.2), st.floats(-1.0, 1.0), st.floats(0.0, 2.0 * math.pi))


def target(size, turn, way):
    """Wanted acceleration (3,) of a size."""
    plain = math.sqrt(1.0 - turn * turn)
    return size * np.array([plain * math.cos(way), plain * math.sin(way), turn])


@settings(deadline=None, max_examples=100)
@given(
    st.floats(0.05, 0.75),
    st.floats(0.05, 0.15),
    st.floats(-4.0, 4.0),
    targets,
    st.just(0.0) | st.floats(1e-6, 0.6),
    st.floats(0.6, 1.0),
)
def test_elements_rest_or_move_within_the_limits(x, y, heading, wanted, least, most):
    wanted = target(*wanted)
    push = allocator(ALUMINIUM, least=least, most=most).pushes(np.array([[[x, y, heading]]]), THERE, wanted[None, None])
    length = np.hypot(push[..., 0], push[..., 1])
    moves = length > 0.0
    assert (length[moves] >= least * (1.0 - 1e-12)).all() and length.max() <= most * (1.0 + 1e-12)
    _, element, *_ = cut((ALUMINIUM,), [[x, y, heading]])
    assert set(np.flatnonzero(moves.ravel())) <= set(element.tolist())
    expected = error((ALUMINIUM,), [[x, y, heading]], push[0], wanted[None])[1]
    assert expected <= (wanted**2).sum() * (1.0 + 1e-9)  # never worse than zero pushes


def brute_force(parts, pose, wanted, lengths, turns=36):
    """Return the least expected error over a grid of phasors, amplitude times angle, on the elements under a part."""
    angle = 2.0 * np.pi * np.arange(turns) / turns
    choices = np.concatenate([[[0.0, 0.0]], *(r * np.column_stack([np.cos(angle), np.sin(angle)]) for r in lengths)])
    _, element, share, lever = cut(parts, pose)
    lever = lever / math.sqrt(parts[0].gyration)
    total, spread = np.zeros((1, 3)), np.zeros(1)
    for k in range(len(element)):
        x, y = choices.T
        effect = np.column_stack([share[k] * x, share[k] * y, lever[k, 0] * y - lever[k, 1] * x])
        cost = SPREAD**2 * (share[k] ** 2 + (lever[k] ** 2).sum()) * (x * x + y * y)
        total, spread = (total[:, None] + effect).reshape(-1, 3), (spread[:, None] + cost).ravel()
    return (((wanted - total) ** 2).sum(axis=1) + spread).min()


@pytest.mark.parametrize("size", [0.03, 0.1, 0.2, 0.4])
def test_near_optimal_on_few_elements(size):
    """Compare with all pairs of phasors for a block of 40 x 20 mm off the centre of two elements."""
    part = Part.rectangle(0.040, 0.020, friction=0.5)
    errors, best = [], []
    for k in range(12):
        pose = np.array([[0.130 + 0.0005 * k, 0.091, 0.0]])
        wanted = target(size, math.sin(3.0 * k), 2.0 * k)
        push = allocator(part).pushes(pose[None], THERE, wanted[None, None])[0]
        assert len(cut((part,), pose)[1]) == 2
        errors.append(error((part,), pose, push, wanted[None])[1])
        best.append(brute_force((part,), pose, wanted, np.linspace(MIN, 1.0, 7)))
    errors, best = np.sqrt(errors), np.sqrt(best)
    assert np.median(errors / best) < 1.05 and (errors < best + 0.02).all()


def test_small_pushes_pass_the_dead_zone():
    generator = np.random.default_rng(1)
    pose = np.column_stack(
        [generator.uniform(0.1, 0.7, 60), generator.uniform(0.06, 0.14, 60), generator.uniform(-3, 3, 60)]
    )
    there, aware, plain = np.ones((60, 1), dtype=bool), [], []
    wanted = np.array([target(0.1, *pair) for pair in generator.uniform([-1, 0], [1, 6], (60, 2))])
    for maker, errors in ((allocator(ALUMINIUM), aware), (allocator(ALUMINIUM, least=0.0), plain)):
        push = maker.pushes(pose[:, None], there, wanted[:, None])
        push[np.hypot(push[..., 0], push[..., 1]) < MIN * (1.0 - 1e-9)] = 0.0  # loss in the dead zone
        errors += [
            np.linalg.norm(error((ALUMINIUM,), p[None], u, w)[0]) for p, u, w in zip(pose, push, wanted, strict=True)
        ]
    assert np.median(plain) == pytest.approx(0.1, rel=0.02) and np.median(aware) < 0.003 and max(aware) < 0.03


def test_pushes_above_the_dead_zone_have_least_norm():
    """Elements above the dead zone have the same phasors as without one, up to the exact shares."""
    pose, wanted = np.array([[[0.3, 0.11, 0.4]]]), np.array([[[0.6, -0.3, 0.05]]])
    aware, plain = allocator(ALUMINIUM), allocator(ALUMINIUM, least=0.0)
    assert aware.pushes(pose, THERE, wanted) == pytest.approx(plain.pushes(pose, THERE, wanted), abs=0.02)


# -- several parts and worlds ------------------------------------------------------------------------------------------

CLOSE = np.array([[0.3, 0.117, 0.0], [0.352, 0.117, 0.0], [0.6, 0.09, 0.4]])  # the first two share elements


def test_parts_that_share_elements_get_their_pushes():
    parts = (STEEL, STEEL, ALUMINIUM)
    missed = []
    for k in range(20):
        wanted = np.array([target(0.15, math.sin(k + p), 2.0 * k + p) for p in range(3)])
        push = allocator(*parts).pushes(CLOSE[None], np.ones((1, 3), dtype=bool), wanted[None])[0]
        missed.append(np.abs(error(parts, CLOSE, push, wanted)[0]).max())
    assert np.median(missed) < 0.02 and max(missed) < 0.08


def test_parts_without_a_push_absent_and_distant_ones_have_no_effect():
    generator, there = np.random.default_rng(5), np.ones((1, 3), dtype=bool)
    three, one = allocator(STEEL, STEEL, ALUMINIUM), allocator(ALUMINIUM)
    wanted = 0.1 * generator.normal(size=(1, 3, 3))
    push, alone = three.pushes(CLOSE[None], there, wanted), one.pushes(CLOSE[None, 2:], THERE, wanted[:, 2:])
    assert (push[0, :, 16:] == alone[0, :, 16:]).all() and (alone[0, :, :16] == 0.0).all()
    assert (push[0, :, :16] != 0.0).any() and (push[0, :, 16:] != 0.0).any()
    absent = three.pushes(CLOSE[None], np.array([[False, False, True]]), wanted)
    still = three.pushes(CLOSE[None], there, wanted * [[[0.0], [0.0], [1.0]]])
    assert (absent == alone).all() and (still == alone).all()
    assert (three.pushes(CLOSE[None], ~there, wanted) == 0.0).all()


def test_a_world_gets_the_same_bits_alone_and_in_any_batch():
    generator = np.random.default_rng(2)
    parts, worlds = (STEEL, ALUMINIUM, DISC), 40
    pose = np.tile(CLOSE, (worlds, 1, 1)) + generator.normal(size=(worlds, 3, 3)) * [0.01, 0.01, 1.0]
    there, wanted = generator.random((worlds, 3)) < 0.8, 0.1 * generator.normal(size=(worlds, 3, 3))
    together = allocator(*parts).pushes(pose, there, wanted)
    order = generator.permutation(worlds)
    for threads in (1, 2, 3):
        other = Allocator(SURFACE, parts, sheet(), threads=threads)
        assert (other.pushes(pose[order], there[order], wanted[order]) == together[order]).all()
    one = allocator(*parts)
    for w in range(worlds):
        assert (one.pushes(pose[w : w + 1], there[w : w + 1], wanted[w : w + 1]) == together[w : w + 1]).all()


# -- on the simulator --------------------------------------------------------------------------------------------------


def test_one_pulse_shifts_the_place_of_rest_as_wanted():
    """Compare with the displacement a T / c of a pulse in the planar model, from rest to rest."""
    worlds, generator = 40, np.random.default_rng(3)
    part, surface = ALUMINIUM, SURFACE
    pose = np.column_stack(
        [generator.uniform(0.1, 0.7, 40), generator.uniform(0.06, 0.14, 40), generator.uniform(-3, 3, 40)]
    )
    simulator = Simulator(surface, part, worlds=worlds)
    simulator.reset(pose[:, None])
    still = np.zeros((worlds, surface.rows, surface.columns))
    simulator.advance(still, still, periods=60)
    before = simulator.pose.copy()
    shift = 0.002 * np.array([target(1.0, *pair) for pair in generator.uniform([-1, 0], [1, 6], (worlds, 2))])
    drag = part.friction * surface.gravity / (2.0 * surface.table_speed)
    maker = allocator(part, least=1e-4 / surface.max_amplitude)
    wanted = (drag * shift / surface.period)[:, None] / [1.0, 1.0, math.sqrt(part.gyration)]
    push = FrictionalInverse(surface, part).push(np.zeros((worlds, 1, 3)), wanted).push
    actions = maker.actions(before, np.ones((worlds, 1), dtype=bool), push)
    phasor = actions.reshape(worlds, surface.rows, surface.columns, 2).astype(float)
    amplitude, phase = surface.max_amplitude * np.hypot(*phasor.T).T, np.arctan2(*phasor.T[::-1]).T
    assert amplitude[amplitude > 0.0].min() > 0.999e-4
    simulator.advance(amplitude, phase, periods=1)
    simulator.advance(still, still, periods=60)
    moved = (simulator.pose - before)[:, 0] * [1.0, 1.0, math.sqrt(part.gyration)]
    missed = np.linalg.norm(moved - shift, axis=1)
    assert np.median(missed) < 0.15e-3 and missed.max() < 0.5e-3  # m; a pulse of least norm has no effect


# -- data sheet --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("form", POWERS)
def test_soft_dead_zones_are_compensated(form):
    pose, wanted = np.array([[[0.3, 0.11, 0.4]]]), np.array([[[0.1, -0.3, 0.15]]])
    shape = (SURFACE.rows, SURFACE.columns, 2)
    commanded = Allocator(SURFACE, [STEEL], sheet(form=form)).actions(pose, THERE, wanted).reshape(shape)
    requested = allocator(STEEL, least=0.0).actions(pose, THERE, wanted).reshape(shape)
    length = np.hypot(commanded[..., 0], commanded[..., 1])[..., None]
    power = {"soft": 1, "cubic": 2}[form]
    assert length[length > 0.0].min() < MIN < length.max()
    realised = np.where(length < MIN, (length / MIN) ** power, 1.0) * commanded
    assert realised == pytest.approx(requested, abs=1e-6)


def test_limits_are_those_of_the_data_sheet():
    info = info_of("Align", actuators={"kind": "prototype", "limit": 2.5e-4, "resolution": 1e-5})
    limits = Allocator(info.surface, info.parts, info.hardware)
    assert limits.least == pytest.approx((1e-4 * (1.0 + MARGIN) + 0.5e-5) / SURFACE.max_amplitude)
    assert limits.most == pytest.approx(2.5e-4 / SURFACE.max_amplitude)
    tight = dataclasses.replace(info.hardware, dead_zone=2.49e-4)
    assert Allocator(info.surface, info.parts, tight).least == pytest.approx(2.5e-4 / SURFACE.max_amplitude)


# -- effect on the parts -----------------------------------------------------------------------------------------------


def accelerations(parts, pose, push):
    """Return accelerations of parts at rest under pushes, by the first-order averaged model, over those at full amplitude."""
    result = []
    for k, part in enumerate(parts):
        amplitude = SURFACE.max_amplitude * np.hypot(push[..., 0], push[..., 1])
        phase = np.arctan2(-push[..., 0], -push[..., 1])
        acceleration = mean_acceleration(SURFACE, part, pose[:, k], np.zeros(3), amplitude, phase, order=1)
        scale = 0.5 * part.friction * SURFACE.full_scale
        result.append(acceleration / scale * np.array([1, 1, math.sqrt(part.gyration)]))
    return np.stack(result, axis=1)


@pytest.mark.parametrize("parts, pose, missed", [
    ((STEEL, ALUMINIUM), [[0.3, 0.11, 0.4], [0.5, 0.08, -0.3]], 0.02),
    ((STEEL, STEEL), [[0.3, 0.117, 0.0], [0.352, 0.117, 0.0]], 0.05),  # 2 mm apart, the gap in the middle of an element
], ids=["separate", "adjacent"])  # fmt: skip
def test_parts_get_their_pushes(parts, pose, missed):
    wanted = np.array([[[0.3, 0.1, 0.1], [-0.2, 0.2, -0.1]]])
    push = allocator(*parts, least=0.0).pushes(np.array([pose]), np.ones((1, 2), dtype=bool), wanted)
    assert np.hypot(push[..., 0], push[..., 1]).max() <= 1 + 1e-12
    assert accelerations(parts, np.array([pose]), push) == pytest.approx(wanted, abs=missed)


def test_a_part_alone_gets_the_same_push_from_all_its_elements():
    pose, wanted = np.array([[[0.3, 0.11, 0.4]]]), np.array([[[0.6, -0.3, 0.0]]])
    push = allocator(STEEL, least=0.0).pushes(pose, THERE, wanted)[0]
    under = np.hypot(push[..., 0], push[..., 1]) > 0
    assert 4 <= under.sum() <= 12
    assert push[under] == pytest.approx(np.tile(wanted[0, 0, :2] / (1 + DAMPING), (under.sum(), 1)), abs=1e-9)


def least_error(parts, pose, wanted):
    """Return the least expected error of pushes up to 1, by many steps of the projected gradient; the problem is convex."""
    part, element, share, lever = cut(parts, pose)
    lever = lever / np.sqrt([parts[k].gyration for k in part])[:, None]
    _, at = np.unique(element, return_inverse=True)
    effect, variance = np.zeros((3 * len(parts), at.max() + 1, 2)), np.zeros(at.max() + 1)
    for k, j, a, (x, y) in zip(3 * part, at, share, lever, strict=True):
        effect[k : k + 3, j] += [[a, 0.0], [0.0, a], [-y, x]]
        variance[j] += SPREAD**2 * (a * a + x * x + y * y)
    push, step = (
        np.zeros(effect.shape[1:]),
        1.0 / (np.linalg.norm(effect.reshape(len(effect), -1), 2) ** 2 + variance.max()),
    )
    for _ in range(5000):
        missing = wanted.ravel() - np.tensordot(effect, push, 2)
        push = push + step * (np.tensordot(missing, effect, 1) - variance[:, None] * push)
        push /= np.maximum(np.hypot(*push.T), 1.0)[:, None]
    missing = wanted.ravel() - np.tensordot(effect, push, 2)
    return (missing**2).sum() + (variance * (push**2).sum(axis=1)).sum()


@pytest.mark.parametrize("pose", [[[0.3, 0.11, 0.4]], [[0.3, 0.117, 0.0], [0.352, 0.117, 0.0]]])
def test_effects_beyond_the_limit_are_missed_little_more_than_necessary(pose):
    """Random effects, most of them infeasible, on a part alone and on two that share elements."""
    parts, generator, pose = (STEEL,) * len(pose), np.random.default_rng(3), np.array(pose)
    there, plain = np.ones((1, len(pose)), dtype=bool), allocator(*(STEEL,) * len(pose), least=0.0)
    ratios, limited = [], 0
    for wanted in generator.uniform(-1.0, 1.0, (12, len(pose), 3)):
        push = plain.pushes(pose[None], there, wanted[None])[0]
        length = np.hypot(push[..., 0], push[..., 1]).max()
        assert length <= 1.0 + 1e-12
        limited += length > 1.0 - 1e-9
        ratios.append(math.sqrt(error(parts, pose, push, wanted)[1] / least_error(parts, pose, wanted)))
    assert limited > 8 and min(ratios) > 1.0 - 1e-6
    assert np.median(ratios) < 1.06 and max(ratios) < 1.2


def test_weak_elements_are_compensated():
    pose, wanted = np.array([[[0.3, 0.11, 0.4]]]), np.array([[[0.2, -0.1, 0.05]]])
    gain = np.ones((1, SURFACE.rows * SURFACE.columns))
    _, element, share, _ = cut((STEEL,), pose[0])
    gain[0, element[np.argmax(share)]] = 0.0
    plain = allocator(STEEL, least=0.0)
    for known, most in ((gain, 0.02), (None, 1.0)):
        push = plain.pushes(pose, THERE, wanted, known)[0].reshape(-1, 2) * gain[0][:, None]
        missed = np.abs(error((STEEL,), pose[0], push, wanted[0])[0]).max()
        assert missed < most and (known is not None or missed > 0.04)
