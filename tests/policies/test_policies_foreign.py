"""Models with ``predict`` only: action and observation follow from their spaces or from settings."""

from types import SimpleNamespace

import gymnasium as gym
import numpy as np
import pytest

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
        for policy in (Model(shape, action=action), {"policy": Model(shape), "action": action}):
            made = make_policy(policy, info_of())
            assert (made.action, made.observation) == (action, "state")
            check_predictions(made, 512)


def test_settings_override_the_model():
    reported = make_policy({"policy": Model((512,), action="element"), "action": "phasor"}, info_of())
    assert reported.action == "phasor"
    assert make_policy({"policy": Model((6,))}, info_of()).action == "field"
    assert make_policy(bare(action="patch"), info_of()).action == "patch"


def bare(**attributes):
    return SimpleNamespace(predict=lambda *arguments: None, **attributes)


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


@pytest.mark.parametrize("task, observation, other, more", [
    ("Align", "goal", "Align", {"action": "patch"}), ("Sort", "parts", "SortTwelve", {}),
    ("Align", "image", "Align", {"surface": {"rows": 4, "columns": 8}}),
])  # fmt: skip
def test_models_of_stable_baselines_are_evaluated(task, observation, other, more):
    sb3 = pytest.importorskip("stable_baselines3")
    from vibgym.adapters.sb3 import VecEnv

    settings = {"action": "field", "observation": observation, "max_episode_steps": 4}
    kind = "CnnPolicy" if observation == "image" else "MultiInputPolicy"
    model = sb3.PPO(
        kind, VecEnv(f"vibgym/{task}-v0", num_envs=2, **settings), n_steps=4, batch_size=8, device="cpu", seed=0
    )
    assert rollout(model, f"vibgym/{task}-v0", seeds=range(2), **settings).steps.tolist() == [4, 4]
    assert rollout(model, task, seeds=range(2), observation=observation, max_episode_steps=4).steps.tolist() == [4, 4]
    env = gym.make(f"vibgym/{task}-v0", **settings)
    policy, (seen, _) = make_policy(model, env), env.reset(seed=0)
    assert (policy.action, policy.observation) == ("field", observation)
    assert (policy.predict(seen)[0] == model.predict(seen, deterministic=True)[0]).all()
    with pytest.raises(ValueError, match="^(policy|action)"):
        rollout(model, other, seeds=[0], **{**settings, **more})
