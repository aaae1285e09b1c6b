"""The control loop on a simulated machine does what the same policy does in the simulated environment."""

import gymnasium as gym
import numpy as np
import pytest

from tests.hardware.helpers import IDEAL, PROTOTYPE, SENSOR, Faulty, Polar, as_image, locate
from vibgym import Part, Surface
from vibgym.actuators import ACTUATORS
from vibgym.envs.actions import Action
from vibgym.hardware import ControlLoop, HardwareEnv, ReplayDriver, SimulatedDriver
from vibgym.hardware.env import Readings, write_motion
from vibgym.hardware.record import Recorder
from vibgym.identification import Excitation, Log, fit
from vibgym.policies import make_policy
from vibgym.policies.task_info import TaskInfo

CYCLES = 40


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setattr(ACTUATORS, "_items", {**ACTUATORS._items, "polar": Polar})


def simulated(task, policy, cycles, seed, **settings):
    """Return poses (cycles + 1, parts, 3) and motion (cycles, 2, rows, columns) of an episode."""
    probe = gym.make(f"vibgym/{task}-v0", **settings)
    policy = make_policy(policy, probe)
    env = gym.make(f"vibgym/{task}-v0", **{**settings, "action": policy.action, "observation": policy.observation})
    observation, _ = env.reset(seed=seed)
    core, surface, state, batches = env.unwrapped.core, env.unwrapped.surface, None, []
    core.pipeline.before.append(batches.append)
    poses, motions = [env.unwrapped.truth.pose[0]], []
    for _ in range(cycles):
        action, state = policy.predict(observation, state, deterministic=True)
        observation = env.step(action)[0]
        motion = np.zeros((2, surface.rows, surface.columns))
        write_motion(core.actuators.compensated(batches[-1].command), surface, *motion)
        motions.append(motion)
        poses.append(env.unwrapped.truth.pose[0])
    return np.array(poses), np.array(motions)


class Watched(SimulatedDriver):
    """A simulated machine that keeps its true poses and the motion it is sent."""

    def __init__(self, *arguments, **settings):
        self.poses, self.motions = [], []
        super().__init__(*arguments, **settings)

    def send(self, amplitude, phase):
        self.motions.append(np.array([amplitude, phase]))
        super().send(amplitude, phase)

    def receive(self):
        measurement = super().receive()
        self.poses.append(self.env.truth.pose[0])
        return measurement


POSE = {"actuators": PROTOTYPE, "sensor": SENSOR, "action": "velocity"}
LOW_RATE = {**SENSOR, "estimator": "kalman", "rate": 12.5}
SCENES = {
    "a controller, ideal": ("Align", "pose", {"actuators": IDEAL, "action": "velocity"}),
    "patches, noise": ("Align", "local_field", {"actuators": IDEAL, "sensor": "pose"}),
    "hardware": ("Align", "pose", POSE),
    "kalman, low rate": ("Align", "local_field", {"actuators": PROTOTYPE, "sensor": LOW_RATE}),
    "two periods a step": ("Align", "pose", {**POSE, "periods_per_step": 2}),
    "a trained policy": ("Align", "learned", {"actuators": PROTOTYPE, "sensor": SENSOR}),
    "several parts": ("Sort", "pose", POSE),
    "a moving goal": ("Follow", "pose", {**POSE, "sensor": {"kind": "ideal", "estimator": "model"}}),
}  # fmt: skip


TURNED = np.stack([np.linspace(0.9, 1.1, 256), np.linspace(-0.4, 0.4, 256)], axis=-1).reshape(8, 32, 2)
COMPENSATED = {"kind": "prototype", "gain": 0.9, "phase": 0.5, "elements": TURNED.tolist(), "compensate": True}
ROUNDED = {
    **{name: SCENES[name] for name in ("hardware", "a trained policy")},
    "compensated elements": ("Align", "local_field", {"actuators": COMPENSATED, "sensor": SENSOR}),
}


