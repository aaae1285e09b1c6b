"""PushT in the contact kernels: geometry, quasi-static contact, gym-pusht's rules, and the policy."""

import gymnasium as gym
import numpy as np
import pymunk
import pytest
from gymnasium.utils.env_checker import check_env
from shapely import Polygon, union_all
from shapely.affinity import rotate, translate

from studies.benchmarks.peers import PYTHON
from studies.pusht.__main__ import gym_pusht, pushes, steps
from studies.pusht.policy import Planner, resampled
from studies.pusht.scene import CENTRE, CONTACTS, GOAL, GYRATION, PushT, PushTEnv, centre_of, origin_of, start_of
from studies.pusht.ways import CLEARANCE, distance, ways

BOXES = ([(-60, 0), (60, 0), (60, 30), (-60, 30)], [(-15, 30), (15, 30), (15, 120), (-15, 120)])
"""The T of gym-pusht about its origin."""

MIDDLE = np.array([256.0, 256.0, 0.0])

both_laws = pytest.mark.parametrize("contacts", CONTACTS)


def outline(pose):
    """Return the T at a pose of its origin."""
    t = union_all([Polygon(box) for box in BOXES])
    return translate(rotate(t, pose[2], origin=(0, 0), use_radians=True), pose[0], pose[1])


def pushed(contacts, block, start, velocity, periods):
    """Return a world after pushes at a constant target velocity (px a period), with the pusher moving at it from the start."""
    world, velocity = PushT(1, contacts), np.asarray(velocity, dtype=float)
    world.set_state([*start, *(10.0 * velocity)], block)
    world.rollout((start + velocity * (2.0 + np.arange(periods)[:, None]))[None])
    return world


def test_mass_and_inertia_are_those_of_gym_pusht():
    body = pymunk.Body(1, 1)
    middles = [np.array(pymunk.Poly(body, box).center_of_gravity) for box in BOXES]
    assert np.mean(middles, axis=0) == pytest.approx(CENTRE)
    assert 2.0 * pymunk.moment_for_poly(1, BOXES[0]) == pytest.approx(GYRATION)


def test_coverage_is_the_area_shared_with_the_goal():
    random, world = np.random.default_rng(0), PushT()
    poses = GOAL + random.normal(size=(50, 3)) * (40.0, 40.0, 1.0)
    expected = [outline(pose).intersection(outline(GOAL)).area / 6300.0 for pose in poses]
    assert world.coverage(centre_of(poses)) == pytest.approx(expected, abs=1e-12)
    assert world.coverage(centre_of(GOAL)[None]) == pytest.approx(1.0)


def test_starts_are_those_of_gym_pusht():
    generator, _ = gym.utils.seeding.np_random(7)
    drawn = [generator.integers(50, 450), generator.integers(50, 450), generator.integers(100, 400)]
    drawn += [generator.integers(100, 400), generator.uniform(-np.pi, np.pi)]
    body = pymunk.Body(1, 1)
    body.center_of_gravity = tuple(CENTRE)
    body.position = [int(number) for number in drawn[2:4]]
    body.angle = drawn[4]  # which moves the position
    pusher, block = start_of(7)
    assert pusher.tolist() == drawn[:2]
    assert origin_of(block) == pytest.approx([*body.position, body.angle])
    assert centre_of(origin_of(block)) == pytest.approx(block)


@both_laws
def test_nothing_moves_without_contact_or_after_it(contacts):
    world = PushT(1, contacts)
    world.set_state([50.0, 50.0], MIDDLE)
    world.rollout(np.full((1, 10, 2), 120.0))
    assert world.block[0].tolist() == MIDDLE.tolist()
    world = pushed(contacts, MIDDLE, [256.0, 195.0], [0.0, 10.0], 5)
    world.rollout(np.full((1, 3, 2), 50.0))
    rest = world.block.copy()
    world.rollout(np.full((1, 10, 2), 50.0))
    assert rest[0, 1] > 266.0 and world.block.tolist() == rest.tolist()


