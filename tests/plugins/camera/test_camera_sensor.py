"""The camera as a sensor: flags, images, and its statistics."""

import math

import gymnasium as gym
import numpy as np
import pytest

import vibgym  # noqa: F401
from tests.plugins.camera.helpers import SURFACE, camera, setup, state_of
from vibgym import Part
from vibgym.kernels.jit import jit
from vibgym.plugins.camera import CameraSensor
from vibgym.plugins.camera.fitting import fit_errors, random_poses, sample_alone
from vibgym.plugins.camera.statistical import normal_levels, smooth_noise
from vibgym.scene.parts import shipped_part

BLOCK, DISC = shipped_part("aluminium_block"), Part.disc(0.02, friction=0.5)
SQUARE = Part.rectangle(0.04, 0.04, friction=0.5)
TRIANGLE = Part.polygon([[0.03, 0.0], [-0.015, 0.026], [-0.015, -0.026]], friction=0.5)


@pytest.mark.parametrize("lines, edge, position, heading", [
    ("all", "grey", 2e-5, 0.1), ("half", "grey", 3e-5, 0.1), ("all", "threshold", 6e-5, 0.45),
    ("half", "threshold", 1.2e-4, 0.8),
])  # fmt: skip
def test_accuracy_for_the_aluminium_block(lines, edge, position, heading):
    """Check the error at default noise, blur, light and distortion, at its height, anywhere on the surface."""
    known = setup([BLOCK], lines=lines, edge=edge)
    error, seen = sample_alone(known, 0, random_poses(known, 0, 300, seed=9), key=77)
    assert seen.all()
    assert error[:, :2].std() < position and math.degrees(error[:, 2].std()) < heading
    assert np.abs(error[:, :2].mean(axis=0)).max() < 3e-5


def test_a_part_that_leaves_the_image_is_lost_and_found_again():
    x = [0.790, 0.798, 0.806, 0.815, 0.806, 0.798]
    sensor = camera([BLOCK, DISC], [[[x[0], 0.1, 0.0], [0.2, 0.1, 0.0]]])
    seen = []
    for at in x[1:]:
        sensor.sample(state_of([[[at, 0.1, 0.0], [0.2, 0.1, 0.0]]]))
        seen.append(sensor.due.seen[0].tolist())
        assert sensor.info()["losses"].tolist() == [int(not seen[-1][0])] and not sensor.info()["merges"].any()
    assert seen == [[True, True], [True, True], [False, True], [True, True], [True, True]]


@pytest.mark.parametrize("statistical", [False, True])
def test_touching_parts_are_merged_and_separated_again(statistical):
    gaps = [0.03, 0.015, 0.0003, 0.0003, 0.02]
    poses = [[[0.3, 0.1, 0.0], [0.35 + gap, 0.1, 0.0], [0.6, 0.1, 1.0]] for gap in gaps]
    sensor = camera([BLOCK] * 3, [poses[0]], statistical=statistical)
    for pose, gap in zip(poses[1:], gaps[1:]):
        sensor.sample(state_of([pose]))
        apart = gap > 0.001
        assert sensor.due.seen[0].tolist() == [apart, apart, True]
        assert sensor.info()["merges"].tolist() == [0 if apart else 2] and not sensor.info()["losses"].any()
        assert np.isfinite(sensor.due.pose).all() and not sensor.info()["swaps"].any()


def test_the_image_is_the_one_that_is_due():
    """With a delay of two periods, the image equals that without delay two steps ago; noise is new at each sample."""
    late, now = (
        gym.make("vibgym/Align-v0", action="field", sensor={"kind": "camera", "delay": delay}, observation="camera")
        for delay in (2, 0)
    )
    images = [now.reset(seed=3)[0]]
    assert (late.reset(seed=3)[0] == images[0]).all() and late.observation_space.shape == (285, 752)
    for k in range(4):
        images.append(now.step(np.zeros(6, np.float32))[0])
        image, *_, info = late.step(np.zeros(6, np.float32))
        assert (image == images[max(k - 1, 0)]).all() and late.observation_space.contains(image)
        assert {"swaps", "merges", "losses"} <= set(info["measured"])


# -- the statistical sensor --------------------------------------------------------------------------------------------


@jit
def noise_at(places: np.ndarray, kind: int, quantiles: np.ndarray, values: np.ndarray) -> None:
    for n in range(places.shape[0]):
        x, y, z = places[n, 0], places[n, 1], places[n, 2]
        values[n, 0], values[n, 1], values[n, 2] = smooth_noise(x, y, z, kind, quantiles)