@pytest.mark.parametrize("name, exactly", [*((name, True) for name in SCENES), *((name, False) for name in ROUNDED)])
def test_commands_and_poses_are_those_of_the_environment(name, exactly):
    """Bit for bit, if the environment's actuators are given amplitude and phase as well, else except for their rounding."""
    task, policy, settings = (SCENES if exactly else ROUNDED)[name]
    kind = "polar" if exactly else "prototype"
    rounded = {**settings, "actuators": {**settings["actuators"], "kind": kind}}
    poses, motions = simulated(task, policy, CYCLES, 7, **rounded)
    driver = Watched(task, seed=7, **settings)
    outcome = ControlLoop(driver, task, policy, **settings).run(CYCLES, seed=7, beyond=True)
    assert (outcome.reason, outcome.cycles, outcome.missed) == ("cycle limit", CYCLES, 0)
    assert np.ptp(poses, axis=0).max() > 0.01  # something has moved
    np.testing.assert_allclose(driver.poses, poses, rtol=0.0, atol=0.0 if exactly else 1e-11)
    if exactly:
        np.testing.assert_array_equal(driver.motions, motions)
    else:
        np.testing.assert_allclose(np.array(driver.motions)[:, 0], motions[:, 0], rtol=0.0, atol=1e-13)


def test_observations_and_info_are_those_of_the_environment():
    settings = {"action": "field", "actuators": PROTOTYPE, "sensor": {**SENSOR, "report": ["age", "sigma"]}}
    env = gym.make("vibgym/Align-v0", **{**settings, "actuators": {**PROTOTYPE, "kind": "polar"}})
    machine = HardwareEnv(SimulatedDriver("Align", seed=3, **settings), "Align", **settings)
    (seen, _), (measured, _) = env.reset(seed=3), machine.reset(seed=3)
    np.testing.assert_array_equal(measured, seen)
    rng = np.random.default_rng(0)
    for _ in range(10):
        action = rng.uniform(-1, 1, env.action_space.shape).astype(np.float32)
        seen, _, _, _, truth = env.step(action)
        measured, _, _, _, info = machine.step(action)
        np.testing.assert_array_equal(measured, seen)
        np.testing.assert_array_equal(info["measured"]["age"], truth["measured"]["age"])
        np.testing.assert_allclose(info["position_error"], truth["position_error"], atol=0.01)  # of a late, noisy pose
    assert TaskInfo.of(machine).hardware == TaskInfo.of(env).hardware
    assert TaskInfo.of(machine).step_limit == TaskInfo.of(env).step_limit == 250


def test_success_is_that_of_the_measured_part():
    driver = SimulatedDriver("Align", seed=5)
    outcome = ControlLoop(driver, "Align", "pose", action="velocity").run(200, seed=5)
    assert outcome.reason == "success" and outcome.success and driver.info["is_success"]
    assert outcome.cycles == len(outcome.computing) == len(outcome.period) < 200
    assert not driver.env.core.action.amplitude.any()  # the elements are at rest afterwards


def test_goals_can_be_set_and_start_poses_cannot():
    driver = SimulatedDriver("Align", seed=5)
    loop = ControlLoop(driver, "Align", "pose", action="velocity")
    assert loop.run(200, options={"goal": [0.5, 0.1, 0.3]}).success
    np.testing.assert_allclose(driver.env.truth.pose[0, 0, :2], [0.5, 0.1], atol=0.002)
    with pytest.raises(ValueError, match="cannot be set on hardware"):
        loop.env.reset(options={"pose": [0.5, 0.1, 0.3]})


@pytest.mark.parametrize(("task", "settings", "message"), [
    ("Feed", {}, "arrive and leave"), ("AlignShapes", {}, "shapes"), ("Alien", {}, "Alien"),
    ("Align", {"randomize": {"disturbance": {"rate": 1.0, "tilt_deg": 2.0}}}, "disturbance"),
    ("Align", {"costs": {"effort": 1.0}}, "costs"),
    ("Align", {"sensor": {"kind": "ideal", "report": ["contacts"]}}, "contacts"),
])  # fmt: skip
def test_settings_without_a_meaning_on_hardware_are_refused(task, settings, message):
    with pytest.raises(ValueError, match=message):
        HardwareEnv(None, task, **settings)


