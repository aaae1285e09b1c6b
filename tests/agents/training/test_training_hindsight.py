"""Replay with other goals: what is drawn belongs together, a fall stays a fall, and nothing that is forgotten comes back."""

import copy

import numpy as np
import pytest
import torch
from gymnasium import spaces

from agents.training.hindsight import HindsightBuffer, buffer_bytes
from tests.envs.helpers import SMALL, batch
from vibgym.adapters.sb3 import VecEnv

WORLDS, SIZE = 3, 40
SPACE = spaces.Dict({
    "observation": spaces.Box(-1, 1, (2,)), "achieved_goal": spaces.Box(-1e6, 1e6, (2,)),
    "desired_goal": spaces.Box(-1e6, 1e6, (2,)),
})  # fmt: skip
ACTIONS = spaces.Box(-1, 1, (1,))


class Rewards:
    """Stands for the environment: -1 outside, 0 at the goal, -50 after a fall."""

    def env_method(self, name, achieved, desired, info, indices):
        assert name == "compute_reward" and indices == [0] and info["fallen"].shape == (len(achieved),)
        return [np.where(info["fallen"], -50.0, -(achieved != desired).any(axis=1).astype(float))]


def buffer(size=SIZE * WORLDS, **settings):
    return HindsightBuffer(size, SPACE, ACTIONS, n_envs=WORLDS, env=Rewards(), **settings)


def fill(into, steps, lengths=(7, 5, 11), falls=False):
    """Episodes of these lengths; a world's place is (world, count of its steps), so that every goal tells where it is from."""
    ended = []
    for k in range(steps):
        now = np.array([[world, k] for world in range(WORLDS)], dtype=np.float32)
        wanted = np.full((WORLDS, 2), -1.0, dtype=np.float32)
        seen = {"observation": now, "achieved_goal": now, "desired_goal": wanted}
        after = {"observation": now + [0, 1], "achieved_goal": now + [0, 1], "desired_goal": wanted}
        done = np.array([(k + 1) % length == 0 for length in lengths])
        infos = [{"fallen": falls, "TimeLimit.truncated": not falls} if end else {} for end in done]
        into.add(seen, after, now[:, :1] / WORLDS, np.full(WORLDS, -1.0, np.float32), done, infos)
        ended.append(done)
    return np.array(ended)


