"""Custom actions, observations and tasks that do not fit, NumPy values in settings, JSON specs, and implausible units."""

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec

from tests.envs.helpers import assert_same, batch, single
from vibgym.envs import ACTIONS, OBSERVATIONS, Action, Observation, VibgymEnv, VibgymVectorEnv
from vibgym.physics.core.drive import phasor_drive, polar_drive
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.tasks import TASKS

BOX = gym.spaces.Box(-9.0, 9.0, (3,), np.float32)
OF_TWO = gym.spaces.Dict({name: gym.spaces.Box(-1.0, 1.0, (1,), np.float32) for name in "ab"})


def custom_observation(space, observe):
    """Return an observation class; ``observe`` is called with measurement, relations and episode."""
    return type("Custom", (Observation,), {"space": space, "observe": lambda self, *live: observe(*live)})


@pytest.mark.parametrize("space, observe", [
    (BOX, lambda now, *_: np.zeros((len(now.pose), 4), np.float32)),
    (BOX, lambda now, *_: np.zeros((len(now.pose), 3))),
    (BOX, lambda now, *_: [[0.0, 0.0, 0.0]] * len(now.pose)),
    (BOX, lambda now, *_: {"state": np.zeros((len(now.pose), 3), np.float32)}),
    (OF_TWO, lambda now, *_: {"a": np.zeros((len(now.pose), 1), np.float32)}),
    (None, lambda now, *_: None),
    # Views of live arrays, which the next step would change.
    (gym.spaces.Box(-9.0, 9.0, (3,), np.float64), lambda now, relations, episode: now.pose[:, 0]),
    (gym.spaces.Box(-9.0, 9.0, (3,), np.float64), lambda now, relations, episode: relations.error.reshape(-1, 3)),
    (gym.spaces.Box(-9.0, 9.0, (3,), np.float64), lambda now, relations, episode: np.asarray(episode.goal)[:, 0, ::-1]),
])  # fmt: skip
def test_an_observation_that_does_not_fit_its_space_is_refused(monkeypatch, space, observe):
    monkeypatch.setitem(OBSERVATIONS._items, "custom", custom_observation(space, observe))
    for make in (single, lambda task, **settings: batch(task, 2, **settings)):
        for sensor in ("ideal", "pose"):
            with pytest.raises(ValueError, match="observation 'custom'"):
                make("Align", observation="custom", sensor=sensor).reset(seed=0)


@pytest.mark.parametrize("shape, command", [
    ((2,), lambda action, worlds: None),
    ((2,), lambda action, worlds: np.zeros((worlds, 8, 32, 2))),
    ((2,), lambda action, worlds: phasor_drive(np.zeros((worlds, 8, 32, 2), np.float32), 32, action.full_scale)),
    ((2,), lambda action, worlds: phasor_drive(np.zeros((worlds + 1, 512), np.float32), 32, action.full_scale)),
    ((2,), lambda action, worlds: polar_drive(np.zeros((8, 32)), np.zeros((8, 32)), 1.0)),
    ((2,), lambda action, worlds: polar_drive(np.zeros((worlds, 8, 32)), np.zeros((worlds, 32, 8)), 1.0)),
    (3, lambda action, worlds: None),
])  # fmt: skip
def test_a_command_that_does_not_fit_the_surface_is_refused(monkeypatch, shape, command):
    members = {"shape": shape, "command": lambda self, values, measurement: command(self, len(values))}
    monkeypatch.setitem(ACTIONS._items, "custom", type("Custom", (Action,), members))
    for make in (single, lambda task, **settings: batch(task, 2, **settings)):
        with pytest.raises(ValueError, match="action 'custom'"):
            make("Align", action="custom")


def test_a_class_that_is_no_action_is_refused(monkeypatch):
    for cls in (object, type("Shapeless", (Action,), {"command": lambda self, values, measurement: None})):
        monkeypatch.setitem(ACTIONS._items, "custom", cls)
        with pytest.raises(ValueError, match="action 'custom'"):
            single("Align", action="custom")