def test_a_policy_with_another_action_is_refused():
    with pytest.raises(ValueError, match="action"):
        ControlLoop(SimulatedDriver("Align", seed=5), "Align", "local_field", action="field")


def test_headings_continue_over_full_turns():
    readings = Readings(1, 0.04)
    readings.begin(np.array([[0.4, 0.1, 3.0]]), np.zeros(1, dtype=bool), 0.0)
    for k in range(1, 80):
        heading = 3.0 + 0.1 * k
        readings.add(np.array([[0.4, 0.1, (heading + np.pi) % (2.0 * np.pi) - np.pi]]), 0.04 * k)
        assert readings.last.pose[0, 0, 2] == pytest.approx(heading)
        assert readings.last.mean_velocity[0, 0, 2] == pytest.approx(2.5)


def test_velocities_count_the_time_between_samples():
    readings = Readings(2, 0.04)
    readings.begin(np.zeros((2, 3)), np.zeros(2, dtype=bool), 0.0)
    readings.add(np.array([[0.01, 0.0, 0.0], [np.nan] * 3]), 0.04)
    assert readings.last.seen.tolist() == [[True, False]]
    readings.add(np.array([[0.02, 0.0, 0.0], [0.02, 0.0, 0.0]]), 0.08)
    np.testing.assert_allclose(readings.last.mean_velocity[0, :, 0], [0.25, 0.25])


def test_images_are_located():
    """An image whose bytes are the pose: the same run as with the pose itself."""
    settings = {"sensor": "pose", "action": "velocity"}
    poses, images = Faulty(**settings), Faulty(as_image, **settings)
    ControlLoop(poses, "Align", "pose", **settings).run(20, seed=5)
    ControlLoop(images, "Align", "pose", locate=locate, **settings).run(20, seed=5)
    np.testing.assert_array_equal(images.sent, poses.sent)
    assert "locate" in ControlLoop(Faulty(as_image), "Align", "pose", **settings).run(20, seed=5).reason


def test_an_exception_of_the_policy_stops_the_elements():
    class Bad:
        action, observation, calls = "phasor", "state", 0

        def predict(self, observation, state=None, episode_start=None, deterministic=True):
            self.calls += 1
            if self.calls > 6:  # also those of the rehearsal
                raise RuntimeError("bad policy")
            return np.ones(512, dtype=np.float32), None

    driver = SimulatedDriver("Align", seed=5)
    with pytest.raises(RuntimeError, match="bad policy"):
        ControlLoop(driver, "Align", Bad()).run(20)
    assert driver.env.core.simulator.time > 0.0
    assert not driver.env.core.action.amplitude.any()


def test_the_motion_is_that_of_the_phasors():
    env = HardwareEnv(SimulatedDriver("Align", seed=5), "Align", action="phasor")
    action: Action = env.core.action
    values = np.zeros((1, 8, 32, 2), dtype=np.float32)
    values[0, 2, 3], values[0, 4, 5] = (0.0, 0.5), (-3.0, 0.0)
    motion = np.zeros((2, 8, 32))
    write_motion(action.command(values.reshape(1, -1), None), env.surface, *motion)
    most = env.surface.max_amplitude
    assert motion[0, 2, 3] == pytest.approx(0.5 * most) and motion[1, 2, 3] == pytest.approx(np.pi / 2.0)
    assert motion[0, 4, 5] == most and abs(motion[1, 4, 5]) == pytest.approx(np.pi)
    assert np.count_nonzero(motion[0]) == 2


