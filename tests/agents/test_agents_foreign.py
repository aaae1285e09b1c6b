"""Models that have ``predict`` alone take part: their action space says what they speak."""

from types import SimpleNamespace

import numpy as np
import pytest

from agents.policy import Foreign, Situation, make_policy
from vibgym import Part, Surface

SITUATION = Situation("Align", Surface(), Part.rectangle(0.05, 0.035, friction=0.58))


class Model:
    """What an SB3 model offers: flat actions in the order of the environment's."""

    def __init__(self, shape):
        self.action_space = SimpleNamespace(shape=shape)

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        size = int(np.prod(self.action_space.shape))
        actions = np.arange(size, dtype=np.float32) + np.asarray(observation)[..., :1]
        return actions, state


@pytest.mark.parametrize(
    ("shape", "action", "expected"),
    [
        ((32,), "patch", (1, 4, 4, 2)),
        ((1, 4, 4, 2), "patch", (1, 4, 4, 2)),
        ((512,), "element", (8, 32, 2)),
        ((6,), "field", (1, 6)),
    ],
)
def test_the_action_space_tells_the_action(shape, action, expected):
    policy = make_policy(Model(shape), SITUATION)
    assert isinstance(policy, Foreign)
    assert (policy.action, policy.observation) == (action, "state")
    single, _ = policy.predict(np.zeros(18, dtype=np.float32))
    batch, _ = policy.predict(np.arange(36, dtype=np.float32).reshape(2, 18))
    assert single.shape == expected and batch.shape == (2, *expected)
    assert (single.ravel() == np.arange(single.size)).all()
    assert (batch[1].ravel() == np.arange(single.size) + 18).all()


@pytest.mark.parametrize("shape", [(7,), None, (4, 4, 2)])
def test_other_spaces_are_refused(shape):
    with pytest.raises(ValueError, match=r"policy: .*'action' and 'observation'"):
        make_policy(Model(shape) if shape else SimpleNamespace(predict=lambda *a: None), SITUATION)
