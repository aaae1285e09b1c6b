"""Custom actions and observations that do not fit, NumPy values in settings, JSON specs, and implausible units."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

import vibgym
from tests.envs.helpers import assert_same, batch, single
from vibgym.envs import ACTIONS, OBSERVATIONS, Action, Observation, VibgymEnv, VibgymVectorEnv
from vibgym.physics.core.drive import phasor_drive, polar_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import TASKS


def seen(array):
    class Custom(Observation):
        space = gym.spaces.Box(-1.0, 1.0, (3,), np.float32)

        def observe(self, measurement, relations, episode):
            return array(len(measurement.pose))

    return Custom


@pytest.mark.parametrize("wrong", [
    lambda worlds: np.zeros((worlds, 4), np.float32),
    lambda worlds: np.zeros((worlds, 3)),
    lambda worlds: [[0.0, 0.0, 0.0]] * worlds,
    lambda worlds: {"state": np.zeros((worlds, 3), np.float32)},
])  # fmt: skip
def test_an_observation_that_does_not_fit_its_space_is_refused(monkeypatch, wrong):
    monkeypatch.setitem(OBSERVATIONS._items, "custom", seen(wrong))
    for env in (single("Align", observation="custom"), batch("Align", 2, observation="custom")):
        with pytest.raises(ValueError, match="observation 'custom'"):
            env.reset(seed=0)


@pytest.mark.parametrize("view", [
    lambda measurement, relations, episode: measurement.pose[:, 0],
    lambda measurement, relations, episode: relations.error.reshape(-1, 3),
    lambda measurement, relations, episode: np.asarray(episode.goal)[:, 0, ::-1],
])  # fmt: skip
def test_an_observation_that_the_next_step_would_change_is_refused(monkeypatch, view):
    class Custom(Observation):
        space = gym.spaces.Box(-9.0, 9.0, (3,), np.float64)

        def observe(self, *arguments):
            return view(*arguments)

    monkeypatch.setitem(OBSERVATIONS._items, "custom", Custom)
    for sensor in ("ideal", "pose"):
        with pytest.raises(ValueError, match="observation 'custom' must be a new array"):
            batch("Align", 2, observation="custom", sensor=sensor).reset(seed=0)


def test_a_dictionary_without_a_key_is_refused(monkeypatch):
    class Custom(seen(lambda worlds: {"a": np.zeros((worlds, 1), np.float32)})):
        space = gym.spaces.Dict({name: gym.spaces.Box(-1.0, 1.0, (1,), np.float32) for name in "ab"})

    monkeypatch.setitem(OBSERVATIONS._items, "custom", Custom)
    with pytest.raises(ValueError, match="observation 'custom'"):
        single("Align", observation="custom").reset(seed=0)


@pytest.mark.parametrize("command", [
    lambda action, worlds: None,
    lambda action, worlds: np.zeros((worlds, 8, 32, 2)),
    lambda action, worlds: phasor_drive(np.zeros((worlds, 8, 32, 2), np.float32), 32, action.full_scale),
    lambda action, worlds: phasor_drive(np.zeros((worlds + 1, 512), np.float32), 32, action.full_scale),
    lambda action, worlds: polar_drive(np.zeros((8, 32)), np.zeros((8, 32)), 1.0),
    lambda action, worlds: polar_drive(np.zeros((worlds, 8, 32)), np.zeros((worlds, 32, 8)), 1.0),
])  # fmt: skip
def test_a_command_that_does_not_fit_the_surface_is_refused(monkeypatch, command):
    class Custom(Action):
        shape = (2,)

        def command(self, values, measurement):
            return command(self, len(values))

    monkeypatch.setitem(ACTIONS._items, "custom", Custom)
    for make in (lambda: single("Align", action="custom"), lambda: batch("Align", 2, action="custom")):
        with pytest.raises(ValueError, match="action 'custom'"):
            make()


def test_classes_that_are_no_action_or_have_no_shape_or_space_are_refused(monkeypatch):
    def command(self, values, measurement):
        raise AssertionError

    for cls in (
        object,
        type("Shapeless", (Action,), {"command": command}),
        type("N", (Action,), {"shape": 3, "command": command}),
    ):
        monkeypatch.setitem(ACTIONS._items, "custom", cls)
        with pytest.raises(ValueError, match="action 'custom'"):
            single("Align", action="custom")
    monkeypatch.setitem(OBSERVATIONS._items, "custom", type("Spaceless", (seen(None),), {"space": None}))
    with pytest.raises(ValueError, match="observation 'custom'"):
        single("Align", observation="custom")


def test_numpy_values_in_settings():
    settings = {"surface": {"rows": np.int64(5), "element_size": np.float64(0.026)}, "periods_per_step": np.int32(2)}
    disc = {"shape": "disc", "radius": np.float64(0.02), "friction": np.float64(0.5)}
    env = single("Align", **settings, parts=[disc]).unwrapped
    assert env.surface.rows == 5 and env.parts[0].friction == 0.5 and env.periods_per_step == 2
    triangle = {"shape": "polygon", "vertices": np.array([[0, 0], [0.05, 0], [0, 0.05]]), "friction": 0.5}
    assert len(single("Align", parts=[triangle]).unwrapped.parts[0].outline) == 3
    with pytest.raises(ValueError, match="rows"):
        single("Align", surface={"rows": np.float64(5.5)})


@pytest.mark.parametrize("part", [
    Part.disc(0.02, friction=0.3), Part.rectangle(0.05, 0.03, friction=0.5, height=0.02, mass=0.1, name="mine"),
])  # fmt: skip
def test_specs_go_through_json(part):
    settings = {"surface": Surface(rows=np.int64(9)), "parts": [part], "randomize": {"friction": np.array([0.9, 1.1])}}
    env = single("Align", action="field", **settings)
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.parts[0].to_dict() == part.to_dict() and again.unwrapped.surface == env.unwrapped.surface
    for _ in range(2):
        first, second = env.reset(seed=3)[0], again.reset(seed=3)[0]
        assert (first == second).all()
    many = batch("Align", 2, **settings)
    assert EnvSpec.from_json(many.spec.to_json()).kwargs["parts"] == [part.to_dict()]
    assert single("Align", **settings).unwrapped.parts[0] is part


@pytest.mark.parametrize("make", [
    lambda: Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=94.5),  # grams
    lambda: Part.disc(0.02, friction=0.5, mass=1e-6),
    lambda: single("Align", sensor={"kind": "pose", "noise": 0.1}),  # millimetres
    lambda: single("Align", sensor={"kind": "pose", "noise": [1e-4, 2.0]}),  # degrees
    lambda: single("Align", sensor={"kind": "ideal", "bias": 0.5}),
])  # fmt: skip
def test_implausible_units_are_warned_of(make):
    with pytest.warns(UserWarning, match="are in"):
        make()


def test_plausible_units_pass_without_a_warning(recwarn):
    Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=0.0945)
    single("Align", sensor={"kind": "pose", "noise": 0.001}, parts=["steel_block"])
    assert not [each for each in recwarn if issubclass(each.category, UserWarning)]
    assert vibgym.Part is Part


@pytest.mark.parametrize("field, value", [
    ("goal", [np.nan, 0.1, 0.0]), ("goal", [5.0, 0.1, 0.0]), ("goal", [0.1, 0.1, np.inf]), ("pose", [-0.1, 0.1, 0.0]),
    ("pose", [0.1, np.nan, 0.0]),
])  # fmt: skip
def test_a_task_that_draws_what_is_not_on_the_surface_is_refused(monkeypatch, field, value):
    class Stray(TASKS["Align"]):
        def start(self, uniform, present=None):
            start = super().start(uniform, present)
            getattr(start, field)[uniform[:, 0] > 0.5] = value
            return start

    monkeypatch.setitem(TASKS._items, "Stray", Stray)
    env = VibgymEnv("Stray", action="field")
    seeds = {np.random.default_rng(seed).random() > 0.5: seed for seed in range(9)}  # one of each kind
    env.reset(seed=seeds[False])
    state = env.core.get_state()
    with pytest.raises(ValueError, match=f"^Stray: {field} must be .*, got"):
        env.reset(seed=seeds[True])
    assert_same(env.core.get_state(), state)
    env.reset(seed=seeds[True], options={"pose": [0.2, 0.1, 0.0], "goal": [0.3, 0.1, 0.0]})
    with pytest.raises(ValueError, match=f"Stray: {field}"):
        VibgymVectorEnv("Stray", 8, action="field").reset(seed=0)


@pytest.mark.parametrize("start", [
    lambda start: start._replace(pose=start.pose[:, 0]), lambda start: start._replace(present=np.ones((1, 1))),
])  # fmt: skip
def test_a_start_of_another_shape_is_refused(monkeypatch, start):
    class Flat(TASKS["Align"]):
        def start(self, uniform, present=None):
            return start(super().start(uniform, present))

    monkeypatch.setitem(TASKS._items, "Flat", Flat)
    with pytest.raises(ValueError, match="Flat: p.* of shape"):
        VibgymEnv("Flat", action="field").reset(seed=0)
