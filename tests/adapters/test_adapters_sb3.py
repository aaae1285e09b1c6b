"""The Stable-Baselines3 adapter."""

import warnings

import numpy as np
import pytest
from gymnasium import spaces
from gymnasium.vector import VectorRewardWrapper, VectorWrapper
from gymnasium.wrappers.vector import RecordEpisodeStatistics

from tests.envs.helpers import SMALL, assert_same, batch, single

pytest.importorskip("stable_baselines3")

from stable_baselines3 import PPO
from stable_baselines3.common.evaluation import evaluate_policy
from stable_baselines3.common.monitor import Monitor
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor, VecVideoRecorder

from vibgym.adapters.sb3 import VecEnv

WORLDS = 3


def adapter(task="Align", worlds=WORLDS, **settings):
    return VecEnv(batch(task, worlds, autoreset_mode="SameStep", **settings))


def plain(observation):
    """Return an observation whose dictionary is not ordered."""
    return dict(observation) if isinstance(observation, dict) else observation


@pytest.mark.parametrize("settings", [
    {"action": "patch", "max_episode_steps": 7},
    {"action": "field", "max_episode_steps": 60, "surface": SMALL},
    {"action": "field", "max_episode_steps": 5, "observation": "image"},
    {"action": "field", "max_episode_steps": 60, "surface": SMALL, "observation": "goal"},
])  # fmt: skip
def test_the_adapter_is_stable_baselines_own_batch_of_monitored_environments(settings):
    mine = adapter(**settings)
    theirs = DummyVecEnv([lambda: Monitor(single("Align", **settings))] * WORLDS)
    assert mine.num_envs == theirs.num_envs == WORLDS
    assert mine.action_space == theirs.action_space and mine.observation_space == theirs.observation_space
    mine.seed(5), theirs.seed(5)
    assert_same(mine.reset(), plain(theirs.reset()))
    generator = np.random.default_rng(0)
    push = np.zeros((WORLDS, mine.action_space.shape[0]), dtype=np.float32)
    truncated = terminated = 0
    for _ in range(70):
        push += generator.uniform(-0.2, 0.2, push.shape).astype(np.float32)
        np.clip(push, -1, 1, out=push)
        observation, reward, done, infos = mine.step(push)
        expected, rewards, dones, their_infos = theirs.step(push)
        assert_same(observation, plain(expected))
        assert (reward == rewards).all() and reward.dtype == rewards.dtype == np.float32
        assert (done == dones).all() and done.dtype == bool
        for world in range(WORLDS):
            if not done[world]:
                assert infos[world] == {}
                continue
            got, want = infos[world], their_infos[world]
            assert_same(got["terminal_observation"], want["terminal_observation"])
            for name in want.keys() - {"terminal_observation", "episode", "parts"}:
                assert got[name] == want[name] and type(got[name]) is type(want[name]), name
            assert mine.reset_infos[world] == {k: v for k, v in theirs.reset_infos[world].items() if k != "parts"}
            assert got["episode"]["r"] == pytest.approx(want["episode"]["r"], abs=1e-6)
            assert got["episode"]["l"] == want["episode"]["l"]
            truncated += got["TimeLimit.truncated"]
            terminated += not got["TimeLimit.truncated"]
    assert truncated + terminated >= 2 * WORLDS
    assert terminated > 0 if "surface" in settings else truncated > 0
    mine.close(), theirs.close()


def test_resets_draw_and_count_anew_and_a_seed_applies_once():
    env = adapter(action="field", max_episode_steps=3)
    assert env.seed(5) == [5, 6, 7]
    first, second = env.reset(), env.reset()
    env.seed(5)
    assert (env.reset() == first).all() and (second != first).any()
    push = np.zeros((WORLDS, 6), dtype=np.float32)
    env.step(push), env.reset()
    infos = [env.step(push)[3] for _ in range(3)]
    assert [[bool(info) for info in step] for step in infos] == [[False] * 3, [False] * 3, [True] * 3]
    assert {info["episode"]["l"] for info in infos[-1]} == {3}


def test_options_of_a_reset_apply_once():
    env = adapter("Transport", action="field")
    theirs = DummyVecEnv([lambda: single("Transport", action="field")] * WORLDS)
    places = [{"pose": [0.1 * (k + 1), 0.1, 0.0], "goal": [0.3, 0.1]} for k in range(WORLDS)]
    for options in ({"pose": [0.2, 0.1, 0.3]}, places, None):
        env.seed(5), theirs.seed(5)
        env.set_options(options), theirs.set_options(options)
        assert (env.reset() == theirs.reset()).all() and env.reset_infos[0]["position_error"] > 0.0
        errors = [[info["position_error"] for info in venv.reset_infos] for venv in (env, theirs)]
        assert errors[0] == errors[1]
    env.set_options({"poses": 1})
    with pytest.raises(ValueError, match="poses"):
        env.reset()
    for bad in (places[:2], [*places[:2], {}], [{"parts": [0]}, {"parts": [0]}, {"parts": [1]}]):
        with pytest.raises(ValueError, match="options"):
            env.set_options(bad), env.reset()


