"""Worlds of PPO: their present observations, the episodes that have ended, and the curriculum of environments."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import torch

from agents.checkpoint import arrays
from agents.training_envs import make_worlds
from agents.training_settings import TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.trained.coding import Coding, Inputs
from vibgym.seeds import training_seed

WINDOW = 100
"""Finished episodes over which success and logs are averaged."""


class Worlds:
    """All worlds of a run. It trains in the easier environments of its curriculum first, each until its condition holds.

    Args:
        settings: of the run.
        observation: the environments' ``observation=``.

    Attributes:
        env: the worlds of the present stage.
        stage: index of the stage; the number of stages once the run trains in its own environment.
        began: steps of the run at which the stage began.
        observation: present one; None before the first reset.
        start: (worlds,) bool, where it is the first one of an episode.
        inputs: network inputs of the step before; None after a reset of all worlds.
        episodes: return, length, success and cost of the last finished ones.

    Raises:
        ValueError: an environment is invalid, or a stage has other spaces than the run's own environment.
    """

    def __init__(self, settings: TrainSettings, observation: str) -> None:
        self.settings, self._named = settings, observation
        self.began = 0
        self._generator = torch.Generator().manual_seed(settings.seed)
        self._noise = torch.zeros(1, 1, 1)
        self.episodes: deque[tuple[float, int, bool, float]] = deque(maxlen=WINDOW)
        self.env = self._made(len(settings.curriculum))
        for self.stage in reversed(range(len(settings.curriculum))):  # the first stage remains
            former, self.env = self.env, self._made(self.stage)
            former.close()
            if (self.env.observation_space, self.env.action_space) != (former.observation_space, former.action_space):
                self.env.close()
                where = f"curriculum[{self.stage}].environment"
                raise checks.conflict(f"{where} has other observations or actions than the run's environment")
        self.stage = 0
        self._forget()

    def _forget(self) -> None:
        self.observation: Any = None
        self.start = np.ones(self.env.num_envs, dtype=bool)
        self.inputs: Inputs | None = None
        self.episodes.clear()

    def _made(self, stage: int) -> VecEnv:
        last = stage == len(self.settings.curriculum)
        with checks.within("environment" if last else f"curriculum[{stage}].environment"):
            settings = self.settings.model_copy(update={"environment": self.environment(stage)})
            return make_worlds(settings, self._named)

    def environment(self, stage: int) -> dict[str, Any]:
        """Return the arguments of the environment of a stage. Mappings in it and in the run's environment are merged."""
        merged = dict(self.settings.environment)
        changes = {} if stage == len(self.settings.curriculum) else self.settings.curriculum[stage].environment
        for name, value in changes.items():
            both = isinstance(value, dict) and isinstance(merged.get(name), dict)
            merged[name] = {**merged[name], **value} if both else value
        return merged

    def begin(self, steps: int) -> None:
        """Reset new worlds, and go to the next stage if this one is over after so many steps of the run."""
        if self.observation is None:
            self._reset(steps)
        if self.is_over(steps):
            self.stage, self.began = self.stage + 1, steps
            self.env.close()
            self.env = self._made(self.stage)
            self._forget()
            self._reset(steps)

    def _reset(self, steps: int) -> None:
        """Reset all worlds with seeds of no other reset of the run."""
        # The stage, since imitation may already have made all steps of one.
        self.env.seed(training_seed(self.settings.seed, f"{steps} steps, stage {self.stage}"))
        self.observation = self.env.reset()

    def is_over(self, steps: int) -> bool:
        """Return whether the present stage of the curriculum has ended after so many steps of the run.

        Its success counts after as many steps as all worlds need for an episode that fails: successful ones finish first.
        """
        if self.stage == len(self.settings.curriculum):
            return False
        until, done = self.settings.curriculum[self.stage].until, steps - self.began
        if until.steps is not None and done >= until.steps:
            return True
        least = (self.env.env.unwrapped.max_episode_steps or 0) * self.env.num_envs
        if until.success is None or done < least or len(self.episodes) < WINDOW:
            return False
        return float(np.mean([success for _, _, success, _ in self.episodes])) >= until.success

    def encode(self, coding: Coding) -> Inputs:
        """Return the network inputs of the present observation."""
        return coding.encode(self.observation, self.inputs, self.start)

    def noise(self, shape: tuple[int, ...], correlation: float) -> torch.Tensor:
        """Return standard normal noise (worlds, parts, values) for the present step.

        Args:
            shape: of the noise.
            correlation: with the noise of the step before in the same episode.
        """
        noise = torch.randn(shape, generator=self._generator)
        if correlation:
            share = correlation * torch.from_numpy(~self.start).to(noise)[:, None, None]
            noise = self._noise = share * self._noise + (1.0 - share**2).sqrt() * noise
        return noise

    def step(self, coding: Coding, inputs: Inputs, action: np.ndarray) -> dict[int, Inputs]:
        """Make a step in all worlds.

        Args:
            coding: of the network.
            inputs: of the present observation.
            action: (worlds, parts, values) of the network.

        Returns:
            Inputs of the final observation in worlds whose episode the limit has cut off; :attr:`start` has all that ended.
        """
        self.observation, _, self.start, infos = self.env.step(coding.decode(inputs, action))
        self.inputs, cut = inputs, {}
        for world in np.flatnonzero(self.start).tolist():
            info, episode = infos[world], infos[world]["episode"]
            if info["TimeLimit.truncated"]:
                cut[world] = coding.encode(info["terminal_observation"], inputs.of(world))
            self.episodes.append((episode["r"], episode["l"], info["is_success"], episode.get("c", 0.0)))
        return cut

    def metrics(self) -> dict[str, float]:
        """Return means over the last episodes, and the stage of a curriculum."""
        if not self.episodes:
            return {}
        means = np.mean(self.episodes, axis=0)
        found = {name: float(mean) for name, mean in zip(("return", "length", "success", "cost"), means, strict=True)}
        return found | ({"stage": self.stage} if self.settings.curriculum else {})

    def get_state(self) -> dict[str, Any]:
        """Return everything needed to continue bit for bit."""
        plain = {name: getattr(self, name) for name in ("stage", "began", "observation", "start", "inputs")}
        noise = {"generator": self._generator.get_state(), "noise": self._noise}
        return {**plain, **noise, "episodes": list(self.episodes), "env": self.env.get_state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        self._generator.set_state(state["generator"])
        self._noise = state["noise"]
        state = arrays(state)
        if state["stage"] != self.stage:
            self.env.close()
            self.env = self._made(state["stage"])
        self.env.set_state(state["env"])
        self.stage, self.began = state["stage"], state["began"]
        self.observation, self.start = state["observation"], state["start"]
        self.inputs = None if state["inputs"] is None else Inputs(*state["inputs"])
        self.episodes = deque(map(tuple, state["episodes"]), maxlen=WINDOW)
