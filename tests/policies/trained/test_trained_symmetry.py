"""Quarter turns and reflections: transformed rows and actions against the environment's in a transformed scene.

World k of a batch is a scene after k quarter turns to the left; or worlds are a scene, its reflection, and both again.
"""

import numpy as np
import pytest

from tests.envs.helpers import batch
from tests.policies.helpers import ALUMINIUM, DISC, STEEL
from tests.policies.trained.helpers import actor_tensors, coding_for, observations
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.symmetry import ACTION, Turns, diagonal, reflected, turned_actions, turned_rows
from vibgym.policies.trained.trained import TrainedPolicy

SIDE = 12  # elements
SQUARE = {"rows": SIDE, "columns": SIDE}
PLATE = {"shape": "rectangle", "length": 0.06, "width": 0.03, "friction": 0.5}  # the same after half a turn
POSE, GOAL = [0.2, 0.1, 0.4], [0.05, 0.14, 2.1]
QUARTERS = np.arange(4)


def turned(pose, side):
    """Poses (..., 3), and the same after 1, 2 and 3 turns, (4, ..., 3)."""
    poses = [np.asarray(pose, dtype=float)]
    for _ in range(3):
        x, y, heading = np.moveaxis(poses[-1], -1, 0)
        poses.append(np.stack([side - y, x, heading + 0.5 * np.pi], axis=-1))
    return np.array(poses)


def mirrored(pose):
    """Poses (..., 3) and their reflection, which exchanges x and y, twice, (4, ..., 3)."""
    x, y, heading = np.moveaxis(np.asarray(pose, dtype=float), -1, 0)
    return np.array(2 * [pose, np.stack([y, x, 0.5 * np.pi - heading], axis=-1)])


def scenes(task, action="field", **settings):
    return batch(task, 4, action=action, surface=SQUARE, observation="parts", **settings)


def coding_of(env, **settings):
    return coding_for(TaskInfo.of(env), env.spec.kwargs["action"], **settings)


def turns_of(coding):
    return Turns(coding.columns, coding.parts, coding.action, coding.shape)


def assert_turned(env, rows, tolerance):
    columns = [[row.name, row.width] for row in env.parts_layout]
    matrix = turned_rows(columns, env.parts)
    for k in range(3):
        assert rows[k + 1] == pytest.approx(rows[k] @ matrix.T, abs=tolerance)
    assert np.linalg.matrix_power(matrix, 4) == pytest.approx(np.eye(len(matrix)))


@pytest.mark.parametrize("task, part", [
    ("Transport", "aluminium_block"), ("Align", "aluminium_block"), ("Align", PLATE),
    ("Align", {"shape": "disc", "radius": 0.020, "friction": 0.6}), ("Rotate", "steel_block"),
])  # fmt: skip
def test_rows_of_a_part(task, part):
    env = scenes(task, parts=[part])
    side = env.surface.width
    start = {"pose": turned([POSE], side), "goal": turned([POSE if task == "Rotate" else GOAL], side)}
    start["goal"][..., 2] += 0.3
    rows = env.reset(seed=0, options=start)[0]["parts"]
    assert_turned(env, rows, 2e-5)
    assert all(np.abs(rows[k + 1] - rows[k]).max() > 0.1 for k in range(3))


def test_rows_of_neighbours():
    """Parts that lie at no equal distances, so that their order is the same however the scene is turned."""
    env = scenes("Singulate", parts=["steel_block"] * 4)
    poses = [[0.08, 0.10, 0.3], [0.15, 0.11, 1.0], [0.10, 0.21, 0.1], [0.22, 0.24, 0.7]]
    rows = env.reset(seed=0, options={"pose": turned(poses, env.surface.width)})[0]["parts"]
    assert_turned(env, rows, 2e-5)
    there = [row.start for row in env.parts_layout if row.name.endswith("_there")]
    assert (rows[..., there].sum(axis=-1) == 3).all()


