"""Actuators: latency, custom ones, and every effect of the prototype against its definition."""

import math

import gymnasium as gym
import numpy as np
import pytest

from vibgym import Surface
from vibgym.actuators import ACTUATORS, Actuators
from vibgym.physics.core.drive import all_phasors, polar_drive

SURFACE = Surface(rows=3, columns=4)
W2 = SURFACE.angular_frequency**2
PLAIN = {"dead_zone": 0.0, "latency": 0, "gain_spread": 0.0, "phase_spread": 0.0}


class Weak(Actuators):
    """Actuators that execute a share of the command, drawn for each episode."""

    class Settings(Actuators.Settings):
        least: float = 0.5

    draws = 1

    def __init__(self, *scene, **base):
        super().__init__(*scene, **base)
        self.share = np.ones((self.worlds, 1))

    def begin(self, worlds, uniform):
        self.share[worlds] = self.settings.least + (1.0 - self.settings.least) * uniform

    def realise(self, phasors):
        phasors *= self.share[:, :, None, None]

    def custom_state(self):
        return {"share": self.share}


@pytest.fixture(autouse=True)
def named(monkeypatch):
    monkeypatch.setattr(ACTUATORS, "_items", {**ACTUATORS._items, "weak": Weak})


def batch(worlds, actuators="ideal", **settings):
    settings = {"action": "phasor", **settings}
    return gym.make_vec("vibgym/Align-v0", num_envs=worlds, actuators=actuators, **settings).unwrapped


def random_actions(env, steps, seed=1):
    return np.random.default_rng(seed).uniform(-1, 1, (steps, *env.action_space.shape)).astype(np.float32)


def test_exact_actuators_without_latency_equal_ideal_ones():
    """Equal up to rounding, since the motion is stored as amplitude and phase."""
    ideal, faithful = batch(3), batch(3, {"kind": "weak", "least": 1.0})
    ideal.reset(seed=5), faithful.reset(seed=5)
    for action in random_actions(ideal, 8):
        ideal.step(action), faithful.step(action)
        assert faithful.phasors(1) == pytest.approx(ideal.phasors(1), abs=1e-12)
    assert faithful.truth.pose == pytest.approx(ideal.truth.pose, abs=1e-8)


@pytest.mark.parametrize("periods, latency", [(1, 1), (1, 3), (4, 1), (4, 4), (4, 6), (3, 7)])
def test_commands_take_effect_after_the_latency(periods, latency):
    """Compare with environments of one period per step that get the delayed commands, at rest at first."""
    slow = batch(2, {"kind": "weak", "least": 1.0, "latency": latency}, periods_per_step=periods)
    fine = batch(2, {"kind": "weak", "least": 1.0})
    slow.reset(seed=5), fine.reset(seed=5)
    actions = random_actions(slow, 6)
    for step, action in enumerate(actions):
        slow.step(action)
        for period in range(periods):
            acting = (step * periods + period - latency) // periods
            fine.step(actions[acting] if acting >= 0 else np.zeros_like(action))
        assert (slow.truth.pose == fine.truth.pose).all(), step


def test_a_reset_brings_the_elements_of_its_world_to_rest():
    env = batch(2, {"kind": "weak", "latency": 2}, autoreset_mode="Disabled")
    env.reset(seed=5)
    action = np.ones(env.action_space.shape, dtype=np.float32)
    for _ in range(3):
        env.step(action)
    assert all(np.abs(env.phasors(world)).max() > 0.1 for world in (0, 1))
    env.reset(options={"reset_mask": np.array([True, False])})
    env.step(action)
    assert np.abs(env.phasors(0)).max() == 0.0 and np.abs(env.phasors(1)).max() > 0.1


def test_estimators_use_the_mean_of_drawn_actuators(monkeypatch):
    """The nominal value is the mean of the drawn range."""
    monkeypatch.setattr(Weak, "nominal", lambda self: Weak(self.surface, self.worlds, self.periods), raising=False)
    env = batch(2, "weak", sensor={"kind": "ideal", "estimator": "model"})
    env.reset(seed=1)
    assert (env.core.sensing.estimator._predictor._plant.share == 0.75).all()
    env.step(random_actions(env, 1)[0])


