"""Flow matching: a policy that samples sequences of actions as a data set has them.

The network gives the rate of change from noise to actions, see :mod:`vibgym.policies.trained.flow`. It learns the difference of
recorded actions and noise, at random points of the straight lines between both (Lipman et al., "Flow matching for generative
modeling", ICLR 2023).
"""

from __future__ import annotations

import copy
import math
from types import SimpleNamespace
from typing import Any, Literal

import torch
from pydantic import Field, model_validator
from torch import nn

from agents.networks import NETWORKS
from agents.offline import DataLearner
from agents.training_settings import Widths
from vibgym import checks
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.flow import MAX_HORIZON, TIMES, FlowPolicy
from vibgym.policies.trained.trained import FLOW

WARM, DECAY = 10.0, 0.999
"""The acting network is a running mean of the learned one. Its weight of the past grows from 0 to this, over about so many
updates."""


class FlowActor(nn.Module):
    """Rate of change of a sample, from a row of the coding, the sample, and the time of the flow.

    Args:
        coding: of the environment.
        settings: of the network, with the horizon.
    """

    phases: torch.Tensor

    def __init__(self, coding: Coding, settings: Flow.Settings) -> None:
        super().__init__()
        self.eyes = NETWORKS[settings.network][0].encoder(coding.shape, settings.attention)
        width, values = settings.net[0], settings.horizon * coding.shape.action
        self.first = nn.Linear(self.eyes.size + values + 1 + 2 * TIMES, width)
        self.blocks = nn.ModuleList(
            nn.Sequential(nn.LayerNorm(width), nn.Linear(width, width), nn.SiLU(), nn.Linear(width, width))
            for _ in settings.net
        )
        self.last = nn.Linear(width, values)
        nn.init.zeros_(self.last.weight)
        nn.init.zeros_(self.last.bias)
        self.register_buffer("phases", math.pi * torch.arange(1, TIMES + 1), persistent=False)

    def forward(self, rows: torch.Tensor, sample: torch.Tensor, t: torch.Tensor) -> torch.Tensor:
        """Return (..., horizon * values) for rows (..., columns), samples of that shape and times (..., 1)."""
        phase = self.phases * t
        x = self.first(torch.cat([self.eyes(rows), sample, t, phase.sin(), phase.cos()], dim=-1))
        for block in self.blocks:
            x = x + block(x)
        return self.last(nn.functional.silu(x))


class Flow(DataLearner):
    """Training by flow matching; see the module."""

    class Settings(DataLearner.Settings):
        """Settings of flow matching."""

        network: Literal["joint", "parts", "pixels"] = "joint"
        """Among agents.networks.NETWORKS."""

        net: Widths = (256, 256, 256)
        """Residual blocks, of equal width."""

        batch_size: int = Field(default=256, ge=2, le=10_000_000)
        """Parts."""

        horizon: int = Field(default=8, ge=1, le=MAX_HORIZON)
        """Actions of a plan."""

        executed: int = Field(default=2, ge=1, le=MAX_HORIZON)
        """Of these, before the next plan."""

        euler_steps: int = Field(default=5, ge=1, le=1000)
        """From noise to actions."""

        @model_validator(mode="after")
        def _fits(self) -> Flow.Settings:
            if len(set(self.net)) > 1:
                raise checks.conflict(f"net: all residual blocks must have the same width, got {list(self.net)}")
            if self.executed > self.horizon:
                raise checks.refuse("executed", self.executed, f"at most horizon, {self.horizon}")
            return self

    title, phase = "flow matching", "flow"
    advice = "flow.learning_rate"

    def make_networks(self, coding: Coding) -> None:
        """Make the learned and the acting network, and find the last step of every step's episode."""
        self.learning = FlowActor(coding, self.own)
        acting = copy.deepcopy(self.learning).requires_grad_(False)
        self.policy: Any = SimpleNamespace(coding=coding, actor=acting)
        self.optimizer = torch.optim.AdamW(
            self.learning.parameters(), lr=self.own.learning_rate, weight_decay=1e-4, fused=True
        )
        at = self.data.at
        ends = torch.nonzero(torch.diff(at, append=at[-1:] + 2) > 1).squeeze(-1)  # last steps of episodes
        self._end = ends[torch.searchsorted(ends, torch.arange(len(at)))]
        self._ahead = torch.arange(self.own.horizon)
        driven = self.data.action[self.data.mask[at] > 0.5]
        self._scale = float(driven.std().clamp(min=1e-3))

    def loss(self, chosen: torch.Tensor) -> tuple[torch.Tensor, dict[str, float]]:
        """See :meth:`agents.offline.DataLearner.loss`. After an episode's end its last action is repeated."""
        data = self.data
        at, steps = data.at[chosen], torch.minimum(chosen[:, None] + self._ahead, self._end[chosen, None])
        rows, actions = self.varied(data.rows[at], data.action[steps].transpose(1, 2))
        actions = actions.flatten(-2) / self._scale  # (samples, rows, horizon * values)
        noise, t = torch.randn_like(actions), torch.rand(*actions.shape[:2], 1)
        rate = self.learning(rows, torch.lerp(noise, actions, t), t)
        mask = data.mask[at]
        error = (((rate - (actions - noise)) ** 2).mean(dim=-1) * mask).sum() / mask.sum().clamp(min=1.0)
        return error, {"error": float(error.detach())}

    def updated(self, updates: int) -> None:
        """Move the acting network towards the learned one."""
        keep = min(DECAY, (1.0 + updates) / (WARM + updates))
        with torch.no_grad():
            for mean, new in zip(self.policy.actor.parameters(), self.learning.parameters(), strict=True):
                mean.lerp_(new, 1.0 - keep)

    def acting(self) -> Any:
        """Return the present policy in NumPy."""
        return FlowPolicy(self.actor(), self.network.network, self.policy.coding, self._form())

    def _form(self) -> dict[str, Any]:
        own = self.own
        return {"horizon": own.horizon, "executed": own.executed, "steps": own.euler_steps, "scale": self._scale}

    def custom_entries(self) -> dict[str, Any]:
        """See :meth:`agents.learner.PartsLearner.custom_entries`."""
        return {FLOW: self._form()}

    def learned(self) -> dict[str, Any]:
        """Return networks and optimizers by their names in checkpoints."""
        return {"learning": self.learning, "actor": self.policy.actor, "optimizer": self.optimizer}
