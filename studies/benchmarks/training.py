"""Steps per second of training: ``python -m studies.benchmarks.training``.

Includes rollouts, values, updates and logs, without imitation and learning curves. The cases are measured in turn, several
times; output: medians. ``SB3`` is the PPO of Stable-Baselines3 on the flat state with the same worlds, network sizes,
minibatches and epochs, as a baseline on the same host.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.logger import configure

import vibgym  # noqa: F401 - registers the environments
from agents.ppo import PPO as OurPPO
from agents.training_settings import TrainSettings
from studies import common
from vibgym.adapters.sb3 import VecEnv
from vibgym.simulation.threads import available_threads

TARGETS = {
    "Align, patch": 80_000,
    "Align, element": 25_000,
    "Sort, field": 12_000,
    "Sort, wrench": 12_000,
}
"""Target in steps of worlds per second on two free cores."""

ITERATIONS = 4
"""Rollouts and updates per measurement."""


def rate(learn: Callable[[int], object], steps: int) -> Callable[[], float]:
    """Return a function that measures steps per second; ``steps`` are those of a rollout and update."""
    learn(steps)  # kernels, allocations

    def measure() -> float:
        began = time.perf_counter()
        learn(ITERATIONS * steps)
        return ITERATIONS * steps / (time.perf_counter() - began)

    return measure


def ours(
    task: str, action: str, worlds: int, network: str = "parts", model: Any = "planar", **ppo: Any
) -> Callable[[], float]:
    """Start a training with vibgym's PPO; return a function that measures steps per second."""
    environment = {"action": action, "model": model}
    settings = TrainSettings(
        task=task, environment=environment, worlds=worlds, steps=1, own=OurPPO.Settings(network=network, **ppo)
    )
    learner = OurPPO(settings)
    return rate(lambda steps: learner.learn(learner.steps + steps, lambda metrics: None), learner.own.n_steps * worlds)


LOOP = {"n_steps": 32, "batch_size": 4096, "n_epochs": 3}
"""Settings of all libraries in their comparison, and two layers of 64."""


def sb3(task: str, action: str, worlds: int) -> Callable[[], float]:
    """Start a training with the PPO of Stable-Baselines3 on the flat state; return the same."""
    env = gym.make_vec(f"vibgym/{task}-v0", num_envs=worlds, action=action, autoreset_mode="SameStep")
    adapter = VecEnv(env.unwrapped)  # type: ignore[arg-type]
    model = PPO("MlpPolicy", adapter, **LOOP, policy_kwargs={"net_arch": [64, 64]}, device="cpu")
    model.set_logger(configure(None, []))
    return rate(lambda steps: model.learn(steps, reset_num_timesteps=False), model.n_steps * model.n_envs)


CROWD: dict[str, Any] = {"batch_size": 8192, "n_epochs": 2, "activation": "relu", "net": [128, 128]}
CASES: dict[str, Callable[[], Callable[[], float]]] = {
    "Align, velocity, SB3": lambda: sb3("Align", "velocity", 512),
    "Align, velocity": lambda: ours("Align", "velocity", 512, net=[64, 64], **LOOP),
    "Align, patch, SB3": lambda: sb3("Align", "patch", 512),
    "Align, patch": lambda: ours("Align", "patch", 512, net=[64, 64], **LOOP),
    "Align, element": lambda: ours("Align", "element", 512, network="elements", batch_size=8192, net=[64, 64]),
    "Sort, field": lambda: ours("Sort", "field", 256, batch_size=16384, n_epochs=2, activation="relu", net=[64, 64]),
    "Sort, wrench": lambda: ours("Sort", "wrench", 256, batch_size=16384, n_epochs=2, activation="relu", net=[64, 64]),
    "Pack, velocity": lambda: ours("Pack", "velocity", 128, **CROWD),
    "Pack, velocity, fast contacts": lambda: ours(
        "Pack", "velocity", 128, model={"kind": "planar", "contacts": "fast"}, **CROWD
    ),
}


def main() -> None:
    """Measure and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--rounds", type=int, default=5)
    parser.add_argument("--cases", nargs="+", default=list(CASES), choices=list(CASES))
    asked = parser.parse_args()
    made = {name: CASES[name]() for name in asked.cases}
    rates: dict[str, list[float]] = {name: [] for name in made}
    for _ in range(asked.rounds):
        for name, measure in made.items():
            rates[name].append(measure())
    print(f"{available_threads()} processors, torch with {torch.get_num_threads()} threads; medians of {asked.rounds}")
    first = float(np.median(next(iter(rates.values()))))
    for name, samples in rates.items():
        rate = float(np.median(samples))
        target = f"   target {TARGETS[name]}" if name in TARGETS else ""
        print(f"{name:<34}{rate:9.0f} steps/s   {rate / first:5.2f} x {asked.cases[0]}{target}")


if __name__ == "__main__":
    main()
