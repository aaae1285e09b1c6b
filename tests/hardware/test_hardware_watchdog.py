"""What stops the elements, and what does not: late cycles, old measurements, wrong clocks, borders, emergency stops."""

import numpy as np
import pytest

from tests.hardware.helpers import PROTOTYPE, Faulty, as_image, locate
from vibgym.hardware import ControlLoop, HardwareEnv, Stopped, Watchdog
from vibgym.tasks import TASKS

AT = 5
"""Cycle from which a machine is faulty."""


def run(driver, cycles=60, watchdog=None, **settings):
    settings = {"action": "velocity", **settings}
    loop = ControlLoop(driver, "Align", "pose", watchdog=watchdog, **settings)
    return loop.run(cycles, seed=5, beyond=True)


def from_cycle(change):
    return lambda k, measurement, now: change(k, measurement, now) if k >= AT else (measurement, now)


def moved(measurement, **pose):
    changed = measurement.pose.copy()
    for axis, value in pose.items():
        changed[0, "xyh".index(axis)] = value
    return measurement._replace(pose=changed)


FAULTS = {
    "clock back": (lambda k, m, now: (m, now - 1.0), "the machine's clock went from 0.160 s to -0.800 s", AT),
    "clock stops": (lambda k, m, now: (m, 0.16), "the machine's clock went from 0.160 s to 0.160 s", AT),
    "clock jumps": (
        lambda k, m, now: (m._replace(taken=m.taken + 9.0), now + 9.0),
        "the machine's clock advanced by 9.040 s between two cycles: 225 cycles of 0.04 s were missed",
        AT,
    ),
    "no clock": (lambda k, m, now: (m, np.nan), "the machine's clock went from 0.160 s to nan", AT),
    "samples back": (
        lambda k, m, now: (m._replace(taken=0.01), now), "the clock of measurements went back from 0.160 s to 0.010 s", AT,
    ),
    "samples ahead": (
        lambda k, m, now: (m._replace(taken=now + 0.1), now),
        "a measurement of 0.300 s arrived at 0.200 s: the clocks of machine and camera differ", AT,
    ),
    "samples too old": (
        lambda k, m, now: (m._replace(taken=m.taken - 0.04), now),
        "no usable measurement for 0.240 s: they are 0.040 s old, sensor.delay is 0.000 s", AT + 5,
    ),
    "border": (lambda k, m, now: (moved(m, x=0.827), now), "part 0 is 5.0 mm from the right border", AT),
    "beyond the border": (lambda k, m, now: (moved(m, y=-0.01), now), "-10.0 mm from the bottom border", AT),
    "jump": (
        lambda k, m, now: (moved(m, x=m.pose[0, 0] + (0.3 if m.pose[0, 0] < 0.4 else -0.3)), now),
        "part 0 has moved by 3", AT,  # 300 mm, and its own way
    ),
    "jump while unseen": (
        lambda k, m, now: (moved(m, x=np.nan if k < AT + 3 else 0.15 if m.pose[0, 0] > 0.4 else 0.65), now),
        " mm are possible", AT + 3,
    ),
    "lost part": (lambda k, m, now: (moved(m, x=np.nan), now), "part 0 has not been measured for 0.440 s", AT + 10),
    "wrong poses": (
        lambda k, m, now: (m._replace(pose=np.zeros((2, 3))), now), "measured poses must have shape (1, 3), got (2, 3)", AT,
    ),
}  # fmt: skip
"""What a machine measures from cycle AT on, the reason of the stop, and its cycle."""


@pytest.mark.parametrize("name", FAULTS)
def test_a_fault_stops_the_elements_and_the_reason_is_one_line(name):
    change, reason, cycle = FAULTS[name]
    driver = Faulty(from_cycle(change))
    outcome = run(driver)
    assert reason in outcome.reason and "\n" not in outcome.reason
    assert outcome.cycles == len(driver.sent) == cycle
    assert driver.sent[-1][0].any() and not driver.amplitude.any()


@pytest.mark.parametrize("what", ["pose", "image"])
def test_a_frozen_camera_is_noticed(what):
    """It repeats the measurement of cycle AT; images even with a time that advances."""
    last = []

    def change(k, measurement, now):
        last[:] = [measurement] if k <= AT else last
        if what == "pose":
            return last[0], now
        return as_image(k, last[0]._replace(taken=measurement.taken), now)

    outcome = run(Faulty(change), locate=locate if what == "image" else None)
    assert "no usable measurement for 0.240 s: the same one is repeated" in outcome.reason
    assert outcome.cycles == AT + 6


def test_measurements_within_the_limits_do_not_stop_the_elements():
    def change(k, measurement, now):
        if k % 6:  # one of six cycles has a measurement
            measurement = measurement._replace(pose=np.full((1, 3), np.nan))
        return measurement, now + 0.01 * np.sin(k)

    outcome = run(Faulty(change), sensor={"kind": "ideal", "estimator": "model"})
    assert outcome.reason == "cycle limit"


@pytest.mark.parametrize("missed", [1, 3])
def test_the_estimator_follows_the_held_command_through_missed_cycles(missed):
    """Without noise, the prediction from late measurements equals the truth after missed cycles, too."""
    settings = {"action": "velocity", "actuators": {**PROTOTYPE, "dead": 0.0, "gain_spread": 0.0, "phase_spread": 0.0}}
    settings["actuators"]["latency"] = 0
    settings["sensor"] = {"kind": "ideal", "delay": 2, "estimator": "model"}
    driver = Faulty(skip={AT: missed}, **settings)
    loop = ControlLoop(driver, "Align", "pose", **settings)
    core, before = loop.env.core, driver.inner.env.truth.pose
    outcome = loop.run(AT, seed=5, beyond=True)
    assert (outcome.missed, outcome.cycles) == (missed, AT)
    assert driver.inner.now() == pytest.approx(0.04 * (AT + missed))
    truth = driver.inner.env.truth.pose
    assert np.abs(truth - before).max() > 0.003
    np.testing.assert_allclose(core.sensing.measurement.pose, truth, atol=1e-9)


