"""Coding: rows by name, and the same drive for all actions of elements."""

import numpy as np
import pytest

from tests.envs.helpers import assert_same, batch
from tests.policies.helpers import info_of
from tests.policies.trained.helpers import coding_for
from vibgym.envs.actions import ACTIONS, Phasor
from vibgym.envs.local_actions import patch_size
from vibgym.policies.task_info import TaskInfo

WORLDS = 3
PAIR = info_of("Sort", parts=["steel_block", "aluminium_block"])


def played(task, action, acts, **settings):
    """Observations of steps under actions (steps, worlds, parts, numbers) of parts."""
    env = batch(task, WORLDS, action=action, observation="parts", **settings)
    coding = coding_for(TaskInfo.of(env), action)
    seen, observations = env.reset(seed=4)[0], []
    for act in acts:
        seen = env.step(coding.decode(coding.encode(seen), act))[0]
        observations.append({name: value.copy() for name, value in seen.items()})
    return observations


@pytest.mark.parametrize("task, settings", [("Align", {}), ("Sort", {"parts": ["steel_block", "aluminium_block"] * 2})])
def test_elements_are_driven_the_same_by_every_name(task, settings):
    env = batch(task, WORLDS, action="patch", observation="parts", **settings)
    parts, side = env.single_action_space.shape[0] // (2 * 4**2), 4
    assert parts == len(env.parts)
    acts = np.random.default_rng(0).uniform(-0.7, 0.7, (4, WORLDS, parts, 2 * side**2)).astype(np.float32)
    patch, phasor, element = (played(task, action, acts, **settings) for action in ("patch", "phasor", "element"))
    assert_same(phasor, patch)
    assert len(element) == len(patch) == 4
    for mine, theirs in zip(element, patch, strict=True):  # amplitude and phase are rounded to float32
        assert mine["parts"] == pytest.approx(theirs["parts"], abs=2e-3)
    assert np.abs(patch[-1]["parts"] - patch[0]["parts"]).max() > 0.05


@pytest.mark.parametrize("places", [
    [[0.30, 0.10], [0.34, 0.11]], [[0.30, 0.10], [0.30, 0.10]], [[0.005, 0.006], [0.83, 0.20]],
    [[0.014, 0.014], [0.04, 0.04]], [[0.026, 0.052], [0.078, 0.052]],
])  # fmt: skip
@pytest.mark.parametrize("there", [[1, 1], [1, 0], [0, 1], [0, 0]])
def test_shared_elements_are_driven_by_the_nearest_part(places, there):
    """As with the action "patch": of equally near parts the first; elements outside of the table are omitted."""
    coding, surface, side = coding_for(PAIR, "phasor"), PAIR.surface, patch_size(PAIR.surface, PAIR.parts)
    acts = np.random.default_rng(1).uniform(-0.7, 0.7, (2, side, side, 2)).astype(np.float32)
    centre = np.array(places) / surface.element_size
    first = np.floor(centre + 0.5 - 0.5 * side).astype(int)
    expected, shared = np.zeros((surface.rows, surface.columns, 2), dtype=np.float32), 0
    for row, column in np.ndindex(surface.rows, surface.columns):
        claims = []
        for part in np.flatnonzero(there):
            x, y = column - first[part, 0], row - first[part, 1]
            if 0 <= x < side and 0 <= y < side:
                away = (column + 0.5 - centre[part, 0]) ** 2 + (row + 0.5 - centre[part, 1]) ** 2
                claims.append((round(away, 6), part, y, x))
        if claims:
            _, part, y, x = min(claims)
            expected[row, column] = acts[part, y, x]
        shared += len(claims) > 1
    rows = np.zeros((1, 2, coding.shape.columns), dtype=np.float32)
    start = {row.name: row.start for row in PAIR.parts_layout}
    size = np.array([surface.columns, surface.rows])
    rows[0, :, start["position"] : start["position"] + 2] = 2.0 * centre / size - 1.0
    rows[0, :, start["element"] : start["element"] + 2] = 2.0 * (centre - np.floor(centre)) - 1.0
    seen = coding.encode({"parts": rows, "mask": np.array([there])})
    table = coding.decode(seen, acts.reshape(1, 2, -1))
    assert table.shape == (1, expected.size) and (table.reshape(expected.shape) == expected).all()
    assert (shared > 0) == (there == [1, 1] and places[1] != [0.83, 0.20])


