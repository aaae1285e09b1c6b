"""Helpers of the environment tests."""

from typing import Any

import gymnasium as gym
import numpy as np

import vibgym  # noqa: F401 - registers the environments
from vibgym.policies.task_info import TaskInfo

TASKS = ("Transport", "Align", "Rotate")
WALLS = ["left", "right", "bottom", "top"]
SMALL = {"rows": 3, "columns": 4}  # parts fall off soon
PIXEL = 0.026 / 6
"""Width (m) of a pixel of the observation ``"image"`` of the default surface."""


def single(task: str, **settings: Any) -> Any:
    """A single environment with Gymnasium's wrappers, step limit included."""
    return gym.make(f"vibgym/{task}-v0", **settings)


def batch(task: str, worlds: int, **settings: Any) -> Any:
    """The native batch environment."""
    return gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, **settings)


def assert_same(got: Any, expected: Any, where: str = "") -> None:
    """Assert bitwise equality, including types, shapes and keys."""
    assert type(got) is type(expected), where
    if isinstance(expected, dict):
        assert got.keys() == expected.keys(), where
        for key, value in expected.items():
            assert_same(got[key], value, f"{where}.{key}")
    elif isinstance(expected, tuple | list):
        assert len(got) == len(expected), where
        for k, value in enumerate(expected):
            assert_same(got[k], value, f"{where}[{k}]")
    elif isinstance(expected, np.ndarray):
        assert got.dtype == expected.dtype and got.shape == expected.shape, where
        if expected.dtype == object:
            assert_same(got.tolist(), expected.tolist(), where)
        else:
            assert got.tobytes() == expected.tobytes(), (where, got, expected)
    else:
        assert got == expected, where


def put(env: Any, pose: Any, velocity: Any = None, world: int = 0) -> None:
    """Place the part of one world at ``pose``, or all at (parts, 3); sliding in place unless ``velocity`` is given."""
    core = env.unwrapped.core
    velocity = core.idle if velocity is None else np.asarray(velocity, dtype=float)
    core.simulator.place(np.array([world]), np.asarray(pose, dtype=float).reshape(1, -1, 3), velocity, 0.0)


def goal(env: Any, world: int = 0) -> np.ndarray:
    """Return the goal pose of one world."""
    return env.unwrapped.core.episode.goal[world, 0].copy()


def feature(env: Any, seen: Any, name: str) -> np.ndarray:
    """Return the values of a feature in state observations, (..., parts, width)."""
    return TaskInfo.of(env).layout.numbers(seen, name)


def pixel(x: float, y: float) -> tuple[int, int]:
    """Row and column of the pixel at a point of the default surface."""
    return 8 * 6 - 1 - int(y / PIXEL), int(x / PIXEL)


def still(env: Any) -> np.ndarray:
    """A ``"phasor"`` action with which all elements rest, for one world or a batch."""
    return np.zeros(env.action_space.shape, dtype=np.float32)


def sorted_pose():
    """Six parts in their zones, far apart, and slow enough if they slide in place."""
    rows = [0.04, 0.104, 0.168]
    return np.array([[[0.08, y, 0.0], [0.75, y, 0.0]] for y in rows]).reshape(6, 3)
