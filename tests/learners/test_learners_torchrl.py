"""TorchRL's batched multi-agent environment: specs, parity with the native batch, resets of some worlds, errors."""

import gymnasium as gym
import numpy as np
import pytest

pytest.importorskip("torchrl", reason="extra learners")

import torch
from torchrl.envs.utils import check_env_specs

from vibgym.adapters.torchrl import BatchEnv

pytestmark = pytest.mark.full


@pytest.mark.parametrize(("name", "settings"), [
    ("Sort", {}),
    ("SortCrowded", {"costs": {"impulse": 1.0}, "randomize": {"parts": [2, 6]}}),
    ("Push", {"action": "wrench"}),
    ("Feed", {}),
    ("AlignShapes", {"shapes": [3]}),
])  # fmt: skip
def test_specs_agree_with_what_is_returned(name, settings):
    env = BatchEnv(f"vibgym/{name}-v0", num_envs=3, **settings)
    check_env_specs(env)
    parts = {"Push": 2, "Feed": 12, "AlignShapes": 1}.get(name, 6)
    assert env.group_map == {"parts": [f"part_{k}" for k in range(parts)]}
    assert env.rollout(3)["parts", "action"].shape == (3, 3, parts, 3)
    env.close()


def test_steps_are_those_of_the_native_batch_and_worlds_are_reset_alone():
    settings = {"action": "velocity", "observation": "parts", "max_episode_steps": 5, "costs": {"clearance": 1.0}}
    native = gym.make_vec("vibgym/SortCrowded-v0", num_envs=4, autoreset_mode="Disabled", **settings)
    env = BatchEnv(gym.make_vec("vibgym/SortCrowded-v0", num_envs=4, autoreset_mode="Disabled", **settings))
    env.set_seed(7)
    now, (seen, _) = env.reset(), native.reset(seed=7)
    draw = np.random.default_rng(0)
    for step in range(1, 12):
        np.testing.assert_array_equal(now["parts", "observation"].numpy(), seen["parts"])
        np.testing.assert_array_equal(now["parts", "mask"][..., 0].numpy(), seen["mask"] > 0)
        action = draw.uniform(-1, 1, (4, 6, 3)).astype(np.float32)
        now["parts", "action"] = torch.from_numpy(action)
        then = env.step(now)["next"]
        seen, _, terminated, truncated, info = native.step(action.reshape(4, -1))
        np.testing.assert_array_equal(
            then["parts", "reward"][..., 0].numpy(), info["parts"]["reward"].astype(np.float32)
        )
        np.testing.assert_array_equal(then["parts", "cost"][..., 0].numpy(), info["parts"]["cost"].astype(np.float32))
        np.testing.assert_array_equal(then["truncated"][:, 0].numpy(), truncated)
        now, ended = then, terminated | truncated
        assert truncated.all() == (step % 5 == 0) or ended.any()
        if ended.any():
            now["_reset"] = torch.from_numpy(ended)[:, None]
            now = env.reset(now)
            seen, _ = native.reset(options={"reset_mask": ended})
    env.close()


def test_every_world_gets_its_seed_at_its_next_reset():
    env = BatchEnv("vibgym/Sort-v0", num_envs=4)
    env.set_seed(7)
    first = env.reset()["parts", "observation"].clone()
    env.set_seed(3)
    some = env.reset().clone()
    env.set_seed(7)
    some["_reset"] = torch.tensor([[True], [False], [False], [True]])
    part = env.reset(some)["parts", "observation"]  # as a collector does between two calls of set_seed
    rest = env.reset()["parts", "observation"]
    assert torch.equal(part[[0, 3]], first[[0, 3]]) and not torch.equal(part[1], first[1])
    assert torch.equal(rest[[1, 2]], first[[1, 2]]) and not torch.equal(rest[0], first[0])
    for bad in (-1, 0.5, "seven"):
        with pytest.raises(ValueError, match="seed"):
            env.set_seed(bad)
    env.close()


DISC = {"shape": "disc", "radius": 0.02, "friction": 0.5, "coupling": 0.0}


@pytest.mark.parametrize(("settings", "named"), [
    ({"action": "element"}, "values per part"), ({"observation": "state"}, "observation"), ({"slots": 12}, "slots"),
    ({"parts": [DISC] * 2}, "no agents"),
])  # fmt: skip
def test_bad_settings_and_environments_of_another_form_are_refused(settings, named):
    with pytest.raises(ValueError, match=named):
        BatchEnv("vibgym/Sort-v0", num_envs=2, **settings)
    with pytest.raises(ValueError, match="DISABLED"):
        BatchEnv(gym.make_vec("vibgym/Sort-v0", num_envs=2, observation="parts", action="velocity"))
    with pytest.raises(ValueError, match="parts"):
        BatchEnv(gym.make_vec("vibgym/Sort-v0", num_envs=2, action="velocity", autoreset_mode="Disabled"))
    with pytest.raises(ValueError, match="require the id"):
        BatchEnv(gym.make_vec("vibgym/Sort-v0", num_envs=2), num_envs=3)
