"""PPO: advantages and losses against independent computations."""

from dataclasses import replace

import numpy as np
import pytest
import torch

from agents.ppo import PPO
from agents.rollout import Rollout
from agents.training_file import settings_from
from tests.policies.helpers import info_of
from tests.policies.trained.helpers import coding_for
from vibgym.policies.trained.coding import Inputs

GAMMA, LAMBDA = 0.9, 0.8
STEPS, WORLDS, PARTS = 9, 3, 2
TWO = ["steel_block", "aluminium_block"]


def first_column(rows, mask):
    """A critic with known values."""
    assert rows.shape[:-1] == mask.shape
    return rows[..., 0]


def filled(reward, done, truncated=(), driven=(True, True), **settings):
    info = info_of("Sort", parts=TWO)
    coding, info = (
        coding_for(info),
        replace(info, driven=driven, continuous_feed=settings.pop("continuous_feed", False)),
    )
    generator = np.random.default_rng(0)
    own = PPO.Settings(n_steps=STEPS, gamma=GAMMA, gae_lambda=LAMBDA, **settings)
    rollout, finals = Rollout(own, WORLDS, coding, info), {}
    mask = np.ones((WORLDS, PARTS), dtype=np.float32)
    for step in range(STEPS):
        rows = generator.normal(size=(WORLDS, PARTS, coding.shape.columns)).astype(np.float32)
        action = np.zeros((WORLDS, PARTS, coding.shape.action))
        rollout.add(Inputs(rows, mask), action, np.zeros((WORLDS, PARTS)), reward[step], done[step])
        for world in [where for at, where in truncated if at == step]:
            last = generator.normal(size=(1, PARTS, coding.shape.columns)).astype(np.float32)
            finals[step, world] = last[0, :, 0].astype(np.float64)
            rollout.truncate(world, Inputs(last, mask[:1]))
    rows = generator.normal(size=(WORLDS, PARTS, coding.shape.columns)).astype(np.float32)
    rollout.finish(Inputs(rows, mask), first_column)
    return rollout, finals


@pytest.fixture
def learner():
    """Makes a learner that has reset its worlds."""
    learners = []

    def make(task="Align", action="field", worlds=WORLDS, steps=1, environment=(), **own):
        data = {"task": task, "environment": {"action": action, **dict(environment)}, "worlds": worlds, "steps": steps}
        ppo = PPO(settings_from({**data, "ppo": {"n_steps": STEPS, "net": [8], "critic_net": [8], **own}}))
        learners.append(ppo)
        ppo.env.seed(0)
        ppo.worlds.observation = ppo.env.reset()
        return ppo

    yield make
    for ppo in learners:
        ppo.close()


def case():
    reward = np.random.default_rng(3).normal(size=(STEPS, WORLDS, PARTS))
    done = np.zeros((STEPS, WORLDS), dtype=bool)
    done[2, 0] = done[8, 1] = done[5, 2] = done[6, 2] = True
    return reward, done


def test_advantages_are_those_of_a_plain_loop():
    reward, done = case()
    rollout, finals = filled(reward, done, truncated=[(2, 0), (6, 2)])
    value = rollout.rows[..., 0].astype(np.float64)
    for world, part, step in np.ndindex(WORLDS, PARTS, STEPS):
        total, weight = 0.0, 1.0
        for k in range(step, STEPS):
            end = done[k, world]
            after = finals[k, world][part] if (k, world) in finals else 0.0 if end else value[k + 1, world, part]
            total += weight * (reward[k, world, part] + GAMMA * after - value[k, world, part])
            weight *= GAMMA * LAMBDA
            if end:
                break
        assert rollout.advantage[step, world, part] == pytest.approx(total, abs=1e-5)


def test_driven_parts_receive_the_rewards_of_others():
    reward, done = case()
    driven, _ = filled(reward, done, driven=(True, False))
    together, _ = filled(np.repeat(reward.sum(axis=2, keepdims=True), PARTS, axis=2), done)
    assert driven.advantage[..., 0] == pytest.approx(together.advantage[..., 0], abs=1e-5)
    assert (driven.samples()["mask"][:, 1] == 0).all()
    # They receive them once: only driven parts share.
    shared, _ = filled(reward, done, driven=(True, False), shared=0.3)
    assert (shared.advantage[..., 0] == driven.advantage[..., 0]).all()


@pytest.mark.parametrize("continuous_feed", [False, True])
def test_parts_share_the_rewards_of_others(continuous_feed):
    reward, done = case()
    rollout, _ = filled(reward, done, shared=0.3, continuous_feed=continuous_feed)
    others = reward[..., ::-1]
    expected, _ = filled(reward + 0.3 * (others - (others.mean() if continuous_feed else 0.0)), done)
    assert rollout.advantage == pytest.approx(expected.advantage, abs=1e-5)


