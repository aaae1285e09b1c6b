"""The bits of a world do not depend on its batch, threads, calls or history, nor on other worlds that diverge."""

import copy
import math
import pickle
from typing import Any, NamedTuple

import numpy as np
import pytest

from tests.simulation.helpers import (
    ALUMINIUM,
    C_SHAPE,
    DISC,
    MIXED,
    STEEL,
    SURFACE,
    grid,
    random_fields,
    same,
    snapshot,
)
from vibgym import Part, Simulator, Surface

BLOCK = Part.rectangle(0.050, 0.035, friction=0.6)
KITE = Part.polygon([[0, 0], [0.05, 0], [0.06, 0.03], [0.02, 0.05]], friction=0.3, height=0.03, name="kite")
LAWFUL = Part.rectangle(0.05, 0.035, friction=0.5, friction_law={"kind": "stribeck", "rise": 0.5, "speed": 0.3})
PERIODS = 5


class Scene(NamedTuple):
    """Worlds with random starts and fields."""

    parts: list[Part]
    settings: dict[str, Any] = {}
    walls: tuple[str, ...] = ()
    surface: Surface = SURFACE
    tilt: float = 0.0  # rad, largest of the starts
    conditions: bool = False  # drawn per world

    @property
    def worlds(self):
        """Enough of them for two threads; not a multiple of eight."""
        if len(self.parts) > 1 or self.tilt:
            return 45
        return 803 if "model" in self.settings else 253


CROWD = MIXED * 2, ("left", "bottom")
TILTING = {"model": "tilting"}
SCENES = {
    "block": Scene([BLOCK]),
    "C": Scene([C_SHAPE]),
    "disc": Scene([DISC]),
    "points": Scene([BLOCK], {"pieces": 2}),
    "sticking": Scene([Part.rectangle(0.05, 0.035, friction=0.6, static_friction=0.7)], surface=Surface(frequency=8.0)),
    "averaged": Scene([BLOCK], {"model": "averaged"}),
    "first order": Scene([BLOCK], {"model": "averaged", "order": 1}),
    "strides": Scene([BLOCK], {"model": "averaged", "stride": 2, "steps": 3}),
    "crowd": Scene(CROWD[0], {}, CROWD[1]),
    "fast": Scene(CROWD[0], {"contacts": "fast"}, CROWD[1]),
    "pymunk": Scene(CROWD[0], {"contacts": "pymunk"}, CROWD[1]),
    "conditions": Scene(CROWD[0], {}, CROWD[1], conditions=True),
    "law": Scene([LAWFUL, STEEL, LAWFUL]),
    "tilting block": Scene([STEEL], TILTING, tilt=0.05),
    "tilting kite": Scene([KITE], TILTING, tilt=0.05),
    "tilting three": Scene([STEEL, DISC, ALUMINIUM], TILTING, ("left",), tilt=0.05),
}
BY_CALLS = set(SCENES) - {"averaged", "first order", "strides"}
"""Scenes in which several calls are one; calls of the averaged model convert velocities."""


def begun(scene, index=None, threads=1, seed=0):
    """Return a simulator with some of the scene's worlds (None: all), and their amplitudes and phases."""
    rng, count, worlds = np.random.default_rng(seed), len(scene.parts), scene.worlds
    index = np.arange(worlds) if index is None else np.array(index)
    if count == 1:
        pose = rng.uniform([0.05, 0.03, -3], [0.78, 0.18, 3], (worlds, 1, 3))
    else:
        pose = np.tile(grid(scene.parts), (worlds, 1, 1))
        pose[..., 2] += rng.choice([0.0, math.pi], (worlds, count))
    velocity = rng.uniform(-1, 1, pose.shape) * [0.1, 0.1, 1.0 if count > 1 else 8.0]
    settings = {"walls": scene.walls, "threads": threads, **scene.settings}
    simulator = Simulator(scene.surface, scene.parts, worlds=len(index), **settings)
    simulator.reset(pose[index], velocity[index])
    if scene.conditions:
        friction, mass = rng.uniform(0.3, 1.6, (2, worlds, count))
        incline, patches = rng.normal(0.0, 0.5, (worlds, 2)), rng.uniform(0.5, 1.5, (worlds, 8, 32))
        drawn = {"friction": friction, "mass": mass, "incline": incline, "patches": patches}
        simulator.set_conditions(slice(None), **{name: values[index] for name, values in drawn.items()})
    if scene.tilt:
        size = scene.tilt * rng.uniform(0.0, 1.0, (worlds, count, 1))
        simulator.tip(slice(None), (size * rng.uniform(-1.0, 1.0, (worlds, count, 2)))[index])
    return simulator, [values[index] for values in random_fields(scene.surface, worlds, seed)]