# -- the prototype -------------------------------------------------------------------------------------------------------


def prototype(worlds=1, periods=1, **settings):
    return ACTUATORS.make("actuators", {"kind": "prototype", **PLAIN, **settings}, SURFACE, worlds, periods)


def made(worlds=1, periods=1, **settings):
    """Actuators with an episode begun."""
    own = prototype(worlds, periods, **settings)
    own.prepare(command(worlds, 0.0))
    own.reset(np.arange(worlds), np.full((worlds, own.draws), 0.5))
    return own


def command(worlds, amplitude, phase=0.0):
    shape = (worlds, SURFACE.rows, SURFACE.columns)
    return polar_drive(np.broadcast_to(amplitude, shape).copy(), np.broadcast_to(phase, shape).copy(), math.sqrt(W2))


def done(own, commanded):
    """Return amplitudes (m) and phases (stretches, worlds, rows, columns) in a step, and the periods of each stretch."""
    amplitudes, phases, lengths = [], [], []
    for drive, periods in own.apply(commanded):
        phasors = np.empty((own.worlds, SURFACE.rows, SURFACE.columns, 2))
        all_phasors(drive, phasors)
        amplitudes.append(np.hypot(phasors[..., 0], phasors[..., 1]) / W2)
        phases.append(np.arctan2(phasors[..., 1], phasors[..., 0]))
        lengths.append(periods)
    return np.array(amplitudes), np.array(phases), lengths


ASKED = np.linspace(0.0, 0.39e-3, 12).reshape(3, 4)


@pytest.mark.parametrize("form, below", [
    ("hard", lambda a, d: 0.0 * a), ("soft", lambda a, d: a**2 / d), ("cubic", lambda a, d: a**3 / d**2),
])  # fmt: skip
def test_dead_zone(form, below):
    amplitude, _, _ = done(made(dead_zone=1e-4, dead_zone_form=form), command(1, ASKED))
    assert amplitude[0, 0] == pytest.approx(np.where(ASKED < 1e-4, below(ASKED, 1e-4), ASKED), abs=1e-15)


def test_response_of_one_machine_after_the_dead_zone():
    rng = np.random.default_rng(0)
    elements = np.stack([rng.uniform(0.8, 1.1, (3, 4)), rng.uniform(-0.2, 0.2, (3, 4))], axis=-1)
    own = made(worlds=2, dead_zone=1e-4, gain=0.9, phase=0.3, elements=elements.tolist())
    amplitude, phase, _ = done(own, command(2, ASKED, 1.0))
    expected = np.where(ASKED < 1e-4, 0.0, 0.9 * elements[..., 0] * ASKED)
    assert amplitude[0, 1] == pytest.approx(expected, abs=1e-12)
    assert phase[0, 1, expected > 0] == pytest.approx((1.3 + elements[..., 1])[expected > 0])
    # An estimator's model has the response of the machine.
    assert own.nominal().settings == own.settings.model_copy(update={"limit": SURFACE.max_amplitude, "seed": 0})


@pytest.mark.parametrize("form", ["hard", "soft", "cubic"])
@pytest.mark.parametrize("latency", [0, 2])
def test_a_compensated_response_moves_elements_as_commanded(form, latency):
    rng = np.random.default_rng(1)
    elements = np.stack([1.0 + 0.1 * rng.standard_normal((3, 4)), 0.3 * rng.standard_normal((3, 4))], axis=-1)
    machine = {"gain": 0.8, "phase": 0.5, "elements": elements.tolist(), "dead_zone": 0.05e-3, "dead_zone_form": form}
    own = made(**machine, latency=latency, compensate=True)
    asked = command(1, 0.2e-3, 1.0)
    for _ in range(latency + 1):
        amplitude, phase, _ = done(own, asked)
    assert amplitude[0, 0] == pytest.approx(0.2e-3, rel=1e-9) and phase[0, 0] == pytest.approx(1.0)
    model = own.nominal()  # an estimator's, without latency
    model.prepare(asked)
    model.reset(np.arange(1), np.full((1, model.draws), 0.5))
    amplitude, phase, _ = done(model, asked)
    assert amplitude[0, 0] == pytest.approx(0.2e-3, rel=1e-9) and phase[0, 0] == pytest.approx(1.0)
    plain = made(**machine)
    amplitude, phase, _ = done(plain, plain.compensated(asked))  # without the setting nothing is compensated
    assert amplitude[0, 0] == pytest.approx(0.8 * elements[..., 0] * 0.2e-3)
    assert phase[0, 0] == pytest.approx(1.5 + elements[..., 1])