def test_rows_of_contacts():
    sensor = {"kind": "ideal", "report": ["contacts"]}
    env = scenes("Singulate", "velocity", parts=["steel_block"] * 2, sensor=sensor)
    side, names = env.surface.width, ("contact_normal", "contact_impulse")
    poses = [[0.12, 0.15, 0.3], [0.172, 0.166, 0.3]]
    at = [k for row in env.parts_layout if row.name in names for k in range(row.start, row.start + row.width)]
    acts = turned_actions("velocity", coding_of(env).shape)
    one = np.array([[0.7, 0.2, 0.0], [-0.5, -0.3, 0.0]])
    for start, transformed in (
        (turned(poses, side), lambda act, k: act @ np.linalg.matrix_power(acts, k).T),
        (mirrored(poses), lambda act, k: act[:, [1, 0, 2]] * [1.0, 1.0, -1.0] if k % 2 else act),
    ):
        env.reset(seed=0, options={"pose": start})
        for _ in range(3):
            every = np.array([transformed(one, k).reshape(-1) for k in range(4)], dtype=np.float32)
            rows = env.step(every)[0]["parts"]
        columns = [[row.name, row.width] for row in env.parts_layout]
        order, sign = reflected(columns, diagonal(2))
        expected = (
            rows[0][:, order] * sign
            if transformed(one, 1)[0, 0] == one[0, 1]
            else rows[0] @ turned_rows(columns, env.parts).T
        )
        assert (
            rows[1][:, at] == pytest.approx(expected[:, at], abs=0.1) and np.abs(rows[0][:, at]).min(axis=0).max() > 0.3
        )


def test_rows_of_parts_with_zones():
    """Zones are a scene's, not a world's: one environment for each turn."""
    rows, side = [], SIDE * 0.026
    poses = turned([[0.08, 0.10, 0.3], [0.20, 0.21, 1.0]], side)
    left = turned([[0.02, 0.03, 0.0], [0.11, 0.30, 0.0]], side)[..., :2]
    right = turned([[0.14, 0.03, 0.0], [0.23, 0.20, 0.0]], side)[..., :2]
    for k in range(4):
        zones = {"steel_block": left[k], "aluminium_block": right[k]}
        zones = {name: [*corners.min(axis=0), *corners.max(axis=0)] for name, corners in zones.items()}
        env = scenes("Sort", parts=["steel_block", "aluminium_block"], zones=zones)
        assert env.surface.width == env.surface.depth == pytest.approx(side)
        rows.append(env.reset(seed=0, options={"pose": poses[k]})[0]["parts"][0])
    assert_turned(env, np.array(rows), 2e-5)


SQUARED = {"shape": "rectangle", "length": 0.04, "width": 0.04, "friction": 0.5}
TRIANGLE = {
    "shape": "polygon",
    "vertices": [[0.03, 0.0], [-0.015, 0.0259807621], [-0.015, -0.0259807621]],
    "friction": 0.5,
}
WEDGE = {"shape": "polygon", "vertices": [[0.04, 0.0], [-0.02, 0.02], [-0.02, -0.02]], "friction": 0.5}


@pytest.mark.parametrize(
    "part, symmetry",
    [
        ("aluminium_block", 2),
        (SQUARED, 4),
        (TRIANGLE, 3),
        (WEDGE, 1),
        ({"shape": "disc", "radius": 0.02, "friction": 0.6}, 0),
    ],
)
def test_rows_of_a_reflected_part(part, symmetry):
    env = scenes("Align", "velocity", parts=[part])
    start = {"pose": mirrored([POSE]), "goal": mirrored([GOAL])}
    columns = [[row.name, row.width] for row in env.parts_layout]
    order, sign = reflected(columns, diagonal(symmetry))
    rows = env.reset(seed=0, options=start)[0]["parts"]
    assert env.parts[0].symmetry == symmetry
    assert rows[1] == pytest.approx(rows[0][:, order] * sign, abs=2e-5)
    assert (order[order] == np.arange(len(order))).all() and (sign * sign[order] == 1.0).all()
    move = np.array([0.5, 0.2, 0.3], dtype=np.float32)
    to, times = reflected([[ACTION, 3]], diagonal(symmetry))
    for _ in range(8):
        rows = env.step(np.array(2 * [move, move[to] * times]))[0]["parts"]
    velocity, spin = (next(row.start for row in env.parts_layout if row.name == name) for name in ("velocity", "spin"))
    moves, turns = rows[:2, 0, velocity : velocity + 2], rows[:2, 0, spin]
    # The table's own motion is not reflected.
    assert np.hypot(*(moves[1] - moves[0][::-1])) < 0.08 * np.hypot(*moves[0]) and np.hypot(*moves[0]) > 0.1
    assert turns[1] == pytest.approx(-turns[0], abs=0.04) and abs(turns[0]) > 0.02


