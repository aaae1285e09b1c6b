"""Imitation: a network learns what an expert does in few steps, the same for the same seed."""

import numpy as np
import pytest
import torch

from agents.actor_critic import ActorCritic
from agents.imitation import Imitation, ImitationSettings
from agents.networks import trained_tensors
from agents.training_settings import NetworkSettings
from tests.envs.helpers import batch
from tests.policies.trained.helpers import coding_for
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.trained import TrainedPolicy

WORLDS = 8


class TowardsTheGoal:
    """A simple law: uniform motion towards the goal; it stores its arguments."""

    action, observation = "field", "state"

    def __init__(self, info):
        self.way = next(row.start for row in info.layout.rows if row.name == "way_coarse")
        self.asked = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        self.asked.append((observation.copy(), state, episode_start.copy()))
        action = np.zeros((len(observation), 6), dtype=np.float32)
        action[:, :2] = 0.8 * observation[:, self.way : self.way + 2]
        return action, len(self.asked)


class Answering(TowardsTheGoal):
    """The same in accelerations; it stores the applied actions."""

    action = "wrench"

    def __init__(self, info):
        super().__init__(info)
        self.applied = []

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        action, state = super().predict(observation, state, episode_start)
        return action[:, :3], state

    def acted(self, memory, proposed, done):
        self.applied.append((proposed.copy(), done.copy()))
        return memory + 0.5


def imitation_of(seed=5, turned=False, history=False, made=TowardsTheGoal, **settings):
    env = batch(
        "Transport", WORLDS, action=made.action, observation="parts", autoreset_mode="SameStep", max_episode_steps=30
    )
    coding = coding_for(TaskInfo.of(env), made.action, turned=turned, history=history)
    torch.manual_seed(seed)
    policy = ActorCritic(coding, NetworkSettings(net=[32], critic_net=[8], attention=4), log_std=-0.5)
    expert = made(TaskInfo.of(env))
    own = {"rounds": 3, "steps": 40, "epochs": 6, "batch_size": 64, "learning_rate": 0.01, **settings}
    return Imitation(policy, [(expert, env)], ImitationSettings(expert="pose", **own), seed), expert, coding


@pytest.mark.parametrize("turned", [False, True])
def test_a_network_learns_a_law_from_few_steps(turned):
    imitation, expert, coding = imitation_of(turned=turned)
    errors = list(imitation.rounds())
    assert len(errors) == 3 and imitation.steps == 3 * 40 * WORLDS and coding.turned is turned
    assert errors[-1] < 5e-3 and errors[-1] < 0.5 * errors[0]
    # On new observations its action in the scene is the law's.
    env = batch("Transport", 200, action="field", observation="parts")
    seen, _ = env.reset(seed=9000)
    wanted, _ = expert.predict(env.observed("state"), None, np.ones(200, bool))
    acting = TrainedPolicy(trained_tensors(imitation.policy.actor), "parts", "tanh", coding)
    action, _ = acting.predict(seen)
    assert np.sqrt(((action - wanted) ** 2).mean()) < 0.3 * np.sqrt((wanted**2).mean())


def test_experts_receive_their_memory_and_starts_of_episodes_and_only_the_mean_learns():
    """Without memory of the network, the expert does not receive the applied actions."""
    imitation, expert, coding = imitation_of(made=Answering, epochs=1, noise=0.0)
    before = {name: value.clone() for name, value in imitation.policy.state_dict().items()}
    list(imitation.rounds())
    assert expert.applied == [] and not coding.history
    starts = np.array([start for _, _, start in expert.asked])
    assert starts.shape == (120, WORLDS) and starts[0].all() and not starts[1].any()
    assert 3 * WORLDS <= starts[1:].sum() and [state for _, state, _ in expert.asked] == [None, *range(1, 120)]
    way = np.array([np.hypot(*seen[:, expert.way : expert.way + 2].T) for seen, *_ in expert.asked])
    assert (np.abs(np.diff(way, axis=0))[starts[1:]] > 0.01).mean() > 0.6  # another episode has another displacement
    same = {name for name, value in imitation.policy.state_dict().items() if torch.equal(value, before[name])}
    assert {name for name in before if name.startswith("critic")} <= same
    assert {"actor.log_std.weight", "actor.log_std.bias"} <= same
    assert {"actor.mean.weight", "actor.hidden.0.weight"}.isdisjoint(same)


def test_experts_receive_applied_actions_if_the_network_remembers():
    """Their own in the first round; in the second one the network acts in most worlds."""
    imitation, expert, coding = imitation_of(history=True, made=Answering, epochs=1, rounds=2, noise=0.0)
    list(imitation.rounds())
    assert len(expert.applied) == len(expert.asked) == 80
    assert [state for _, state, _ in expert.asked[1:]] == [k + 0.5 for k in range(1, 80)]
    proposed, done = (np.array(array) for array in zip(*expert.applied, strict=True))
    network_acts = np.abs(done - proposed).reshape(2, 40, WORLDS, 3).max(axis=(1, 3)) > 1e-3
    assert not network_acts[0].any() and 0 < network_acts[1].sum() <= WORLDS and np.abs(done).max() <= 1.0
    rows = imitation._demonstrations.rows.reshape(80, WORLDS, -1)
    previous = rows[..., coding.shape.own - 3 : coding.shape.own]
    starts = np.array([start for _, _, start in expert.asked])
    assert (previous[starts] == 0.0).all() and starts[1:].any()
    assert (previous[1:][~starts[1:]] == done[:-1][~starts[1:]]).all()  # the network learns from the same
