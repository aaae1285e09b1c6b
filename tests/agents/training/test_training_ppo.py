"""PPO with parts as samples: advantages are those of a plain loop, and every part's are its own."""

import threading
import time

import gymnasium as gym
import numpy as np
import pytest
import torch
from gymnasium.envs.registration import EnvSpec
from gymnasium.vector import VectorRewardWrapper

from agents.training.parts_policy import PartsPolicy, trained_tensors
from agents.training.ppo.algorithm import PPO
from agents.training.ppo.hyperparameters import PPOSettings
from agents.training.ppo.learner import PartsPPO
from agents.training.ppo.rollout_buffer import PartsBuffer
from agents.training.training_file import settings_from
from tests.envs.helpers import batch
from tests.policies.helpers import info_of
from tests.policies.trained.helpers import coding_for
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Seen
from vibgym.policies.trained.trained import TrainedPolicy
from vibgym.tasks import TASKS, Align

GAMMA, LAMBDA = 0.9, 0.8
STEPS, WORLDS, PARTS = 9, 3, 2
ACTIONS = gym.spaces.Box(-1.0, 1.0, (12,), np.float32)
TWO = ["steel_block", "aluminium_block"]


@pytest.fixture(scope="module")
def coding():
    return coding_for(info_of("Sort", parts=TWO))


@pytest.fixture(scope="module")
def model():
    """Untrained, on worlds whose episodes are cut off after five steps."""
    env = batch(
        "Sort", WORLDS, parts=TWO, action="field", observation="parts", max_episode_steps=5, autoreset_mode="SameStep"
    )
    return untrained(env)


def untrained(env, **settings):
    policy = {"network": PPOSettings(net=[8], critic_net=[8], attention=4), "log_std": -0.5}
    policy["coding"] = coding_for(TaskInfo.of(env), "field")
    made = {"n_steps": STEPS, "batch_size": 24, "n_epochs": 2, "gamma": GAMMA, "gae_lambda": LAMBDA, "seed": 1}
    return PartsPPO(PartsPolicy, VecEnv(env), policy_kwargs=policy, device="cpu", **{**made, **settings})


class FirstColumn:
    """A critic whose values are known: a part's is the first number of its row."""

    def __call__(self, rows, mask):
        assert rows.shape[:-1] == mask.shape
        return rows[..., 0]


def filled(coding, reward, done, cut=(), there=None, driven=None):
    """A buffer of random rows, with these rewards and ends; ``cut`` holds (step, world) of ends that are cut off, ``there``
    (steps + 1, worlds, parts) which parts are there."""
    there = np.ones((STEPS + 1, WORLDS, PARTS), dtype=np.float32) if there is None else there
    generator = np.random.default_rng(0)
    buffer = PartsBuffer(STEPS, ACTIONS, ACTIONS, "cpu", LAMBDA, GAMMA, WORLDS, coding=coding, driven=driven)
    buffer.reset()
    finals = {}
    for step in range(STEPS + 1):
        rows = generator.normal(size=(WORLDS, PARTS, coding.shape.columns)).astype(np.float32)
        seen = Seen(rows, there[step])
        if step == STEPS:
            buffer.finish(seen, FirstColumn())
            break
        actions = generator.normal(size=(WORLDS, PARTS, coding.shape.action)).astype(np.float32)
        buffer.write(seen, actions, np.zeros((WORLDS, PARTS)), reward[step], done[step])
        for world in [where for at, where in cut if at == step]:
            last = generator.normal(size=(1, PARTS, coding.shape.columns)).astype(np.float32)
            finals[step, world] = last[0, :, 0].astype(np.float64)
            buffer.cut_off(world, Seen(last, there[step + 1, world : world + 1]))
    return buffer, finals


def case():
    generator = np.random.default_rng(3)
    reward = generator.normal(size=(STEPS, WORLDS, PARTS))
    done = np.zeros((STEPS, WORLDS), dtype=bool)
    done[2, 0] = done[8, 1] = done[5, 2] = done[6, 2] = True
    return reward, done


