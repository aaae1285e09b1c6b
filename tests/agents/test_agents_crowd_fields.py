"""Policies for several parts: what they see, what they refuse, and who rules an element under several parts."""

import math

import numpy as np
import pytest

from agents.control.crowd_seen import see_crowd, wrap
from agents.control.sharing import DAMPING, RULES, Sharing, area_samples, cover
from agents.policy import Situation, make_policy
from tests.agents.helpers import situation
from tests.envs.helpers import batch, single
from vibgym import Part, Surface, allocation
from vibgym.config import part_from

SURFACE = Surface()
STEEL, ALUMINIUM = part_from("steel_block"), part_from("aluminium_block")
DISC = Part.disc(0.02, friction=0.6)
MANY = ("zero", "random", "local_fields", "planner")
CROWDS = ("Sort", "SortThreeKinds", "Singulate")


def facing(name="Sort", **settings):
    """What a policy may know of an environment."""
    return Situation.of(single(name, action="field", **settings).unwrapped.core.task, name)


def of_parts(*parts):
    return Situation("Sort", SURFACE, parts[0], parts, tuple(range(len(parts))), None, len(parts))


# -- what is known and seen --------------------------------------------------------------------------------------------


def test_situation_is_what_the_task_makes_public():
    known = facing("SortThreeKinds", slots=8)
    assert known.task == "SortThreeKinds" and known.many and len(known.parts) == 6 and known.part is known.parts[0]
    assert known.kind == (0, 1, 2, 0, 1, 2)
    assert known.zones is not None and known.zones.shape == (3, 4)
    assert known.slots == 8 and known.state_size == 160
    assert facing("Singulate").zones is None and facing("Singulate").state_size == 120
    alone = Situation.of(single("Align").unwrapped.core.task)
    assert (alone.task, alone.many, alone.state_size) == ("Align", False, 18) and alone.parts == (alone.part,)
    one = situation()
    assert one.parts == (one.part,)


@pytest.mark.parametrize("name", CROWDS)
def test_what_policies_read_from_the_state_is_the_state(name):
    env = batch(name, 4, action="patch", slots=7, randomize={"parts": [3, 6]})
    env.reset(seed=5)
    env.action_space.seed(5)
    core = env.unwrapped.core
    known = Situation.of(core.task)
    for _ in range(4):
        rows, *_ = env.step(env.action_space.sample())
        seen = see_crowd(rows, known)
        there = core.score.present
        pose, velocity = core.simulator.pose, core.simulator.mean_velocity
        assert (seen.present == there).all() and not there.all()
        assert seen.centre[there] == pytest.approx(pose[there][:, :2], abs=1e-6)
        assert seen.velocity[there] == pytest.approx(velocity[there][:, :2], abs=1e-6)
        assert seen.spin[there] == pytest.approx(np.clip(velocity[there][:, 2], -10, 10), abs=1e-5)
        symmetry = core.observation.symmetry
        turned = wrap(seen.heading - pose[..., 2], symmetry)[there & (symmetry > 0)]
        assert turned == pytest.approx(0.0, abs=1e-6)
        near = there & (core.score.gap < 0.1)
        assert seen.gap[near] == pytest.approx(core.score.gap[near], abs=1e-4)
        assert not seen.single and see_crowd(rows[0], known).single


def test_wrap():
    assert wrap(np.array([3.0, 3.0, -7.0]), np.array([2, 1, 1])) == pytest.approx([3 - math.pi, 3.0, 2 * math.pi - 7])