def test_the_adapter_reports_what_monitors_do():
    env = adapter(action="field", max_episode_steps=3, periods_per_step=2)
    assert env.metadata["render_fps"] == 12
    monitored = VecMonitor(env, info_keywords=("position_error", "reward_terms"))
    monitored.reset()
    *_, infos = [monitored.step(np.zeros((WORLDS, 6)))[3] for _ in range(3)]
    assert infos[0]["episode"]["position_error"] > 0.0 and "distance" in infos[0]["episode"]["reward_terms"]


def test_attributes_and_wrappers():
    env = VecEnv("vibgym/Align-v0", num_envs=3, wrappers=[RecordEpisodeStatistics])
    assert env.get_attr("num_envs") == [3, 3, 3] and env.get_attr("num_envs", [1]) == [3]
    env.set_attr("note", "hello")
    assert env.env.note == "hello"
    assert env.env_is_wrapped(Monitor) == [True] * 3 and env.env_is_wrapped(DummyVecEnv) == [False] * 3
    assert env.env_is_wrapped(RecordEpisodeStatistics, [0, 2]) == [True] * 2


def test_worlds_are_rendered():
    env = VecEnv("vibgym/Align-v0", num_envs=2, action="field", render_mode="rgb_array")
    env.seed(0), env.reset()
    images = env.get_images()
    assert env.render_mode == "rgb_array" and len(images) == 2 and (images[0] != images[1]).any()
    picture = env.render()
    assert picture.dtype == np.uint8 and picture.size == sum(image.size for image in images)
    assert adapter(action="field").render_mode is None


def test_videos_are_recorded(tmp_path):
    pytest.importorskip("moviepy")
    env = VecEnv("vibgym/Align-v0", num_envs=2, action="field", render_mode="rgb_array")
    video = VecVideoRecorder(env, str(tmp_path), lambda step: step == 0, video_length=3)
    video.reset()
    for _ in range(4):
        video.step(np.zeros((2, 6), dtype=np.float32))
    video.close()
    assert [path.suffix for path in tmp_path.iterdir()] == [".mp4"]


@pytest.mark.parametrize("settings", [{"action": "patch"}, {"observation": "state"}])
def test_scenes_with_different_spaces_are_refused(settings):
    first = {"action": "field", "observation": "parts", "autoreset_mode": "SameStep"}
    one, small = batch("Align", 2, **first), batch("Align", 2, **first, surface=SMALL)
    assert VecEnv(one, small).num_envs == 4  # rows by parts are of any surface
    with pytest.raises(ValueError, match="scenes"):
        VecEnv(one, batch("Align", 2, **{**first, **settings}))


def test_other_environments_are_refused():
    with pytest.raises(ValueError, match="autoreset_mode"):
        VecEnv(batch("Align", 2))
    env = batch("Align", 2, autoreset_mode="SameStep")
    env.single_observation_space = spaces.Dict({"pose": spaces.Discrete(3)})
    with pytest.raises(ValueError, match="observation"):
        VecEnv(env)
    with pytest.raises(ValueError, match="settings"):
        VecEnv(adapter().envs[0], num_envs=2, action="field")
    with pytest.raises(ValueError, match="num_envs"):
        VecEnv("vibgym/Align-v0", num_envs=0)