def test_advantages_are_those_of_a_plain_loop(coding):
    """The generalised advantage estimate by its definition, in float64; ends that are cut off count by their values."""
    reward, done = case()
    buffer, finals = filled(coding, reward, done, cut=[(2, 0), (6, 2)])
    assert len(finals) == 2
    value = buffer.rows[..., 0].astype(np.float64)
    for world in range(WORLDS):
        for part in range(PARTS):
            for step in range(STEPS):
                total, weight = 0.0, 1.0
                for k in range(step, STEPS):
                    last = done[k, world]
                    after = (
                        finals[k, world][part] if (k, world) in finals else 0.0 if last else value[k + 1, world, part]
                    )
                    total += weight * (reward[k, world, part] + GAMMA * after - value[k, world, part])
                    weight *= GAMMA * LAMBDA
                    if last:
                        break
                assert buffer.advantage[step, world, part] == pytest.approx(total, abs=1e-5)
    samples = buffer.samples()
    target = samples["target"].numpy().reshape(STEPS, WORLDS, PARTS)
    assert target == pytest.approx(buffer.advantage + buffer.value, abs=1e-6)
    assert samples["rows"].shape == (STEPS * WORLDS, PARTS, coding.shape.columns)


def test_a_parts_reward_is_credited_to_it_alone(coding):
    reward, done = case()
    before, _ = filled(coding, reward, done)
    reward = reward.copy()
    reward[4, 1, 0] += 1.0
    after, _ = filled(coding, reward, done)
    change = after.advantage - before.advantage
    expected = np.zeros_like(change)
    expected[:5, 1, 0] = (GAMMA * LAMBDA) ** np.arange(4, -1, -1)
    assert change == pytest.approx(expected, abs=1e-5)


def test_the_return_of_a_part_that_leaves_ends_there(coding):
    """World 1: part 0 leaves in step 3 and another one comes in step 5; advantages are those of two episodes, and nobody
    else's change. World 0 is cut off in step 2, in which its part 1 leaves: what is seen last there is not worth anything."""
    reward, done = case()
    there = np.ones((STEPS + 1, WORLDS, PARTS), dtype=np.float32)
    there[4:6, 1, 0] = there[3, 0, 1] = 0.0
    stays, finals = filled(coding, reward, done, cut=[(2, 0)])
    leaves, _ = filled(coding, reward, done, cut=[(2, 0)], there=there)
    value, paid = leaves.rows[..., 0].astype(np.float64), reward[:, 1, 0]
    total = 0.0
    for step in (3, 2, 1, 0):
        after = 0.0 if step == 3 else value[step + 1, 1, 0]
        total = paid[step] + GAMMA * after - value[step, 1, 0] + GAMMA * LAMBDA * total
        assert leaves.advantage[step, 1, 0] == pytest.approx(total, abs=1e-5)
    same = np.ones_like(leaves.advantage, dtype=bool)
    same[:6, 1, 0] = same[:3, 0, 1] = False
    assert (leaves.advantage == stays.advantage)[same].all()
    worth = stays.advantage[2, 0, 1] - leaves.advantage[2, 0, 1]
    assert worth == pytest.approx(GAMMA * finals[2, 0][1], abs=1e-5)


def test_parts_that_are_not_driven_are_no_samples_and_pay_those_that_are(coding):
    reward, done = case()
    all_of, _ = filled(coding, reward, done)
    found, _ = filled(coding, reward, done, driven=(True, False))
    together, _ = filled(coding, np.repeat(reward.sum(axis=2, keepdims=True), PARTS, axis=2), done)
    assert found.advantage[..., 0] == pytest.approx(together.advantage[..., 0], abs=1e-5)
    assert (found.samples()["mask"] == all_of.samples()["mask"] * torch.tensor([1.0, 0.0])).all()
    assert (all_of.driven.all(), all_of.mask.all()) == (True, True)


def test_an_end_and_a_cut_are_told_apart(coding):
    reward, done = case()
    ended, _ = filled(coding, reward, done)
    cut, finals = filled(coding, reward, done, cut=[(2, 0)])
    assert cut.advantage[2, 0] - ended.advantage[2, 0] == pytest.approx(GAMMA * finals[2, 0], abs=1e-5)