def test_rows_of_reflected_neighbours():
    env = scenes("Singulate", parts=["steel_block"] * 4)
    poses = [[0.08, 0.10, 0.3], [0.15, 0.11, 1.0], [0.10, 0.21, 0.1], [0.22, 0.24, 0.7]]
    rows = env.reset(seed=0, options={"pose": mirrored(poses)})[0]["parts"]
    order, sign = reflected([[row.name, row.width] for row in env.parts_layout], diagonal(2))
    assert rows[1] == pytest.approx(rows[0][:, order] * sign, abs=2e-5)


def test_parts_of_different_symmetry_are_refused():
    with pytest.raises(ValueError, match="turns"):
        turned_rows([["way_far", 2]], [STEEL, DISC])
    assert turned_rows([["way_far", 2]], [STEEL, ALUMINIUM]).tolist() == [[0, -1], [1, 0]]


@pytest.mark.parametrize("action", ["field", "wrench", "velocity", "target", "patch", "phasor", "element"])
def test_turned_actions_do_the_same(action):
    """To a few percent of the speed that they give: the table's own motion turns by a quarter of its period, which parts
    do not begin with. Wrenches, which make up for friction, keep what differs then: a tenth of the speed."""
    env = scenes("Align", action)
    side, coding = env.surface.width, coding_of(env)
    turns = turns_of(coding)
    seen, _ = env.reset(seed=0, options={"pose": turned([POSE], side), "goal": turned([GOAL], side)})
    size = coding.shape.action
    generator = np.random.default_rng(2)
    if coding.shape.side:  # phasors that push up to the right, more on one side: they turn the part, too
        row, column = np.mgrid[: coding.shape.side, : coding.shape.side] / (coding.shape.side - 1)
        one = np.stack([0.2 + 0.5 * column, 0.3 - 0.2 * row], axis=-1) + generator.uniform(-0.1, 0.1, (*row.shape, 2))
    else:
        one = np.array([0.5, 0.2, 0.3, -0.2, 0.1, 0.3])[:size]
    acts = turns.turn_actions(QUARTERS[:, None], np.tile(one.reshape(-1).astype(np.float32), (4, 1, 1)))
    for _ in range(10):
        seen = env.step(coding.decode(coding.encode(seen), acts))[0]
    velocity, spin = (next(row for row in env.parts_layout if row.name == name) for name in ("velocity", "spin"))
    moves = seen["parts"][:, 0, velocity.start : velocity.start + 2].astype(float)
    speed = np.hypot(*moves[0])
    assert speed > 0.1
    matrix, share = np.array([[0.0, -1.0], [1.0, 0.0]]), 0.12 if action == "wrench" else 0.08
    for k in range(3):
        assert np.hypot(*(moves[k + 1] - matrix @ moves[k])) < share * speed
    assert np.ptp(seen["parts"][:, 0, spin.start]) < 0.04 and np.abs(seen["parts"][:, 0, spin.start]).min() > 0.02


@pytest.mark.parametrize("action", ["field", "wrench", "velocity", "target", "patch", "phasor"])
def test_four_turns_of_an_action_are_none(action):
    shape = coding_of(scenes("Align", action)).shape
    matrix = turned_actions(action, shape)
    assert (np.linalg.matrix_power(matrix, 4) == np.eye(shape.action)).all()
    assert not (matrix @ matrix == np.eye(shape.action)).all()