@pytest.mark.parametrize("lever", [0.0, 40.0])
def test_a_small_push_moves_the_t_by_the_closed_form(lever):
    """A normal motion d at the lever b moves the centre of mass by d / (1 + b^2 / r^2) and turns by b / r^2 times that."""
    world = pushed("projected", MIDDLE, [256.0 + lever, 196.0], [0.0, 1.0], 2)
    way = world.pusher[0, 1] - 196.0
    moved = way / (1.0 + lever**2 / GYRATION)
    assert world.block[0] - MIDDLE == pytest.approx([0.0, moved, lever / GYRATION * moved], abs=0.03)
    assert moved > 1.0


def test_projected_contacts_do_not_overlap():
    count = 64
    pusher, block, along = pushes(count, 0.0)
    block[:, :2] = 256.0 + (block[:, :2] - 256.0) * 0.2  # away from the walls, where the T may be squeezed
    pusher[:, :2] += block[:, :2] - pushes(count, 0.0)[1][:, :2]
    world, moved = PushT(count), np.zeros(count)
    world.set_state(pusher, block)
    for period in range(1, 11):
        world.rollout((pusher[:, :2] + 8.0 * period * along)[:, None])
        assert world.gaps().min() > -0.1
        moved = np.maximum(moved, np.hypot(*(world.block - block)[:, :2].T))
    assert np.median(moved) > 20.0


@both_laws
def test_walls_hold_the_t(contacts):
    """The stem points at the left wall, 8 px away, and the push is beside the centre: the T turns about its tip."""
    world = pushed(contacts, [90.0, 256.0, 0.5 * np.pi], [151.0, 296.0], [-6.0, 0.0], 12)
    bounds = outline(origin_of(world.block[0])).bounds
    assert bounds[0] == pytest.approx(7.0, abs=0.1 if contacts == "projected" else 0.5)
    assert world.block[0, 2] > 0.5 * np.pi + 0.3 and world.gaps()[0] > -0.5


@both_laws
def test_batch_and_single_worlds_agree_bit_for_bit(contacts):
    actions = np.random.default_rng(3).uniform(0.0, 512.0, (12, 6, 2)).repeat(5, axis=1)
    batch = PushT(12, contacts)
    start = batch.reset(range(12))
    batch.rollout(actions)
    assert np.abs(batch.observation() - start)[:, 2:].max() > 10.0
    single = PushT(1, contacts)
    for k in reversed(range(12)):
        single.reset([k])
        for action in actions[k]:
            single.step(action[None])
        assert single.observation()[0].tolist() == batch.observation()[k].tolist()


def test_delayed_contacts_are_those_of_pymunk():
    """The installed pymunk, another version than gym-pusht's, with gym-pusht's scene and controller."""
    for block, start, velocity in (
        ([256.0, 256.0, 0.4], [290.0, 170.0], [-2.0, 12.0]),  # bar
        ([200.0, 240.0, 2.0], [110.0, 240.0], [10.0, 3.0]),  # stem
        ([256.0, 256.0, 0.0], [310.0, 330.0], [-8.0, -6.0]),  # into the corner of both
    ):
        space = pymunk.Space()
        space.damping = 0.0
        agent, body = pymunk.Body(body_type=pymunk.Body.KINEMATIC), pymunk.Body(1, GYRATION)
        space.add(agent, pymunk.Circle(agent, 15), body, *(pymunk.Poly(body, box) for box in BOXES))
        body.center_of_gravity = tuple(CENTRE)
        body.angle = block[2]
        body.position = tuple(origin_of(np.array(block))[:2])
        agent.position = tuple(start)
        world = PushT(1, "delayed")
        world.set_state(start, block)
        for period in range(20):
            target = np.array(start) + np.array(velocity) * (period + 1)
            for _ in range(10):
                force = 100.0 * (target - agent.position) - 20.0 * np.array(agent.velocity)
                agent.velocity = tuple(np.array(agent.velocity) + 0.01 * force)
                space.step(0.01)
            world.rollout(target[None, None])
        expected = [*body.local_to_world(body.center_of_gravity), body.angle]
        assert np.abs(np.array(expected) - block).max() > 20.0
        assert world.block[0] == pytest.approx(expected, abs=1e-6)