@pytest.mark.parametrize("part", [
    Part.disc(0.02, friction=0.3), Part.rectangle(0.05, 0.03, friction=0.5, height=0.02, mass=0.1, name="mine"),
])  # fmt: skip
def test_objects_and_numpy_values_go_through_json(part):
    settings = {
        "surface": Surface(rows=np.int64(9)), "parts": [part], "randomize": {"friction": np.array([0.9, 1.1])},
        "periods_per_step": np.int32(2),
    }  # fmt: skip
    env = single("Align", action="field", **settings)
    assert env.unwrapped.parts[0] is part and env.unwrapped.periods_per_step == 2
    again = gym.make(EnvSpec.from_json(env.spec.to_json()))
    assert again.unwrapped.parts[0].to_dict() == part.to_dict() and again.unwrapped.surface == env.unwrapped.surface
    assert (env.reset(seed=3)[0] == again.reset(seed=3)[0]).all()
    many = batch("Align", 2, **settings)
    assert EnvSpec.from_json(many.spec.to_json()).kwargs["parts"] == [part.to_dict()]
    triangle = {"shape": "polygon", "vertices": np.array([[0, 0], [0.05, 0], [0, 0.05]]), "friction": np.float64(0.5)}
    assert len(single("Align", surface={"rows": np.int64(5)}, parts=[triangle]).unwrapped.parts[0].outline) == 3


@pytest.mark.parametrize("make, implausible", [
    (lambda: Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=94.5), True),  # grams
    (lambda: Part.rectangle(0.05, 0.035, friction=0.58, height=0.02, mass=0.0945), False),
    (lambda: Part.disc(0.02, friction=0.5, mass=1e-6), True),
    (lambda: single("Align", sensor={"kind": "pose", "noise": 0.1}), True),  # millimetres
    (lambda: single("Align", sensor={"kind": "pose", "noise": 0.001}), False),
    (lambda: single("Align", sensor={"kind": "pose", "noise": [1e-4, 2.0]}), True),  # degrees
    (lambda: single("Align", sensor={"kind": "ideal", "bias": 0.5}), True),
])  # fmt: skip
def test_implausible_units_are_warned_of(make, implausible, recwarn):
    make()
    assert any("are in" in str(warning.message) for warning in recwarn) == implausible


@pytest.mark.parametrize("field, value", [
    ("goal", [np.nan, 0.1, 0.0]), ("goal", [5.0, 0.1, 0.0]), ("goal", [0.1, 0.1, np.inf]), ("pose", [-0.1, 0.1, 0.0]),
    ("pose", [0.1, np.nan, 0.0]), ("pose", None), ("present", None),
])  # fmt: skip
def test_a_task_that_draws_what_is_not_on_the_surface_is_refused(monkeypatch, field, value):
    """Or another shape or type, in half of the episodes."""

    class Stray(TASKS["Align"]):
        def start(self, uniform, present=None):
            start = super().start(uniform, present)
            if value is not None:
                getattr(start, field)[uniform[:, 0] > 0.5] = value
                return start
            return start._replace(**{field: np.ones((len(uniform), 1))}) if uniform[0, 0] > 0.5 else start

    monkeypatch.setitem(TASKS._items, "Stray", Stray)
    env = VibgymEnv("Stray", action="field")
    seeds = {np.random.default_rng(seed).random() > 0.5: seed for seed in range(9)}  # one of each kind
    env.reset(seed=seeds[False])
    state = env.core.get_state()
    with pytest.raises(ValueError, match=f"^Stray: {field} must be .*, got"):
        env.reset(seed=seeds[True])
    assert_same(env.core.get_state(), state)
    if value is not None:
        env.reset(seed=seeds[True], options={"pose": [0.2, 0.1, 0.0], "goal": [0.3, 0.1, 0.0]})
        with pytest.raises(ValueError, match=f"Stray: {field}"):
            VibgymVectorEnv("Stray", 8, action="field").reset(seed=0)
