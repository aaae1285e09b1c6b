"""Sensorless schedules: fields in time, a policy that depends on time only, files, the search, and its command."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from studies.sensorless.__main__ import main
from studies.sensorless.handmade import FAMILIES, as_drawn, schedule_of, shifted
from studies.sensorless.play import COARSE, FINE, Trials, cost, draw_trials, errors_of, play
from studies.sensorless.schedule import COLUMNS, Schedule, SchedulePolicy, load_schedule, read_schedule, save_schedule
from studies.sensorless.search import costs, decoded, encoded, search
from studies.sensorless.settings import SensorlessSettings
from tests.envs.helpers import batch
from tests.policies.classical.test_classical_open_loop import observations
from tests.policies.helpers import ALUMINIUM, SURFACE, info_of
from vibgym import Surface

GOAL = np.array([0.416, 0.104, 0.0])
FIELD = [0.416, 0.104, 0.0, 1.0, 0.5, 0.0, 0.026]
QUICK = SensorlessSettings(seconds=2.0, segments=2, starts=6, generations=12, population=8, evaluated=8)


def schedule(fields=None, seconds=(0.10, 0.06)):
    fields = np.array([FIELD, [0.3, 0.05, 1.0, 0.3, 0.0, 0.4, 0.05]]) if fields is None else np.array(fields)
    return Schedule(fields, np.array(seconds), GOAL, 0.58)


def both(angle=0.0, seconds=2.0):
    return schedule_of("both squeezes at once", GOAL, seconds, 0.58, angle, 0.026, 0.5)


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
    uniform = Schedule(np.array([[0.416, 50.0, 0.0, 1.0, 0.0, 0.0, 0.026]]), np.ones(1), GOAL, 0.58).phasors(SURFACE)[0]
    assert np.hypot(uniform[..., 0], uniform[..., 1]) == pytest.approx(1.0, abs=1e-6)


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


def test_play_agrees_with_the_environment():
    """The poses of a simulated schedule are those of its policy in Align, to rounding."""
    start, played = np.array([0.2, 0.06, 1.0]), both(0.3, seconds=0.5)
    trials = Trials(start[None], np.ones(1), np.zeros((1, 0)))
    poses = play([played], trials, ALUMINIUM, SURFACE, "ideal", 1.0)[:, 0, 0]
    env, policy = batch("Align", 1, action="phasor"), SchedulePolicy(info_of("Align"), played)
    seen, _ = env.reset(seed=0, options={"pose": start, "goal": GOAL})
    state = None
    for pose in poses[1:]:
        action, state = policy.predict(seen, state)
        seen, *_ = env.step(action)
        assert env.unwrapped.core.simulator.pose[0, 0] == pytest.approx(pose, abs=1e-9)
    assert np.hypot(*(poses[-1] - poses[0])[:2]) > 0.05


def test_schedules_and_trials_of_a_batch_are_independent():
    trials = draw_trials(ALUMINIUM, SURFACE, "prototype", (0.9, 1.1), 3, (4, 2))
    several = play([both(), both(0.5)], trials, ALUMINIUM, SURFACE, "prototype", 0.6)
    first = Trials(trials.pose[:1], trials.friction[:1], trials.uniform[:1])
    alone = play([both(0.5)], first, ALUMINIUM, SURFACE, "prototype", 0.6)
    assert (several[:, 1, 0] == alone[:, 0, 0]).all()
    assert (several[0, 0] == trials.pose).all() and (several[0, 1] == trials.pose).all()
    assert (several[-1, 0] != several[-1, 1]).any()


def test_a_file_gives_back_what_was_saved_and_others_are_refused(tmp_path):
    path = tmp_path / "blind.json"
    save_schedule(path, schedule(), SURFACE, {"seed": 3})
    stored, record = read_schedule(path)
    assert (stored.fields == schedule().fields).all() and (stored.seconds == schedule().seconds).all()
    assert (stored.goal == GOAL).all() and stored.friction == 0.58 and record["training"] == {"seed": 3}
    with pytest.raises(ValueError, match="policy 'schedule'"):
        load_schedule(path, info_of("Sort"))
    for change, message in (({"friction": "high"}, "blind.json: friction"), ({"fields": None}, "blind.json: fields")):
        path.write_text(json.dumps({**record, **change}))
        with pytest.raises(ValueError, match=message):
            load_schedule(path, info_of("Align"))
    save_schedule(path, schedule(), Surface(rows=6), {})
    with pytest.raises(ValueError, match=r"blind.json: surface"):
        load_schedule(path, info_of("Align"))


def test_stored_schedules_fit_the_table():
    files = sorted(Path("studies/sensorless/schedules").glob("*.json"))
    assert len(files) == 4 and all(load_schedule(path, info_of("Align")).schedule.total <= 4.0 for path in files)


def test_heading_errors_are_modulo_the_symmetry():
    poses = np.array([[0.4187, 0.1076, math.pi - 0.01], [0.416, 0.104, 0.02], [0.416, 0.104, -1.5]])
    errors = errors_of(poses, GOAL, 2)
    assert errors.distance == pytest.approx([0.0045, 0.0, 0.0]) and errors.heading == pytest.approx([0.01, 0.02, 1.5])
    assert errors.within(COARSE).tolist() == [True, True, False]
    assert errors.within(FINE).tolist() == [False, True, False]
    assert not errors_of(poses, GOAL, 0).heading.any()
    assert errors_of(poses, GOAL, 4).heading[2] == pytest.approx(math.pi / 2 - 1.5)


def test_the_cost_increases_with_size_and_duration_of_errors():
    pose = np.tile(GOAL, (20, 4, 3, 1))
    pose[:, 1, :, 0] += 0.004
    pose[:, 2, :, 0] += 0.008
    pose[:10, 3, :, 2] += 0.1
    values = cost(errors_of(pose, GOAL, 2))
    assert values[0] == 0.0 < values[3] < math.inf and 0.0 < values[1] < values[2]
    assert values[1] == pytest.approx(2.0 * math.log(5.0))  # 4 mm are twice the tolerance, all the time and at the end
    assert values[3] == pytest.approx(0.5 * math.log1p((0.1 / FINE[1]) ** 2))


def test_starts_are_entirely_on_the_table():
    trials = draw_trials(ALUMINIUM, SURFACE, "ideal", (0.9, 1.1), 500, (1, 0))
    low, high = trials.pose[:, :2].min(0), trials.pose[:, :2].max(0)
    assert (low >= ALUMINIUM.radius).all() and (high <= [0.832 - ALUMINIUM.radius, 0.208 - ALUMINIUM.radius]).all()
    assert (
        high - low > [0.7, 0.13]
    ).all() and 0.9 <= trials.friction.min() < 0.92 < 1.08 < trials.friction.max() <= 1.1


@pytest.mark.parametrize("family", FAMILIES)
def test_encoding_and_decoding_give_the_same_schedule(family):
    """Fields are the same at all times; the longest segment is halved."""
    moved = shifted(schedule_of(family, GOAL, 2.4, 0.58, 0.2, 0.05, 0.5), np.array([0.003, -0.002]))
    restored = decoded(encoded(moved, 3, 2.4), GOAL, 2.4, 0.58, 0.04)
    assert restored.total == pytest.approx(2.4) and len(restored.seconds) == 3
    for time in np.arange(0.02, 2.4, 0.04):
        mine, theirs = (np.searchsorted(np.cumsum(one.seconds), time) for one in (moved, restored))
        assert restored.fields[theirs] == pytest.approx(moved.fields[mine])


def test_segments_end_with_steps_and_within_the_time():
    for numbers in np.random.default_rng(0).normal(0.0, 3.0, (50, 24)):
        schedule = decoded(numbers, GOAL, 4.0, 0.58, 0.16)
        assert schedule.total <= 4.0 + 1e-9
        assert np.cumsum(schedule.seconds) / 0.16 == pytest.approx(np.round(np.cumsum(schedule.seconds) / 0.16))


def test_two_squeezes_move_all_starts_to_one_pose():
    """An elliptic field has one stable pose up to half a turn."""
    trials = draw_trials(ALUMINIUM, SURFACE, "ideal", (1.0, 1.0), 12, (4, 1))
    ends = play(
        [as_drawn("both squeezes at once", ALUMINIUM, SensorlessSettings())], trials, ALUMINIUM, SURFACE, "ideal", 4.0
    )[-1, 0]
    assert np.ptp(ends[:, :2], axis=0) == pytest.approx(0.0, abs=0.002)
    assert abs(np.exp(2j * ends[:, 2]).mean()) > 0.99 > 0.6 > abs(np.exp(2j * trials.pose[:, 2]).mean())


def test_a_search_improves_and_repeats():
    first = both()
    result = search(ALUMINIUM, SURFACE, QUICK, "ideal", first, 3, quiet=True)
    again = search(ALUMINIUM, SURFACE, QUICK, "ideal", first, 3, quiet=True)
    other = search(ALUMINIUM, SURFACE, QUICK, "ideal", first, 4, quiet=True)
    assert (result.schedule.fields == again.schedule.fields).all() and (result.history == again.history).all()
    assert (result.schedule.fields != other.schedule.fields).any()
    fresh = draw_trials(ALUMINIUM, SURFACE, "ideal", (0.9, 1.1), 40, (9, 9))
    before, after = costs([first, result.schedule], fresh, ALUMINIUM, SURFACE, QUICK, "ideal")
    assert after < before - 0.3


def test_the_command_writes_schedules_and_a_page(tmp_path):
    config = tmp_path / "quick.yaml"
    config.write_text(
        "parts: [aluminium_block]\nhardware: [ideal]\nseconds: 1.6\nsegments: 2\nstarts: 2\npopulation: 4\n"
        "generations: 1\nseeds: [1, 2]\nevaluated: 3\nprocesses: 1\n"
    )
    assert main([str(config), "--output", str(tmp_path / "out")]) == 0
    page = (tmp_path / "out" / "sensorless.md").read_text()
    assert "## Aluminium block, ideal hardware" in page and "| learned, seed 1 |" in page.replace("**", "").replace(
        " (stored)", ""
    )
    schedule, record = read_schedule(tmp_path / "out" / "aluminium_block-ideal.json")
    assert schedule.total <= 1.6 + 1e-9 and (schedule.goal == GOAL).all()
    assert record["training"]["seed"] in (1, 2) and record["training"]["hardware"] == "ideal"


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


@pytest.mark.parametrize("text, message", [
    ("parts: [cube]", "parts"),
    ("friction: [1.1, 0.9]", r"friction\[1\]"),
    ("goal: [0.9, 0.1, 0.0]", "goal: x"),
    ("seeds: [1, 1]", "seeds"),
    ("speed: 3", "speed"),
])  # fmt: skip
def test_invalid_configurations_are_rejected_before_writing(tmp_path, capsys, text, message):
    config = tmp_path / "bad.yaml"
    config.write_text(text)
    assert main([str(config), "--output", str(tmp_path / "out")]) == 2
    error = capsys.readouterr().err
    assert len(error.splitlines()) == 1 and pytest.raises(ValueError, match=message).matches(ValueError(error))
    assert not (tmp_path / "out").exists()