def test_smooth_noise_is_normal_continuous_and_its_components_independent():
    random = np.random.default_rng(4)
    places, values = random.uniform(-500, 500, (20_000, 3)), np.empty((20_000, 3))
    noise_at(places, 0, normal_levels(), values)
    assert np.abs(values.mean(axis=0)).max() < 0.03 and values.std(axis=0) == pytest.approx(1.0, abs=0.03)
    assert np.abs(np.corrcoef(values.T) - np.eye(3)).max() < 0.03
    assert (np.abs(values) < 1.0).mean() == pytest.approx(0.683, abs=0.015)
    near, other = np.empty_like(values), np.empty_like(values)
    noise_at(places + 1e-6, 0, normal_levels(), near)
    noise_at(places, 1, normal_levels(), other)
    assert np.abs(near - values).max() < 1e-4 and abs(np.corrcoef(values[:, 0], other[:, 0])[0, 1]) < 0.03


@pytest.mark.parametrize("settings", [{"edge": "threshold"}, {"edge": "grey", "lines": "all"}])
def test_errors_of_the_statistical_sensor_equal_the_cameras(settings):
    """Compare deviations at random poses, of independent samples, and of the change between neighbouring poses."""
    worlds, known = 300, setup([BLOCK, DISC], **settings)
    for kind, part in enumerate((BLOCK, DISC)):
        pose = random_poses(known, kind, worlds, seed=21)[:, None]
        shifted = pose + [0.4e-3, 0.2e-3, 0.01]
        spread = {}
        for statistical in (False, True):
            sensor = camera([part], pose, statistical=statistical, **settings)
            errors = [sensor.due.pose - pose]
            for at in (pose, shifted):
                sensor.sample(state_of(at))
                assert sensor.due.seen.all()
                errors.append(sensor.due.pose - at)
            first, again, moved = (error[:, 0] for error in errors)
            spread[statistical] = np.array([first.std(0), (again - first).std(0), (moved - first).std(0)])
        columns = [0, 1, 2] if part is BLOCK else [0, 1]
        ratio = spread[True][:, columns] / spread[False][:, columns]
        assert (ratio[:2] > 0.75).all() and (ratio[:2] < 1.33).all(), ratio
        assert (ratio[2] > 0.6).all() and (ratio[2] < 1.6).all(), ratio


@pytest.mark.parametrize("part", [BLOCK, SQUARE, TRIANGLE])
def test_effect_of_motion_on_interlaced_lines(part):
    """Centres lag by a quarter of a period, and parts seem turned by the shift and the turn between both halves."""
    random, worlds = np.random.default_rng(3), 60
    pose = random_poses(setup([part]), 0, worlds, seed=5)[:, None]
    velocity = random.uniform([-0.2, -0.2, -3.0], [0.2, 0.2, 3.0], (worlds, 1, 3))
    errors = {}
    for statistical in (False, True):
        sensor = camera([part], pose, statistical=statistical, lines="interlaced")
        sensor.track.velocity[:] = velocity  # as after some tracked samples
        sensor.samples[:] = 1
        sensor.track.pose[:] = pose - 0.04 * velocity
        sensor.sample(state_of(pose, velocity))
        assert sensor.due.seen.all()
        errors[statistical] = (sensor.due.pose - pose)[:, 0]
    assert errors[False][:, :2] == pytest.approx(-0.01 * velocity[:, 0, :2], abs=3e-4)
    difference = (errors[True] - errors[False]).std(axis=0)
    assert (difference < [6e-5, 6e-5, math.radians(0.25)]).all(), difference
    assert errors[False][:, 2].std() > math.radians(0.9)  # a noticeable effect


@pytest.mark.parametrize("statistical", [False, True])
def test_its_error_freezes_at_rest(statistical):
    """With whole pixels, the error of the mean over many samples equals that of one, since white noise is small."""
    pose = random_poses(setup([BLOCK]), 0, 60, seed=2)[:, None]
    sensor = camera([BLOCK], pose, statistical=statistical, edge="threshold", noise=0.3)
    total = np.zeros_like(pose)
    for _ in range(16):
        sensor.sample(state_of(pose))
        total += sensor.due.pose - pose
    one, mean = (sensor.due.pose - pose).std(axis=0), (total / 16).std(axis=0)
    assert (mean > 0.8 * one).all() and one[0, 2] > math.radians(0.3)


def test_sigma_for_estimators():
    sensor = CameraSensor(SURFACE, [DISC, BLOCK, DISC], 1, 1, CameraSensor.Settings(edge="threshold"))
    errors = fit_errors(sensor.setup)
    (sigma,) = sensor.sigma
    assert sigma.shape == (3, 3) and (sigma[0] == sigma[2]).all() and sigma[0, 2] == 0.0
    assert sigma[1] == pytest.approx(np.sqrt(errors.mean**2 + errors.fixed**2 + errors.white**2)[1])
