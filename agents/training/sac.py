"""Stable-Baselines3's SAC with a leaner update."""

from __future__ import annotations

from typing import Any

import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.utils import polyak_update
from torch.nn import functional

from agents.training.checkpoint import Diverged
from agents.training.hindsight import HindsightBuffer
from agents.training.noise import Wandering
from agents.training.resumable import Resumable
from vibgym.policies.trained.goal_policy import LEAST_LOG_STD, MOST_LOG_STD


class LeanSAC(Resumable, SAC):
    """SAC for small networks on one core, where most of an update's time goes into calls and not into numbers.

    The update is that of Haarnoja et al., "Soft Actor-Critic Algorithms and Applications", 2018
    (https://arxiv.org/abs/1812.05905), as Stable-Baselines3 has it, with three differences in what is computed when. Features
    of a batch are made once and not for each network, which asks for an extractor without weights. The critics' weights get no
    gradients from the actor's loss, which would be thrown away. Actor and entropy coefficient learn at every
    ``policy_delay``-th update of the critics only (as in TD3, https://arxiv.org/abs/1802.09477).

    With the sparse goal reward alone, values that it cannot come to are cut off, as Andrychowicz et al. do for rewards of -1
    and 0; what is worse than never reaching a goal, a fall, then counts as much as that, and does not outweigh all else that
    the critics learn.

    Args:
        policy_delay: updates of the critics for one of the actor.
        values: least and largest value of a transition; None: whatever rewards come to.
        more: of :class:`stable_baselines3.SAC`; the entropy coefficient must be learned.

    Raises:
        ValueError: an extractor that has weights.
    """

    def __init__(self, *args: Any, policy_delay: int, values: tuple[float, float] | None, **more: Any) -> None:
        self.policy_delay, self.values = policy_delay, values
        super().__init__(*args, **more)
        if any(True for _ in self.actor.features_extractor.parameters()) or self.ent_coef_optimizer is None:
            raise ValueError("policy: its features extractor has weights, or the entropy coefficient is not learned")

    def own_state(self) -> dict[str, Any]:
        assert isinstance(self.replay_buffer, HindsightBuffer) and isinstance(self.action_noise, Wandering)
        return {"replay": self.replay_buffer.get_state(), "noise": self.action_noise.get_state()}

    def set_own_state(self, state: dict[str, Any]) -> None:
        assert isinstance(self.replay_buffer, HindsightBuffer) and isinstance(self.action_noise, Wandering)
        self.replay_buffer.set_state(state["replay"])
        self.action_noise.set_state(state["noise"])

    def _setup_learn(self, *args: Any, **more: Any) -> Any:
        """As SB3's, which would quieten the noise of a training that goes on."""
        assert isinstance(self.action_noise, Wandering)
        kept = self.action_noise.value.copy()
        result = super()._setup_learn(*args, **more)
        self.action_noise.value = kept
        return result

    def train(self, gradient_steps: int, batch_size: int = 64) -> None:
        """Draw ``gradient_steps`` batches of ``batch_size`` transitions and learn from each.

        Raises:
            Diverged: numbers that are not finite.
        """
        assert self.replay_buffer is not None and self.ent_coef_optimizer is not None and self.log_ent_coef is not None
        self.policy.set_training_mode(True)
        self._update_learning_rate([self.actor.optimizer, self.critic.optimizer, self.ent_coef_optimizer])
        extract = self.actor.features_extractor
        weights, targets = list(self.critic.parameters()), list(self.critic_target.parameters())
        critic_losses, actor_losses, coefficients = [], [], []
        for _ in range(gradient_steps):
            batch = self.replay_buffer.sample(batch_size)
            coefficient = self.log_ent_coef.detach().exp()
            with torch.no_grad():
                seen, after = extract(batch.observations), extract(batch.next_observations)
                action, logarithm = self._draw(after)
                value = _least(self.critic_target, after, action) - coefficient * logarithm
                wanted = batch.rewards + (1.0 - batch.dones) * self.gamma * value
                if self.values is not None:
                    wanted = wanted.clamp(*self.values)
            both = torch.cat((seen, batch.actions), dim=1)
            loss = sum(0.5 * functional.mse_loss(network(both), wanted) for network in self.critic.q_networks)
            assert isinstance(loss, torch.Tensor)
            self.critic.optimizer.zero_grad()
            loss.backward()
            self.critic.optimizer.step()
            critic_losses.append(loss.detach())
            self._n_updates += 1
            if self._n_updates % self.policy_delay == 0:
                self.critic.requires_grad_(False)
                action, logarithm = self._draw(seen)
                loss = (coefficient * logarithm - _least(self.critic, seen, action)).mean()
                self.actor.optimizer.zero_grad()
                loss.backward()
                self.actor.optimizer.step()
                self.critic.requires_grad_(True)
                actor_losses.append(loss.detach())
                surplus = (logarithm.detach() + float(self.target_entropy)).mean()
                self.ent_coef_optimizer.zero_grad()
                (-self.log_ent_coef * surplus).sum().backward()
                self.ent_coef_optimizer.step()
                coefficients.append(coefficient)
            with torch.no_grad():
                polyak_update(weights, targets, self.tau)
        if not torch.isfinite(critic_losses[-1]):
            raise Diverged("NaN or infinity in what the critics lose")
        self.logger.record("train/n_updates", self._n_updates, exclude="tensorboard")
        for name, values in (("critic_loss", critic_losses), ("actor_loss", actor_losses), ("ent_coef", coefficients)):
            if values:
                self.logger.record(f"train/{name}", float(np.mean(torch.stack(values).numpy())))

    def _draw(self, features: torch.Tensor) -> tuple[torch.Tensor, torch.Tensor]:
        """Actions (batch, size) and the logarithms of their densities (batch, 1).

        Gaussian noise through tanh; the density by ``2 (log 2 - u - softplus(-2u))``, the logarithm of ``1 - tanh(u)^2``
        without its cancellation.
        """
        latent = self.actor.latent_pi(features)
        mean = self.actor.mu(latent)
        spread = self.actor.log_std(latent).clamp(LEAST_LOG_STD, MOST_LOG_STD)  # type: ignore[operator]
        noise = torch.randn_like(mean)
        before = mean + spread.exp() * noise
        narrowing = 2.0 * (LOG_2 - before - functional.softplus(-2.0 * before))
        logarithm = -0.5 * noise * noise - spread - HALF_LOG_2_PI - narrowing
        return torch.tanh(before), logarithm.sum(dim=1, keepdim=True)


LOG_2 = float(np.log(2.0))
HALF_LOG_2_PI = 0.5 * float(np.log(2.0 * np.pi))


def _least(critic: Any, features: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
    """(batch, 1) the lower value of the critics."""
    both = torch.cat((features, action), dim=1)
    first, second = (network(both) for network in critic.q_networks)
    return torch.minimum(first, second)