@pytest.mark.parametrize("steps", [4, 30, 3 * SIZE + 13])
@pytest.mark.parametrize("horizon", [0, 3, 100])
def test_goals_lie_ahead_in_the_same_episode(steps, horizon):
    """Also in a buffer that is full for long, and of episodes that go on."""
    kept, lengths = buffer(hindsight=1.0, horizon=horizon), (7, 5, 200)
    fill(kept, steps, lengths)
    drawn = kept.sample(4000)
    goal, place = drawn.observations["desired_goal"].numpy(), drawn.observations["achieved_goal"].numpy()
    assert (drawn.next_observations["desired_goal"].numpy() == goal).all()
    assert (drawn.next_observations["achieved_goal"].numpy() == place + [0, 1]).all()
    ahead = goal[:, 1] - place[:, 1] - 1
    assert (goal[:, 0] == place[:, 0]).all() and (ahead >= 0).all() and (ahead <= horizon).all()
    length = np.array(lengths)[place[:, 0].astype(int)]
    assert (goal[:, 1] <= np.minimum((place[:, 1] // length + 1) * length, steps)).all()
    assert (place[:, 1] >= steps - SIZE).all() and len(np.unique(place, axis=0)) == WORLDS * min(steps, SIZE)
    assert (drawn.rewards.numpy()[:, 0] == np.where(ahead == 0, 0.0, -1.0)).all()
    most = min(horizon, min(steps, SIZE) - 1)  # of the long episode
    assert most - 3 <= ahead.max() <= most


def test_the_rest_of_a_batch_keeps_its_goals():
    kept = buffer(hindsight=0.25)
    fill(kept, 30)
    goal = kept.sample(100).observations["desired_goal"].numpy()
    assert (goal[:25] != -1.0).all() and (goal[25:] == -1.0).all()


def test_a_fall_stays_a_fall_and_ends():
    kept = buffer(hindsight=1.0)
    ended = fill(kept, 35, falls=True)
    drawn = kept.sample(2000)
    place = drawn.observations["achieved_goal"].numpy().astype(int)
    last = ended[place[:, 1], place[:, 0]]
    assert last.any() and (drawn.rewards.numpy()[:, 0] == -50.0).tolist() == last.tolist()
    assert drawn.dones.numpy()[:, 0].astype(bool).tolist() == last.tolist()


def test_what_the_step_limit_cuts_off_does_not_end():
    kept = buffer()
    assert fill(kept, 35).any()
    assert not kept.sample(2000).dones.any()


def test_the_same_draws_again_and_other_ones():
    def drawn(seed):
        kept = buffer(seed=seed)
        fill(kept, 30)
        return kept.sample(50).next_observations["desired_goal"].numpy()

    assert (drawn(1) == drawn(1)).all() and (drawn(1) != drawn(2)).any()


@pytest.mark.parametrize("steps", [0, 9, 2 * SIZE + 3])
def test_a_buffer_goes_on_from_a_state(steps):
    """With the same memory, draws and episodes, those that are under way too."""
    kept, other = buffer(), buffer(seed=9)
    fill(kept, steps)
    other.set_state(copy.deepcopy(kept.get_state()))
    for each in (kept, other):
        fill(each, 7)
    assert (other.pos, other.full, other.size()) == (kept.pos, kept.full, kept.size())
    for mine, theirs in zip(kept.sample(500), other.sample(500), strict=True):
        pairs = [(mine[key], theirs[key]) for key in mine] if isinstance(mine, dict) else [(mine, theirs)]
        assert mine is None or all(torch.equal(*pair) for pair in pairs)  # discounts are for other buffers


def test_memory_is_what_is_said():
    kept = buffer()
    names = ("actions", "rewards", "dones", "timeouts", "fallen", "length")
    arrays = [*kept.observations.values(), *kept.next_observations.values(), *(getattr(kept, name) for name in names)]
    assert buffer_bytes(SIZE * WORLDS, WORLDS, SPACE, ACTIONS) == sum(array.nbytes for array in arrays)


def test_rewards_are_the_environment_s_own():
    """Of parts that wander on a small surface, and fall from it."""
    env = VecEnv(batch("Align", WORLDS, action="field", observation="goal", surface=SMALL, autoreset_mode="SameStep"))
    kept = HindsightBuffer(900, env.observation_space, env.action_space, n_envs=WORLDS, env=env, hindsight=0.0)
    again = HindsightBuffer(
        900, env.observation_space, env.action_space, n_envs=WORLDS, env=env, hindsight=1.0, horizon=0
    )
    env.seed(3)
    seen, falls, generator = env.reset(), 0, np.random.default_rng(0)
    push = np.zeros((WORLDS, 6), dtype=np.float32)
    for _ in range(120):
        push = np.clip(push + generator.uniform(-0.3, 0.3, push.shape), -1, 1).astype(np.float32)
        after, reward, done, infos = env.step(push)
        true = {key: value.copy() for key, value in after.items()}
        for world in np.flatnonzero(done):
            falls += infos[world]["fallen"]
            for key in true:
                true[key][world] = infos[world]["terminal_observation"][key]
        kept.add(seen, true, push, reward, done, infos), again.add(seen, true, push, reward, done, infos)
        seen = after
    assert falls > 0
    drawn = kept.sample(3)  # as many as worlds: rewards of a batch are not handed out world by world
    assert drawn.rewards.shape == (3, 1)
    there = again.sample(500)
    assert set(np.unique(there.rewards.numpy())) == {
        -50.0,
        0.0,
    }  # every step reaches where it leads, unless to the floor
    fallen = again.fallen[: again.size()]
    assert (again.rewards[: again.size()][fallen] == -50.0).all() and fallen.sum() == falls