def losses(model, part):
    model.policy.zero_grad()
    loss, facts = model._loss(part, 0.2, True)
    loss.backward()
    grads = {name: value.grad.clone() for name, value in model.policy.named_parameters() if value.grad is not None}
    return float(loss.detach()), facts, grads


def minibatch(model, mask):
    generator = torch.Generator().manual_seed(0)
    shape, n = model.policy.coding.shape, 20
    rows = torch.rand((n, PARTS, shape.columns), generator=generator) * 2 - 1
    with torch.no_grad():
        mean, log_std = model.policy.actor(rows)
    noise = torch.randn(mean.shape, generator=generator)
    log_prob = -(0.5 * noise**2 + log_std + 0.918938533).sum(dim=-1)
    advantage = torch.randn((n, PARTS), generator=generator)
    target = torch.randn((n, PARTS), generator=generator)
    actions = mean + log_std.exp() * noise
    names = {"rows": rows, "actions": actions, "log_prob": log_prob, "advantage": advantage, "target": target}
    return {**names, "mask": torch.tensor(mask).expand(n, PARTS).clone()}


def test_absent_parts_teach_nothing(model):
    """Neither what stands in their places nor how many there are changes the loss or its gradient."""
    part = minibatch(model, [1.0, 0.0])
    loss, facts, grads = losses(model, part)
    assert facts["kl"] == pytest.approx(0.0, abs=1e-5) and facts["clipped"] == 0.0
    for name in ("advantage", "target", "actions", "log_prob"):
        part[name][:, 1] = 7.0
    part["rows"][:, 1] = 0.5
    again, _, others = losses(model, part)
    assert again == pytest.approx(loss, rel=1e-5)
    assert all(torch.allclose(others[name], grad, atol=1e-6) for name, grad in grads.items())
    assert max(grad.abs().max() for grad in grads.values()) > 1e-3
    part["advantage"][:, 0] *= -1.0
    assert not torch.allclose(losses(model, part)[2]["actor.mean.weight"], grads["actor.mean.weight"], atol=1e-4)


def test_no_part_at_all_is_no_fault(model):
    loss, _, grads = losses(model, minibatch(model, [0.0, 0.0]))
    assert loss == 0.0 and all((grad == 0).all() for grad in grads.values())


def test_the_gradient_is_that_of_ppo(model):
    """At the policy that acted the ratio is 1: the gradient of the mean of advantage x log-probability, reversed."""
    part = minibatch(model, [1.0, 1.0])
    _, _, grads = losses(model, part)
    model.policy.zero_grad()
    mean, log_std = model.policy.actor(part["rows"])
    scale = log_std.exp()
    log_prob = torch.distributions.Normal(mean, scale).log_prob(part["actions"]).sum(dim=-1)
    (-(part["advantage"] * log_prob).mean()).backward()
    for name, value in model.policy.actor.named_parameters():
        if name == "eyes.attention.key.bias":  # logits do not depend on it
            assert value.grad is None
            continue
        assert torch.allclose(value.grad, grads[f"actor.{name}"], atol=1e-5), name


def test_a_rollout_keeps_what_happened(model):
    """Rewards of the parts, and values of the last observations where the limit cut episodes off."""
    env, seen = model.env, []
    step = env.step_wait

    def watched():
        found = step()
        for world in np.flatnonzero(found[2]):
            found[3][world]["is_success"] = bool(world == 1)
        seen.append((env.part_reward.copy(), found[2].copy(), [info.get("terminal_observation") for info in found[3]]))
        return found

    env.step_wait = watched
    try:
        model.learn(STEPS * WORLDS, reset_num_timesteps=True)
    finally:
        del env.step_wait
    buffer = model.rollout_buffer
    assert len(seen) == STEPS and model.num_timesteps == STEPS * WORLDS
    done = np.array([each[1] for each in seen])
    assert (buffer.done == done).all() and done[4].all() and done.sum() == WORLDS
    reward = np.array([each[0] for each in seen])
    others = np.arange(STEPS) != 4
    assert buffer.reward[others] == pytest.approx(reward[others], abs=1e-6)
    assert len(buffer.cut) == WORLDS and sorted(world for _, world, *_ in buffer.cut) == [0, 1, 2]
    for at, world, rows, _ in buffer.cut:
        assert at == 4 and (rows == seen[4][2][world]["parts"][:PARTS]).all()
    assert (buffer.reward[4] != reward[4].astype(np.float32)).all()
    assert list(model.ep_success_buffer) == [False, True, False] and len(model.ep_info_buffer) == WORLDS


