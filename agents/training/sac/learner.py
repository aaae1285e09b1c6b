"""Soft actor-critic, as the paper has it, on Stable-Baselines3's networks and loop.

Haarnoja et al. 2018, "Soft Actor-Critic Algorithms and Applications", https://arxiv.org/abs/1812.05905; the numbers of
equations are those of this paper.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import stable_baselines3
import torch
from stable_baselines3.common.utils import polyak_update
from torch.nn import functional

from agents.failures import Diverged
from agents.training.parts_policy import HALF_LOG_TAU
from agents.training.resumable import Resumable
from agents.training.sac.replay import Replay
from vibgym.policies.trained.state_policy import LEAST_LOG_STD, MOST_LOG_STD

LOG_2 = math.log(2.0)


class SAC(Resumable, stable_baselines3.SAC):
    """Stable-Baselines3's SAC with an update that reads as the paper does, and a state from which it goes on exactly.

    Two critics Q estimate the soft return of an action, two slow copies of them give the targets, the actor pi is a Gaussian
    squashed by a hyperbolic tangent, and the temperature alpha follows a wanted entropy. The critics get no gradients from the
    actor's loss, which would be thrown away.

    Args:
        *arguments, **more: of :class:`stable_baselines3.SAC`; the temperature must be learned, and the replay buffer be a
            :class:`agents.training.sac.replay.Replay`.
    """

    replay_buffer: Replay
    ent_coef_optimizer: torch.optim.Optimizer
    log_ent_coef: torch.Tensor

    def own_state(self) -> dict[str, Any]:
        return {"replay": self.replay_buffer.get_state()}

    def set_own_state(self, state: dict[str, Any]) -> None:
        self.replay_buffer.set_state(state["replay"])

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Draw ``gradient_steps`` batches of ``batch_size`` transitions and learn from each.

        Raises:
            Diverged: numbers that are not finite.
        """
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer])
        told = []
        for _ in range(gradient_steps):
            batch = self.replay_buffer.sample(batch_size)
            alpha = self.log_ent_coef.detach().exp()

            # Critics: the soft Bellman residual, equation (5), with the target of its gradient, equation (6).
            with torch.no_grad():
                following, log_pi = self._draw(batch.next_observations)
                value = _values(self.critic_target, batch.next_observations, following).amin(dim=0) - alpha * log_pi
                target = batch.rewards + (1.0 - batch.dones) * self.gamma * value
            critic_loss = 0.5 * ((_values(self.critic, batch.observations, batch.actions) - target) ** 2).mean(1).sum()
            _descend(self.critic.optimizer, critic_loss)

            # Actor: equation (9), through the noise that an action is made of.
            self.critic.requires_grad_(False)
            action, log_pi = self._draw(batch.observations)
            actor_loss = (alpha * log_pi - _values(self.critic, batch.observations, action).amin(dim=0)).mean()
            _descend(self.actor.optimizer, actor_loss)
            self.critic.requires_grad_(True)

            # Temperature: equation (18), by its logarithm as Stable-Baselines3 does.
            surplus = (log_pi.detach() + float(self.target_entropy)).mean()
            _descend(self.ent_coef_optimizer, (-self.log_ent_coef * surplus).sum())

            # Target networks follow slowly.
            with torch.no_grad():
                polyak_update(self.critic.parameters(), self.critic_target.parameters(), self.tau)
            self._n_updates += 1
            told.append(torch.stack([critic_loss.detach(), actor_loss.detach(), alpha[0]]))
        means = torch.stack(told).mean(dim=0).tolist()
        if not np.isfinite(means).all():
            raise Diverged("NaN or infinity in what critics and actor lose")
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, mean in zip(("critic_loss", "actor_loss", "ent_coef"), means, strict=True):
            self.logger.record(f"train/{name}", mean)

    def _draw(self, observations: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions (batch, size), equation (8), and the logarithms of their densities (batch, 1), appendix C.

        The tangent's slope by ``2 (log 2 - u - softplus(-2u))``, the logarithm of ``1 - tanh(u)^2`` without its cancellation.
        """
        latent = self.actor.latent_pi(observations)
        mean = self.actor.mu(latent)
        log_std = self.actor.log_std(latent).clamp(LEAST_LOG_STD, MOST_LOG_STD)  # type: ignore[operator]
        noise = torch.randn_like(mean)
        u = mean + log_std.exp() * noise
        log_slope = 2.0 * (LOG_2 - u - functional.softplus(-2.0 * u))
        log_pi = -0.5 * noise * noise - log_std - HALF_LOG_TAU - log_slope
        return torch.tanh(u), log_pi.sum(dim=1, keepdim=True)


def _values(critic: Any, observations: torch.Tensor, actions: torch.Tensor) -> torch.Tensor:
    """(2, batch, 1) of both critics."""
    return torch.stack([network(torch.cat((observations, actions), dim=1)) for network in critic.q_networks])


def _descend(optimizer: torch.optim.Optimizer, loss: torch.Tensor) -> None:
    optimizer.zero_grad()
    loss.backward()
    optimizer.step()