def test_columns_are_picked_by_name_and_one_is_a_batch_of_one():
    info = info_of("Align")
    every = coding_for(info)
    wanted = [column for column in every.columns if column[0] in ("element", "way_far", "way_fine", "turn")]
    fewer = coding_for(info, columns=wanted)
    assert (fewer.shape.columns, fewer.shape.neighbours, fewer.shape.place) == (7, 0, 0) and fewer.columns == wanted
    width = every.shape.columns
    seen = {"parts": np.arange(2 * width, dtype=np.float32).reshape(2, 1, width), "mask": np.ones((2, 1), np.int8)}
    layout = {row.name: slice(row.start, row.start + row.width) for row in info.parts_layout}
    rows = fewer.encode(seen).rows
    assert (rows == np.concatenate([seen["parts"][..., layout[name]] for name, _ in wanted], axis=-1)).all()
    assert (every.encode(seen).rows == seen["parts"]).all()
    for coding in (every, fewer):
        one = coding.encode({name: values[1] for name, values in seen.items()})
        assert_same(list(one), [array[1:] if array.shape[0] == 2 else array for array in coding.encode(seen)])
    assert coding_for(info, columns=every.columns).columns == every.columns


def test_rows_of_slots_without_a_part_are_not_read():
    """A scene may have more slots than parts."""
    coding, width = coding_for(PAIR), sum(row.width for row in PAIR.parts_layout)
    seen = {"parts": np.ones((5, 7, width)), "mask": np.array([[1, 0, 0, 0, 0, 0, 0]] * 5)}
    rows, mask, *_ = coding.encode(seen)
    assert rows.shape == (5, 2, width) and mask.tolist() == [[1.0, 0.0]] * 5 and mask.dtype == rows.dtype == np.float32


def test_actions_without_parts_and_elements_are_refused(monkeypatch):
    class Whole(Phasor):
        """A custom action without values per part."""

    monkeypatch.setattr(ACTIONS, "_items", {**ACTIONS, "whole": Whole})
    info = info_of("Align")
    for action in ("whole", "swing"):
        with pytest.raises(ValueError, match="action"):
            coding_for(info, action)


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize("action, history, history_columns", [
    ("wrench", True, []), ("target", 1, ["velocity"]), ("velocity", 3, []), ("velocity", 3, ["heading", "velocity"]),
])  # fmt: skip
def test_rows_contain_the_last_steps(turned, action, history, history_columns):
    """Action, then the columns before it, the last step first, all turned like the present row; zeros before the start."""
    coding = coding_for(PAIR, action, turned=turned, history=history, history_columns=history_columns)
    plain, turns = coding_for(PAIR, action), coding_for(PAIR, action, turned=True)._turns
    assert turns is not None
    at = {row.name: range(row.start, row.start + row.width) for row in PAIR.parts_layout}
    chosen = [k for name in history_columns for k in at[name]]
    own, width, steps = plain.shape.own, 3 + len(chosen), int(history)
    assert coding.shape.columns == plain.shape.columns + steps * width and coding.shape.own == own + steps * width
    assert (
        coding.history_columns == history_columns and coding.columns == plain.columns
    )  # actions are no columns of the scene
    env = batch("Sort", WORLDS, action=action, observation="parts", parts=["steel_block", "aluminium_block"])
    random, before, observation, past = np.random.default_rng(0), None, env.reset(seed=4)[0], []
    for step in range(6):
        seen, raw = coding.encode(observation, before, np.zeros(WORLDS, bool)), plain.encode(observation).rows
        whole = turns.turn_rows(seen.quarters, raw) if turned else raw
        assert (seen.rows[..., :own] == whole[..., :own]).all()
        assert (seen.rows[..., own + steps * width :] == whole[..., own:]).all()
        for k in range(steps):
            remembered = seen.rows[..., own + k * width : own + (k + 1) * width]
            rows, command = past[-1 - k] if k < step else (np.zeros_like(raw), np.zeros_like(remembered[..., :3]))
            rows = turns.turn_rows(seen.quarters, rows) if turned else rows
            assert (remembered[..., :3] == coding.to_rows(seen, command)).all()
            assert (remembered[..., 3:] == rows[..., chosen]).all()
        actions = coding.decode(seen, random.uniform(-1, 1, (WORLDS, 2, 3)).astype(np.float32))
        past.append((raw, actions.reshape(WORLDS, 2, 3)))
        observation, before = env.step(actions)[0], seen
    assert not turned or coding.encode(observation, before).quarters.any()


