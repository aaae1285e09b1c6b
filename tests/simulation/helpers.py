"""Parts, scenes and checks that the tests of simulators share."""

import math

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.fields import uniform

SURFACE = Surface()
STILL = Surface(20, 20, 0.05, 0.0)
STEEL = Part.rectangle(0.05, 0.04, friction=0.64, height=0.004, name="steel")
ALUMINIUM = Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=0.0945, name="aluminium")
DISC = Part.disc(0.02, friction=0.6, name="disc")
L_SHAPE = Part.polygon(
    np.array([(0, 0), (50, 0), (50, 20), (20, 20), (20, 50), (0, 50)]) * 1e-3, friction=0.6, name="L"
)
C_SHAPE = Part.polygon(
    np.array([[0, 0], [80, 0], [80, 20], [20, 20], [20, 60], [80, 60], [80, 80], [0, 80]]) * 1e-3, friction=0.6
)
MIXED = [STEEL, ALUMINIUM, DISC, L_SHAPE]
CORNER = uniform(math.radians(225)).drive(SURFACE)
"""Full push towards the corner of the left and the bottom wall."""


def random_scene(surface, worlds, seed=0, margin=0.08, velocity=(0.0, 0.0, 0.0)):
    """Return arguments of :func:`simulated`: poses (worlds, 1, 3) ``margin`` m within the borders, velocity, random fields."""
    rng = np.random.default_rng(seed)
    low, high = [margin, margin, -math.pi], [surface.width - margin, surface.depth - margin, math.pi]
    pose, shape = rng.uniform(low, high, (worlds, 3))[:, None], (worlds, surface.rows, surface.columns)
    return pose, velocity, rng.uniform(0.0, surface.max_amplitude, shape), rng.uniform(-math.pi, math.pi, shape)


def simulated(surface, parts, pose, velocity=None, amplitude=0.0, phase=0.0, periods=1, *, conditions=None, **settings):
    """Return a simulator after some periods of one drive, with a world for each of the poses (worlds, parts, 3)."""
    worlds = len(pose) if np.ndim(pose) == 3 else 1
    simulator = Simulator(surface, parts, **{"worlds": worlds, **settings})
    simulator.reset(pose, velocity)
    simulator.set_conditions(slice(None), **(conditions or {}))
    simulator.advance(amplitude, phase, periods)
    return simulator


def grid(parts):
    """Return poses (parts, 3) of up to 33 parts without contacts."""
    columns = math.ceil(len(parts) / 3)
    k = np.arange(len(parts))
    return np.column_stack([0.05 + (k % columns) * 0.072, 0.035 + (k // columns) * 0.068, np.zeros(len(parts))])


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
