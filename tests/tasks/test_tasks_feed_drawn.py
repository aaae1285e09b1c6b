"""Parts that arrive with given probabilities, as the stable poses of a mesh."""

import math

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import batch, single
from vibgym import Part
from vibgym.physics.core.noise import uniforms
from vibgym.tasks import in_stable_poses
from vibgym.tasks.feed import ALIKE, enough
from vibgym.tasks.flow import DRAWN

PROBABILITIES = [0.6, 0.3, 0.1]


def parts(*slots):
    """Return three different parts, a small, a large and a medium one, in so many slots each."""
    kinds = [Part.rectangle(a, b, friction=0.6, name=name) for a, b, name in
             ((0.03, 0.02, "small"), (0.07, 0.05, "large"), (0.05, 0.04, "medium"))]  # fmt: skip
    return [kind for kind, count in zip(kinds, slots, strict=True) for _ in range(count)]


def arrivals(env, steps, seed):
    """Yield the parts that have arrived (worlds, parts) at the reset and in each step; parts fall at random."""
    core, worlds = env.unwrapped.core, env.num_envs
    _, info = env.reset(seed=seed)
    yield core.episode.present.copy()
    rest, draw = np.zeros(env.action_space.shape, dtype=np.float32), np.random.default_rng(seed)
    for _ in range(steps):
        core.simulator.state.fallen[...] |= draw.random((worlds, len(core.parts))) < 0.2
        info = env.step(rest)[4]
        yield info["parts"]["arrived"].copy()


@pytest.mark.parametrize("slots", [(12, 12, 12), (3, 2, 1), (1, 1, 1)])
@pytest.mark.parametrize("heap", [1, 2])
def test_parts_arrive_in_the_drawn_sequence(slots, heap):
    """In each world after n arrivals: as many of each part as among the first n draws, independent of slots and room."""
    slots = [max(count, heap) for count in slots]
    settings = {"probabilities": PROBABILITIES, "heap": heap}
    env = batch("Feed", 4, action="wrench", parts=parts(*slots), task_settings=settings)
    came = np.zeros((4, 3), dtype=int)
    edges = np.searchsorted(np.repeat(np.arange(3), slots), np.arange(3))
    for arrived in arrivals(env, 250, seed=5):
        came += np.add.reduceat(arrived.astype(int), edges, axis=1)
        for key, counts in zip(env.unwrapped.core.scoring.custom_state()["flow_key"], came, strict=True):
            drawn = np.searchsorted(
                np.cumsum(PROBABILITIES), [uniforms(key, k, 0, DRAWN, 0)[0] for k in range(counts.sum())]
            )
            assert np.bincount(drawn, minlength=3).tolist() == counts.tolist()
    assert (came.sum(axis=1) > 30).all()
    env.close()


def test_frequencies_are_the_probabilities():
    """Within 3.3 standard deviations, with few slots and parts that need more room; without the draw they are not."""
    arrived = {}
    for probabilities in (PROBABILITIES, None):
        env = batch("Feed", 32, action="wrench", parts=parts(4, 3, 2), task_settings={"probabilities": probabilities})
        came = sum(new.sum(axis=0) for new in arrivals(env, 400, seed=1))
        arrived[probabilities is None] = np.add.reduceat(came, [0, 4, 7])
        env.close()
    for by_slots, came in arrived.items():
        n, p = came.sum(), np.array(PROBABILITIES)
        away = np.abs(came - n * p) / np.sqrt(n * p * (1 - p))
        assert n > 4000 and (away < 3.3).all() != by_slots


def test_no_more_parts_than_asked_are_on_the_table():
    env = batch(
        "Feed", 4, action="wrench", parts=parts(9, 9, 9), task_settings={"probabilities": PROBABILITIES, "most": 5}
    )
    env.reset(seed=2)
    rest, seen = np.zeros(env.action_space.shape, dtype=np.float32), 0
    for _ in range(150):
        info = env.step(rest)[4]
        seen = max(seen, info["parts"]["present"].sum(axis=1).max())
    assert seen == 5
    env.close()