def advanced(scene, index=None, threads=1, calls=(PERIODS,)):
    simulator, fields = begun(scene, index, threads)
    for periods in calls:
        simulator.advance(*fields, periods)
    return simulator


@pytest.mark.parametrize("name", SCENES)
def test_a_world_has_the_same_bits_in_any_batch_order_thread_and_call(name):
    scene = SCENES[name]
    together = advanced(scene)
    whole = snapshot(together)
    start = begun(scene)[0]
    assert np.abs(whole["pose"] - start.pose)[..., :2].max() > 0.004
    if len(scene.parts) > 6:
        assert together.statistics["contact"] >= scene.worlds
    order = np.random.default_rng(5).permutation(scene.worlds)
    for index, threads, calls in (
        (range(scene.worlds), 2, (PERIODS,)),
        (order, 3, (PERIODS,)),
        ([7] * 20, 1, (PERIODS,)),
        ([0], 1, (PERIODS,)),
        ([scene.worlds - 1], 1, (PERIODS,)),
        (range(scene.worlds), 1, (2, *[1] * (PERIODS - 2)) if name in BY_CALLS else (PERIODS,)),
    ):
        expected = {key: values[list(index)] if values.ndim else values for key, values in whole.items()}
        assert same(snapshot(advanced(scene, index, threads, calls)), expected), (index, threads, calls)
    assert len(advanced(scene, None, 2, (1,)).blocks.edges) > 1


@pytest.mark.parametrize("name", SCENES)
def test_a_state_continues_in_any_simulator(name):
    """Restored into the same simulator, a new one, one with another history, and copies."""
    scene, few = SCENES[name], range(6)
    original, fields = begun(scene, few)
    original.advance(*fields, PERIODS)
    state = original.get_state()
    others = {"deepcopy": copy.deepcopy(original), "pickle": pickle.loads(pickle.dumps(original))}
    time = original.time
    original.advance(*fields, 3)
    after = snapshot(original)
    others["new"] = Simulator(scene.surface, scene.parts, worlds=6, walls=scene.walls, **scene.settings)
    others["used"] = begun(scene, few, seed=1)[0]
    others["used"].advance(*fields, 2)
    others["itself"] = original
    for key in ("new", "used", "itself"):
        others[key].set_state(state)
    for key, simulator in others.items():
        assert simulator.time == time
        simulator.advance(*fields, 3)
        assert same(snapshot(simulator), after), key
    original.reset(begun(scene, few)[0].pose)
    assert not original.sticking.any() and not original.fallen.any() and original.time == 0.0
    assert (original.friction == 1.0).all() and (original.mass == 1.0).all() and (original.incline == 0.0).all()
    assert (original.patches == 1.0).all()


@pytest.mark.parametrize("name", ["block", "averaged", "crowd", "fast", "pymunk", "tilting block"])
def test_a_diverged_world_keeps_its_last_state_and_changes_no_other(name):
    (simulator, fields), (sound, _) = begun(SCENES[name], range(3)), begun(SCENES[name], range(3))
    simulator.advance(*fields, 2)
    sound.advance(*fields, 2)
    simulator.state.velocity[1, -1, 2] = 1.7e308
    before = simulator.pose[1]
    simulator.advance(*fields, 3)
    sound.advance(*fields, 3)
    assert simulator.diverged.tolist() == [False, True, False]
    assert np.isfinite(simulator.pose).all() and (simulator.pose[1] == before).all()
    assert (simulator.mean_velocity[1] == 0.0).all()
    assert same(snapshot(simulator, [0, 2]), snapshot(sound, [0, 2]))
    simulator.reset(sound.pose)
    simulator.advance(*fields)
    assert not simulator.diverged.any()
