"""Worlds of one simulator with different parts."""

import copy
import pickle

import numpy as np
import pytest

from tests.simulation.helpers import random_fields, simulated
from vibgym import Part, Surface
from vibgym.scene.kinds import Kinds

SURFACE = Surface(rows=6, columns=8)
EVERY = [
    Part.rectangle(0.05, 0.035, friction=0.58, height=0.01, mass=0.09, name="block"),
    Part.disc(0.02, friction=0.4, height=0.01, mass=0.05, name="disc"),
    Part.polygon(
        [[0, 0], [0.05, 0], [0.03, 0.04]], friction=0.64, height=0.01, mass=0.06, restitution=0.5, name="triangle"
    ),
    Part.rectangle(0.025, 0.02, friction=0.5, height=0.01, mass=0.02, contact_friction=0.1, name="small"),
]
FAST, PYMUNK = {"model": "planar", "contacts": "fast"}, {"model": "planar", "contacts": "pymunk"}
SCENES = [("planar", 1), ("averaged", 1), ("tilting", 1), ("planar", 4), ("tilting", 4), (FAST, 4), (PYMUNK, 4)]


@pytest.mark.parametrize(("model", "parts"), SCENES, ids=str)
def test_each_world_moves_as_one_with_its_parts_alone(model, parts):
    settings = model if isinstance(model, dict) else {"model": model}
    draw, worlds = np.random.default_rng(0), 6
    kind = np.array([draw.integers(0, len(EVERY), parts) for _ in range(worlds)])
    kinds = Kinds(EVERY, np.zeros((worlds, parts), dtype=int), [range(len(EVERY))] * parts)
    kinds.choose(np.arange(worlds), kind)
    middle = np.array([[0.06, 0.05, 0.3], [0.125, 0.05, 1.0], [0.06, 0.11, 2.0], [0.125, 0.11, 0.0]])[:parts]
    pose = middle + draw.uniform(-0.002, 0.002, (worlds, parts, 3))
    amplitude, phase = random_fields(SURFACE, worlds)
    together = simulated(SURFACE, kinds, pose, None, amplitude, phase, 12, **settings)
    for world in range(worlds):
        # Fast contacts take the steps that the finest of all kinds requires.
        everyone = Kinds(EVERY, kind[[world]], [range(len(EVERY))] * parts)
        scene = pose[world], None, amplitude[world], phase[world], 12
        alone = simulated(SURFACE, everyone, *scene, **settings)
        for name in ("pose", "velocity", "mean_velocity", "fallen", "contact_impulse"):
            np.testing.assert_array_equal(getattr(together, name)[world], getattr(alone, name)[0], err_msg=name)
        if settings.get("contacts") != "fast":
            fixed = simulated(SURFACE, [EVERY[k] for k in kind[world]], *scene, **settings)
            np.testing.assert_array_equal(fixed.pose[0], together.pose[world])
    assert len({tuple(row) for row in kind.tolist()}) > 2 and np.abs(together.pose - pose).max() > 0.005


def test_values_follow_the_kinds():
    """Also those of copies, and of kinds with other properties."""
    kinds = Kinds(EVERY, np.zeros((2, 1), dtype=int), [range(len(EVERY))])
    held = kinds.values(lambda part: part.mass)
    twice = kinds.changed(lambda part: part).values(lambda part: part.mass, 2)
    copied, copies = copy.deepcopy((kinds, held))
    for known, values in ((kinds, held), (pickle.loads(pickle.dumps((kinds, held)))), (copied, copies)):
        known.choose(np.array([1]), np.array([[2]]))
        np.testing.assert_array_equal(values[:, 0], [EVERY[0].mass, EVERY[2].mass])
    np.testing.assert_array_equal(twice, held)
