"""What tests of contacts share."""

import numpy as np


def kinetic_energy(simulator):
    """Of every world, (worlds,), J."""
    mass = np.array([part.mass for part in simulator.parts])
    inertia, velocity = mass * [part.gyration for part in simulator.parts], simulator.velocity
    return 0.5 * (mass * (velocity[..., :2] ** 2).sum(axis=2) + inertia * velocity[..., 2] ** 2).sum(axis=1)