def test_ways_lead_ahead_after_so_many_turns():
    env = scenes("Align")
    coding = coding_of(env)
    turns = turns_of(coding)
    way = next(row.start for row in env.parts_layout if row.name == "way_far")
    rows = np.zeros((16, sum(size for _, size in coding.columns)), dtype=np.float32)
    angle = np.arange(16) * np.pi / 8
    rows[:, way : way + 2] = np.stack([np.cos(angle), np.sin(angle)], axis=-1).round(7)
    quarters = turns.ahead(rows)
    assert quarters.tolist() == [0] * 4 + [3] * 4 + [2] * 4 + [1] * 4
    ahead = turns.turn_rows(quarters, rows)[:, way : way + 2]
    assert (ahead[:, 0] > 0).all() and (ahead[:, 1] >= 0).all()
    assert turns.ahead(np.zeros((2, 3, rows.shape[1]), dtype=np.float32)).tolist() == [[0] * 3] * 2
    back = turns.turn_rows((-quarters) % 4, turns.turn_rows(quarters, rows))
    assert (back == rows).all()


@pytest.mark.parametrize("action", ["field", "wrench", "velocity", "target", "patch"])
def test_policies_by_construction_do_the_same_in_a_turned_scene(action):
    env = scenes("Align", action)
    coding = coding_of(env, turned=True)
    turns = turns_of(coding)
    policy = TrainedPolicy(actor_tensors(coding.shape), "parts", "tanh", coding)
    seen = observations(coding, 50)
    before = policy.predict(seen)[0].reshape(50, 1, -1)
    once = np.ones((50, 1), dtype=int)
    after = policy.predict({**seen, "parts": turns.turn_rows(once, seen["parts"])})[0].reshape(50, 1, -1)
    assert (after == turns.turn_actions(once, before)).all()
    plain = TrainedPolicy(policy.tensors, "parts", "tanh", coding_of(env))
    assert np.abs(plain.predict(seen)[0].reshape(50, 1, -1) - before).max() > 0.1
    learned = coding.to_rows(coding.encode(seen), before)  # and back: the network's output for its turned rows
    assert (coding.decode(coding.encode(seen), learned).reshape(50, 1, -1) == before).all()


@pytest.mark.parametrize("action", ["wrench", "velocity", "target"])
@pytest.mark.parametrize("memory", [{}, {"history": 2, "history_columns": ["velocity", "spin"]}])
def test_averaged_policies_do_the_same_in_a_reflected_scene(action, memory):
    env = scenes("Singulate", action, parts=["steel_block", "steel_block"])
    coding = coding_of(env, turned=True, **memory)
    policy = TrainedPolicy(actor_tensors(coding.shape), "parts", "tanh", coding, symmetric=True)
    columns = [[row.name, row.width] for row in env.parts_layout]
    order, sign = reflected(columns, diagonal(2))
    state, plain = None, TrainedPolicy(policy.tensors, "parts", "tanh", coding)
    rng = np.random.default_rng(4)
    for _ in range(4):
        rows = rng.uniform(-1.0, 1.0, (1, 2, len(order))).astype(np.float32)
        seen = {"parts": np.concatenate([rows, rows[..., order] * sign]), "mask": np.ones((2, 2))}
        actions, after = policy.predict(seen, state)
        one, other = actions.reshape(2, 2, 3)
        assert other == pytest.approx(one[:, [1, 0, 2]] * [1.0, 1.0, -1.0], abs=1e-5)
        assert np.abs(plain.predict(seen, state)[0] - actions).max() > 0.01
        state = after


def test_other_networks_have_no_symmetry():
    for action, settings in (("wrench", {}), ("field", {"turned": True}), ("phasor", {"turned": True})):
        assert coding_of(scenes("Align", action), **settings).symmetry is None
