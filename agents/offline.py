"""Learning from a data set: behaviour cloning, and implicit Q-learning (IQL).

Cloning imitates the recorded actions. IQL (Kostrikov, Nair & Levine 2021, "Offline Reinforcement Learning with Implicit
Q-Learning", https://arxiv.org/abs/2110.06169) learns values of states and actions from the recorded actions, and weights the
samples of cloning by their advantage.
"""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any, Literal

import numpy as np
import torch
from pydantic import Field, model_validator
from stable_baselines3.common.utils import polyak_update
from torch import nn

from agents.actor_critic import ActorCritic
from agents.imitation import relative_error
from agents.learner import PartsLearner, Report
from agents.networks import PartsCritic
from agents.training_envs import make_worlds
from agents.training_settings import NetworkSettings, Rate, RateSettings, TrainSettings
from vibgym import checks
from vibgym.policies.trained.coding import Coding

BLOCK = 100
"""Updates between two calls of ``report``."""

MAX_WEIGHT = 20.0
"""Largest weight of a sample, as a multiple of the usual one."""


class ActionValues(nn.Module):
    """Two values of every part's action; targets use the lower one (Fujimoto et al. 2018).

    The action stands between the part's own columns and those of its neighbours.
    """

    def __init__(self, coding: Coding, settings: Offline.Settings) -> None:
        super().__init__()
        shape = coding.shape
        self.own = shape.own
        wider = shape._replace(columns=shape.columns + shape.action)
        make = (wider, list(settings.critic_net), settings.activation, settings.attention)
        self.both = nn.ModuleList(PartsCritic(*make) for _ in range(2))

    def forward(self, rows: torch.Tensor, mask: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        """Return both values (2, samples, parts)."""
        rows = torch.cat([rows[..., : self.own], action, rows[..., self.own :]], dim=-1)
        return torch.stack([critic(rows, mask) for critic in self.both])


class DataLearner(PartsLearner):
    """Learning from a data set, without episodes of its own.

    Args:
        settings: of the run.

    Attributes:
        own: settings of the algorithm.
        data: all steps.
        optimizer: of all weights that learn.
    """

    class Settings(NetworkSettings, RateSettings):
        """Settings of learning from a data set; a step is an update from one minibatch."""

        dataset: str = Field(min_length=1)
        """Minari's name, as ``python -m agents record`` writes it."""

        directory: str | None = None
        """Of the data sets; None: Minari's default."""

        episodes: int | None = Field(default=None, ge=1)
        """Of the data set, at most; None: all."""

        batch_size: int = Field(default=1024, ge=2, le=10_000_000)
        """Parts."""

    own: Any
    optimizer: torch.optim.Optimizer

    def __init__(self, settings: TrainSettings) -> None:
        from agents.transitions import read  # Minari is an extra

        super().__init__(settings)
        assert isinstance(settings.own, DataLearner.Settings)
        self.own = own = settings.own
        settings.check_alone()
        with checks.within("environment"):  # one world per scene
            self.env = make_worlds(settings.model_copy(update={"worlds": len(settings.all_scenes)}), self.observation)
        try:
            torch.manual_seed(settings.seed)
            coding = self.coding()
            self.data = read(own, self.env.env, self.action, coding, settings.algorithm)
        except ValueError:
            self.env.close()
            raise
        self.equivalents = [tuple(map(torch.from_numpy, equivalent)) for equivalent in coding.equivalents]
        self.make_networks(coding)

    def make_networks(self, coding: Coding) -> None:
        """Make the networks and the optimizer."""
        raise NotImplementedError

    def loss(self, chosen: torch.Tensor) -> tuple[torch.Tensor, dict[str, float]]:
        """Return the loss of a minibatch, and metrics; ``chosen`` (samples,) are indices of steps."""
        raise NotImplementedError

    def updated(self, updates: int) -> None:
        """Called after every update, with their number so far."""

    def learn(self, until: int, report: Report) -> None:
        """Make updates until there are ``until``; ``report`` is called every :data:`BLOCK` updates."""
        metrics: dict[str, float] = {}
        while self.steps < until:
            report(metrics)
            end = min(self.steps - self.steps % BLOCK + BLOCK, until)
            losses = [self._update(step) for step in range(self.steps, end)]
            self.steps = end
            self.check_finite()
            metrics = {name: float(np.mean([loss[name] for loss in losses])) for name in losses[0]}
        report(metrics)

    def _update(self, step: int) -> dict[str, float]:
        for group in self.optimizer.param_groups:
            group["lr"] = self.own.rate(1.0 - step / self.settings.steps)
        samples = max(self.own.batch_size // self.data.mask.shape[1], 1)
        loss, metrics = self.loss(torch.randint(len(self.data.at), (samples,)))
        self.optimizer.zero_grad()
        loss.backward()
        self.optimizer.step()
        self.updated(step + 1)
        return metrics

    def varied(self, rows: torch.Tensor, action: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return samples of equivalent scenes, drawn at random: see :attr:`vibgym.policies.trained.coding.Coding.equivalents`.

        Args:
            rows: (samples, 1, columns).
            action: (samples, 1, ..., values).
        """
        if len(self.equivalents) < 2:
            return rows, action
        rows, action = rows.clone(), action.clone()
        drawn = torch.randint(len(self.equivalents), (len(rows),))
        for number, (order, sign, to, times) in enumerate(self.equivalents):
            some = drawn == number
            rows[some], action[some] = rows[some][..., order] * sign, action[some][..., to] * times
        return rows, action

    def get_state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on."""
        return {**super().get_state(), "data": self.data.info["sha256"]}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        if state["data"] != self.data.info["sha256"]:
            raise ValueError(f"{self.data.info['dataset']} has changed")
        super().set_state(state)

    def save_policy(self, path: Path, training: dict[str, Any]) -> None:
        """Write the policy with a description of the data set."""
        super().save_policy(path, {**training, "data": self.data.info})


class Offline(DataLearner):
    """Behaviour cloning and implicit Q-learning. The policy has the form of PPO's."""

    class Settings(DataLearner.Settings):
        """Settings of cloning and implicit Q-learning (Kostrikov, Nair & Levine 2021)."""

        method: Literal["cloning", "iql"] = "cloning"
        """How the actor learns."""

        floor: float = Field(default=1.0, gt=0, le=10)
        """Size of actions below which errors are absolute."""

        gamma: float = Field(default=0.98, gt=0, lt=1)
        """Discount of a step, of "iql"."""

        expectile: float = Field(default=0.8, gt=0.5, lt=1)
        """Of values of states, of "iql"."""

        temperature: float = Field(default=1.0, gt=0, le=100)
        """Standard deviations of advantage per factor e of the weight, of "iql"."""

        tau: Rate = 0.01
        """Share of the learned network in an update of the target network, of "iql"."""

        @model_validator(mode="after")
        def _supported(self) -> Offline.Settings:
            if self.method == "iql" and self.network == "pixels":
                raise checks.conflict("network 'pixels' requires method 'cloning', got 'iql'")
            return self

    title, phase = "learning from a data set", "offline"
    advice = "offline.learning_rate"

    def make_networks(self, coding: Coding) -> None:
        """See :meth:`DataLearner.make_networks`."""
        own = self.own
        self.policy = ActorCritic(coding, own, log_std=-3.0)  # not trained
        self.values: ActionValues | None = None
        learn = list(self.policy.actor.parameters())
        if own.method == "iql":
            self.values = ActionValues(coding, own)
            self.target = copy.deepcopy(self.values).requires_grad_(False)
            learn = [*self.policy.parameters(), *self.values.parameters()]
        self.optimizer = torch.optim.Adam(learn, lr=own.learning_rate, fused=True)

    def loss(self, chosen: torch.Tensor) -> tuple[torch.Tensor, dict[str, float]]:
        """See :meth:`DataLearner.loss`."""
        data, settings = self.data, self.own
        at = data.at[chosen]
        rows, action = self.varied(data.rows[at], data.action[chosen])
        mask = data.mask[at]
        metrics, loss, weight = dict[str, float](), torch.zeros(()), mask
        if self.values is not None:
            advantage, loss, metrics = self._values(rows, mask, action, chosen)
            here = mask > 0.5
            scale = advantage[here].std().clamp(min=1e-6) * settings.temperature
            weight = mask * (advantage / scale).exp().clamp(max=MAX_WEIGHT)
        error = relative_error(self.policy.actor(rows)[0], action, weight, settings.floor)
        return error + loss, {"error": float(error.detach()), **metrics}

    def updated(self, updates: int) -> None:
        """Move the target networks."""
        if self.values is not None:
            with torch.no_grad():
                polyak_update(self.values.parameters(), self.target.parameters(), self.own.tau)

    def _values(
        self, rows: torch.Tensor, mask: torch.Tensor, action: torch.Tensor, chosen: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, dict[str, float]]:
        """Return advantages of the recorded actions, the loss of all values, and metrics."""
        assert self.values is not None
        data, settings, count = self.data, self.own, mask.sum().clamp(min=1.0)
        after = data.at[chosen] + 1
        with torch.no_grad():
            action_value = self.target(rows, mask, action).amin(dim=0)
            later = self.policy.critic(data.rows[after], data.mask[after])
            continues = (settings.gamma * (1.0 - data.ended[chosen]))[:, None]
            target = data.reward[chosen][:, None] + continues * later
        value = self.policy.critic(rows, mask)
        advantage = action_value - value
        asymmetry = torch.where(advantage > 0.0, settings.expectile, 1.0 - settings.expectile)
        of_states = (asymmetry.detach() * advantage**2 * mask).sum() / count
        of_actions = ((self.values(rows, mask, action) - target) ** 2 * mask).sum() / count
        metrics = {
            "value": float(of_states.detach()),
            "action_value": float(of_actions.detach()),
            "mean_value": float((value.detach() * mask).sum() / count),
        }
        return advantage.detach(), of_states + of_actions, metrics

    def learned(self) -> dict[str, Any]:
        """Return networks and optimizers by their names in checkpoints."""
        values = {} if self.values is None else {"values": self.values, "target": self.target}
        return {"policy": self.policy, **values, "optimizer": self.optimizer}
