"""Episodes against single environments, and metrics against counts of their own from the recorded poses."""

import math

import gymnasium as gym
import numpy as np
import pytest
import shapely
from shapely import affinity

from agents.evaluation.films import Log
from agents.evaluation.rows import study_rows
from agents.evaluation.table import METRICS, where
from tests.agents.evaluation.conftest import CASES, SENSOR, Pusher
from vibgym.policies.rollout import rollout

SEVERAL = [(task, "ideal", policy) for policy in ("local_field", "zero") for task in ("Sort", "Singulate")]


def alone(policy, task, seed):
    """The same episode in an environment of its own."""
    env = gym.make(f"vibgym/{task}-v0", action=policy.action, observation=policy.observation)
    observation, info = env.reset(seed=seed)
    state, done, steps, total, length = None, False, 0, 0.0, 0.0
    poses, infos = [env.unwrapped.truth.pose[0]], [info]
    while not done:
        action, state = policy.predict(observation[None], state, np.array([steps == 0]))
        observation, reward, terminated, truncated, info = env.step(action[0])
        done, steps, total = terminated or truncated, steps + 1, total + float(reward)
        poses.append(env.unwrapped.truth.pose[0])
        infos.append(info)
        length += np.hypot(*(poses[-1] - poses[-2])[:, :2].T).sum()
    return {**info, "steps": steps, "return": total, "path_length": length, "poses": np.array(poses), "infos": infos}


@pytest.mark.parametrize("task, name", [
    ("Transport", "pusher"), ("Transport", "counting"), ("Align", "pusher"), ("Align", "counting"), ("Sort", "local_field"),
])  # fmt: skip
def test_same_numbers_as_single_environments(basic, several, played, played_several, task, name):
    results, runs = (several, played_several) if task == "Sort" else (basic, played)
    run, episodes = runs[task, "ideal", name], where(results.main, task=task, policy=name)
    policy = next(case.policy for case in results.cases if case.place[1:] == (task, "ideal", name))
    for k, row in zip(range(4), episodes.to_dict("records"), strict=False):
        one = alone(policy, task, row["seed"])
        last = one["steps"]
        assert (row["steps"], row["success"], row["fallen"]) == (last, one["is_success"], one["fallen"])
        assert (row["return"], row["path_length_m"]) == pytest.approx((one["return"], one["path_length"]), rel=1e-9)
        assert row["position_error_m"] == one["position_error"]
        np.testing.assert_array_equal(run.poses[k, : last + 1], one["poses"].astype(np.float32))
        assert np.isnan(run.poses[k, last + 1 :]).all()
        heading = one["heading_error"] if task == "Align" else math.nan
        np.testing.assert_array_equal(row["heading_error_rad"], heading)
        if task == "Sort":
            assert row["parts_done"] == one["parts_done"]
            clearances = [info["clearance"] for info in one["infos"]]
            np.testing.assert_array_equal(run.over_time("clearance")[k, : last + 1], np.float32(clearances))
        else:
            of_several = ("parts_done", "throughput_parts_per_s", "collisions", "clearance_m")
            assert np.isnan([row[key] for key in of_several]).all()


def test_the_table_holds_what_was_recorded(basic, several, played, played_several):
    for results, runs in ((basic, played), (several, played_several)):
        for place, run in runs.items():
            episodes = where(results.main, **dict(zip(("task", "hardware", "policy"), place, strict=True)))
            assert episodes["seed"].tolist() == list(run.seeds)
            for column, attribute in METRICS.items():
                expected = getattr(run, attribute, None)
                if expected is not None:
                    np.testing.assert_array_equal(episodes[column], np.asarray(expected, dtype=float), err_msg=column)
            # Times count successes, as multiples of the bound too.
            times = np.where(run.success, 0.04 * run.steps, np.nan)
            np.testing.assert_allclose(episodes["time_to_goal_s"], times)
            np.testing.assert_allclose(episodes["time_over_bound"], times / run.bound)
            assert not (episodes["time_over_bound"] <= 1.0).any()
            assert (episodes["timed_steps"] == run.timing.world_steps).all() and (episodes["policy_s"] > 0.0).all()
    still = where(basic.main, task="Transport", policy="still <&>")
    assert not still["success"].any() and (still["steps"] == 250).all() and (still["timed_steps"] == 8 * 249).all()
    assert where(basic.main, task="Transport", policy="pusher")["success"].sum() >= 4  # else this shows little


def test_all_policies_and_hardware_share_starts_and_goals(basic, several, played, played_several):
    for results, runs in ((basic, played), (several, played_several)):
        for task in results.settings.tasks:
            first, *others = (run for place, run in runs.items() if place[0] == task)
            for other in others:
                count = len(other.seeds)
                np.testing.assert_array_equal(first.goals[:count], other.goals)
                np.testing.assert_array_equal(first.poses[:count, 0], other.poses[:, 0])
                assert first.film.seed == other.film.seed or count < len(first.seeds)
    still, broken = (played_several["Transport", *key] for key in (("ideal", "still"), ("broken", "pusher")))
    np.testing.assert_array_equal(still.poses[:4], broken.poses)


def test_effects_are_those_of_rollouts(several):
    cells = study_rows(several, "effects", several.settings.effects)
    cells = {(cell["case"], cell["policy"]): cell for cell in cells}
    assert list(cells) == [(case, policy) for case in CASES for policy in ("pusher", "late <eyes>")]
    for case, arguments in CASES.items():
        for policy, own in (("pusher", {}), ("late <eyes>", {"sensor": SENSOR})):
            run, cell = rollout(Pusher(), "Transport", seeds=range(300, 304), **arguments, **own), cells[case, policy]
            assert (cell["episodes"], cell["successes"]) == (4, run.success.sum())
            assert cell["position_error_median_m"] == np.median(run.position_error)
    assert cells["none", "pusher"]["successes"] > cells["all dead", "pusher"]["successes"] == 0