class Shifted(VectorRewardWrapper):
    """Pays more."""

    def rewards(self, reward):
        return reward + 7.0


def test_a_rollout_keeps_the_reward_of_a_wrapper():
    """Every part is credited with what the wrapper paid its world."""
    env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
    model = untrained(Shifted(env))
    model.learn(STEPS * WORLDS)
    paid = model.rollout_buffer.reward
    assert (abs(paid - 7.0) < 1.0).all() and (paid[..., 0] == paid[..., 1]).all() and len(np.unique(paid)) > STEPS


def test_wrappers_of_a_registered_environment_take_part(monkeypatch):
    """An id whose batch comes wrapped is trained on as it is, scene and network as without."""
    for name, made in (
        ("mine/Shifted-v0", lambda **more: Shifted(VibgymVectorEnv("Align", **more))),
        ("mine/Pole-v0", lambda num_envs, **more: gym.make_vec("CartPole-v1", num_envs, "sync")),
    ):
        entry = {"entry_point": "vibgym.envs:VibgymEnv", "vector_entry_point": made}
        monkeypatch.setitem(gym.registry, name, EnvSpec(name, **entry))
    ppo = {"n_steps": 4, "batch_size": 8, "n_epochs": 1, "net": [8], "critic_net": [8]}
    made = {"task": "mine/Shifted-v0", "algorithm": "ppo", "worlds": 2, "steps": 8, "judging": None, "ppo": ppo}
    settings = settings_from({**made, "environment": {"action": "field"}})
    env = PPO(settings).make_env()
    model = PPO(settings).make_model(env)
    model.learn(8)
    assert not env.credits_parts and (abs(model.rollout_buffer.reward - 7.0) < 1.0).all()
    assert isinstance(env.env, VibgymVectorEnv) and model.policy.coding.parts == env.env.parts
    with pytest.raises(ValueError, match="task"):
        PPO(settings.model_copy(update={"task": "mine/Pole-v0"})).make_env()


class Thrifty(Align):
    """Align, and the elements' energy counts."""

    TERMS = {**Align.TERMS, "energy": 1.0}

    def reward(self, step):
        return {**super().reward(step), "energy": -np.square(step.phasors).mean(axis=(1, 2, 3))[:, None] * step.present}


def test_a_reward_of_ones_own_is_learned_from(monkeypatch):
    """By settings alone: with another weight of a term other weights of the network, and without it those of the task."""
    monkeypatch.setattr(TASKS, "_items", {**TASKS, "Thrifty": Thrifty})
    made = {
        "algorithm": "ppo", "worlds": 4, "steps": 128, "judging": None,
        "ppo": {"n_steps": 16, "batch_size": 32, "n_epochs": 2, "net": [8], "critic_net": [8]},
    }  # fmt: skip
    learned = []
    for task, weight in (("Align", None), ("Thrifty", 0.0), ("Thrifty", 1.0)):
        environment = {
            "action": "field",
            **({} if weight is None else {"task_settings": {"weights": {"energy": weight}}}),
        }
        settings = settings_from({**made, "task": task, "environment": environment})
        env = PPO(settings).make_env()
        model = PPO(settings).make_model(env)
        model.learn(settings.steps)
        learned.append(PPO(settings).actor(model))
        env.close()
    align, free, costly = learned
    assert all((align[name] == free[name]).all() for name in align)
    assert any((align[name] != costly[name]).any() for name in align)


def test_the_critic_alone_learns_at_first():
    env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
    model = untrained(env, critic_steps=STEPS * WORLDS)
    before = {name: value.clone() for name, value in model.policy.state_dict().items()}
    model.learn(STEPS * WORLDS)
    changed = {name.split(".")[0] for name, value in model.policy.state_dict().items() if (value != before[name]).any()}
    assert changed == {"critic"}
    model.learn(STEPS * WORLDS, reset_num_timesteps=False)
    changed = {name.split(".")[0] for name, value in model.policy.state_dict().items() if (value != before[name]).any()}
    assert changed == {"critic", "actor"}