def test_the_gradient_is_that_of_the_policy_gradient_at_ratio_one(learner):
    learner = learner("Sort")
    learner.collect()
    batch = learner.rollout.samples()
    batch["advantage"] = torch.randn_like(batch["advantage"])
    learner.loss(batch)[0].backward()
    gradients = {
        name: parameter.grad.clone()
        for name, parameter in learner.policy.actor.named_parameters()
        if parameter.grad is not None
    }
    learner.policy.zero_grad()
    mean, log_std = learner.policy.actor(batch["rows"])
    log_prob = torch.distributions.Normal(mean, log_std.exp()).log_prob(batch["actions"]).sum(dim=-1)
    (-(batch["advantage"] * log_prob * batch["mask"]).sum() / batch["mask"].sum()).backward()
    for name, parameter in learner.policy.actor.named_parameters():
        if parameter.grad is not None:
            assert torch.allclose(parameter.grad, gradients[name], atol=1e-5), name


@pytest.mark.parametrize("cost", [0.0, 0.25])
def test_touching_parts_pay_in_training_only(learner, cost, monkeypatch):
    """In world 0 the parts touch, in world 1 the second part alone reports it, in world 2 none."""
    learner, paid = learner("Sort", environment={"parts": TWO}, touch_cost=cost), []
    rows = {row.name: row.start for row in learner.env.env.parts_layout}
    there, gap = rows["neighbour_1_there"], rows["neighbour_1_gap"]
    step = learner.env.step

    def close(observation):
        parts = observation["parts"].copy()
        parts[:, :PARTS, there], parts[:, :PARTS, gap] = 1.0, 0.5
        parts[0, :PARTS, gap] = parts[1, 1, gap] = 0.0
        return {**observation, "parts": parts}

    def watched(actions):
        observation, *rest = step(actions)
        paid.append(learner.env.part_reward.copy())
        return close(observation), *rest

    monkeypatch.setattr(learner.env, "step", watched)
    learner.worlds.observation = close(learner.worlds.observation)
    learner.collect()
    expected = np.zeros((STEPS, WORLDS, PARTS))
    expected[:, 0] = expected[:, 1, 1] = cost
    assert np.array(paid) - learner.rollout.reward == pytest.approx(expected, abs=1e-6)
    assert not learner.rollout.truncated and np.any(paid)


def test_the_critic_learns_first(learner):
    steps = 2 * STEPS * WORLDS
    learner, changed = learner(steps=steps, batch_size=8, critic_steps=steps // 2), []
    before = {name: tensor.clone() for name, tensor in learner.policy.state_dict().items()}

    def report(metrics):
        now = learner.policy.state_dict().items()
        changed.append({name.split(".")[0] for name, tensor in now if not torch.equal(tensor, before[name])})

    learner.learn(steps, report)
    assert changed == [set(), {"critic"}, {"critic", "actor"}]


def test_the_average_of_the_last_actors_is_stored_and_the_last_one_explores(learner):
    steps = STEPS * WORLDS
    learner, last, stored = learner(steps=4 * steps, batch_size=8, critic_steps=steps, averaging=0.75), [], []

    def report(metrics):
        last.append({name: tensor.numpy().copy() for name, tensor in learner.policy.actor.state_dict().items()})
        stored.append({name: tensor.copy() for name, tensor in learner.actor().items()})

    learner.learn(4 * steps, report)
    for name, expected in last[2].items():  # before two reports no update changed the actor
        for k in range(5):
            expected = last[k][name] if k < 3 else 0.75 * expected + 0.25 * last[k][name]
            np.testing.assert_allclose(stored[k][name], expected, rtol=1e-5, atol=1e-7)
    assert np.abs(stored[4]["mean.weight"] - last[4]["mean.weight"]).max() > 1e-5


def test_correlated_noise_is_standard_normal_and_begins_anew_with_episodes(learner):
    learner = learner(action="velocity", worlds=400, n_steps=4, noise_correlation=0.9)
    shape, steps, begins = (400, 1, 3), 30, 20
    noise = []
    for step in range(steps):
        learner.worlds.start = np.full(400, step in (0, begins))
        noise.append(learner.worlds.noise(shape, 0.9).numpy().reshape(-1))
    noise = np.array(noise)
    assert noise.mean(axis=1) == pytest.approx(0.0, abs=5.0 / 1200**0.5)
    assert noise.var(axis=1) == pytest.approx(1.0, abs=5.0 * (2.0 / 1200) ** 0.5)
    correlation = np.array([np.corrcoef(one, other)[0, 1] for one, other in zip(noise[:-1], noise[1:], strict=True)])
    within = np.arange(1, steps) != begins
    assert correlation[within] == pytest.approx(0.9, abs=0.05)
    assert abs(correlation[~within]) < 0.15
    assert np.corrcoef(noise[0], noise[10])[0, 1] == pytest.approx(0.9**10, abs=0.15)
