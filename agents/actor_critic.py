"""Actor and critic together, with the coding of their inputs, and the normal distribution of actions."""

from __future__ import annotations

import math

import torch
from torch import nn

from agents.networks import NETWORKS
from agents.training_settings import NetworkSettings
from vibgym import checks
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.symmetry import Symmetry

HALF_LOG_TAU = 0.5 * math.log(2.0 * math.pi)

MIN_DEVIATION = 0.02
"""Added to the standard deviations of rows."""


class ActorCritic(nn.Module):
    """Actor and critic with the coding of their inputs.

    Args:
        coding: of the environment.
        settings: name, widths and activation of the networks.
        log_std: initial logarithmic standard deviation of exploration.
        noise_floor: see :class:`.networks.PartsActor`, which alone has one; None: none.
        standardized: standardize rows without neighbours, see :meth:`standardize`.
        symmetric: average both networks over the equivalent scenes of the coding.
    """

    def __init__(
        self,
        coding: Coding,
        settings: NetworkSettings,
        log_std: float,
        noise_floor: float | None = None,
        standardized: bool = False,
        symmetric: bool = False,
    ) -> None:
        super().__init__()
        self.coding, self.network, self.standardized, self.symmetric = coding, settings.network, standardized, symmetric
        make_actor, make_critic = NETWORKS[settings.network]
        rest = settings.activation, settings.attention
        floor = {} if noise_floor is None else {"floor": noise_floor}
        self.actor = make_actor(coding.shape, list(settings.net), *rest, log_std, **floor)
        self.critic = make_critic(coding.shape, list(settings.critic_net), *rest)
        if symmetric:
            if coding.symmetry is None:
                raise checks.conflict("symmetric requires network 'joint', or 'turned' with an action of motions")
            symmetry = Symmetry(*map(torch.from_numpy, coding.symmetry))
            self.actor.symmetry = self.critic.symmetry = symmetry
        if standardized:
            self._set(torch.zeros(coding.shape.columns), torch.zeros(coding.shape.columns))

    @property
    def unstandardized(self) -> bool:
        """Whether rows are to be standardized and :meth:`standardize` was not called yet."""
        return self.standardized and not bool(self.actor.eyes.scale.any())

    def standardize(self, rows: torch.Tensor) -> None:
        """Standardize rows by means and standard deviations of these (..., columns); columns that hardly vary stay small."""
        every = rows.reshape(-1, rows.shape[-1])
        self._set(every.mean(dim=0), 1.0 / (every.std(dim=0) + MIN_DEVIATION))

    def standardize_critic(self) -> None:
        """Standardize the critic's rows as the actor's, which was loaded."""
        self._set(self.actor.eyes.mean, self.actor.eyes.scale)

    def _set(self, mean: torch.Tensor, scale: torch.Tensor) -> None:
        for network in (self.actor, self.critic):
            network.eyes.mean, network.eyes.scale = mean.clone(), scale.clone()

    def sample(self, rows: torch.Tensor, noise: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Return actions (..., action) for rows (..., columns) and standard normal noise, and log-probabilities (...)."""
        mean, log_std = self.actor(rows)
        return mean + log_std.exp() * noise, -(0.5 * noise * noise + log_std + HALF_LOG_TAU).sum(dim=-1)


def log_probability(action: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Return log-probabilities (...) of actions (..., size) under a normal distribution."""
    scaled = (action - mean) * torch.exp(-log_std)
    return -(0.5 * scaled * scaled + log_std + HALF_LOG_TAU).sum(dim=-1)
