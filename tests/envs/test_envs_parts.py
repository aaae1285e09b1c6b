"""The observation by parts against the simulator's state, by a second computation, and against the state observation."""

import math

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch, single
from vibgym.envs.features import NEIGHBOUR, NEIGHBOURS, OWN, RowLayout
from vibgym.physics.contacts.hulls import all_gaps

DISC = {"shape": "disc", "radius": 0.020, "friction": 0.6, "name": "disc"}
L_SHAPE = {
    "shape": "polygon", "vertices_mm": [[0, 0], [60, 0], [60, 20], [20, 20], [20, 60], [0, 60]], "friction": 0.5,
    "name": "angle",
}  # fmt: skip
MIXED = ["steel_block", DISC, L_SHAPE, "steel_block", DISC, L_SHAPE, "steel_block"]
NOISY = {"kind": "pose", "report": ["age", "sigma"]}
CASES = [
    ("Transport", {}), ("Rotate", {"sensor": NOISY}), ("Sort", {"parts": MIXED, "slots": 9, "randomize": {"parts": [1, 7]}}),
    ("Singulate", {"sensor": NOISY, "walls": ["left"]}), ("Follow", {"parts": [DISC, "steel_block"]}),
]  # fmt: skip


def clip(values):
    return np.clip(values, -1.0, 1.0)


def own_quantities(core, measured, relations, world, part):
    """Return the documented features of a part's row, from the measurement."""
    surface, one, task, episode = core.surface, core.parts[part], core.task, core.episode
    (x, y, heading), moved = measured.pose[world, part], measured.mean_velocity[world, part]
    displacement, heading_error = relations.error[world, part, :2], relations.error[world, part, 2]
    size, low, speed = np.array([surface.width, surface.depth]), 0.0, surface.table_speed
    edges = np.array([x - low, size[0] - x, y - low, size[1] - y])
    zone = np.zeros(4) if task.zones is None else task.zones[task.kind[part]][[0, 2, 1, 3]]
    motion = episode.motion[world, part].reshape(-1, 3)
    expected = {
        "kind": np.eye(3)[task.kind[part]],
        "friction": one.friction,
        "radius": one.radius / 0.1,
        "gyration": math.sqrt(one.gyration) / 0.1,
        "extent": math.sqrt(one.area) / 0.2,
        "position": clip(2.0 * np.array([x, y]) / size - 1.0),
        "element": 2.0 * (np.array([x, y]) / surface.element_size % 1.0) - 1.0,
        "heading": [math.cos(one.symmetry * heading), math.sin(one.symmetry * heading)],
        "way_far": np.tanh(displacement / 0.25),
        "way_coarse": np.tanh(displacement / 0.05),
        "way_fine": np.tanh(displacement / 0.005),
        "way_finest": np.tanh(displacement / 0.0005),
        "turn": clip(heading_error / (2 * math.pi)),
        "turn_coarse": math.tanh(heading_error / 0.5),
        "turn_fine": math.tanh(heading_error / 0.05),
        "turn_finest": math.tanh(heading_error / 0.005),
        "velocity": clip(moved[:2] / speed),
        "spin": clip(moved[2] / 25.0),
        "borders": np.tanh(edges / 0.05),
        "zone": np.tanh((np.array([x, x, y, y]) - zone) * [1, -1, 1, -1] / 0.05),
        "age": math.tanh(measured.age[world, part] / 10.0),
        "sigma": np.tanh(
            [math.hypot(*measured.sigma[world, part, :2]) / 1e-3, measured.sigma[world, part, 2] / math.radians(1.0)]
        ),
    }
    if len(motion):
        expected["goal_velocity"], expected["goal_spin"] = clip(motion[0, :2] / speed), clip(motion[0, 2] / 25.0)
        expected["way_ahead"] = clip((displacement + motion[1:, :2]) / 0.25).ravel()
        expected["turn_ahead"] = clip((heading_error + motion[1:, 2]) / (2 * math.pi))
    return expected


def neighbour_quantities(core, measured, relations, gaps, world, part, other):
    """Return the documented features of a neighbour in a row."""
    apart = measured.pose[world, other, :2] - measured.pose[world, part, :2]
    faster = measured.mean_velocity[world, other, :2] - measured.mean_velocity[world, part, :2]
    turned = core.parts[other].symmetry * measured.pose[world, other, 2]
    return {
        "there": 1.0,
        "apart": np.tanh(apart / 0.05),
        "apart_far": np.tanh(apart / 0.25),
        "gap": math.tanh(gaps[world, part, other] / (math.sqrt(2.0) * core.surface.element_size)),
        "velocity": clip(faster / (2.0 * core.surface.table_speed)),
        "heading": [math.cos(turned), math.sin(turned)],
        "same_kind": float(core.task.kind[part] == core.task.kind[other]),
        "way": np.tanh(relations.error[world, other, :2] / 0.05),
    }


