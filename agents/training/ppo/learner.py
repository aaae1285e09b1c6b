"""PPO with parts as samples, on Stable-Baselines3: its own loop and logs, leaner steps and updates.

Every part of every world is a sample with its own reward and advantage, so that what one part does well or badly is not charged
to all (learning.md). What costs time in SB3's loop for many worlds is done in batch: no dictionaries of worlds that have not
ended, values of a whole rollout at once, few and large minibatches.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import torch
from stable_baselines3 import PPO
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.utils import FloatSchedule, update_learning_rate

from agents.training.checkpoint import check_finite
from agents.training.parts_policy import HALF_LOG_TAU, PartsPolicy, log_probability
from agents.training.ppo.overlap import learn_overlapping
from agents.training.ppo.rollout_buffer import PartsBuffer
from agents.training.resumable import Resumable
from vibgym.policies.trained.coding import Seen

PACE, LEAST_PACE, FAR = 1.5, 0.01, 4.0
"""By what the learning rate changes, its least share, and multiples of ``target_kl`` at which an update ends."""


class PartsPPO(Resumable, PPO):
    """PPO (Schulman et al. 2017) over :class:`agents.training.parts_policy.PartsPolicy`; see the module.

    Args:
        policy, env, **settings: as SB3's; ``env`` is a :class:`vibgym.adapters.sb3.VecEnv` over worlds with
            observations by parts. ``batch_size`` counts parts.
        touch_cost: what a step in touch with another part costs, in training alone: tasks count touches, but do not price them.
        critic_steps: steps at the start in which the critic alone learns: an actor that has been taught something is not to
            be spoilt by values that mean nothing yet.
        precision: of updates: ``"bfloat16"`` casts all layers but the last ones.
        driven: of each part whether actions speak for it, see :class:`.rollout_buffer.PartsBuffer`; None: all.
        overlap: whether rollouts are made beside updates, see :mod:`agents.training.ppo.overlap`.

    Attributes:
        waiting: with ``overlap``, samples of a rollout that has not been learned from.
        pace: share of the learning rate, which ``target_kl`` rules: a small standard deviation makes every step a large one.
    """

    policy: PartsPolicy
    rollout_buffer: PartsBuffer

    def __init__(
        self,
        policy: Any,
        env: Any,
        *,
        touch_cost: float = 0.0,
        critic_steps: int = 0,
        precision: str = "float32",
        overlap: bool = False,
        driven: Sequence[bool] | None = None,
        **settings: Any,
    ) -> None:
        coding = settings["policy_kwargs"]["coding"]
        buffer = {"rollout_buffer_class": PartsBuffer, "rollout_buffer_kwargs": {"coding": coding, "driven": driven}}
        super().__init__(policy, env, **buffer, **settings)
        self.critic_steps, self.touch_cost = critic_steps, touch_cost
        self.precision, self.overlap = precision, overlap
        self.pace = 1.0
        self._seen: Seen | None = None  # at the last step
        self.waiting: dict[str, torch.Tensor] | None = None

    @staticmethod
    def _wrap_env(env: Any, verbose: int = 0, monitor_wrapper: bool = True) -> Any:
        """The adapter as it is: SB3 would turn images round, and networks of pixels read them as environments give them."""
        return env

    def own_state(self) -> dict[str, Any]:
        waiting = None if self.waiting is None else {name: each.numpy() for name, each in self.waiting.items()}
        return {"pace": self.pace, "seen": None if self._seen is None else list(self._seen), "waiting": waiting}

    def set_own_state(self, state: dict[str, Any]) -> None:
        seen, waiting = state["seen"], state["waiting"]
        self.pace, self._seen = state["pace"], None if seen is None else Seen(*seen)
        self.waiting = None if waiting is None else {name: torch.from_numpy(each) for name, each in waiting.items()}

    def learn(self, total_timesteps: int, callback: Any = None, log_interval: int = 1, *more: Any, **named: Any) -> Any:
        """Make steps and learn from them, as Stable-Baselines3 does, or both at a time."""
        if not self.overlap:
            return super().learn(total_timesteps, callback, log_interval, *more, **named)
        learn_overlapping(self, total_timesteps, callback, log_interval)
        return self

    def collect_rollouts(self, env: Any, callback: BaseCallback, rollout_buffer: Any, n_rollout_steps: int) -> bool:
        """Let all worlds make ``n_steps`` steps; False where the callback ends the training."""
        callback.on_rollout_start()
        goes_on = self.make_steps(self.policy.actor, callback)
        if goes_on:
            self.end_rollout(callback)
        return goes_on

    def end_rollout(self, callback: BaseCallback) -> None:
        """Values and advantages of the steps made, by the critic as it is."""
        seen = self.policy.coding.see(self._last_obs, self._seen, self._last_episode_starts)
        self.rollout_buffer.finish(seen, self.policy.critic)
        callback.update_locals(locals())
        callback.on_rollout_end()

    def make_steps(self, actor: Any, callback: BaseCallback) -> bool:
        """Let all worlds make ``n_steps`` steps as ``actor`` says; False where the callback ends the training."""
        env: Any = self.env
        coding, buffer = self.policy.coding, self.rollout_buffer
        buffer.reset()
        for _ in range(self.n_steps):
            seen = coding.see(self._last_obs, self._seen, self._last_episode_starts)
            with torch.no_grad():
                mean, log_std = actor(torch.from_numpy(seen.rows))
                noise = torch.randn_like(mean)
                action = mean + log_std.exp() * noise
                log_prob = -(0.5 * noise * noise + log_std + HALF_LOG_TAU).sum(dim=-1)
            action, asked = action.numpy(), action.clamp(-1.0, 1.0).numpy()
            observation, _, done, infos = env.step(coding.actions(seen, asked))
            reward = env.part_reward - self.touch_cost * coding.touching(seen)
            buffer.write(seen, action, log_prob.numpy(), reward, done)
            self.num_timesteps += env.num_envs
            for world in np.flatnonzero(done).tolist():
                if infos[world]["TimeLimit.truncated"]:
                    buffer.cut_off(world, coding.see(infos[world]["terminal_observation"], seen.of(world)))
            self._update_info_buffer(infos, done)
            self._last_obs, self._last_episode_starts, self._seen = observation, done, seen
            if not callback.on_step():
                return False
        return True

    def train(self, steps: int | None = None, order: torch.Generator | None = None) -> None:
        """Update actor and critic from the rollout that waits, or else from the last one.

        Args:
            steps: that had been made when it ended; None: those made until now.
            order: of the samples; None: torch's own generator.

        Raises:
            Diverged: numbers that are not finite.
        """
        assert isinstance(self.clip_range, FloatSchedule) or callable(self.clip_range)
        rate = self.lr_schedule(self._current_progress_remaining)
        update_learning_rate(self.policy.optimizer, self.pace * rate)
        clip = self.clip_range(self._current_progress_remaining)
        samples = self.rollout_buffer.samples() if self.waiting is None else dict(self.waiting)
        acts = (self.num_timesteps if steps is None else steps) > self.critic_steps
        here = samples["mask"] > 0.5
        of_parts = samples["advantage"][here]
        samples["advantage"] = (samples["advantage"] - of_parts.mean()) / (of_parts.std() + 1e-8)
        worlds = len(samples["mask"])
        size = max(self.batch_size // samples["mask"].shape[1], 1)
        losses: dict[str, list[float]] = {"policy": [], "value": [], "kl": [], "clipped": []}
        far = False
        for _ in range(self.n_epochs):
            for chosen in torch.randperm(worlds, generator=order).split(size):
                if len(chosen) * 2 < size and worlds >= size:  # a last, small minibatch would be noise
                    continue
                part = {name: each.index_select(0, chosen) for name, each in samples.items()}
                loss, facts = self._loss(part, clip, acts)
                for name, value in facts.items():
                    losses[name].append(value)
                if self.target_kl is not None and acts and losses["kl"][1:]:  # nothing has changed before the first
                    self._adapt(facts["kl"])
                    update_learning_rate(self.policy.optimizer, self.pace * rate)
                    if facts["kl"] > FAR * self.target_kl:
                        far = True
                        break
                self.policy.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), self.max_grad_norm)
                self.policy.optimizer.step()
            if far:
                break
            self._n_updates += 1
        for name, values in losses.items():
            self.logger.record(f"train/{name}", float(np.mean(values)) if values else float("nan"))
        self.logger.record("train/pace", self.pace)
        check_finite(self)

    def _adapt(self, kl: float) -> None:
        """Learn more slowly where the actor has moved too far within an update, and faster again where it hardly has."""
        assert self.target_kl is not None
        if kl > 2.0 * self.target_kl:
            self.pace = max(self.pace / PACE, LEAST_PACE)
        elif kl < 0.5 * self.target_kl:
            self.pace = min(self.pace * PACE, 1.0)

    def _loss(self, part: dict[str, torch.Tensor], clip: float, acts: bool) -> tuple[torch.Tensor, dict[str, float]]:
        """Loss of a minibatch, and what to tell of it."""
        mask = part["mask"]
        count = mask.sum().clamp(min=1.0)
        with torch.autocast("cpu", dtype=torch.bfloat16, enabled=self.precision == "bfloat16"):
            value = self.policy.critic(part["rows"], mask)
            mean, log_std = self.policy.actor(part["rows"]) if acts else (None, None)
        value_loss = (((value - part["target"]) ** 2) * mask).sum() / count
        if mean is None or log_std is None:
            return value_loss, {"policy": 0.0, "value": float(value_loss.detach()), "kl": 0.0, "clipped": 0.0}
        difference = log_probability(part["actions"], mean, log_std) - part["log_prob"]
        ratio = difference.exp()
        advantage = part["advantage"]
        gain = torch.min(advantage * ratio, advantage * ratio.clamp(1.0 - clip, 1.0 + clip))
        policy_loss = -(gain * mask).sum() / count
        loss = policy_loss + self.vf_coef * value_loss
        if self.ent_coef > 0.0:
            loss = loss - self.ent_coef * (log_std.sum(dim=-1) * mask).sum() / count
        with torch.no_grad():
            kl = float((((ratio - 1.0) - difference) * mask).sum() / count)
            clipped = float((((ratio - 1.0).abs() > clip) * mask).sum() / count)
        return loss, {
            "policy": float(policy_loss.detach()),
            "value": float(value_loss.detach()),
            "kl": kl,
            "clipped": clipped,
        }
