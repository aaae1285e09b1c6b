"""Models with ``predict`` only: action and observation follow from their spaces or from settings."""

import importlib
from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

from tests.envs.helpers import single
from tests.policies.helpers import info_of
from vibgym.policies import rollout
from vibgym.policies.foreign import ModelPolicy
from vibgym.policies.registry import make_policy


class Model:
    """Model with the interface of SB3: flat actions in the order of the environment's."""

    def __init__(self, shape, **attributes):
        self.action_space = SimpleNamespace(shape=shape)
        vars(self).update(attributes)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        size = int(np.prod(self.action_space.shape))
        actions = np.arange(size, dtype=np.float32) + np.asarray(observation)[..., :1]
        return actions.reshape(*np.shape(observation)[:-1], *self.action_space.shape), state


def check_predictions(policy, size):
    one, _ = policy.predict(np.zeros(18, dtype=np.float32))
    many, _ = policy.predict(np.arange(36, dtype=np.float32).reshape(2, 18))
    assert one.shape == (size,) and many.shape == (2, size)
    assert (one == np.arange(size)).all() and (many[1] == np.arange(size) + 18).all()


@pytest.mark.parametrize(
    "shape, action", [((32,), "patch"), ((1, 4, 4, 2), "patch"), ((6,), "field"), ((1, 6), "field")]
)
def test_the_action_space_determines_the_action(shape, action):
    policy = make_policy(Model(shape), info_of())
    assert isinstance(policy, ModelPolicy) and (policy.action, policy.observation) == (action, "state")
    check_predictions(policy, int(np.prod(shape)))


@pytest.mark.parametrize("shape", [(512,), (8, 32, 2)])
def test_ambiguous_action_spaces_require_a_setting(shape):
    with pytest.raises(ValueError, match=r"policy") as error:
        make_policy(Model(shape), info_of())
    assert "\n" not in str(error.value)
    for action in ("element", "phasor"):
        for made in (
            make_policy(Model(shape, action=action), info_of()),  # was once always taken for "element"
            make_policy({"policy": Model(shape), "action": action}, info_of()),
            ModelPolicy(Model(shape), info_of(), action=action),
        ):
            assert (made.action, made.observation) == (action, "state")
            check_predictions(made, 512)


def test_settings_override_the_model():
    reported = make_policy({"policy": Model((512,), action="element"), "action": "phasor"}, info_of())
    assert reported.action == "phasor"
    assert make_policy({"policy": Model((6,))}, info_of()).action == "field"


def bare(**attributes):
    return SimpleNamespace(predict=lambda *arguments: None, **attributes)


def test_models_without_spaces_may_name_action_and_observation():
    assert make_policy(bare(action="patch"), info_of()).action == "patch"


@pytest.mark.parametrize("policy, named", [
    (Model((7,)), "policy"), (bare(), "policy"), (Model((6,), action="patch"), "policy"),
    (Model((6,), action="swing"), "policy.action"), ({"policy": Model((512,)), "action": "field"}, "policy"),
    ({"policy": Model((6,)), "colour": 1}, "policy"), ({"policy": 3}, "policy"),
    (Model((6,), observation="smell"), "policy.observation"),
    (Model((6,), observation_space=SimpleNamespace(shape=(120,))), "policy"),
])  # fmt: skip
def test_models_that_do_not_fit_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, info_of())
    assert "\n" not in str(error.value)


# -- models of Stable-Baselines3 ---------------------------------------------------------------------------------------


def sb3_env(*arguments, **settings):
    return importlib.import_module("vibgym.adapters.sb3").VecEnv(*arguments, **settings)


def test_a_goal_conditioned_model_is_evaluated():
    """SAC with hindsight replay reads the goal dictionary."""
    sb3 = pytest.importorskip("stable_baselines3")
    env = sb3_env("vibgym/Align-v0", num_envs=2, action="field", observation="goal", max_episode_steps=8)
    model = sb3.SAC(
        "MultiInputPolicy", env, replay_buffer_class=sb3.HerReplayBuffer, learning_starts=20, buffer_size=200, batch_size=8,
        policy_kwargs={"net_arch": [8]}, device="cpu", seed=0,
    )  # fmt: skip
    model.learn(40)
    policy = make_policy(model, single("Align", action="field", observation="goal"))
    assert (policy.action, policy.observation) == ("field", "goal")
    for more in ({"observation": "goal"}, {}, {"action": "field"}):
        found = rollout(model, "vibgym/Align-v0", seeds=range(3), max_episode_steps=5, **more)
        assert (found.steps <= 5).all()
    alone = gym.make("vibgym/Align-v0", action="field", observation="goal")
    seen, _ = alone.reset(seed=0)
    assert (policy.predict(seen)[0] == model.predict(seen, deterministic=True)[0]).all()


@pytest.mark.parametrize("task, observation", [("Sort", "parts"), ("Align", "image")])
def test_models_of_parts_and_of_images_are_evaluated(task, observation):
    sb3 = pytest.importorskip("stable_baselines3")
    settings = {"action": "field", "observation": observation, "max_episode_steps": 4}
    env = sb3_env(f"vibgym/{task}-v0", num_envs=2, **settings)
    kind = "CnnPolicy" if observation == "image" else "MultiInputPolicy"
    kwargs = {} if observation == "image" else {"net_arch": [8]}
    model = sb3.PPO(kind, env, n_steps=4, batch_size=8, n_epochs=1, policy_kwargs=kwargs, device="cpu", seed=0)
    model.learn(8)
    found = rollout(model, f"vibgym/{task}-v0", seeds=range(2), **settings)
    assert found.steps.tolist() == [4, 4]
    alone = gym.make(f"vibgym/{task}-v0", **settings)
    seen, _ = alone.reset(seed=0)
    action, _ = make_policy(model, alone).predict(seen)
    assert action.shape == alone.action_space.shape
    with pytest.raises(ValueError, match="policy"):  # another scene
        rollout(model, "vibgym/SortTwelve-v0" if task == "Sort" else "vibgym/Align-v0", seeds=[0],
                **(settings | ({"surface": {"rows": 4, "columns": 8}} if observation == "image" else {})))  # fmt: skip