def test_a_reset_must_leave_a_slot_to_every_part():
    env = single("Feed", parts=parts(2, 1, 1), task_settings={"probabilities": PROBABILITIES})
    env.reset(seed=1, options={"parts": [0, 2, 3]})
    with pytest.raises(ValueError, match=r"options\['parts'\].*parts\[2\]"):
        env.reset(seed=1, options={"parts": [0, 1, 3]})


def saved(mesh, path):
    path.write_bytes(mesh.export(file_type="stl"))
    return path


def test_slots_by_the_binomial_distribution():
    stats = pytest.importorskip("scipy.stats")
    for draws, p in ((12, 0.7), (12, 0.05), (1, 0.5), (18, 1e-4), (100, 0.3), (3, 1.0)):
        assert enough(draws, p) == stats.binom.ppf(0.99, draws, p)


def test_stable_poses_of_a_plate_with_holes(tmp_path):
    """Two holes on a diagonal: both large faces look different, opposite narrow ones (no through hole) look the same."""
    trimesh, shapely = pytest.importorskip("trimesh"), pytest.importorskip("shapely")
    pytest.importorskip("mapbox_earcut")
    holes = [shapely.Point(x, y).buffer(3.0).exterior.coords for x, y in ((12, 8), (-12, -8))]
    plate = trimesh.creation.extrude_polygon(
        shapely.Polygon(shapely.box(-20, -15, 20, 15).exterior.coords, holes), 10.0
    )
    path = saved(plate, tmp_path / "plate.stl")
    made = in_stable_poses(path, friction=0.5, names={0: "up", 1: "down"}, most=6)
    settings, names = made["task_settings"], [part.name for part in made["parts"]]
    assert list(dict.fromkeys(names)) == ["up", "down", "other"] and len(settings["probabilities"]) == 4
    up, down, *others = settings["probabilities"]
    assert up == pytest.approx(down) and sum(settings["probabilities"]) == pytest.approx(1.0)
    assert names.count("up") == enough(6, up) and names.count("other") == sum(enough(6, other) for other in others)
    for part in made["parts"]:
        assert np.ptp(part.rim[:, 0]) > np.ptp(part.rim[:, 1])  # lengthwise
    with pytest.raises(ValueError, match="friction alone tips 'other'"):
        gym.make("vibgym/Feed-v0", action="wrench", **made)
    with pytest.raises(ValueError, match="names"):
        in_stable_poses(path, friction=0.5, names={9: "up"})
    made = in_stable_poses(path, friction=0.5, without=[2, 4])
    assert made["task_settings"]["probabilities"] == pytest.approx([0.5, 0.5])
    env = gym.make("vibgym/Feed-v0", action="wrench", **made)
    assert env.unwrapped.task.kinds == ("plate-0", "plate-1")
    assert env.reset(seed=1)[1]["parts"]["arrived"].any()


def test_facets_of_a_round_side_are_one_pose(tmp_path):
    trimesh = pytest.importorskip("trimesh")
    path = saved(trimesh.creation.cylinder(10.0, 30.0, sections=32), tmp_path / "pin.stl")
    with pytest.warns(UserWarning, match="no prism"):
        made = in_stable_poses(path, friction=0.5)
    # From its centre the two end faces have this share of all directions; of the facets none is stable alone.
    ends = 1.0 - 15.0 / math.hypot(15.0, 10.0)
    assert made["task_settings"]["probabilities"] == pytest.approx([ends, 1.0 - ends], rel=0.02)
    lying = made["parts"][-1]
    assert lying.name == "pin-2" and np.ptp(lying.rim[:, 0]) == pytest.approx(0.03, rel=ALIKE)
    with pytest.raises(ValueError, match="names: stable pose 1 is, after a turn"):
        in_stable_poses(path, friction=0.5, names={0: "head", 1: "tail"})
