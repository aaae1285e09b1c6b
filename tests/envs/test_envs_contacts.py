"""Contact impulses in the simulator and in observations."""

import gymnasium as gym
import numpy as np
import pytest
import shapely
from shapely import affinity
from shapely.ops import nearest_points

from tests.envs.helpers import batch
from vibgym import Part, Simulator, Surface
from vibgym.envs.features import RowLayout

FELT = {"sensor": {"kind": "ideal", "report": ["contacts"]}}


def test_contact_impulses_of_a_collision_in_closed_form():
    """The impulse between discs without friction, head on, is ``(1 + e) v m1 m2 / (m1 + m2)``."""
    heavy, light = (
        Part.disc(0.02, friction=0.0, contact_friction=0.0, mass=mass, restitution=0.5) for mass in (0.3, 0.1)
    )
    sim = Simulator(Surface(horizontal_amplitude=0.0), [heavy, light])
    sim.reset([[[0.2, 0.1, 0.0], [0.2407, 0.1, 0.0]]], [[[0.3, 0.0, 0.0], [0.0, 0.0, 0.0]]])
    assert not sim.contact_impulse.any()
    sim.advance(0.0, 0.0)
    given = sim.contact_impulse[0]
    assert given[1] == pytest.approx([1.5 * 0.3 * 0.3 * 0.1 / 0.4, 0.0], rel=1e-9, abs=1e-12)
    assert given.sum(axis=0) == pytest.approx([0.0, 0.0], abs=1e-15)
    sim.advance(0.0, 0.0)
    assert not sim.contact_impulse.any()  # apart again


def test_observations_contain_contacts():
    env = batch("Push", 16, action="wrench", observation="parts_and_state", **FELT).unwrapped
    observation, _ = env.reset(seed=0)
    surface, parts, felt = env.surface, env.parts, 0
    rows, blocks = RowLayout.of(env.task), env.core.observation.layout
    action = np.zeros((16, 3, 3), dtype=np.float32)
    for _ in range(60):
        way = env.truth.pose[:, 2:, :2] - env.truth.pose[:, :2, :2]
        action[:, :2, :2] = way / np.abs(way).max(axis=-1, keepdims=True)
        observation, *_ = env.step(action)
        normal = rows.numbers(observation["parts"], "contact_normal")
        impulse = rows.quantity(observation["parts"], "contact_impulse")
        assert (normal == blocks.numbers(observation["state"], "contact_normal")).all()
        mass = [[part.mass] for part in parts]
        assert impulse * mass == pytest.approx(env.core.simulator.contact_impulse, abs=2e-6)
        felt += (np.abs(impulse[:, 2]).max(axis=-1) > 0.02 * surface.table_speed).sum()
    assert felt > 100
    for world in range(16):
        pose = env.truth.pose[world]
        shapes = [
            affinity.translate(affinity.rotate(shapely.Polygon(part.outline), turn, (0, 0), use_radians=True), x, y)
            for part, (x, y, turn) in zip(parts, pose, strict=True)
        ]
        nearest = min((0, 1), key=lambda k: shapes[2].distance(shapes[k]))
        mine, theirs = nearest_points(shapes[2], shapes[nearest])
        way = np.array([theirs.x - mine.x, theirs.y - mine.y])
        if np.hypot(*way) > 0.002:  # shapely has no normal for touching outlines
            # A disc's outline is a polygon for shapely.
            assert normal[world, 2] == pytest.approx(way / np.hypot(*way), abs=0.06)


@pytest.mark.parametrize("sensor", [{"kind": "pose"}, {"kind": "ideal", "estimator": "kalman"}])
def test_contacts_require_an_ideal_sensor(sensor):
    with pytest.raises(ValueError, match=r"sensor\.report"):
        gym.make("vibgym/Push-v0", sensor=sensor | {"report": ["contacts"]})