def test_rollouts_beside_updates_are_one_update_old_whoever_is_faster(monkeypatch):
    """Slow worlds and slow updates make the same weights; each rollout's policy is the one from before the update beside it."""
    made = []
    for slow in ("make_steps", "train"):
        env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
        model, acted, learned = untrained(env, overlap=True, learning_rate=1e-2), [], []
        steps, train, save = model.make_steps, model.train, lambda actor: actor.mean.weight.detach().clone()

        def watched_steps(actor, callback, slow=slow, steps=steps, acted=acted, save=save):
            time.sleep(0.1 * (slow == "make_steps"))
            acted.append(save(actor))
            return steps(actor, callback)

        def watched_train(*told, slow=slow, train=train, learned=learned, model=model, save=save):
            time.sleep(0.1 * (slow == "train"))
            learned.append(save(model.policy.actor))
            train(*told)

        monkeypatch.setattr(model, "make_steps", watched_steps), monkeypatch.setattr(model, "train", watched_train)
        threads = torch.get_num_threads()
        model.learn(4 * STEPS * WORLDS)
        assert len(acted) == len(learned) == 4 and model.waiting is None and torch.get_num_threads() == threads
        assert model.num_timesteps == 4 * STEPS * WORLDS and model._n_updates == 4 * model.n_epochs
        # The first rollout has no update beside it, and the last update no rollout.
        assert all(torch.equal(mine, theirs) for mine, theirs in zip(acted[1:], learned[:-1], strict=True))
        assert not torch.equal(learned[0], learned[1])
        made.append(model.policy.state_dict())
    assert all(torch.equal(one, made[1][name]) for name, one in made[0].items())


def test_an_error_beside_an_update_is_told_and_nobody_works_on(monkeypatch):
    env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
    model, threads = untrained(env, overlap=True), torch.get_num_threads()
    step, count = model.env.step_wait, iter(range(100))

    def breaks():
        if next(count) == STEPS + 2:
            raise OSError("a world is gone")
        return step()

    monkeypatch.setattr(model.env, "step_wait", breaks)
    with pytest.raises(OSError, match="a world is gone"):
        model.learn(4 * STEPS * WORLDS)
    assert torch.get_num_threads() == threads
    assert not [each for each in threading.enumerate() if each.name.startswith("rollout")]


def test_bfloat16_is_for_processors_that_have_it(monkeypatch):
    """Refused elsewhere; actions and values stay in float32, and the gradient is that of float32 to its roundings."""
    settings = settings_from(
        {"task": "Sort", "steps": 8, "environment": {"action": "field"}, "ppo": {"precision": "bfloat16"}}
    )
    env = PPO(settings).make_env()
    for can in ({"avx2": True, "avx512_bf16": False}, {}):
        monkeypatch.setattr(torch.cpu, "get_capabilities", lambda can=can: can, raising=False)
        with pytest.raises(ValueError, match="ppo.precision"):
            PPO(settings).make_model(env)
    monkeypatch.setattr(torch.cpu, "get_capabilities", lambda: {"amx_bf16": True}, raising=False)
    assert PPO(settings).make_model(env).precision == "bfloat16"
    env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
    model = untrained(env)
    part = minibatch(model, [1.0, 1.0])
    loss, facts, grads = losses(model, part)
    model.precision = "bfloat16"
    coarse, said, others = losses(model, part)
    assert coarse != loss and coarse == pytest.approx(loss, rel=0.02) and said["kl"] < 1e-3
    for name, grad in grads.items():
        assert others[name].dtype == torch.float32
        assert (others[name] - grad).norm() < 0.15 * grad.norm(), name  # rectified units close to zero turn over


