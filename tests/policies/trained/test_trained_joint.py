"""One row for all parts: it does not depend on where they are or how they lie together, and actions turn with it."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import vibgym
from vibgym.policies.classical.pushing import PushingPolicy
from vibgym.policies.trained.joint import REACH, WAVES, JointCoding, root_of, share_of
from vibgym.policies.trained.residual import with_base
from vibgym.policies.trained.symmetry import VECTORS


@pytest.fixture(scope="module")
def scene():
    env = gym.make("vibgym/Push-v0", action="velocity", observation="parts").unwrapped
    return env, JointCoding(env.surface, env.parts, env.parts_layout, "velocity"), env.reset(seed=1)[0]


@pytest.fixture(scope="module")
def correction(scene):
    """Scene, conversion and random observation of a network that corrects the pushing rule."""
    env, _, seen = scene
    layout = with_base(env.parts_layout, PushingPolicy.PLAN)
    worlds = SimpleNamespace(surface=env.surface, parts=env.parts, parts_layout=layout)
    rows = np.random.default_rng(0).uniform(-0.7, 0.7, (3, sum(row.width for row in layout))).astype(np.float32)
    for row, plain in zip(layout, with_base(env.parts_layout), strict=False):
        if row == plain and row.name != "base":  # before the columns of the base
            columns = slice(row.start, row.start + row.width)
            rows[:, columns] = seen["parts"][:, columns]
    coding = JointCoding(env.surface, env.parts, layout, "velocity")
    return worlds, coding, {"parts": rows, "mask": seen["mask"]}


def moved(env, seen, angle, shift):
    """Return the observation after all parts and the goal were turned by an angle and shifted; borders are not changed."""
    rows = seen["parts"].astype(np.float64)
    cos, sin = np.cos(angle), np.sin(angle)
    turn = np.array([[cos, sin], [-sin, cos]])  # of rows of vectors
    half = 0.5 * np.array([env.surface.width, env.surface.depth])
    for row in env.parts_layout:
        columns = slice(row.start, row.start + 2)
        if row.name == "position":
            rows[:, columns] = (rows[:, columns] * half) @ turn / half + shift
        elif row.name in VECTORS or row.name == "heading":
            rows[:, columns] = rows[:, columns] @ turn
        elif row.name == "base":
            rows[:, columns] = root_of(share_of(rows[:, columns]) @ turn)
    return {"parts": rows.astype(np.float32), "mask": seen["mask"]}


@given(st.floats(-3.1, 3.1), st.floats(-0.3, 0.3), st.integers(0, 1000))
def test_rows_and_actions_move_with_the_scene(scene, angle, shift, seed):
    env, coding, seen = scene
    one, other = coding.encode(seen), coding.encode(moved(env, seen, angle, shift))
    kept = [
        k for k, name in enumerate(names_of(env, coding)) if name not in ("position", "element", "heading", "borders")
    ]
    np.testing.assert_allclose(other.rows[0, 0, kept], one.rows[0, 0, kept], atol=2e-5)
    outputs = np.random.default_rng(seed).uniform(-0.7, 0.7, (1, 1, coding.shape.action)).astype(np.float32)
    first, second = (coding.decode(inputs, outputs).reshape(3, 3) for inputs in (one, other))
    velocity = [episodes[:, :2] * np.abs(episodes[:, :2]) for episodes in (first, second)]
    cos, sin = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(velocity[1], velocity[0] @ np.array([[cos, sin], [-sin, cos]]), atol=1e-5)
    np.testing.assert_allclose(second[:, 2], first[:, 2], atol=1e-6)
    assert not second[2].any()  # the pushed part is not driven


@given(st.floats(-3.1, 3.1), st.integers(0, 1000))
def test_corrections_move_with_the_scene(correction, angle, seed):
    """They are velocities, and see the base's velocities and its plan in the frame of the part."""
    env, coding, seen = correction
    one, other = coding.encode(seen), coding.encode(moved(env, seen, angle, 0.1))
    kept = [
        k for k, name in enumerate(names_of(env, coding)) if name not in ("position", "element", "heading", "borders")
    ]
    np.testing.assert_allclose(other.rows[0, 0, kept], one.rows[0, 0, kept], atol=2e-5)
    outputs = np.random.default_rng(seed).uniform(-0.7, 0.7, (1, 1, coding.shape.action)).astype(np.float32)
    first, second = (coding.decode(inputs, outputs).reshape(3, 3) for inputs in (one, other))
    cos, sin = np.cos(angle), np.sin(angle)
    np.testing.assert_allclose(second[:, :2], first[:, :2] @ np.array([[cos, sin], [-sin, cos]]), atol=1e-5)
    assert np.hypot(*first[0, :2]) == pytest.approx(np.hypot(*outputs[0, 0, :2]), abs=1e-6)
    assert not first[:, 2].any() and not first[2].any() and coding.adds_velocities and coding.slots == 1


