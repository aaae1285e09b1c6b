"""Actions: phasors of all elements."""

import math

import numpy as np
import pytest

from tests.envs.helpers import put, single
from vibgym import Surface, fields
from vibgym.scene.parts import part_from

SIZE = 0.026
PATCH = 4  # elements across the patch of a shipped block


def stepped(action, values, pose=None, **settings):
    """Return the phasors of all elements, as fractions of full amplitude, in a step with the action ``values``."""
    env = single("Rotate", action=action, **settings)
    env.reset(seed=3)
    if pose is not None:
        put(env, pose)
    before = env.unwrapped.core.simulator.pose[0, 0]
    env.step(values)
    return env.unwrapped.core.phasors(0), before


def values_for(action, seed, low=-1.0, high=1.0):
    shape = single("Rotate", action=action).unwrapped.action_shape
    return np.random.default_rng(seed).uniform(low, high, shape).astype(np.float32)


@pytest.mark.parametrize("surface", [{}, {"max_amplitude": 0.1e-3}])
def test_element(surface):
    """Amplitudes are relative to the largest allowed one."""
    values = values_for("element", 1)
    phasors, _ = stepped("element", values, surface=surface)
    amplitude, phase = 0.5 * (1.0 + values[..., 0].astype(float)), math.pi * values[..., 1].astype(float)
    expected = np.stack([amplitude * np.cos(phase), amplitude * np.sin(phase)], axis=-1)
    assert phasors == pytest.approx(expected, abs=1e-14)
    assert (stepped("element", np.full_like(values, -1.0))[0] == 0.0).all()  # the lowest amplitude is rest


def test_phasor_in_the_unit_disc():
    values = values_for("phasor", 2)
    phasors, _ = stepped("phasor", values)
    length = np.hypot(values[..., 0], values[..., 1]).astype(float)[..., None]
    assert (length > 1).any() and (length < 1).any()
    assert phasors == pytest.approx(values.astype(float) / np.maximum(length, 1.0), abs=1e-6)


@pytest.mark.parametrize("pose", [
    [0.4, 0.1, 0.3], [0.014, 0.012, 0.0], [0.82, 0.2, 1.0], [0.026 * 5, 0.026 * 3, 0.7], [0.3, 0.004, 2.0],
])  # fmt: skip
def test_patch(pose):
    values = values_for("patch", 3)
    assert values.shape == (1, PATCH, PATCH, 2)
    phasors, pose = stepped("patch", values, pose)
    length = np.maximum(np.hypot(values[0, ..., 0], values[0, ..., 1]), 1.0)[..., None]
    expected = np.zeros((8, 32, 2))
    # The patch's centre is the corner (even k) nearest to the part's centre.
    first_column, first_row = round(pose[0] / SIZE) - PATCH // 2, round(pose[1] / SIZE) - PATCH // 2
    assert abs((first_column + PATCH / 2) * SIZE - pose[0]) <= SIZE / 2 + 1e-12
    for i, j in np.ndindex(PATCH, PATCH):
        row, column = first_row + i, first_column + j
        if 0 <= row < 8 and 0 <= column < 32:
            expected[row, column] = values[0, i, j] / length[i, j]
    assert phasors == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("part", ["aluminium_block", "steel_block", {"shape": "disc", "radius": 0.04, "friction": 0.5}])
def test_patch_covers_the_part_at_any_position(part):
    shape = part_from(part)
    env = single("Rotate", action="patch", parts=[part])
    env.reset(seed=0)
    k = env.unwrapped.action_shape[1]
    generator = np.random.default_rng(4)
    for _ in range(25):
        pose = generator.uniform([0.06, 0.06, -3], [0.77, 0.14, 3])
        put(env, pose)
        env.step(np.ones((1, k, k, 2), dtype=np.float32))
        moving = np.hypot(*np.moveaxis(env.unwrapped.core.phasors(0), -1, 0)) > 0.5
        cosine, sine = np.cos(pose[2]), np.sin(pose[2])
        corners = pose[:2] + shape.outline @ np.array([[cosine, sine], [-sine, cosine]])
        columns, rows = np.floor(corners / SIZE).astype(int).T
        assert moving[rows, columns].all()
        assert moving.sum() == k * k


def sum_of_fields(strength, centre, surface):
    """The action means the fields of ``vibgym.fields`` (thesis fig. 4.4) around the part, with a reach of k / 2 elements."""
    ux, uy, sx, sy, inward, turn = np.clip(strength, -1, 1)
    x, y = centre[:2]
    reach = PATCH * surface.element_size / 2
    field = fields.uniform(0.0, ux) + fields.uniform(math.pi / 2, uy)
    field += fields.squeeze(x, y, math.pi / 2, sx, reach) + fields.squeeze(x, y, 0.0, sy, reach)
    field += fields.radial(x, y, inward, reach) + fields.tangential(x, y, turn, reach)
    return field.phasors(surface)


@pytest.mark.parametrize("seed", range(4))
def test_field(seed):
    strength = values_for("field", seed)[0] * (1.0 if seed % 2 else 0.3)
    phasors, pose = stepped("field", strength[None].astype(np.float32))
    expected = sum_of_fields(strength.astype(np.float32).astype(float), pose, Surface())
    assert phasors == pytest.approx(expected, abs=1e-12)
