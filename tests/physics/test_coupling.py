"""Parts with a coupling below 1 move as if the elements under them had a smaller amplitude."""

import math

import numpy as np
import pytest

from tests.simulation.helpers import SURFACE, simulated
from vibgym import Part
from vibgym.allocation.frictional import FrictionalInverse

RNG = np.random.default_rng(5)
AMPLITUDE = RNG.uniform(0.0, SURFACE.max_amplitude, (3, 8, 32))
PHASE = RNG.uniform(-math.pi, math.pi, (3, 8, 32))
POSE = np.array([[[0.2, 0.1, 0.3]], [[0.4, 0.08, 1.0]], [[0.6, 0.12, -2.0]]])
ANGLE = [[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.06], [0, 0.06]]
SHAPES = {
    "block": lambda **own: Part.rectangle(0.050, 0.035, friction=0.58, **own),
    "disc": lambda **own: Part.disc(0.020, friction=0.6, **own),
    "angle": lambda **own: Part.polygon(ANGLE, friction=0.5, **own),
    "sticking": lambda **own: Part.rectangle(0.05, 0.04, friction=1.0, static_friction=9.0, **own),
}  # fmt: skip


def played(part, share, periods=20, **knobs):
    """Poses and velocities after some periods, with the amplitudes times ``share``."""
    sim = simulated(SURFACE, part, POSE, None, share * AMPLITUDE, PHASE, periods, **knobs)
    return np.concatenate([sim.pose, sim.velocity], axis=-1)


@pytest.mark.parametrize("shape, knobs", [
    *((shape, {}) for shape in SHAPES), ("block", {"pieces": 3}), ("block", {"model": "averaged"}),
])  # fmt: skip
@pytest.mark.parametrize("coupling", [0.0, 0.25, 0.7])
def test_coupling_equals_a_smaller_amplitude(shape, knobs, coupling):
    soft, hard = SHAPES[shape](coupling=coupling), SHAPES[shape]()
    assert played(soft, 1.0, **knobs) == pytest.approx(played(hard, coupling, **knobs), abs=1e-9)
    assert coupling == 0.0 or abs(played(soft, 1.0) - played(hard, 1.0)).max() > 1e-3 or shape == "sticking"


def test_coupling_per_part_with_unchanged_contacts():
    """Two touching parts, of which the undriven one blocks the other."""
    pusher, still = SHAPES["disc"](), SHAPES["block"](coupling=0.0, name="soft")
    right = None, SURFACE.max_amplitude, -math.pi / 2, 12  # drives all coupled parts to the right
    pose = [[0.2, 0.1, 0.0], [0.25, 0.1, 0.0], [0.6, 0.1, 0.0]]
    sim = simulated(SURFACE, [pusher, still, SHAPES["block"]()], pose, *right)
    moved = sim.pose[0, :, 0] - [0.2, 0.25, 0.6]
    free = simulated(SURFACE, SHAPES["block"](coupling=0.0), pose[1], *right)
    alone = free.pose[0, 0, 0] - 0.25
    assert abs(alone) < 6e-3  # from rest, it soon slides in place
    assert moved[1] > alone + 2e-3 and moved[0] < moved[2]  # pushed, which slows the pusher down


def test_soft_parts_need_larger_amplitudes():
    still = np.zeros((1, 1, 3))
    wanted = np.array([[[0.5, 0.2, 0.0]]])
    hard, soft = (FrictionalInverse(SURFACE, SHAPES["block"](coupling=c)).push(still, wanted) for c in (1.0, 0.5))
    assert soft.push == pytest.approx(2.0 * hard.push) and soft.acceleration == pytest.approx(hard.acceleration)
    most = FrictionalInverse(SURFACE, SHAPES["block"](coupling=0.5)).push(still, 100.0 * wanted)
    assert np.hypot(*most.push[0, 0, :2]) == pytest.approx(1.0)