def names_of(env, coding):
    """Return the names of the columns of a joint row; the displacements of other parts are called "away"."""
    own = [name for name, width in coding.columns if not name.startswith("neighbour_") for _ in range(width)]
    others = ["away" if name == "position" else name for name in own]
    return own + 2 * (others + 4 * len(WAVES) * ["wave"])


@given(st.integers(0, 10_000))
def test_outputs_are_the_inverse_of_actions(scene, seed):
    _, coding, seen = scene
    inputs = coding.encode(seen)
    action = np.random.default_rng(seed).uniform(-0.7, 0.7, (1, 3, 3)).astype(np.float32)
    action[:, 2] = 0.0
    decoded = coding.decode(inputs, coding.to_rows(inputs, action)).reshape(action.shape)
    speeds = [act[..., :2] * np.abs(act[..., :2]) for act in (decoded, action)]  # the root amplifies rounding at 0
    np.testing.assert_allclose(*speeds, atol=1e-6)
    np.testing.assert_allclose(decoded[..., 2], action[..., 2], atol=1e-6)


def test_displacements_are_those_of_the_discs_from_the_part(scene):
    env, coding, seen = scene
    pose = env.truth.pose[0]
    heading = pose[2, 2]
    frame = np.array([[np.cos(heading), -np.sin(heading)], [np.sin(heading), np.cos(heading)]])
    names = np.array(names_of(env, coding))
    displacements = coding.encode(seen).rows[0, 0, names == "away"].reshape(2, 2)
    np.testing.assert_allclose(displacements * REACH, (pose[:2, :2] - pose[2, :2]) @ frame, atol=1e-6)


def transformed(equivalent, rows, outputs):
    return rows[..., equivalent.order] * equivalent.sign, outputs[..., equivalent.to] * equivalent.times


def mirrored(env, seen):
    """Return the observation of the scene that is reflected from left to right. The T is symmetric about its stem."""
    rows = seen["parts"].copy()
    for row in env.parts_layout:
        at = row.start
        if row.name in VECTORS:
            rows[:, at : at + row.width : 2] *= -1.0
        elif row.name == "heading":
            rows[:, at + 1] *= -1.0
        elif row.name == "borders":
            rows[:, [at, at + 1]] = rows[:, [at + 1, at]]
        elif row.name.startswith(("turn", "spin")) or row.name == "plan_turn":
            rows[:, at : at + row.width] *= -1.0
        elif row.name == "base":
            rows[:, [at, at + 2]] *= -1.0
        elif row.name == "plan_push":  # strength, turn, way round, arrival
            rows[:, at + 1 : at + 3] *= -1.0
    return {"parts": rows, "mask": seen["mask"]}


def test_equivalent_scenes_have_equivalent_actions(scene):
    """Exchanged discs and reflection: rows and outputs of the transformed scene are transformed rows and outputs."""
    env, coding, _ = scene
    env.reset(seed=1)
    for _ in range(40):  # with velocities
        seen = env.step(np.array([0.5, 0.3, 0.2, -0.6, 0.4, 0.1, 0.0, 0.0, 0.0], dtype=np.float32))[0]
    action = np.random.default_rng(0).uniform(-0.7, 0.7, (1, 3, 3)).astype(np.float32)
    swapped = {"parts": seen["parts"][[1, 0, 2]], "mask": seen["mask"]}
    reflection = np.array([-1.0, 1.0, -1.0], dtype=np.float32)
    cases = [
        (seen, action), (swapped, action[:, [1, 0, 2]]), (mirrored(env, seen), action * reflection),
        (mirrored(env, swapped), action[:, [1, 0, 2]] * reflection),
    ]  # fmt: skip
    own = coding.encode(seen)
    assert len(coding.equivalents) == 4
    for equivalent, (other, acted) in zip(coding.equivalents, cases, strict=True):
        inputs = coding.encode(other)
        rows, outputs = transformed(equivalent, own.rows, coding.to_rows(own, action))
        np.testing.assert_allclose(rows, inputs.rows, atol=1e-6)
        np.testing.assert_allclose(outputs, coding.to_rows(inputs, acted), atol=1e-6)


