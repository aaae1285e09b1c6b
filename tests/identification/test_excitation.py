"""Excitation and simulated recordings."""

from __future__ import annotations

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.identification import Camera, Excitation, record

BLOCK = Part.rectangle(0.050, 0.035, friction=0.58, height=0.02)
DISC = Part.disc(0.02, friction=0.7)


def test_commands_are_valid_and_follow_from_the_seed():
    surface = Surface()
    first, second = (Excitation(surface, [BLOCK, DISC], 4) for _ in range(2))
    for pose in (first.start, first.start + 0.01, np.full((2, 3), np.nan)):
        amplitude, phase = first.command(pose)
        np.testing.assert_array_equal(second.command(pose), (amplitude, phase))
        assert amplitude.shape == phase.shape == (8, 32)
        assert (amplitude >= 0.0).all() and (amplitude <= surface.max_amplitude).all()


def test_commands_are_finite_when_the_first_image_is_lost():
    excitation = Excitation(Surface(), [BLOCK, DISC], 4)
    for pose in (np.full((2, 3), np.nan), excitation.start):
        assert np.isfinite(excitation.command(pose)).all()


@pytest.mark.parametrize("seed", range(4))
def test_parts_stay_on_the_surface_and_apart(seed):
    actuators = {"kind": "prototype", "latency": 3, "phase": 0.6 * (-1) ** seed, "gain": 1.1}
    log = record(
        Surface(), [BLOCK, BLOCK], actuators, Camera(noise_position=3e-4, dropout=0.05), seconds=24.0, seed=seed
    )
    pose = log.pose[np.isfinite(log.pose[..., 0]).all(axis=1)]
    assert (pose[..., :2] > 0.0).all() and (pose[..., 0] < 0.832).all() and (pose[..., 1] < 0.208).all()
    assert np.hypot(*(pose[:, 0] - pose[:, 1])[:, :2].T).min() > 2.0 * BLOCK.radius
    assert np.ptp(pose[..., 0], axis=0).min() > 0.15  # they do move


def test_without_room_parts_are_refused():
    with pytest.raises(ValueError, match="side by side"):
        Excitation(Surface(), [BLOCK] * 12)


class Constant:
    """Uniform command along +x."""

    start = np.array([[0.1, 0.1, 0.0]])

    def command(self, pose):
        return np.full((8, 32), 2e-4), np.full((8, 32), -0.5 * np.pi)


def test_a_recording_has_latency_and_the_map_of_the_camera():
    camera = Camera(scale=1.02, turn=0.02, x=3e-3, y=-2e-3)
    exact, late = (
        record(Surface(), BLOCK, {"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0, "latency": k}, seconds=1.0,
               excitation=Constant())
        for k in (0, 5)
    )  # fmt: skip
    seen = record(
        Surface(), BLOCK, {"kind": "prototype", "gain_spread": 0.0, "phase_spread": 0.0, "latency": 0}, camera, seconds=1.0,
        excitation=Constant(),
    )  # fmt: skip
    np.testing.assert_allclose(late.pose[5:, 0, :2] - exact.pose[:-5, 0, :2], 0.0, atol=2e-5)
    middle = np.array([0.416, 0.104])
    turn = np.array([[np.cos(0.02), -np.sin(0.02)], [np.sin(0.02), np.cos(0.02)]])
    expected = middle + [3e-3, -2e-3] + 1.02 * (exact.pose[:, 0, :2] - middle) @ turn.T
    np.testing.assert_allclose(seen.pose[:, 0, :2], expected, atol=1e-12)
    np.testing.assert_allclose(seen.pose[:, 0, 2], exact.pose[:, 0, 2] + 0.02, atol=1e-12)
    np.testing.assert_allclose(seen.taken - seen.time, 0.04, atol=1e-12)