@pytest.mark.parametrize("settings, message", [
    ({"history": -1}, "history"), ({"history": 101}, "history"), ({"history": 1.5}, "history"),
    ({"history": "2"}, "history"), ({"history_columns": ["velocity"]}, "history_columns requires history"),
    ({"history": 2, "history_columns": "velocity"}, "history_columns"),
    ({"history": 2, "history_columns": ["smell"]}, "history_columns.*smell"),
    ({"history": 2, "history_columns": ["neighbour_1_gap"]}, "history_columns"),
    ({"history": 2, "history_columns": ["position"], "columns": [["element", 2], ["velocity", 2]]},
     "history_columns.*position"),
])  # fmt: skip
def test_a_memory_that_is_none_is_refused(settings, message):
    with pytest.raises(ValueError, match=message) as error:
        coding_for(PAIR, "wrench", **settings)
    assert "\n" not in str(error.value)


def test_touching_reads_the_same_columns_with_remembers():
    coding, plain = coding_for(PAIR, "wrench", history=True), coding_for(PAIR, "wrench")
    start = {row.name: row.start for row in PAIR.parts_layout}
    rows = np.ones((3, 2, plain.shape.columns), dtype=np.float32)
    rows[0, :, start["neighbour_1_gap"]], rows[1, 0, start["neighbour_1_gap"]] = 0.0, 0.01
    rows[0, 1, start["neighbour_1_there"]] = 0.0
    seen = {"parts": rows, "mask": np.ones((3, 2))}
    for reader in (coding, plain):
        assert reader.touching(reader.encode(seen)).tolist() == [[1.0, 0.0], [1.0, 0.0], [0.0, 0.0]]


def test_all_steps_are_forgotten_at_the_start_of_an_episode_and_before_an_arrival():
    info = info_of("Feed", parts=["steel_block", "aluminium_block"])
    coding, plain = coding_for(info, "wrench", history=3), coding_for(info, "wrench")
    rows, columns = np.zeros((2, 2, plain.shape.columns)), slice(plain.shape.own, plain.shape.own + 9, 3)
    before = None
    for step, (start, mask, remembered) in enumerate([
        (False, 1.0, [[0, 0, 0], [0, 0, 0]]), (False, 1.0, [[1, 0, 0], [1, 0, 0]]), (False, 1.0, [[2, 1, 0], [2, 1, 0]]),
        (True, 1.0, [[0, 0, 0], [3, 2, 1]]), (False, 0.0, [[4, 0, 0], [4, 3, 2]]), (False, 1.0, [[0, 0, 0], [5, 4, 3]]),
        (False, 1.0, [[6, 0, 0], [6, 5, 4]]),
    ], start=1):  # fmt: skip
        # The first part of the first world starts anew in the fourth step and is absent in the fifth.
        here = np.array([[mask, 1.0], [1.0, 1.0]])
        memory, kept = before, None if before is None else before.command.copy()
        before = coding.encode({"parts": rows, "mask": here}, memory, np.array([start, False]))
        assert (10 * before.rows[:, 0, columns]).round().tolist() == remembered
        assert memory is None or (memory.command == kept).all()  # it is not written to
        alone = coding.encode({"parts": rows[:1], "mask": here[:1]}, memory and memory.of(0), np.array([start]))
        assert (alone.rows == before.rows[:1]).all()
        coding.decode(before, np.full((2, 2, 3), 0.1 * step, dtype=np.float32))


@pytest.mark.parametrize("worlds, got", [(None, "str"), (2, r"of shape \(2, 1, 3\)"), (0, r"of shape \(0, 0, 0\)")])
def test_another_memory_is_refused(worlds, got):
    info = info_of("Align")
    coding, plain = coding_for(info, "wrench", history=True), coding_for(info, "wrench")
    seen = [{"parts": np.zeros((k, 1, plain.shape.columns)), "mask": np.ones((k, 1))} for k in (2, 3)]
    other = {None: "yesterday", 2: coding.encode(seen[0]), 0: plain.encode(seen[1])}[worlds]
    with pytest.raises(ValueError, match=r"state") as error:
        coding.encode(seen[1], other)
    assert "\n" not in str(error.value)