def test_corrections_of_equivalent_scenes_are_equivalent(correction):
    env, coding, seen = correction
    own, outputs = coding.encode(seen), np.random.default_rng(1).uniform(-0.7, 0.7, (1, 1, 4)).astype(np.float32)
    swapped = {"parts": seen["parts"][[1, 0, 2]], "mask": seen["mask"]}
    cases = seen, swapped, mirrored(env, seen), mirrored(env, swapped)
    signs = np.array([1.0, 1.0, -1.0, -1.0])
    done = coding.decode(own, outputs).reshape(3, 3)
    for k, (equivalent, other, sign) in enumerate(zip(coding.equivalents, cases, signs, strict=True)):
        inputs = coding.encode(other)
        rows, turned = transformed(equivalent, own.rows, outputs)
        np.testing.assert_allclose(rows, inputs.rows, atol=1e-6)
        acted = coding.decode(inputs, turned).reshape(3, 3)
        acted = acted[[1, 0, 2]] if k % 2 else acted  # exchanged discs
        np.testing.assert_allclose(acted * [sign, 1.0, 1.0], done, atol=1e-6)


def test_an_averaged_network_is_equal_in_equivalent_scenes(correction):
    """Its mean is the mean of those in all scenes, each transformed back; in all of them it does the same."""
    _, coding, seen = correction
    rng, size, values = np.random.default_rng(2), coding.shape.columns, coding.shape.action
    weights = rng.normal(size=(size, 2 * values)).astype(np.float32) / size**0.5

    def network(rows):
        outputs = np.tanh(rows @ weights)
        return outputs[..., :values], outputs[..., values:]

    rows = coding.encode(seen).rows
    mean, log_std = (
        average(outputs)
        for average, outputs in zip(
            (coding.symmetry.mean, coding.symmetry.spread), network(coding.symmetry.rows(rows)), strict=True
        )
    )
    expected = np.zeros_like(mean)
    for equivalent in coding.equivalents:
        other = network(rows[..., equivalent.order] * equivalent.sign)[0]
        expected[..., equivalent.to] += 0.25 * other * equivalent.times
        there = coding.symmetry.rows(rows[..., equivalent.order] * equivalent.sign)
        np.testing.assert_allclose(
            coding.symmetry.mean(network(there)[0]), transformed(equivalent, rows, mean)[1], atol=1e-6
        )
        spread = transformed(equivalent._replace(times=1.0), rows, log_std)[1]
        np.testing.assert_allclose(coding.symmetry.spread(network(there)[1]), spread, atol=1e-6)
    np.testing.assert_allclose(mean, expected, atol=1e-6)
    assert np.abs(mean - network(rows)[0]).max() > 0.05


def test_different_parts_are_not_exchanged_and_one_part_has_no_others():
    disc, other = (vibgym.Part.disc(20e-3, friction=0.6, height=5e-3) for _ in range(2))
    rod = vibgym.Part.rectangle(40e-3, 20e-3, friction=0.6)
    env = gym.make("vibgym/Pack-v0", parts=[disc, other, rod], action="velocity", observation="parts").unwrapped
    coding = JointCoding(env.surface, env.parts, env.parts_layout, "velocity")
    # The anchor, the first disc, keeps its place: nothing is left to exchange with the second.
    assert len(coding.equivalents) == 1 and coding.shape.action == 9
    env = gym.make("vibgym/Align-v0", action="velocity", observation="parts").unwrapped
    coding = JointCoding(env.surface, env.parts, env.parts_layout, "velocity")
    assert coding.encode(env.reset(seed=0)[0]).rows.shape == (1, 1, coding.shape.columns) and coding.shape.action == 3


@pytest.mark.parametrize(("changes", "said"), [
    ({"action": "wrench"}, "velocity"), ({"turned": True}, "turned"), ({"history": True}, "history"),
    ({"columns": [["position", 2]]}, "heading"),
])  # fmt: skip
def test_what_is_not_supported(scene, changes, said):
    env, _, _ = scene
    arguments = {"action": "velocity", **changes}
    with pytest.raises(ValueError, match=said):
        JointCoding(env.surface, env.parts, env.parts_layout, **arguments)