# -- errors ------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name, task, named", [
    ("open_loop", "Sort", "policy 'open_loop'.*Sort.*one part.*Transport, Align, Rotate"),
    ("local_field", "Singulate", "policy 'local_field'.*Singulate.*one part"),
    ("local_fields", "Align", "policy 'local_fields'.*Align.*several parts.*Sort, Singulate"),
    ("planner", "Rotate", "policy 'planner'.*Rotate.*several parts.*Sort, Singulate"),
])  # fmt: skip
def test_policies_say_which_tasks_they_do_not_serve(name, task, named):
    known = Situation.of(single(task, action="field").unwrapped.core.task)
    with pytest.raises(ValueError, match=named) as error:
        make_policy(name, known)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("policy, named", [
    ({"kind": "local_fields", "rule": "loudest"}, "rule.*loudest.*'nearest', 'average', 'solve'"),
    ({"kind": "local_fields", "response": 0}, "response"), ({"kind": "planner", "braking": 2}, "braking"),
    ({"kind": "local_fields", "margin": -1}, "margin"), ({"kind": "planner", "safe": 0}, "safe"),
    ({"kind": "planner", "soft": -1}, "soft"), ({"kind": "planner", "hard": math.nan}, "hard"),
    ({"kind": "planner", "yielding": 1.5}, "yielding"), ({"kind": "planner", "calm": 0}, "calm"),
    ({"kind": "planner", "faithful": -1}, "faithful"), ({"kind": "planner", "edge": 0}, "edge"),
    ({"kind": "planner", "inset": -0.1}, "inset"),
    ({"kind": "planner", "colour": 1}, "policy 'planner'.*colour"),
])  # fmt: skip
def test_bad_arguments_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, facing())
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("name", MANY)
@pytest.mark.parametrize("seen", [np.zeros(18), np.zeros((3, 119)), 0.0, np.zeros((0,))])
def test_wrong_observations_are_refused(name, seen):
    with pytest.raises(ValueError, match="^observation: .*120"):
        make_policy(name, facing()).predict(seen)


# -- the protocol ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MANY)
@pytest.mark.parametrize("task", CROWDS)
def test_actions_fit_the_environment(task, name):
    env = batch(task, 3, action=make_policy(name, facing(task)).action, slots=7, randomize={"parts": [2, 6]})
    policy = make_policy(name, Situation.of(env.unwrapped.core.task))
    seen, _ = env.reset(seed=0)
    state, start = None, np.ones(3, dtype=bool)
    for _ in range(4):
        action, state = policy.predict(seen, state, start)
        assert action.dtype == np.float32 and env.action_space.contains(action)
        seen, *_ = env.step(action)
        start = np.zeros_like(start)


@pytest.mark.parametrize("name", ["zero", "local_fields", "planner"])
@pytest.mark.parametrize("task", CROWDS)
def test_a_batch_is_its_rows(task, name):
    policy = make_policy(name, facing(task))
    env = batch(task, 4, action=policy.action)
    rows, _ = env.reset(seed=1)
    together, alone = None, [None] * 4
    for step in range(6):
        start = np.array([step == 0, step == 0, step in (0, 3), step == 0])  # one world begins anew
        actions, together = policy.predict(rows, together, start)
        for world, row in enumerate(rows):
            action, alone[world] = policy.predict(row, alone[world], start[world : world + 1])
            assert action.shape == actions.shape[1:]
            assert action == pytest.approx(actions[world], abs=1e-6)
        rows, *_ = env.step(actions)


# -- who rules an element under several parts --------------------------------------------------------------------------


def shares(parts, pose):
    sharing = Sharing(of_parts(*parts), "solve")
    share = np.empty((len(pose), len(parts), SURFACE.rows, SURFACE.columns))
    lever = np.empty((*share.shape, 2))
    cover(sharing.samples, sharing.first, pose, np.ones(pose.shape[:2], bool), SURFACE.element_size, share, lever)
    return share, lever


def test_samples_have_the_moments_of_the_part():
    for part in (STEEL, ALUMINIUM, DISC, Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0, 0.05]], friction=0.5)):
        points = area_samples(part)
        assert len(points) > 30
        assert points.mean(axis=0) == pytest.approx(0.0, abs=1e-3)
        assert (points**2).sum(axis=1).mean() == pytest.approx(part.gyration, rel=0.08)


def test_shares_are_those_of_the_area():
    """A block straight on the grid: shares are products of lengths."""
    share, lever = shares([STEEL], np.array([[[0.104, 0.104, 0.0]]]))  # centre on a corner of four elements
    assert share[0, 0].sum() == pytest.approx(1.0) and (share[0, 0] > 0).sum() == 4
    assert share[0, 0, 3:5, 3:5] == pytest.approx(0.25)
    assert lever[0, 0, 3, 3] == pytest.approx(0.25 * np.array([-0.0125, -0.010]))
    beside, _ = shares([STEEL], np.array([[[0.0, 0.1, 0.0]]]))
    assert beside.sum() == pytest.approx(0.5)  # half of it is beside the surface


