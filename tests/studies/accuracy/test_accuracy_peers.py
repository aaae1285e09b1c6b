"""The peers solve the problem they are measured on: SciPy, point sampling, and MuJoCo where it is installed."""

import importlib.util
import math

import numpy as np
import pytest

from studies.accuracy import mujoco_scene, point_sampling, scipy_peers
from studies.accuracy.reference import integrate
from studies.benchmarks import point_sampling as plain
from vibgym import Part, Surface

BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
L_SHAPE = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.03], [0.03, 0.03], [0.03, 0.06], [0, 0.06]], friction=0.6)
needs_mujoco = pytest.mark.skipif(importlib.util.find_spec("mujoco") is None, reason="needs the extra mujoco")


def scene(seed, spin=3.0):
    surface, rng = Surface(), np.random.default_rng(seed)
    shape = (surface.rows, surface.columns)
    pose = rng.uniform([0.1, 0.09, -3.0], [0.7, 0.12, 3.0])
    amplitude, phase = rng.uniform(0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)
    return pose, np.array([0.0, 0.0, spin]), amplitude, phase


# -- SciPy -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("method", scipy_peers.METHODS)
@pytest.mark.parametrize("part", [L_SHAPE, Part.disc(0.02, friction=0.5)], ids=lambda part: part.name)
def test_scipy_converges_to_the_reference(method, part):
    start = scene(1)
    exact = integrate(Surface(), part, *start, 3, estimate=False).pose
    errors, evaluations = [], []
    for rtol in (1e-3, 1e-5, 1e-8):
        run = scipy_peers.integrate(Surface(), part, *start, 3, method=method, rtol=rtol)
        assert run.pose.shape == run.velocity.shape == (4, 3) and run.seconds > 0
        errors.append(np.abs(run.pose - exact).max())
        evaluations.append(run.evaluations)
    assert errors[0] > errors[1] > errors[2] and errors[2] < 1e-7
    assert evaluations[0] < evaluations[1] < evaluations[2]


def test_scipy_at_the_border_and_off_it():
    pose, _, amplitude, phase = scene(2)
    pose = [0.012, 0.1, 0.5]
    exact = integrate(Surface(), BLOCK, pose, [0, 0, 1], amplitude, phase, 2, estimate=False)
    run = scipy_peers.integrate(Surface(), BLOCK, pose, [0, 0, 1], amplitude, phase, 2, rtol=1e-8)
    assert not exact.fallen and np.abs(run.pose - exact.pose).max() < 1e-7
    flying = scipy_peers.integrate(Surface(), BLOCK, [-1.0, -1.0, 0.0], [0.1, 0, 1], amplitude, phase, 2)
    assert flying.pose[-1] == pytest.approx([-1 + 0.1 * 0.08, -1.0, 0.08], abs=1e-12)


# -- point sampling ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("part", [BLOCK, L_SHAPE], ids=lambda part: part.name)
@pytest.mark.parametrize("x", [0.4, 0.01])  # within, and over the border
def test_the_compiled_sampler_does_what_the_plain_one_does(part, x):
    """Same points, same steps: the same numbers to rounding."""
    surface, n, steps, periods = Surface(), 9, 12, 2
    worlds = [scene(seed, spin) for seed, spin in ((1, 3.0), (2, -20.0), (3, 0.0))]
    pose, velocity, amplitude, phase = (np.array(array) for array in zip(*worlds))
    pose[:, 0] = x
    got = np.concatenate(
        point_sampling.simulate(surface, part, pose, velocity, amplitude, phase, periods, points=n, steps=steps), axis=1
    )
    points = plain.strew(part.outline, n)
    for world in range(3):
        expected = plain.simulate(
            points, gyration=part.gyration, friction=part.friction, pose=pose[world], velocity=velocity[world],
            amplitude=amplitude[world], phase=phase[world], periods=periods, steps=steps,
        )[-1]  # fmt: skip
        assert got[world] == pytest.approx(expected, abs=1e-10)


@pytest.mark.parametrize("part", [BLOCK, Part.disc(0.02, friction=0.5)], ids=lambda part: part.name)
def test_more_points_come_nearer_to_the_reference(part):
    surface = Surface()
    worlds = [scene(seed) for seed in range(20, 26)]
    exact = np.array([integrate(surface, part, *world, 3, tolerance=1e-6, estimate=False).pose[-1] for world in worlds])
    start = [np.array(array) for array in zip(*worlds)]
    errors = []
    for n in (4, 12, 48):
        pose, _ = point_sampling.simulate(surface, part, *start, 3, points=n, steps=24)
        errors.append(np.median(np.hypot(*(pose - exact)[:, :2].T)))
    assert errors[0] > 2 * errors[1] > 4 * errors[2] and errors[2] < 2e-5


def test_a_part_too_fast_for_the_steps_has_no_numbers():
    pose, velocity = point_sampling.simulate(Surface(), BLOCK, [[0.4, 0.1, 0]], [[9.0, 0, 0]], 0, 0, 1, steps=12)
    assert np.isnan(pose).all() and np.isnan(velocity).all()
    pose, _ = point_sampling.simulate(Surface(), BLOCK, [[0.4, 0.1, 0]], [[0.0, 0, 0]], 0, 0, 1, steps=12)
    assert np.isfinite(pose).all()


# -- MuJoCo ------------------------------------------------------------------------------------------------------------


@needs_mujoco
def test_mujoco_comes_nearer_to_the_steady_velocity_with_finer_steps():
    surface = Surface(rows=1, columns=1, element_size=8.0)
    part = Part.rectangle(0.05, 0.035, friction=0.6)
    errors = []
    for timestep in (5e-4, 1e-4, 4e-5):
        run = mujoco_scene.simulate(
            surface, part, [4, 4, 0], [0.3, 0.05, 0], surface.max_amplitude, 1.5 * math.pi, 25, timestep=timestep
        )
        x, y, _ = run.mean_velocity[-8:].mean(axis=0)
        errors.append(abs(complex(x, y) - 0.30438 * np.exp(1j * math.radians(9.93))) / 0.30438)
    assert errors[0] > errors[1] > errors[2] and errors[2] < 0.25


@needs_mujoco
def test_mujoco_on_a_still_table_slides_to_a_stop():
    surface = Surface(rows=1, columns=1, element_size=8.0, horizontal_amplitude=0.0)
    part = Part.rectangle(0.05, 0.035, friction=0.6)
    run = mujoco_scene.simulate(surface, part, [4, 4, 0.3], [0.3, 0, 0], 0, 0, 3, timestep=2e-4)
    assert run.pose[-1, 0] - 4 == pytest.approx(0.3**2 / (2 * 0.6 * 9.81), rel=0.1)


@needs_mujoco
def test_mujoco_builds_the_elements_within_reach():
    built = mujoco_scene.build(Surface(), BLOCK, [0.4, 0.1, 0.0], reach=0.01)
    assert set(built.row) == set(range(2, 6)) and len(built.row) == built.model.nbody - 3
    with pytest.raises(ValueError, match="part"):
        mujoco_scene.build(Surface(), L_SHAPE, [0.4, 0.1, 0.0], reach=0.01)
    with pytest.raises(ValueError, match="timestep"):
        mujoco_scene.simulate(Surface(), BLOCK, *scene(1), 1, timestep=3e-4)
