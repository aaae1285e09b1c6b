"""Tasks for several parts: the numbers against counts of their own from the recorded poses, and the files."""

import csv
import dataclasses
import math
import re

import gymnasium as gym
import numpy as np
import pytest
import shapely
from shapely import affinity

from agents.evaluation import films
from agents.evaluation.films import Log
from tests.agents.evaluation.conftest import Shepherd
from vibgym.policies.rollout import rollout

PAIRS = [(task, "ideal", policy) for policy in ("shepherd", "lazy shepherd") for task in ("Sort", "Singulate")]


def distances(found, task, poses):
    """Distances (steps, pairs) between the outlines, m; 0 where they overlap, inf of absent parts."""
    outlines = [shapely.Polygon(part.outline) for part in found.tasks[task].parts]
    one, other = np.triu_indices(len(outlines), 1)
    result = np.full((len(poses), len(one)), math.inf)
    for step, pose in enumerate(poses.astype(np.float64)):
        placed = [
            affinity.translate(affinity.rotate(outline, each[2], origin=(0, 0), use_radians=True), each[0], each[1])
            for outline, each in zip(outlines, pose, strict=True)
        ]
        result[step] = [placed[i].distance(placed[j]) for i, j in zip(one, other, strict=True)]
    return result


def over_time(rollout, name):
    values = rollout.over_time(name)
    assert values is not None
    return values


def poses_of(rollout, episode):
    return rollout.poses[episode, : rollout.steps[episode] + 1]


@pytest.mark.parametrize("pair", PAIRS)
def test_collisions_and_clearance_from_the_poses(several, pair):
    rollout = several.rollout(*pair)
    for episode in range(3):
        poses = poses_of(rollout, episode)
        if rollout.fallen[episode]:  # a part that has fallen is out of the way
            poses = poses[:-1]
        between = distances(several, pair[0], poses)
        touching = between < 1e-4
        assert rollout.collisions[episode] == (touching[1:] & ~touching[:-1]).sum()
        clearances = np.maximum(over_time(rollout, "clearance")[episode, : len(poses)], 0.0)
        np.testing.assert_allclose(clearances, between.min(axis=1), atol=1e-6)
    everything = np.nanmin(over_time(rollout, "clearance"), axis=1)
    np.testing.assert_array_equal(rollout.clearance, everything.astype(np.float64))


def test_there_were_collisions(several):
    assert several.rollout("Sort", "ideal", "shepherd").collisions.sum() > 0  # else the test above has shown little
    assert several.rollout("Sort", "ideal", "lazy shepherd").collisions.sum() == 0
    assert (several.rollout("Singulate", "ideal", "lazy shepherd").clearance < 1e-5).all()  # in touch from the start


@pytest.mark.parametrize("pair", PAIRS)
def test_throughput_from_the_poses(several, pair):
    rollout, task = several.rollout(*pair), several.tasks[pair[0]]
    for episode, steps in enumerate(rollout.steps):
        last = poses_of(rollout, episode)[-2:].astype(np.float64)
        if rollout.fallen[episode]:
            continue
        done = 0
        if pair[0] == "Sort":
            speed = np.hypot(*(last[1] - last[0])[:, :2].T) / rollout.step_time
            for part, kind in enumerate(task.kind):
                zone, centre = shapely.box(*task.zones[kind]), last[1, part, :2]
                done += zone.contains(shapely.Point(centre)) and speed[part] < 0.020
        else:
            one, other = np.triu_indices(6, 1)
            between = distances(several, "Singulate", last)[1]
            done = sum(between[(one == part) | (other == part)].min() > math.sqrt(2.0) * 0.026 for part in range(6))
        assert rollout.parts_done[episode] == done
        assert rollout.throughput[episode] == pytest.approx(done / (0.04 * steps))
        assert not rollout.success[episode] or done == 6


@pytest.mark.parametrize("pair", PAIRS)
def test_paths(several, pair):
    rollout, task = several.rollout(*pair), several.tasks[pair[0]]
    for episode in range(len(rollout.seeds)):
        places = poses_of(rollout, episode)[..., :2].astype(np.float64)
        lengths = np.hypot(*np.moveaxis(np.diff(places, axis=0), -1, 0)).sum(axis=0)
        np.testing.assert_allclose(rollout.path_lengths[episode], lengths, atol=1e-4)
        assert rollout.path_length[episode] == pytest.approx(lengths.sum(), abs=5e-4)
        if pair[0] == "Sort":
            ways = [
                shapely.box(*task.zones[kind]).distance(shapely.Point(places[0, part]))
                for part, kind in enumerate(task.kind)
            ]
        else:
            ways = np.hypot(*(places[-1] - places[0]).T).tolist()
        assert rollout.straight[episode] == pytest.approx(sum(ways), abs=1e-6)
        efficiency = rollout.path_efficiency[episode]
        if rollout.success[episode]:
            assert efficiency == pytest.approx(sum(ways) / lengths.sum(), rel=1e-3) and 0.0 < efficiency <= 1.0 + 1e-3
        else:
            assert math.isnan(efficiency)