def test_the_limits_of_compensated_elements_are_on_the_data_sheet():
    elements = [[[0.5, 0.0], [1.5, 0.0], [1.0, 0.2], [0.0, 0.0]]] * 3  # the last of each row is dead
    own = made(gain=0.8, elements=elements, dead_zone=0.1e-3, limit=0.3e-3, resolution=1e-6, compensate=True)
    sheet = own.data_sheet
    assert (sheet.limit, sheet.dead_zone, sheet.resolution) == pytest.approx((0.24e-3, 0.08e-3, 0.8e-6))
    amplitude, _, _ = done(own, command(1, sheet.dead_zone))
    # The weak element moves as commanded. Strong ones would rest at such a command: they move as little as they can.
    assert amplitude[0, 0, 0] == pytest.approx([0.08e-3, 0.121e-3, 0.081e-3, 0.0], rel=0.02)
    below, _, _ = done(own, command(1, 0.9 * sheet.dead_zone))
    assert below[0, 0, 0] == pytest.approx([0.072e-3, 0.0, 0.0, 0.0], rel=0.02)
    with pytest.raises(ValueError, match="gain"):
        made(gain=0.0, compensate=True)


def test_limit_and_resolution():
    amplitude, _, _ = done(made(limit=0.25e-3, resolution=1e-5), command(1, ASKED))
    assert amplitude[0, 0] == pytest.approx(np.minimum(np.round(ASKED / 1e-5) * 1e-5, 0.25e-3), abs=1e-15)


def test_spread_is_normal_and_the_elements_own():
    own = made(worlds=60, gain_spread=0.05, phase_spread=0.1)
    uniform = np.random.default_rng(1).random((60, own.draws))
    uniform[1] = uniform[0]
    own.reset(np.arange(60), uniform)
    amplitude, phase, _ = done(own, command(60, 2e-4, 0.5))
    gain, turn = amplitude[0] / 2e-4, phase[0] - 0.5
    n = gain.size
    assert abs(gain.mean() - 1.0) < 4 * 0.05 / math.sqrt(n) and abs(turn.mean()) < 4 * 0.1 / math.sqrt(n)
    assert abs(gain.std() / 0.05 - 1.0) < 4 / math.sqrt(2 * n) and abs(turn.std() / 0.1 - 1.0) < 4 / math.sqrt(2 * n)
    assert len(np.unique(gain[0])) == 12
    assert (gain[0] == gain[1]).all()  # the same draws of the world's generator
    again, _, _ = done(own, command(60, 1e-4, 0.5))
    assert again[0] == pytest.approx(0.5 * amplitude[0])  # a gain stays for the episode


def test_gains_are_limited_to_the_largest_amplitude():
    amplitude, _, _ = done(made(worlds=50, gain_spread=0.3), command(50, SURFACE.max_amplitude))
    assert amplitude.max() == pytest.approx(SURFACE.max_amplitude) and (amplitude > 0.999 * SURFACE.max_amplitude).any()


def test_faults_one_by_one():
    own = made(dead=[[0, 1]], stuck=[[2, 3, 1e-4, 0.7]])
    amplitude, phase, _ = done(own, command(1, 2e-4, 0.1))
    expected = np.full((3, 4), 2e-4)
    expected[0, 1], expected[2, 3] = 0.0, 1e-4
    assert amplitude[0, 0] == pytest.approx(expected, abs=1e-15) and phase[0, 0, 2, 3] == pytest.approx(0.7)
    assert done(own, command(1, 0.0))[0][0, 0, 2, 3] == pytest.approx(1e-4)  # for any command