def accelerations(parts, pose, push):
    """Of parts at rest under pushes, by the averaged model of the first order, over what full amplitude gives."""
    result = []
    for k, part in enumerate(parts):
        amplitude = SURFACE.max_amplitude * np.hypot(push[..., 0], push[..., 1])
        phase = np.arctan2(-push[..., 0], -push[..., 1])
        found = allocation.mean_acceleration(SURFACE, part, pose[:, k], np.zeros(3), amplitude, phase, order=1)
        scale = 0.5 * part.friction * SURFACE.full_scale
        result.append(found / scale * np.array([1, 1, math.sqrt(part.gyration)]))
    return np.stack(result, axis=1)


WANTED = np.array([[[0.3, 0.1, 0.1], [-0.2, 0.2, -0.1]]])


@pytest.mark.parametrize("rule", RULES)
def test_parts_apart_get_what_they_want(rule):
    pose = np.array([[[0.3, 0.11, 0.4], [0.5, 0.08, -0.3]]])
    there = np.ones((1, 2), dtype=bool)
    push = Sharing(of_parts(STEEL, ALUMINIUM), rule).pushes(pose, there, WANTED)
    assert accelerations([STEEL, ALUMINIUM], pose, push) == pytest.approx(WANTED, abs=0.03)


def test_only_fields_found_together_serve_parts_that_share_elements():
    """Side by side, 2 mm apart, wishes apart: the other rules give part of it to the neighbour."""
    parts, there = [STEEL, STEEL], np.ones((1, 2), dtype=bool)
    pose = np.array([[[0.3, 0.117, 0.0], [0.352, 0.117, 0.0]]])  # the border is in the middle of an element
    error = {}
    for rule in RULES:
        push = Sharing(of_parts(*parts), rule).pushes(pose, there, WANTED)
        assert np.hypot(push[..., 0], push[..., 1]).max() <= 1 + 1e-12
        error[rule] = np.abs(accelerations(parts, pose, push) - WANTED).max()
    assert error["solve"] < 0.05 < min(error["average"], error["nearest"]), error


def test_a_part_alone_gets_the_same_push_from_all_its_elements():
    pose, there = np.array([[[0.3, 0.11, 0.4]]]), np.ones((1, 1), dtype=bool)
    wanted = np.array([[[0.6, -0.3, 0.0]]])
    for rule in RULES:
        push = Sharing(of_parts(STEEL), rule).pushes(pose, there, wanted)[0]
        under = np.hypot(push[..., 0], push[..., 1]) > 0
        assert 4 <= under.sum() <= 12
        assert push[under] == pytest.approx(np.tile(wanted[0, 0, :2] / (1 + DAMPING), (under.sum(), 1)), abs=1e-9)


def test_nearest_and_average_rule_differ_only_where_parts_share():
    parts, there = [STEEL, STEEL], np.ones((1, 2), dtype=bool)
    pose = np.array([[[0.3, 0.117, 0.0], [0.355, 0.117, 0.0]]])
    share, _ = shares(parts, pose)
    shared = (share[0] > 0).all(axis=0)
    nearest, average = (Sharing(of_parts(*parts), rule).pushes(pose, there, WANTED)[0] for rule in RULES[:2])
    different = np.abs(nearest - average).max(axis=-1) > 1e-9
    assert shared.sum() >= 2 and (different == shared).all()


def test_absent_parts_claim_nothing():
    pose = np.array([[[0.3, 0.11, 0.4], [0.31, 0.11, 0.0]]])
    one = Sharing(of_parts(STEEL), "solve").actions(pose[:, :1], np.array([[True]]), WANTED[:, :1])
    two = Sharing(of_parts(STEEL, STEEL), "solve").actions(pose, np.array([[True, False]]), WANTED)
    assert two == pytest.approx(one, abs=1e-6)
    none = Sharing(of_parts(STEEL, STEEL), "solve").actions(pose, np.zeros((1, 2), dtype=bool), WANTED)
    assert (none == 0).all()
