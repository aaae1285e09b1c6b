"""What tests of simulators share."""

import math

import numpy as np


def snapshot(simulator, worlds=slice(None)):
    """Copies of all that a state holds, of some worlds, and the time."""
    state = {name: np.array(value) for name, value in simulator.get_state().items()}
    periods = state.pop("periods")
    return {name: value[worlds] for name, value in state.items()} | {
        "periods": periods,
        "time": np.array(simulator.time),
    }


def same(one, other):
    """Whether two snapshots are the same bits."""
    return one.keys() == other.keys() and all(np.array_equal(one[name], other[name]) for name in one)


def same_motion(one, other):
    """Assert that two simulators have the same motion to the bit, whatever their conditions."""
    for name in ("pose", "velocity", "mean_velocity", "fallen", "sticking", "diverged"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name


def random_fields(surface, worlds, seed=0):
    """Amplitudes (m) and phases (worlds, rows, columns) of elements that know nothing of one another."""
    rng = np.random.default_rng(seed)
    shape = (worlds, surface.rows, surface.columns)
    return rng.uniform(0.0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def kinetic_energy(simulator):
    """Of every world, (worlds,), J."""
    mass = np.array([part.mass for part in simulator.parts])
    inertia, velocity = mass * [part.gyration for part in simulator.parts], simulator.velocity
    return 0.5 * (mass * (velocity[..., :2] ** 2).sum(axis=2) + inertia * velocity[..., 2] ** 2).sum(axis=1)