@pytest.mark.parametrize("skip", [{}, {5: 2, 12: 3}], ids=["no missed cycles", "missed cycles"])
def test_a_run_is_recorded_and_replayed(tmp_path, skip):
    settings = {"actuators": PROTOTYPE, "sensor": SENSOR, "action": "velocity"}
    driver = Faulty(skip=skip, **settings)
    outcome = ControlLoop(driver, "Align", "pose", **settings).run(CYCLES, seed=7, record=tmp_path / "run.npz")
    log = Log.load(outcome.log)
    assert outcome.missed == sum(skip.values()) and len(log) == outcome.cycles + 1  # and the stop
    np.testing.assert_array_equal(np.stack([log.amplitude, log.phase], axis=1)[:-1], driver.sent)
    assert not log.amplitude[-1].any()
    assert np.isnan(log.pose).any() and np.isfinite(log.pose).any()  # dropouts

    again, known = ReplayDriver(log), log.settings
    loop = ControlLoop(again, known["task"], "pose", **known["environment"])
    replayed = loop.run(CYCLES, seed=known["seed"], options=known["options"])
    assert (replayed.cycles, replayed.missed, replayed.reason) == (outcome.cycles, outcome.missed, outcome.reason)
    assert np.nanmax(again.difference) == 0.0 and np.isfinite(again.difference).sum() == outcome.cycles

    other = ReplayDriver(log)
    loop = ControlLoop(other, "Align", "local_field", actuators=PROTOTYPE, sensor=SENSOR)
    assert loop.run(100, seed=7, beyond=True).reason == "end of the recording"
    assert np.nanmax(other.difference) > 1e-5


def test_a_run_of_one_cycle_leaves_no_recording(tmp_path):
    driver = Faulty(lambda k, measurement, now: (measurement, -1.0 if k else now))
    outcome = ControlLoop(driver, "Align", "pose", action="velocity").run(9, seed=5, record=tmp_path / "run.npz")
    assert outcome.cycles == 1 and outcome.log is None and not list(tmp_path.iterdir())
    with pytest.raises(ValueError, match="record"):
        ControlLoop(driver, "Align", "pose").run(9, record=tmp_path)


def test_a_simulated_camera_sends_its_images():
    sensor = {"kind": "camera", "delay": 1}
    driver = SimulatedDriver("Align", seed=5, images=True, sensor=sensor)
    env = gym.make("vibgym/Align-v0", action="phasor", observation="camera", sensor=sensor)
    image, _ = env.reset(seed=5)
    rest = np.zeros(env.action_space.shape, dtype=np.float32)
    for _ in range(3):
        measurement = driver.receive()
        assert measurement.pose is None
        np.testing.assert_array_equal(measurement.image, image)
        image = env.step(rest)[0]
    assert measurement.taken == pytest.approx(driver.now() - 0.04)
    with pytest.raises(ValueError, match="camera"):
        SimulatedDriver("Align", images=True)


@pytest.mark.full
def test_the_record_of_a_driver_identifies_its_machine(tmp_path):
    surface, block = Surface(), Part.rectangle(0.05, 0.035, friction=0.52, height=0.02)
    machine = {"kind": "prototype", "gain": 0.9, "latency": 1, "dead_zone": 0.0}
    driver = SimulatedDriver("Align", seed=1, parts=[block], actuators=machine, sensor={"kind": "pose", "delay": 0})
    nominal = {"surface": {}, "actuators": "prototype", "parts": [block.to_dict()]}
    recorder = Recorder(tmp_path / "run.npz", nominal, (surface.rows, surface.columns), 1)
    excitation = Excitation(surface, [block], seed=0)
    for _ in range(900):
        measured = driver.receive()
        amplitude, phase = excitation.command(np.array(measured.pose))
        driver.send(amplitude, phase)
        recorder.add(driver.now(), amplitude, phase, measured.pose, measured.taken)
    path = recorder.save()
    assert path is not None
    nominal_block = Part.rectangle(0.05, 0.035, friction=0.6, height=0.02)
    fitted = fit(Log.load(path), surface, [nominal_block])
    assert fitted.values["latency"] == 1
    assert fitted.values["friction"] == pytest.approx(0.52, rel=0.02)
    assert fitted.values["gain"] == pytest.approx(0.9, rel=0.02)
    assert fitted.values["horizontal_amplitude"] == pytest.approx(surface.horizontal_amplitude, rel=0.01)
