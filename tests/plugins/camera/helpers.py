"""Helpers of the camera tests."""

import numpy as np

from vibgym import Surface
from vibgym.physics.core.records import new_state
from vibgym.plugins.camera import CameraSensor, Setup

SURFACE = Surface()
QUIET = {"noise": 0.0, "blur": 0.0, "light": 0.0, "distortion": 0.0}


def setup(parts, **settings):
    return Setup(SURFACE, parts, CameraSensor.Settings(**settings), 0.04)


def state_of(pose, velocity=None, gone=None):
    """Return a state with poses (worlds, parts, 3)."""
    pose = np.asarray(pose, dtype=float)
    state = new_state(*pose.shape[:2])
    state.pose[:] = pose
    state.mean_velocity[:] = 0.0 if velocity is None else velocity
    state.fallen[:] = False if gone is None else gone
    return state


def camera(parts, pose, periods=1, **settings):
    """Return a sensor after a reset to poses (worlds, parts, 3)."""
    state = state_of(pose)
    worlds = len(state.pose)
    sensor = CameraSensor(SURFACE, parts, worlds, periods, CameraSensor.Settings(**settings))
    uniform = np.random.default_rng(5).random((worlds, sensor.all_draws))
    sensor.keep_pictures()
    sensor.reset(np.arange(worlds), state, uniform)
    return sensor
