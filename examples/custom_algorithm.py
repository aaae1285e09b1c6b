"""A custom algorithm, augmented random search of a linear policy: ``python examples/custom_algorithm.py [STEPS]`` (10 s).

H. Mania, A. Guy and B. Recht, "Simple random search of static linear policies", NeurIPS 2018; docs/learning.md.
"""

import sys
from pathlib import Path

import numpy as np

from agents.algorithms import ALGORITHMS
from agents.train import Training
from agents.training_envs import make_worlds
from agents.training_file import settings_from
from vibgym.policies import rollout
from vibgym.settings import BaseSettings


class Search:
    class Settings(BaseSettings):
        rate: float = 0.05
        noise: float = 0.1
        periods: int = 60  # of an episode

    def __init__(self, settings):
        self.own, self.action, self.observation, self.steps = settings.own, settings.action, "state", 0
        self.venv = make_worlds(settings, self.observation)  # one batch, as Stable-Baselines3's VecEnv
        self.random = np.random.default_rng(settings.seed)
        self.weights = np.zeros((self.venv.action_space.shape[0], self.venv.observation_space.shape[0]))

    def predict(self, observation, state=None, episode_start=None, deterministic=True):
        return np.clip(observation @ self.weights.T, -1.0, 1.0).astype(np.float32), state

    def learn(self, until, report):
        half = self.venv.num_envs // 2
        while self.steps < until:
            noise = self.random.standard_normal((half, *self.weights.shape))
            weights = self.weights + self.own.noise * np.concatenate([noise, -noise])  # (worlds, action, observation)
            observation, returns = self.venv.reset(), np.zeros(2 * half)
            for _ in range(self.own.periods):
                action = np.clip(np.einsum("wao,wo->wa", weights, observation), -1.0, 1.0).astype(np.float32)
                observation, reward, _, _ = self.venv.step(action)
                returns += reward
            slope = np.einsum("d,dao->ao", returns[:half] - returns[half:], noise) / half
            self.weights += self.own.rate / returns.std() * slope
            self.steps += self.own.periods * 2 * half
            report({"return": float(returns.mean())})

    def save(self, directory):
        np.savez(directory / "search.npz", weights=self.weights, steps=self.steps)

    def load(self, directory):
        return False  # every run starts anew


ALGORITHMS.register("search", Search)
steps = int(sys.argv[1]) if len(sys.argv) > 1 else 500_000
run = {"task": "Transport", "environment": {"action": "field"}, "worlds": 128, "steps": steps, "algorithm": "search"}
with Training(settings_from(run), Path("runs/custom_algorithm"), quiet=True) as training:
    for when in ("untrained", "trained"):
        result = rollout(training.learner, "vibgym/Transport-v0", seeds=range(100))
        print(f"{when:10} {100 * result.success.mean():5.1f} %, mean return {result.returns.mean():.2f}", flush=True)
        if when == "untrained":
            training.run()
