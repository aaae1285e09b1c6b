"""Train PPO of Stable-Baselines3 to move a part to a pose (20 s, 99 to 100 %): ``python examples/train_ppo.py [STEPS]``.

An action commands the velocity of the part. Stable-Baselines3 is in the extra ``learn``.
"""

import sys
import time

import numpy as np
import torch
from stable_baselines3 import PPO

from vibgym.adapters.sb3 import VecEnv
from vibgym.policies import rollout
from vibgym.seeds import training_seed

ID = "vibgym/Align-v0"
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 100_000  # of all worlds together
torch.set_num_threads(1)  # a small network is trained faster by one
venv = VecEnv(ID, num_envs=128, action="velocity")
settings = {"n_steps": 32, "batch_size": 2048, "n_epochs": 8, "learning_rate": lambda left: 1.5e-3 * left}
model = PPO("MlpPolicy", venv, seed=0, device="cpu", policy_kwargs={"log_std_init": -0.7}, **settings)
venv.seed(training_seed(0))  # instead of the model's seed: the worlds begin with seeds that no evaluation uses
for when in ("untrained", "trained"):
    began = time.perf_counter()
    if when == "trained":
        model.learn(steps)
    taken = time.perf_counter() - began
    result = rollout(model, ID, seeds=range(200), action="velocity")  # episodes that are not those of the training
    median = f"median {np.nanmedian(result.time_to_goal):.2f} s" if result.success.any() else "never there"
    print(f"{when} in {taken:.1f} s: success {100 * result.success.mean():.1f} %, {median}", flush=True)