def test_same_numbers_as_single_environments(several):
    rollout, policy = several.rollout("Sort", "ideal", "shepherd"), Shepherd()
    for k, seed in enumerate(rollout.seeds[:2]):
        env = gym.make("vibgym/Sort-v0", action="field", observation="state")
        observation, info = env.reset(seed=seed)
        done, steps, total = False, 0, 0.0
        while not done:
            action, _ = policy.predict(observation)
            observation, reward, terminated, truncated, info = env.step(action)
            done, steps, total = terminated or truncated, steps + 1, total + float(reward)
            assert over_time(rollout, "clearance")[k, steps] == np.float32(info["clearance"])
        assert rollout.steps[k] == steps and rollout.success[k] == info["is_success"]
        assert rollout.parts_done[k] == info["parts_done"]
        assert rollout.position_error[k] == info["position_error"]
        assert rollout.returns[k] == pytest.approx(total, rel=1e-12, abs=1e-12)


def test_some_succeed_and_some_do_not(several):
    """Else the tests of this file have shown little."""
    assert sum(several.rollout(*pair).success.sum() for pair in PAIRS) >= 3
    assert not several.rollout("Sort", "ideal", "lazy shepherd").success.any()


def test_absent_parts_leave_no_trace():
    found = rollout(Shepherd(), "Sort", seeds=range(12), keep=Log, randomize={"parts": [1, 3]})
    present = np.isfinite(found.poses[:, 0, :, 0])
    counts = present.sum(axis=1)
    assert set(counts.tolist()) == {1, 2, 3}
    assert (np.isfinite(found.poses[..., 0]).any(axis=1) == present).all()
    assert (found.path_lengths[~present] == 0.0).all() and (found.parts_done <= counts).all()
    assert (np.isnan(found.clearance) == (counts == 1)).all() and (found.collisions[counts == 1] == 0).all()
    assert (found.parts_done[found.success] == counts[found.success]).all()


def test_columns(several, written_several):
    with (written_several / "episodes.csv").open(newline="", encoding="utf-8") as file:
        episodes = list(csv.DictReader(file))
    own = ["parts_done", "throughput_parts_per_s", "collisions", "clearance_m"]
    assert [name for name in episodes[0] if name in own] == own
    assert len(episodes) == 5 + 2 * 6 + 2 * 5
    mine = [row for row in episodes if (row["task"], row["policy"]) == ("Sort", "shepherd")]
    rollout = several.rollout("Sort", "ideal", "shepherd")
    assert [int(row["collisions"]) for row in mine] == rollout.collisions.tolist()
    assert [float(row["throughput_parts_per_s"]) for row in mine] == rollout.throughput.tolist()
    assert [float(row["clearance_m"]) for row in mine] == rollout.clearance.tolist()
    assert all(row[key] == "" for row in episodes[:5] for key in own)
    assert {row[key] for row in episodes for key in ("good_per_minute", "pattern_error_m", "coverage")} == {""}
    with (written_several / "results.csv").open(newline="", encoding="utf-8") as file:
        rows = {(row["task"], row["policy"]): row for row in csv.DictReader(file)}
    row = rows["Sort", "shepherd"]
    assert float(row["throughput_median_parts_per_s"]) == np.median(rollout.throughput)
    assert float(row["collisions_mean"]) == rollout.collisions.mean()
    assert float(row["clearance_median_m"]) == np.median(rollout.clearance)
    assert rows["Transport", "pusher"]["collisions_mean"] == "" == row["heading_error_median_rad"]


def test_pictures_show_zones_and_trails(several):
    film = several.rollout("Sort", "ideal", "shepherd").film
    frames, _ = films.frames_of(film, several.scenery["Sort"])
    assert (frames[0] != frames[-1]).any()
    assert re.match(r"0\.00 s   \d of 6 parts done ", film.captions[0]) and len(film.captions) == len(film.poses)
    # A zone tints its end of the table: the picture differs from Singulate's at the left and at the right, not between.
    pictures = []
    for task in ("Sort", "Singulate"):
        own, scenery = several.rollout(task, "ideal", "lazy shepherd").film, several.scenery[task]
        empty = dataclasses.replace(own, present=np.zeros_like(own.present))
        pictures.append(films.picture(empty, scenery, 0, films.painter_for(scenery, 520)))
    columns = (pictures[0][:140] != pictures[1][:140]).any(axis=(0, 2))
    assert columns[40:80].all() and columns[-80:-40].all() and not columns[200:-200].any()