def test_dictionaries_are_batches_and_parts_have_rewards_of_their_own():
    """Several scenes equal each alone; the last step of an episode has its reward, not that of the next episode."""
    parts = {"parts": ["steel_block", "aluminium_block"], "action": "field", "observation": "parts"}
    settings = [{**parts, "max_episode_steps": 4}, {**parts, "max_episode_steps": 6, "walls": ["left"]}]
    both = VecEnv(*(batch("Sort", n, autoreset_mode="SameStep", **s) for n, s in zip((2, 3), settings, strict=True)))
    alone = [batch("Sort", n, autoreset_mode="SameStep", **s) for n, s in zip((2, 3), settings, strict=True)]
    both.seed(5)
    seen, first = both.reset(), [env.reset(seed=seed)[0] for env, seed in zip(alone, (5, 7), strict=True)]
    assert both.num_envs == 5 and set(seen) == {"parts", "mask"}
    generator, ends = np.random.default_rng(0), 0
    for step in range(12):
        for name in seen:
            assert (seen[name] == np.concatenate([observation[name] for observation in first])).all()
        push = generator.uniform(-1, 1, (5, 12)).astype(np.float32)
        seen, _, done, infos = both.step(push)
        steps = [env.step(action) for env, action in zip(alone, (push[:2], push[2:]), strict=True)]
        first, expected = [returned[0] for returned in steps], []
        for *_, info in steps:
            reward = info["parts"]["reward"].copy()
            if "final_info" in info:
                ended = info["_final_info"]
                reward[ended] = info["final_info"]["parts"]["reward"][ended]
            expected.append(reward)
        assert (both.part_reward == np.concatenate(expected)).all() and both.part_reward.shape == (5, 2)
        assert done.tolist() == [(step + 1) % 4 == 0] * 2 + [(step + 1) % 6 == 0] * 3
        for world in np.flatnonzero(done):
            last = infos[world]["terminal_observation"]
            assert (last["parts"] != seen["parts"][world]).any() and last["parts"].shape == seen["parts"][world].shape
            ends += 1
    assert ends == 3 * 2 + 2 * 3


def test_stable_baselines_learns_and_evaluates_on_it():
    env = adapter(action="field", max_episode_steps=5)
    model = PPO("MlpPolicy", env, n_steps=8, batch_size=24, n_epochs=1, policy_kwargs={"net_arch": [4]}, device="cpu")
    model.learn(48)
    assert model.num_timesteps == 48 and len(model.ep_info_buffer) == 9
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        returns, lengths = evaluate_policy(model, env, n_eval_episodes=3, return_episode_rewards=True)
    assert lengths == [5, 5, 5] and np.isfinite(returns).all()


def test_rewards_of_goals_are_computed_for_replay():
    env = adapter(action="field", observation="goal")
    desired = np.zeros((WORLDS, 3))
    achieved = desired + np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, 0.0]])
    for rows in (slice(None), slice(2)):
        got = env.env_method("compute_reward", achieved[rows], desired[rows], {}, indices=[0, 2])
        assert [array.tolist() for array in got] == [[0.0, -1.0, 0.0][rows]] * 2
    fallen = {"fallen": np.array([True, False, True])}
    (got,) = env.env_method("compute_reward", achieved, desired, fallen, indices=[0])
    assert got.tolist() == [-50.0, -1.0, -50.0]


class Halved(VectorRewardWrapper):
    """Halve the reward."""

    def rewards(self, reward):
        return 0.5 * reward


class PartByPart(VectorWrapper):
    """Divide the rewards by three, also those of the parts."""

    credits_parts = True

    def step(self, actions):
        seen, reward, *ends, info = self.env.step(actions)
        for reported in (info["parts"], info.get("final_info", {}).get("parts", {})):
            if reported:
                reported["reward"] = reported["reward"] / 3.0
        return seen, reward / 3.0, *ends, info


def test_made_by_name_with_wrappers():
    settings = {"parts": ["steel_block", "aluminium_block"], "action": "field", "max_episode_steps": 4}
    plain, half, third, both = (
        VecEnv("vibgym/Sort-v0", num_envs=3, wrappers=wrappers, **settings)
        for wrappers in ((), [Halved], [PartByPart], [RecordEpisodeStatistics, Halved, PartByPart])
    )
    assert [env.keeps_rewards for env in (plain, half, third, both)] == [True, False, False, False]
    assert [env.credits_parts for env in (plain, half, third, both)] == [True, False, True, False]
    for env in (plain, half, third, both):
        assert env.num_envs == 3 and env.get_attr("num_envs") == [3] * 3
        env.seed(1), env.reset()
    for push in np.random.default_rng(0).uniform(-1, 1, (9, 3, 12)).astype(np.float32):
        _, whole, done, _ = plain.step(push)
        assert plain.part_reward.mean(axis=1) == pytest.approx(whole, abs=1e-6)
        for env, share in ((half, 2.0), (third, 3.0), (both, 6.0)):
            _, reward, ended, infos = env.step(push)
            assert reward == pytest.approx(whole / share, abs=1e-7) and (ended == done).all()
            expected = plain.part_reward / share if env.credits_parts else np.repeat(reward[:, None], 2, axis=1)
            assert env.part_reward == pytest.approx(expected, abs=1e-7)
        for world in np.flatnonzero(done):
            assert infos[world]["episode"]["l"] == 4
    state = half.get_state()
    after = half.step(push)
    half.set_state(state)
    assert_same(half.step(push)[:3], after[:3])
