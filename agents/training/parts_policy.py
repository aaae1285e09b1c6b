"""Stable-Baselines3's policy of parts: an actor that all parts share, and a critic that sees all parts of a world."""

from __future__ import annotations

import math
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3.common.policies import ActorCriticPolicy
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor
from torch import nn

from agents.training.hyperparameters import NetworkSettings
from agents.training.networks.elements import ElementsActor
from agents.training.networks.parts import PartsActor, PartsCritic
from agents.training.networks.pixels import PixelsActor, PixelsCritic
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.pictures import PictureCoding

NETWORKS: dict[str, tuple[Any, Any]] = {
    "parts": (PartsActor, PartsCritic),
    "elements": (ElementsActor, PartsCritic),
    "pixels": (PixelsActor, PixelsCritic),
}
"""Actor and critic by the network's name: a part's action as a whole, one applied to every element around it, one of images."""

HALF_LOG_TAU = 0.5 * math.log(2.0 * math.pi)


class WholeObservation(BaseFeaturesExtractor):
    """Hands observations on as they are."""

    def __init__(self, space: gym.Space) -> None:
        super().__init__(space, features_dim=1)

    def forward(self, observations: Any) -> Any:
        """The same."""
        return observations


class PartsPolicy(ActorCriticPolicy):
    """Actor and critic over observations by parts; for :class:`agents.training.ppo.learner.PartsPPO`, and for SB3's own PPO.

    For the latter a world is one sample: log-probabilities add up over its parts, and its value is their mean.

    Args:
        observation_space, action_space, lr_schedule: as SB3 hands them on.
        coding: of the environment.
        network: which one of :data:`NETWORKS`, its widths, activation, and size of the encodings of other parts.
        log_std: of the exploration at the start.
        noise_floor: see :class:`agents.training.networks.parts.PartsActor`, which alone takes one; None: none.
    """

    def __init__(
        self,
        observation_space: gym.Space,
        action_space: gym.Space,
        lr_schedule: Any,
        *,
        coding: Coding | PictureCoding,
        network: NetworkSettings,
        log_std: float,
        noise_floor: float | None = None,
        **more: Any,
    ) -> None:
        self.coding = coding
        of_actor, of_critic = NETWORKS[network.network]
        rest = network.activation, network.attention
        floor = {} if noise_floor is None else {"floor": noise_floor}
        self._make = lambda: (
            of_actor(coding.shape, list(network.net), *rest, log_std, **floor),
            of_critic(coding.shape, list(network.critic_net), *rest),
        )
        super().__init__(
            observation_space, action_space, lr_schedule, features_extractor_class=WholeObservation, **more
        )

    def _build(self, lr_schedule: Any) -> None:
        self.actor, self.critic = self._make()
        self.optimizer = torch.optim.Adam(self.parameters(), lr=lr_schedule(1), eps=1e-5, fused=True)

    def forward(self, obs: Any, deterministic: bool = False) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Actions of worlds (batch, parts * numbers), their values (batch, 1) and log-probabilities (batch,)."""
        rows, mask = self._seen(obs)
        mean, log_std = self.actor(rows)
        action = mean if deterministic else mean + log_std.exp() * torch.randn_like(mean)
        log_prob = (log_probability(action, mean, log_std) * mask).sum(dim=-1)
        return action.flatten(1), self._value(rows, mask), log_prob

    def evaluate_actions(self, obs: Any, actions: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor, torch.Tensor]:
        """Values, log-probabilities and entropies of worlds' actions."""
        rows, mask = self._seen(obs)
        mean, log_std = self.actor(rows)
        log_prob = (log_probability(actions.reshape(mean.shape), mean, log_std) * mask).sum(dim=-1)
        entropy = ((log_std + 0.5 + HALF_LOG_TAU).sum(dim=-1) * mask).sum(dim=-1)
        return self._value(rows, mask), log_prob, entropy

    def predict_values(self, obs: Any) -> torch.Tensor:
        """Values (batch, 1) of worlds."""
        return self._value(*self._seen(obs))

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """The environment's actions, see :meth:`vibgym.policies.protocol.Policy.predict`."""
        seen = self.coding.see(observation, state, episode_start)
        with torch.no_grad():
            mean, log_std = self.actor(torch.from_numpy(seen.rows))
            action = mean if deterministic else mean + log_std.exp() * torch.randn_like(mean)
        actions = self.coding.actions(seen, action.clamp(-1.0, 1.0).numpy())
        return (actions[0] if self.coding.single(observation) else actions), seen

    def _value(self, rows: torch.Tensor, mask: torch.Tensor) -> torch.Tensor:
        of_parts = self.critic(rows, mask) * mask
        return of_parts.sum(dim=-1, keepdim=True) / mask.sum(dim=-1, keepdim=True).clamp(min=1.0)

    def _seen(self, obs: Any) -> tuple[torch.Tensor, torch.Tensor]:
        parts = len(self.coding.parts)
        return obs["parts"][:, :parts].float(), obs["mask"][:, :parts].float()


def log_probability(action: torch.Tensor, mean: torch.Tensor, log_std: torch.Tensor) -> torch.Tensor:
    """Of the parts' actions (..., numbers) under a normal distribution, (...)."""
    scaled = (action - mean) * torch.exp(-log_std)
    return -(0.5 * scaled * scaled + log_std + HALF_LOG_TAU).sum(dim=-1)


def trained_tensors(module: nn.Module) -> dict[str, np.ndarray]:
    """What a module has learned, as NumPy arrays under torch's names."""
    return {name: value.detach().cpu().numpy() for name, value in module.state_dict().items()}