@pytest.mark.parametrize("task, settings", CASES)
def test_rows_agree_with_the_table(task, settings):
    worlds = 6
    env = batch(task, worlds, observation="parts", action="field", **settings)
    seen, _ = env.reset(seed=3)
    env.action_space.seed(3)
    core, rows = env.unwrapped.core, {row.name: row for row in env.unwrapped.parts_layout}
    parts, several, compared = len(core.parts), core.task.MAX_PARTS != 1, 0
    for step in range(5):
        if step:
            seen, *_ = env.step(env.action_space.sample())
        assert env.observation_space.contains(seen) and seen["mask"].dtype == np.int8
        measured, relations, present = core.sensing.measurement, core.measured, core.episode.present
        assert (seen["mask"][:, :parts] == present).all() and not seen["mask"][:, parts:].any()
        assert not seen["parts"][seen["mask"] == 0].any()
        gaps = np.empty((worlds, parts, parts))
        all_gaps(core.simulator.hulls, measured.pose, gaps)
        for world, part in np.argwhere(present):
            expected = own_quantities(core, measured, relations, world, part)
            others = [k for k in range(parts) if k != part and present[world, k] and not measured.gone[world, k]]
            others = sorted(others, key=lambda k: gaps[world, part, k])[:NEIGHBOURS]
            for k in range(NEIGHBOURS if several else 0):
                near = dict.fromkeys((feature.name for feature in NEIGHBOUR), 0.0)
                if k < len(others) and not measured.gone[world, part]:
                    near = neighbour_quantities(core, measured, relations, gaps, world, part, others[k])
                    compared += 1
                expected |= {f"neighbour_{k + 1}_{name}": value for name, value in near.items()}
            for name, row in rows.items():
                got = seen["parts"][world, part, row.start : row.start + row.width]
                # Just at the edge of an element its numbers may jump from 1 to -1.
                assert got == pytest.approx(np.broadcast_to(expected[name], row.width), abs=3e-6), name
    assert compared >= 60 or not several


def test_columns_of_each_task():
    def names(task, **settings):
        rows = single(task, observation="parts", **settings).unwrapped.parts_layout
        return {row.name for row in rows}, sum(row.width for row in rows)

    own = {feature.name for feature in OWN}
    rows = [single("Sort", surface={"rows": 8 * k, "columns": 32 * k}).unwrapped.parts_layout for k in (1, 2)]
    assert {a.name for a, b in zip(*rows, strict=True) if a != b} == {
        "position"
    }  # other columns have no size of the surface
    moving = {"goal_velocity", "goal_spin", "way_ahead", "turn_ahead"}
    turning = {"turn", "turn_coarse", "turn_fine", "turn_finest"}
    measured_features, zoned = {"age", "sigma", "arrived", "contact_normal", "contact_impulse"}, {"kind", "zone"}
    assert names("Transport") == (own - moving - turning - measured_features - zoned, 25)
    assert names("Rotate") == (own - moving - measured_features - zoned, 29)
    assert names("Rotate", sensor=NOISY) == (own - moving - zoned - (measured_features - {"age", "sigma"}), 32)
    sort, size = names("Sort")
    assert sort & own == own - moving - turning - measured_features and size == 32 + 65
    assert names("Singulate")[0] == sort - {"zone"}
    assert names("Feed")[0] == sort | turning | {"arrived"}
    pushed = names("Push")[0] - names("Pack")[0]
    assert pushed == {f"neighbour_{k}_{name}" for k in range(1, 6) for name in ("way_far", "turn")}
    follow, size = names("Follow")
    assert follow & own == own - measured_features - zoned and size == 29 + 15 + 65


def test_quantities_come_back():
    env = batch("Sort", 20, observation="parts", action="field")
    env.reset(seed=1)
    seen, *_ = env.step(env.action_space.sample())
    layout, truth = RowLayout.of(env.unwrapped.task), env.unwrapped.truth
    assert layout.rows == env.unwrapped.parts_layout
    rows = seen["parts"]
    assert layout.quantity(rows, "position") == pytest.approx(truth.pose[..., :2], abs=1e-6)
    assert layout.quantity(rows, "velocity") == pytest.approx(truth.mean_velocity[..., :2], abs=1e-6)
    assert layout.quantity(rows, "way_far") == pytest.approx(truth.error[..., :2], abs=1e-4)
    near = truth.gap < 0.05
    assert near.any()
    assert layout.quantity(rows, "neighbour_1_gap")[near][:, 0] == pytest.approx(truth.gap[near], abs=1e-6)


@pytest.mark.parametrize("many", [False, True])
def test_observed_equals_an_environment_with_that_observation(many):
    """It has no effect on the following steps."""
    settings = {"action": "wrench", "actuators": "prototype", "sensor": {"kind": "pose", "estimator": "model"}}
    make = (
        (lambda **kind: batch("Align", 3, **settings, **kind))
        if many
        else lambda **kind: single("Align", **settings, **kind)
    )
    env, others = make(observation="parts"), {}
    for kind in ("state", "parts", "parts_and_state", "image", "goal"):
        others[kind] = make(observation=kind)
    seen = {kind: other.reset(seed=5)[0] for kind, other in others.items()}
    env.reset(seed=5)
    env.action_space.seed(5)
    for _ in range(3):
        for kind, expected in seen.items():
            assert_same(env.unwrapped.observed(kind), expected)
        action = env.action_space.sample()
        env.step(action)
        seen = {kind: other.step(action)[0] for kind, other in others.items()}


def test_observations_that_cannot_be_observed():
    env = single("Sort", observation="parts").unwrapped
    with pytest.raises(gym.error.ResetNeeded):
        env.observed("state")
    env.reset(seed=0)
    for bad, named in (("flat", "kind"), ("goal", "observation"), (None, "kind"), (3, "kind"), (["state"], "kind")):
        with pytest.raises(ValueError, match=named):
            env.observed(bad)
    seeing = single("Align", sensor="camera").unwrapped
    seeing.reset(seed=0)
    with pytest.raises(ValueError, match="kind"):
        seeing.observed("camera")