def test_film_is_the_watched_episode(basic, played):
    for place, run in played.items():
        film, world = run.film, run.seeds.index(run.film.seed)
        np.testing.assert_array_equal(film.poses.astype(np.float32), run.poses[world, : run.steps[world] + 1])
        assert film.phasors.shape == (len(film.poses), 8, 32, 2) and not film.phasors[0].any()
        labels = dict(zip(("task", "hardware", "policy"), place, strict=True))
        assert where(basic.main, **labels)["filmed"].tolist() == [seed == film.seed for seed in run.seeds]
        if place[0] == "Transport":  # the farthest goal of the first worlds
            displacement = np.hypot(*(run.goals - run.poses[:, 0])[:, 0, :2].T)
            assert world == displacement.argmax()
    assert played["Align", "ideal", "pusher"].film.phasors[1].any()


def distances(results, task, poses):
    """Distances (steps, pairs) between the outlines, m; 0 where they overlap, inf of absent parts."""
    outlines = [shapely.Polygon(part.outline) for part in results.tasks[task].parts]
    one, other = np.triu_indices(len(outlines), 1)
    result = np.full((len(poses), len(one)), math.inf)
    for step, pose in enumerate(poses.astype(np.float64)):
        placed = [
            affinity.translate(affinity.rotate(outline, row[2], origin=(0, 0), use_radians=True), row[0], row[1])
            for outline, row in zip(outlines, pose, strict=True)
        ]
        result[step] = [placed[i].distance(placed[j]) for i, j in zip(one, other, strict=True)]
    return result


def poses_of(run, episode):
    return run.poses[episode, : run.steps[episode] + 1]


@pytest.mark.parametrize("place", SEVERAL)
def test_collisions_and_clearance_from_the_poses(several, played_several, place):
    run = played_several[place]
    clearance = run.over_time("clearance")
    for episode in range(3):
        poses = poses_of(run, episode)
        if run.fallen[episode]:  # a part that has fallen is out of the way
            poses = poses[:-1]
        between = distances(several, place[0], poses)
        touching = between < 1e-4
        assert run.collisions[episode] == (touching[1:] & ~touching[:-1]).sum()
        np.testing.assert_allclose(np.maximum(clearance[episode, : len(poses)], 0.0), between.min(axis=1), atol=1e-6)
    np.testing.assert_array_equal(run.clearance, np.nanmin(clearance, axis=1).astype(np.float64))


@pytest.mark.parametrize("place", SEVERAL)
def test_throughput_and_paths_from_the_poses(several, played_several, place):
    run, task = played_several[place], several.tasks[place[0]]
    for episode, steps in enumerate(run.steps):
        poses = poses_of(run, episode).astype(np.float64)
        lengths = np.hypot(*np.moveaxis(np.diff(poses[..., :2], axis=0), -1, 0)).sum(axis=0)
        np.testing.assert_allclose(run.path_lengths[episode], lengths, atol=1e-4)
        if place[0] == "Sort":
            zones = [shapely.box(*task.zones[kind]) for kind in task.kind]
            starts, ends = ([shapely.Point(pose[:2]) for pose in poses[k]] for k in (0, -1))
            straight = sum(zone.distance(start) for zone, start in zip(zones, starts, strict=True))
            speed = np.hypot(*(poses[-1] - poses[-2])[:, :2].T) / run.step_time
            done = sum(zones[part].contains(ends[part]) and speed[part] < 0.020 for part in range(6))
        else:
            straight = np.hypot(*(poses[-1] - poses[0])[:, :2].T).sum()
            one, other = np.triu_indices(6, 1)
            between = distances(several, "Singulate", poses[-1:])[0]
            done = sum(between[(one == part) | (other == part)].min() > math.sqrt(2.0) * 0.026 for part in range(6))
        assert run.straight[episode] == pytest.approx(straight, abs=1e-6)
        efficiency = straight / lengths.sum() if run.success[episode] else np.nan
        assert run.path_efficiency[episode] == pytest.approx(efficiency, rel=1e-3, nan_ok=True)
        assert not efficiency > 1.0 + 1e-3
        if not run.fallen[episode]:
            assert run.parts_done[episode] == done
            assert run.throughput[episode] == pytest.approx(done / (0.04 * steps))
            assert not run.success[episode] or done == 6


def test_there_were_collisions_and_successes(played_several):
    """Else the tests above have shown little."""
    sort, lazy, heap = (played_several[place] for place in (SEVERAL[0], SEVERAL[2], SEVERAL[3]))
    assert sort.collisions.sum() > 0
    assert sum(played_several[place].success.sum() for place in SEVERAL) >= 3
    assert lazy.collisions.sum() == 0 and not lazy.success.any()
    assert (heap.clearance < 1e-5).all()  # in touch from the start


def test_absent_parts_leave_no_trace(several):
    policy = next(case.policy for case in several.cases if case.place[1:] == SEVERAL[0])
    result = rollout(policy, "Sort", seeds=range(12), keep=Log, randomize={"parts": [1, 3]})
    present = np.isfinite(result.poses[:, 0, :, 0])
    counts = present.sum(axis=1)
    assert set(counts.tolist()) == {1, 2, 3}
    assert (np.isfinite(result.poses[..., 0]).any(axis=1) == present).all()
    assert (result.path_lengths[~present] == 0.0).all() and (result.parts_done <= counts).all()
    assert (np.isnan(result.clearance) == (counts == 1)).all() and (result.collisions[counts == 1] == 0).all()
    assert (result.parts_done[result.success] == counts[result.success]).all()
