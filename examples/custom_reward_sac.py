"""A custom reward, trained with SAC on a batch of worlds: ``python examples/custom_reward_sac.py [STEPS]`` (2 minutes, 100 %).

The reward includes the energy of the elements. Stable-Baselines3 is in the extra ``learn``.
"""

import sys

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import SAC

from vibgym.adapters.sb3 import VecEnv
from vibgym.policies import rollout
from vibgym.seeds import training_seed
from vibgym.tasks import TASKS, Transport


class ThriftyTransport(Transport):
    """Transport with a cost for the energy of the elements."""

    TERMS = {**Transport.TERMS, "energy": 0.05}

    def reward(self, step):
        """Return terms (worlds, parts) by name; ``step.phasors``: 1 is full scale."""
        energy = np.square(step.phasors).sum(axis=-1).mean(axis=(1, 2))
        return {**super().reward(step), "energy": -energy[:, None] * step.present}


TASKS.register("ThriftyTransport", ThriftyTransport)
gym.register(
    "mine/ThriftyTransport-v0",
    entry_point="vibgym.envs:VibgymEnv",
    vector_entry_point="vibgym.envs:VibgymVectorEnv",
    max_episode_steps=250,
    kwargs={"task": "ThriftyTransport", "action": "field", "max_episode_periods": 250},
)

torch.set_num_threads(1)  # such small networks gain nothing from more, and other work loses them
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 60_000
venv = VecEnv("mine/ThriftyTransport-v0", num_envs=32)
settings = {"learning_rate": 1e-3, "batch_size": 256, "gradient_steps": 8, "learning_starts": min(2000, steps // 2)}
settings["ent_coef"] = (
    "auto_0.01"  # rewards per step are about 0.01: with a first value of 1, entropy dominates the return for long
)
model = SAC("MlpPolicy", venv, seed=0, device="cpu", policy_kwargs={"net_arch": [128, 128]}, **settings)
venv.seed(training_seed(0))  # instead of the model's seed: the worlds begin with seeds that no evaluation uses
for when in ("untrained", "trained"):
    result = rollout(model, "mine/ThriftyTransport-v0", seeds=range(100), action="field")
    print(f"{when:10} {100 * result.success.mean():5.1f} %, mean return {result.returns.mean():.2f}", flush=True)
    if when == "untrained":
        model.learn(steps, progress_bar=True)