def test_shares_of_faults():
    own = prototype(500, dead=0.2, stuck=0.1)
    own.prepare(command(500, 0.0))
    own.reset(np.arange(500), np.random.default_rng(0).random((500, own.draws)))
    amplitude, _, _ = done(own, command(500, 2e-4))
    n = amplitude.size
    dead, sound = (amplitude == 0.0).sum() / n, (np.abs(amplitude - 2e-4) < 1e-15).sum() / n
    assert abs(dead - 0.2) < 4 * math.sqrt(0.2 * 0.8 / n) and abs(sound - 0.7) < 4 * math.sqrt(0.7 * 0.3 / n)


@pytest.mark.parametrize("periods", [1, 3])
def test_latencies_that_differ_from_world_to_world(periods):
    many = prototype(4, periods)
    many.vary({"latency": [0, 5]})
    many.prepare(command(4, 0.0))
    uniform = np.array([0.1, 0.99, 0.4, 0.6])[:, None].repeat(many.draws, axis=1)
    many.reset(np.arange(4), uniform)
    latencies = many.drawn()["latency"]
    assert latencies.tolist() == [0, 5, 2, 3]
    one = [made(periods=periods, latency=int(latency)) for latency in latencies]
    for step in range(5):
        commanded = 1e-5 * (step + 1)
        amplitude, _, lengths = done(many, command(4, commanded))
        together = np.repeat(amplitude[:, :, 0, 0], lengths, axis=0)
        for world, own in enumerate(one):
            amplitude, _, lengths = done(own, command(1, commanded))
            assert together[:, world] == pytest.approx(np.repeat(amplitude[:, 0, 0, 0], lengths), abs=1e-18)


def test_bandwidth_is_a_lag_of_first_order():
    """Means over periods of the step response 1 - exp(-2 pi B t)."""
    own = made(periods=2, bandwidth=3.0)
    amplitude = np.concatenate([done(own, command(1, 2e-4))[0][:, 0, 1, 1] for _ in range(4)])
    rate = 2 * math.pi * 3.0 * SURFACE.period
    k = np.arange(8)
    expected = 1.0 - np.exp(-rate * k) * (1.0 - math.exp(-rate)) / rate
    assert amplitude == pytest.approx(2e-4 * expected, rel=1e-12)


def test_hardware_with_a_seed_is_the_same_in_all_worlds_and_episodes():
    env = gym.make_vec("vibgym/Align-v0", num_envs=3, actuators={"kind": "prototype", "seed": 4}).unwrapped
    env.reset(seed=0)
    first = env.core.actuators.elements
    env.reset(seed=9)
    assert (env.core.actuators.elements == first).all() and (first[0] == first[1]).all()
    other = gym.make_vec("vibgym/Align-v0", num_envs=3, actuators={"kind": "prototype", "seed": 5}).unwrapped
    other.reset(seed=0)
    assert (other.core.actuators.elements != first).any()


def test_the_data_sheet_contains_nominal_values_only():
    own = made(dead_zone=5e-5, dead_zone_form="soft", limit=2e-4, latency=3, gain_spread=0.1, dead=0.1, resolution=1e-6)
    sheet = own.data_sheet
    assert (sheet.dead_zone, sheet.dead_zone_form, sheet.limit) == (5e-5, "soft", 2e-4)
    assert (sheet.latency, sheet.resolution, sheet.bandwidth) == (3, 1e-6, None)
    model = own.nominal()
    model.prepare(command(1, 0.0))
    model.reset(np.arange(1), np.zeros((1, 0)))
    amplitude, _, _ = done(model, command(1, ASKED))
    expected = np.minimum(np.where(ASKED < 5e-5, ASKED**2 / 5e-5, ASKED), 2e-4)
    assert amplitude[0, 0] == pytest.approx(expected, abs=1e-6)
