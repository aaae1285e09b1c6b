"""Sensorless schedules: fields in time, a policy that is blind, files that are checked."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.sensorless.schedule import (
    COLUMNS,
    Schedule,
    SchedulePolicy,
    load_schedule,
    read_schedule,
    save_schedule,
)
from tests.envs.helpers import single
from tests.policies.classical.test_classical_open_loop import observations
from tests.policies.helpers import SURFACE, info_of
from vibgym import Surface

GOAL = np.array([0.416, 0.104, 0.0])
FIELD = [0.416, 0.104, 0.0, 1.0, 0.5, 0.0, 0.026]


def schedule(fields=None, seconds=(0.10, 0.06)):
    fields = np.array([FIELD, [0.3, 0.05, 1.0, 0.3, 0.0, 0.4, 0.05]]) if fields is None else np.array(fields)
    return Schedule(fields, np.array(seconds), GOAL, 0.58)


@pytest.mark.parametrize("periods", [1, 3])
def test_segments_act_for_their_time_and_then_all_rest(periods):
    """For any step time the shares of the segments add up to their durations, in order."""
    played, step = schedule(), 0.04 * periods
    shares = played.shares(step * np.arange(6), step)
    assert shares.sum(axis=1) == pytest.approx(np.ones(6))
    assert step * shares[:, :2].sum(axis=0) == pytest.approx([0.10, 0.06])
    assert shares[-1].tolist() == [0.0, 0.0, 1.0]
    assert not played.phasors(SURFACE)[-1].any()


def test_pushes_lead_to_the_lines_and_around_the_centre():
    """Without friction a phasor is (-y, -x) of the push: left of the centre to the right, above it down; a swirl turns."""
    x, y = SURFACE.element_centres()
    aligned = Schedule(np.array([FIELD]), np.ones(1), GOAL, 0.0).phasors(SURFACE)[0]
    push_x, push_y = -aligned[..., 1], -aligned[..., 0]
    assert (np.sign(push_x) == np.sign(GOAL[0] - x)).all() and (np.sign(push_y) == np.sign(GOAL[1] - y)).all()
    far = (abs(x - GOAL[0]) > 0.026) & (abs(y - GOAL[1]) > 0.026)
    assert push_x[far] / push_y[far] == pytest.approx((0.5 * np.sign(GOAL[0] - x) / np.sign(GOAL[1] - y))[far])
    turning = Schedule(np.array([[*GOAL, 0.0, 0.0, 1.0, 0.026]]), np.ones(1), GOAL, 0.0).phasors(SURFACE)[0]
    assert ((x - GOAL[0]) * -turning[..., 0] - (y - GOAL[1]) * -turning[..., 1] > 0.0).all()


def test_nothing_but_time_is_looked_at():
    policy = SchedulePolicy(info_of("Align"), schedule())
    seen, other = observations("Align", worlds=2, steps=6), observations("Align", worlds=2, steps=6, seed=5)
    state = blind = None
    for step in range(6):
        action, state = policy.predict(seen[step], state)
        same, blind = policy.predict(other[step], blind)
        assert (action == same).all() and (action[0] == action[1]).all()
        alone, _ = policy.predict(seen[step][0], None if step == 0 else type(state)(state.time[:1] - 0.04))
        assert (alone == action[0]).all()
    assert not action.any()  # all rest after 0.16 s
    restarted, _ = policy.predict(seen[0], state, np.array([False, True]))
    fresh, _ = policy.predict(seen[0])
    assert not restarted[0].any() and (restarted[1] == fresh[1]).all() and fresh.any()


def test_its_actions_are_whole_phasors_of_the_environment():
    """A field that reaches every element at full amplitude moves the elements at full amplitude."""
    env = single("Align", action="phasor")
    env.reset(seed=0)
    uniform = Schedule(np.array([[0.416, 50.0, 0.0, 1.0, 0.0, 0.0, 0.026]]), np.ones(1), GOAL, 0.58)
    action, _ = SchedulePolicy(info_of("Align"), uniform).predict(np.zeros(env.observation_space.shape))
    env.step(action)
    phasors = env.unwrapped.core.phasors(0)
    assert np.hypot(phasors[..., 0], phasors[..., 1]) == pytest.approx(1.0, abs=1e-6)


@pytest.mark.parametrize("task", ["Sort", "Follow"])
def test_other_tasks_are_refused(task):
    with pytest.raises(ValueError, match="policy 'schedule'"):
        SchedulePolicy(info_of(task), schedule())


def test_a_file_gives_back_what_was_saved(tmp_path):
    path = tmp_path / "blind.json"
    save_schedule(path, schedule(), SURFACE, {"seed": 3})
    found, record = read_schedule(path)
    assert (found.fields == schedule().fields).all() and (found.seconds == schedule().seconds).all()
    assert (found.goal == GOAL).all() and found.friction == 0.58 and record["training"] == {"seed": 3}
    seen = observations("Align", worlds=2, steps=1)[0]
    loaded, direct = load_schedule(path, info_of("Align")), SchedulePolicy(info_of("Align"), schedule())
    assert (loaded.predict(seen)[0] == direct.predict(seen)[0]).all()


def test_stored_schedules_fit_the_table():
    files = sorted(Path("studies/sensorless/schedules").glob("*.json"))
    assert len(files) == 4 and all(load_schedule(path, info_of("Align")).schedule.total <= 4.0 for path in files)


def test_unsuitable_files_are_refused(tmp_path):
    path = tmp_path / "blind.json"
    save_schedule(path, schedule(), Surface(rows=6), {})
    with pytest.raises(ValueError, match=r"blind.json: surface"):
        load_schedule(path, info_of("Align"))
    record = json.loads(path.read_text())
    path.write_text(json.dumps({**record, "friction": "high"}))
    with pytest.raises(ValueError, match="blind.json: friction"):
        load_schedule(path, info_of("Align"))
    path.write_text(json.dumps({**record, "format": "vibgym-policy"}))
    with pytest.raises(ValueError, match="vibgym-schedule"):
        load_schedule(path, info_of("Align"))
    path.write_text(json.dumps(record))
    tensors = path.with_name(record["tensors"])
    tensors.write_bytes(tensors.read_bytes()[:-1])
    with pytest.raises(ValueError, match="SHA-256 differs"):
        load_schedule(path, info_of("Align"))


@pytest.mark.parametrize("fields, seconds, message", [
    ([FIELD], (0.1, 0.2), "fields"),
    ([FIELD], (-0.1,), "seconds"),
    ([], (), "seconds"),
    ([[math.nan, *FIELD[1:]]], (0.1,), "fields"),
    ([[*FIELD[:6], 0.0]], (0.1,), "fields: reach"),
])  # fmt: skip
def test_bad_schedules_are_refused(fields, seconds, message):
    with pytest.raises(ValueError, match=message):
        schedule(fields if len(fields) else np.zeros((0, len(COLUMNS))), seconds)
