"""Models that have ``predict`` alone take part: their spaces, or their owner, say what they speak."""

from types import SimpleNamespace

import numpy as np
import pytest

from tests.envs.helpers import single
from tests.policies.helpers import info_of
from vibgym.policies.foreign import ModelPolicy
from vibgym.policies.registry import make_policy


class Model:
    """What an SB3 model offers: flat actions in the order of the environment's."""

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
def test_the_action_space_tells_the_action(shape, action):
    policy = make_policy(Model(shape), info_of())
    assert isinstance(policy, ModelPolicy) and (policy.action, policy.observation) == (action, "state")
    check_predictions(policy, int(np.prod(shape)))


@pytest.mark.parametrize("shape", [(512,), (8, 32, 2)])
def test_a_model_whose_actions_could_mean_two_things_must_be_told_which(shape):
    with pytest.raises(ValueError, match=r"policy") as error:
        make_policy(Model(shape), info_of())
    assert "\n" not in str(error.value)
    for action in ("element", "phasor"):
        for made in (
            make_policy(Model(shape, action=action), info_of()),  # was taken for "element" whatever it said
            make_policy({"policy": Model(shape), "action": action}, info_of()),
            ModelPolicy(Model(shape), info_of(), action=action),
        ):
            assert (made.action, made.observation) == (action, "state")
            check_predictions(made, 512)


def test_what_the_owner_says_goes_before_what_the_model_says():
    told = make_policy({"policy": Model((512,), action="element"), "action": "phasor"}, info_of())
    assert told.action == "phasor"
    assert make_policy({"policy": Model((6,))}, info_of()).action == "field"


def test_models_act_in_the_environment():
    env = single("Align", action="phasor")
    seen, _ = env.reset(seed=0)
    action, _ = make_policy(Model((8, 32, 2), action="phasor"), info_of()).predict(seen)
    assert action.shape == env.action_space.shape
    env.step(action)


def bare(**attributes):
    return SimpleNamespace(predict=lambda *arguments: None, **attributes)


def test_a_model_without_spaces_that_says_what_it_speaks_is_believed():
    assert make_policy(bare(action="patch"), info_of()).action == "patch"


@pytest.mark.parametrize("policy, named", [
    (Model((7,)), r"policy: .*\(7,\).*'action' and 'observation'"), (Model((4, 4, 2)), r"policy: .*\(4, 4, 2\)"),
    (bare(), "policy: .*'action' and 'observation'"),
    (Model((6,), action="patch"), r"policy: .*\(6,\).*'patch': \(32,\)"),
    (Model((6,), action="swing"), "policy.action: .*swing.*'element', 'phasor'"),
    ({"policy": Model((512,)), "action": "field"}, r"policy: .*\(512,\).*'field': \(6,\)"),
    ({"policy": Model((6,)), "colour": 1}, "policy: .*'policy'.*'action'"), ({"policy": 3}, "policy: .*predict"),
    (Model((6,), observation="image"), "policy.observation: .*image.*'state'"),
    (Model((6,), observation_space=SimpleNamespace(shape=(120,))), r"policy: .*\(120,\).*\(18,\).*Align"),
])  # fmt: skip
def test_models_that_do_not_fit_are_refused(policy, named):
    with pytest.raises(ValueError, match=named) as error:
        make_policy(policy, info_of())
    assert "\n" not in str(error.value)