def resting(steps, change=lambda k, m, now: (m, now), skip=None):
    """Steps of a part that rests at its goal until success; returns the environment, rewards and infos."""
    driver = Faulty(change, skip)
    env = HardwareEnv(driver, "Align", action="field", watchdog=Watchdog(lost=9.0, stale=9.0))
    env.reset(seed=5, options={"goal": driver.inner.env.truth.pose[0]})
    results = []
    while len(results) < steps and not (results and results[-1][-1]["is_success"]):
        results.append(env.step(np.zeros(6, dtype=np.float32)))
    return env, [step[1] for step in results], [step[-1] for step in results]


UNSEEN = {
    "missed": {"skip": {2: 3, 3: 3, 4: 3}},
    "not measured": {"change": lambda k, m, now: (moved(m, x=np.nan) if 2 <= k < 11 else m, now)},
    "repeated": {"change": lambda k, m, now: (m._replace(taken=min(m.taken, 0.04)) if k < 11 else m, now)},
}  # fmt: skip


@pytest.mark.parametrize("name", UNSEEN)
def test_cycles_that_measure_nothing_do_not_count_for_the_hold(name):
    env, _, infos = resting(60, **UNSEEN[name])
    assert infos[-1]["is_success"]
    assert len(infos) == 10 + (0 if name == "missed" else 9)  # 10 cycles that measure the part


@pytest.mark.parametrize("settings", [{}, {"observation": "goal"}, {"custom": True}])
def test_rewards_of_missed_cycles_are_part_of_their_step(settings, monkeypatch):
    if settings.pop("custom", False):
        monkeypatch.setattr(TASKS["Align"], "reward", lambda task, step: {"time": step.quantities["time"]})

    def total(cycles, skip):
        driver = Faulty(skip=skip)
        env = HardwareEnv(driver, "Align", action="field", **settings)
        env.reset(seed=5)
        steps = [env.step(np.zeros(6, dtype=np.float32)) for _ in range(cycles - sum(skip.values()))]
        assert env.core.missed == sum(skip.values())
        assert all(step[1] == pytest.approx(sum(step[-1]["reward_terms"].values())) for step in steps)
        assert all(step[1] == pytest.approx(float(step[-1]["parts"]["reward"].sum())) for step in steps)
        return sum(step[1] for step in steps)

    assert total(9, {2: 3, 4: 1}) == pytest.approx(total(9, {}), abs=1e-9)


def test_too_many_missed_cycles_stop_the_elements():
    driver = Faulty(skip={AT: 4})
    outcome = run(driver)
    assert "4 cycles of 0.04 s were missed, at most 3 are allowed" in outcome.reason
    assert not driver.amplitude.any()
    assert run(Faulty(skip={AT: 4}), watchdog=Watchdog(hold=4)).missed == 4


def test_an_emergency_stop_acts_in_the_same_cycle_and_lasts_until_it_is_released():
    watchdog = Watchdog()

    def change(k, measurement, now):
        if k == AT:
            watchdog.stop("the operator\nhas pressed the button")
        return measurement, now

    driver = Faulty(change)
    loop = ControlLoop(driver, "Align", "pose", action="velocity", watchdog=watchdog)
    assert loop.run(60, seed=5).reason == "the operator has pressed the button"
    assert len(driver.sent) == AT and not driver.amplitude.any()
    assert loop.run(60, seed=5).cycles == 0
    watchdog.release()
    assert loop.run(3, seed=5, beyond=True).reason == "cycle limit"


def test_a_stopped_environment_sends_nothing_until_it_is_reset():
    driver = Faulty(from_cycle(lambda k, m, now: (m, 0.0)))
    env = HardwareEnv(driver, "Align", action="field")
    env.reset(seed=5)
    action = np.ones(6, dtype=np.float32)
    with pytest.raises(Stopped, match="clock"):
        for _ in range(AT):
            env.step(action)
    sent = len(driver.sent)
    with pytest.raises(Stopped, match="clock"):
        env.step(action)
    assert len(driver.sent) == sent and not driver.amplitude.any()


def test_a_part_that_is_not_measured_at_the_start_is_an_error():
    driver = Faulty(lambda k, m, now: (moved(m, x=np.nan), now))
    with pytest.raises(ValueError, match="part 0 is not measured"):
        run(driver)
    assert not driver.sent


@pytest.mark.parametrize("limit", [{"hold": -1}, {"stale": np.nan}, {"border": "near"}, {"jump": -1}, {"lost": -0.1}])
def test_bad_limits_are_refused(limit):
    with pytest.raises(ValueError, match=next(iter(limit))):
        Watchdog(**limit)


def test_borders_with_walls_do_not_count():
    driver = Faulty(from_cycle(lambda k, m, now: (m, now)))
    watchdog = Watchdog(border=0.01)
    watchdog.start(driver.inner.surface, ["right"], driver.inner.env.core.sensing.sensor, 0.0, 0.0)
    pose = np.array([[0.831, 0.1, 0.0]])
    watchdog.check_parts(pose, np.ones(1, dtype=bool))
    with pytest.raises(Stopped, match="top border"):
        watchdog.check_parts(np.array([[0.4, 0.207, 0.0]]), np.ones(1, dtype=bool))
    watchdog.check_parts(np.array([[0.4, 0.207, 0.0]]), np.zeros(1, dtype=bool))  # an absent part