@pytest.mark.skipif(not PYTHON.exists(), reason="gym-pusht is missing: make peers")
def test_delayed_contacts_are_those_of_gym_pusht():
    world = PushT(1, "delayed")
    with gym_pusht() as peer:
        for seed in (0, 2):
            actions = np.random.default_rng(seed).uniform(100.0, 400.0, (20, 2))
            world.reset([seed])
            assert peer.ask("reset", seed) == pytest.approx([*world.pusher[0], *world.block[0]])
            trace, theirs = world.rollout(actions[None])[0], steps(peer, actions)
            assert trace == pytest.approx(theirs[:, [0, 1, 4, 5, 6]], abs=1e-3)
            assert world.coverage()[0] == pytest.approx(theirs[-1, 7], abs=1e-3)


def test_the_environment_follows_gymnasium_and_ends_as_gym_pusht_does():
    env = PushTEnv()
    check_env(env, skip_render_check=True)
    env.reset(seed=0)
    ends = [env.step(np.array([50.0, 50.0]))[2:4] for _ in range(300)]
    assert not any(ended or cut for ended, cut in ends[:-1]) and ends[-1] == (False, True)
    env.reset(seed=0)
    env.batch.set_state([50.0, 50.0], centre_of(GOAL + (1.0, 0.0, 0.0)))
    _, reward, terminated, truncated, info = env.step([50.0, 50.0])
    assert terminated and not truncated and info["is_success"] and reward == 1.0 and info["coverage"] < 1.0
    env.batch.set_state([50.0, 50.0], centre_of(GOAL + (30.0, 0.0, 0.0)))
    _, reward, terminated, _, info = env.step([50.0, 50.0])
    assert not terminated and reward == pytest.approx(info["coverage"] / 0.95)


@pytest.mark.parametrize("call, name", [
    (lambda world: world.step([[np.nan, 0.0]] * 2), "action"),
    (lambda world: world.step([[600.0, 0.0]] * 2), "action"),
    (lambda world: world.step([1.0, 2.0, 3.0]), "action"),
    (lambda world: world.reset([0]), "seeds"),
    (lambda world: world.rollout(np.zeros((2, 2))), "must be of shape"),
    (lambda world: world.set_state([[0.0, 0.0]] * 2, [[0.0, np.inf, 0.0]] * 2), "block"),
    (lambda _: PushT(1, "soft"), "contacts"),
])  # fmt: skip
def test_invalid_arguments_raise_before_anything_moves(call, name):
    world = PushT(2)
    before = world.reset([0, 1])
    with pytest.raises(ValueError, match=name):
        call(world)
    assert world.observation().tolist() == before.tolist()


def test_ways_lead_around_the_t():
    paths, shape = ways(), translate(outline((0.0, 0.0, 0.0)), *-CENTRE)
    assert distance(paths.point) == pytest.approx(15.0 + CLEARANCE, abs=0.1)
    assert [shape.distance(Polygon([p, p, p, p]).centroid) for p in paths.point[:3]] == pytest.approx(
        [27.0] * 3, abs=0.1
    )
    for start in range(0, len(paths.point), 7):
        for stop in range(0, len(paths.point), 5):
            way = [stop]
            while way[-1] != start:
                way.append(int(paths.before[start, way[-1]]))
            points = resampled(paths.point[way], 1.0) if len(way) > 1 else paths.point[way]
            assert distance(points).min() > 15.0 + CLEARANCE - 3.0


@both_laws
def test_the_policy_pushes_the_t_to_its_goal(contacts):
    """A fixed start, 50 px and 25 degrees from the goal: every plan must be carried out as simulated."""
    world, policy = PushT(1, contacts), Planner(contacts, fresh=96, perturbed=48)
    world.set_state([420.0, 420.0], centre_of(GOAL + (40.0, 30.0, 0.4)))
    before, coverage = float(world.coverage()[0]), 0.0
    for _ in range(150):
        coverage = float(world.step(policy.predict(world.observation()[0])[None]).coverage[0])
        if coverage > 0.95:
            break
    assert before < 0.6 and coverage > 0.95