def test_touches_cost_what_is_learned_from_and_nothing_else():
    """Only the parts that are in touch pay, in the buffer alone: the environment's rewards stay as they are."""
    env = batch("Sort", WORLDS, parts=TWO, action="field", observation="parts", autoreset_mode="SameStep")
    model = untrained(env, touch_cost=0.25)
    paid, coding, step, seen, cost = [], model.policy.coding, model.env.step_wait, model.env, []
    there, gap = (
        next(row.start for row in env.parts_layout if row.name == f"neighbour_1_{name}") for name in ("there", "gap")
    )
    reset = model.env.reset

    def close(observation):  # in world 0 the parts stand side by side, in world 1 the second alone says so
        observation = {**observation, "parts": observation["parts"].copy()}
        observation["parts"][:, :PARTS, there], observation["parts"][:, :PARTS, gap] = 1.0, 0.5
        observation["parts"][0, :PARTS, gap] = observation["parts"][1, 1, gap] = 0.0
        return observation

    def watched():
        found = step()
        paid.append(seen.part_reward.copy())
        return close(found[0]), *found[1:]

    model.env.step_wait, model.env.reset = watched, lambda: close(reset())
    model.learn(STEPS * WORLDS)
    cost = np.array(paid) - model.rollout_buffer.reward
    expected = np.zeros((STEPS, WORLDS, PARTS))
    expected[:, 0], expected[:, 1, 1] = 0.25, 0.25
    assert len(model.rollout_buffer.cut) == 0 and not model.rollout_buffer.done.any()
    assert cost == pytest.approx(expected, abs=1e-6)
    assert coding.touching(coding.see(model._last_obs)).tolist() == [[1.0, 1.0], [0.0, 1.0], [0.0, 0.0]]


@pytest.mark.parametrize("turned", [False, True])
def test_a_rollout_remembers_what_parts_were_told(turned, monkeypatch):
    """And so does the policy that acts without torch: its actions are those of the rollout, through ends of episodes."""
    monkeypatch.setattr(torch, "randn_like", torch.zeros_like)  # a rollout that does not explore
    env = batch(
        "Transport", WORLDS, action="wrench", observation="parts", max_episode_steps=4, autoreset_mode="SameStep"
    )
    coding = coding_for(TaskInfo.of(env), "wrench", turned=turned, remembers=True)
    policy = {"network": PPOSettings(net=[8], critic_net=[8], attention=4), "log_std": -1.0}
    made = {"n_steps": STEPS, "batch_size": 24, "n_epochs": 1, "learning_rate": 1e-9, "seed": 1, "device": "cpu"}
    model = PartsPPO(PartsPolicy, VecEnv(env), policy_kwargs={**policy, "coding": coding}, **made)
    torch.nn.init.normal_(model.policy.actor.mean.weight)
    acting = TrainedPolicy(trained_tensors(model.policy.actor), "parts", "tanh", coding)
    steps, step, async_ = [], model.env.step_wait, model.env.step_async

    def asked(actions):
        steps.append([model._last_obs, model._last_episode_starts, actions.copy()])
        async_(actions)

    def watched():
        found = step()
        steps[-1].append([info.get("terminal_observation") for info in found[3]])
        return found

    model.env.step_async, model.env.step_wait = asked, watched
    model.learn(STEPS * WORLDS)
    rows, own, state = model.rollout_buffer.rows, coding.shape.own, None
    said = slice(own - 3, own)
    cuts = {(at, world): row for at, world, row, _ in model.rollout_buffer.cut}
    assert len(cuts) == 2 * WORLDS
    for k, (observation, start, actions, finals) in enumerate(steps):
        mine, state = acting.predict(observation, state, start)
        assert mine == pytest.approx(actions, abs=1e-5) and (state.rows == pytest.approx(rows[k], abs=1e-5))
        assert start.all() == (k % 4 == 0) and (rows[k, ..., said] == 0.0).all() == (k % 4 == 0)
        for world in range(WORLDS):
            assert ((k, world) in cuts) == (k % 4 == 3)
            if (k, world) in cuts:  # what was seen last remembers too, though another episode has begun
                last = coding.see(finals[world], state.of(world))
                assert cuts[k, world] == pytest.approx(last.rows[0], abs=1e-5) and last.rows[0, 0, said].any()
    forgets, _ = acting.predict(steps[-1][0])
    assert np.abs(forgets - steps[-2][2]).max() > 1e-3
