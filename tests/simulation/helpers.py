"""Helpers of the tests of simulators."""

import math

import numpy as np


def snapshot(simulator, worlds=slice(None)):
    """Return copies of the state of some worlds, and the time."""
    state = {name: np.array(value) for name, value in simulator.get_state().items()}
    periods = state.pop("periods")
    return {name: value[worlds] for name, value in state.items()} | {
        "periods": periods,
        "time": np.array(simulator.time),
    }


def same(one, other):
    """Return whether two snapshots are bitwise equal."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def same_motion(one, other):
    """Assert that two simulators have bitwise equal motion; conditions may differ."""
    for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking", "diverged"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def random_fields(surface, worlds, seed=0):
    """Return independent random amplitudes (m) and phases (worlds, rows, columns)."""
    rng = np.random.default_rng(seed)
    shape = (worlds, surface.rows, surface.columns)
    return rng.uniform(0.0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def kinetic_energy(simulator):
    """Return the kinetic energy of every world, (worlds,) J."""
    mass = np.array([part.mass for part in simulator.parts])
    inertia, velocity = mass * [part.gyration for part in simulator.parts], simulator.velocity
    return 0.5 * (mass * (velocity[..., :2] ** 2).sum(axis=2) + inertia * velocity[..., 2] ** 2).sum(axis=1)
