"""Proximal policy optimisation (PPO) on the native batch environment, with parts as samples.

Schulman et al. 2017, "Proximal Policy Optimization Algorithms", https://arxiv.org/abs/1707.06347, with generalised advantage
estimation (GAE; Schulman et al. 2016, https://arxiv.org/abs/1506.02438). All parts of a world share one actor; every part has
its own reward, value and advantage, and the critic reads all parts of a world. A stopped run continues bit for bit.

With ``cost_limit`` costs are subtracted from rewards with a multiplier (PPO-Lagrangian with one critic).
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import Field, model_validator
from torch.optim.swa_utils import AveragedModel, get_ema_multi_avg_fn

from agents.actor_critic import ActorCritic, log_probability
from agents.imitation import Imitation, check_memory, experts
from agents.learner import PartsLearner, Report
from agents.learning_curve import without_hold
from agents.networks import trained_tensors
from agents.rollout import Rollout
from agents.training_envs import Worlds
from agents.training_settings import (
    MAX_STEPS,
    ImitationSettings,
    NetworkSettings,
    RateSettings,
    TrainSettings,
    for_seed,
)
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.measures import check_cost_limit
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.residual import ResidualPolicy
from vibgym.seeds import training_seed

VALUE_WEIGHT, MAX_GRADIENT = 0.5, 0.5
"""Weight of the value loss, and norm to which gradients are clipped."""

PACE, MIN_PACE, STOP_KL = 1.5, 0.01, 4.0
"""Factor by which ``target_kl`` changes the learning rate, its smallest share, and multiple at which an update ends."""

FIRST_PACE = 0.03
"""Share of the learning rate with which an actor starts after the critic, since the first steps of Adam change every weight by
it: an imitated actor's first update at the full rate had a divergence of 0.045."""


class PPO(PartsLearner):
    """PPO with parts as samples; see the module.

    Attributes:
        rollout: ``n_steps`` steps of all worlds, from which an update learns.
        pace: share of the learning rate while the actor learns, controlled by ``target_kl``.
    """

    class Settings(NetworkSettings, RateSettings):
        """Settings of PPO; defaults are what trained fastest on two cores."""

        n_steps: int = Field(default=32, ge=1, le=1_000_000)
        """Steps of every world in a rollout."""

        batch_size: int = Field(default=4096, ge=2, le=100_000_000)
        """Parts."""

        n_epochs: int = Field(default=3, ge=1, le=1000)
        """Of an update."""

        gamma: float = Field(default=0.98, gt=0, le=1)
        """Discount of a step."""

        gae_lambda: float = Field(default=0.95, gt=0, le=1)
        """Of generalised advantage estimation."""

        clip_range: float = Field(default=0.2, gt=0, le=10)
        """Change of probabilities beyond which an update gains nothing."""

        target_kl: float | None = Field(default=None, gt=0, le=100)
        """Divergence of an update; the learning rate follows it."""

        log_std_init: float = Field(default=-0.5, ge=-5, le=0.5)
        """Logarithmic standard deviation of exploration at the beginning."""

        noise_floor: float | None = Field(default=None, gt=0, le=1)
        """Size of actions above which exploration grows with them; None: the same for all."""

        noise_correlation: float = Field(default=0.0, ge=0, lt=1)
        """Of exploration between successive steps (coloured noise: Hollenstein et al. 2024, arXiv 2312.11091)."""

        touch_cost: float = Field(default=0.0, ge=0, le=1000)
        """Subtracted from the reward per step and part in contact with another; training only."""

        shared: float = Field(default=0.0, ge=0, le=1)
        """Share of every other part's reward that a part gets; training only."""

        cost_limit: float | None = Field(default=None, ge=0)
        """Largest mean cost of an episode, for environments with ``costs``: costs are then subtracted from rewards with a
        multiplier that follows the excess (Ray, Achiam & Amodei 2019, "Benchmarking safe exploration in deep reinforcement
        learning")."""

        multiplier_rate: float = Field(default=0.05, ge=0, le=100)
        """Change of the multiplier in an update, times the excess."""

        multiplier_gain: float = Field(default=0.0, ge=0, le=1000)
        """Part of the multiplier that follows the excess at once, times the excess. Without it a multiplier that rises fast
        overshoots, since costs fall slowly (Stooke, Achiam & Abbeel 2020, "Responsive safety in reinforcement learning by PID
        Lagrangian methods")."""

        standardized: bool = False
        """Standardize rows by means and standard deviations of the first rollout after half of ``critic_steps``, since
        episodes begin with unusual rows; network ``joint`` alone."""

        symmetric: bool = False
        """Average actor and critic over equivalent scenes, in which they then do the same; see
        :attr:`vibgym.policies.trained.coding.Coding.symmetry`."""

        averaging: float = Field(default=0.0, ge=0, lt=1)
        """Weight of earlier updates in the moving average of the actor that is evaluated and stored instead of the last one
        (Polyak & Juditsky 1992); exploration uses the last one. 0: no average."""

        critic_steps: int = Field(default=0, ge=0, le=MAX_STEPS)
        """First steps, in which the critic alone learns."""

        @model_validator(mode="after")
        def _supported(self) -> PPO.Settings:
            for name in ("touch_cost", "shared"):
                if self.network == "joint" and getattr(self, name):
                    raise checks.conflict(f"{name} requires rows of parts, and network 'joint' has one row for all")
            if self.cost_limit is not None and not (self.multiplier_rate or self.multiplier_gain):
                raise checks.conflict("cost_limit requires multiplier_rate or multiplier_gain")
            if self.standardized and self.network != "joint":
                raise checks.conflict(f"standardized requires network 'joint', got {self.network!r}")
            if self.noise_floor is not None and self.network != "parts":
                raise checks.conflict(f"noise_floor requires network 'parts', got {self.network!r}")
            return self

    title, phase = "PPO with parts as samples", "ppo"
    advice = "ppo.learning_rate, ppo.log_std_init or ppo.clip_range"

    def __init__(self, settings: TrainSettings) -> None:
        super().__init__(settings)
        assert isinstance(settings.own, PPO.Settings)
        self.own = settings.own
        # A base policy reads the flat state.
        self.worlds = Worlds(settings, ResidualPolicy.observation if settings.residual else self.observation)
        try:
            self._build(self.coding())
        except ValueError:
            self.close()
            raise

    @property
    def env(self) -> VecEnv:  # pyright: ignore[reportIncompatibleVariableOverride]
        """Worlds of the present stage of the curriculum."""
        return self.worlds.env

    def _build(self, coding: Coding) -> None:
        settings, own, env, imitation = self.settings, self.own, self.env, self.settings.imitation
        if own.n_steps * settings.worlds < 2:
            raise checks.refuse("ppo.n_steps", own.n_steps, "2 or more with one world")
        if own.cost_limit is not None:
            scene = {key: value for key, value in without_hold(settings)[0].items() if key != "action"}
            seed = training_seed(settings.seed, "costs")
            check_cost_limit("ppo.cost_limit", own.cost_limit, settings.task, scene, seed)
        if imitation is not None:
            check_memory(imitation, coding, settings.worlds)
        self.rollout = Rollout(own, env.num_envs, coding, TaskInfo.of(env.env))
        torch.manual_seed(settings.seed)
        self.policy = ActorCritic(coding, own, own.log_std_init, own.noise_floor, own.standardized, own.symmetric)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=own.learning_rate, eps=1e-5, fused=True)
        self.averaged: AveragedModel | None = None  # of the actor
        if own.averaging:
            average = get_ema_multi_avg_fn(own.averaging)
            self.averaged = AveragedModel(self.policy.actor, multi_avg_fn=average, use_buffers=True)
        self.multiplier = self.accumulated = 0.0  # of costs; its part that accumulates
        self.pace = FIRST_PACE if own.critic_steps and own.target_kl is not None else 1.0
        # Steps of imitation count, but do not train the critic.
        self.critic_steps = own.critic_steps
        if imitation is not None:
            self.critic_steps += imitation.rounds * imitation.steps * settings.worlds
            self.experts = experts(imitation, settings.action, settings.seed, env)
        if settings.start is not None:
            self.start_from(Path(for_seed(settings.start, settings.seed)))
            if own.standardized:
                self.policy.standardize_critic()

    def learn(self, until: int, report: Report) -> None:
        """Alternate rollouts and updates, see :meth:`agents.algorithms.Algorithm.learn`.

        Raises:
            Diverged: a loss or a weight is not finite.
        """
        metrics: dict[str, float] = {}
        while self.steps < until:
            report(metrics)
            self.worlds.begin(self.steps)
            self.steps += self.collect()
            if self.policy.unstandardized:  # nothing is learned from actions of other inputs
                if self.steps >= 0.5 * self.critic_steps:
                    self.policy.standardize(torch.from_numpy(self.rollout.rows[:-1]))
                continue
            metrics = self.update(1.0 - self.steps / until)
            self._adapt_multiplier()
            metrics |= self.worlds.metrics()
            if self.own.cost_limit is not None:
                metrics["multiplier"] = self.multiplier
        report(metrics)

    def collect(self) -> int:
        """Make ``n_steps`` steps in all worlds, then compute values and advantages; return the steps of all worlds together."""
        worlds, env, policy, rollout = self.worlds, self.env, self.policy, self.rollout
        coding = policy.coding
        rollout.reset()
        for _ in range(self.own.n_steps):
            inputs = worlds.encode(coding)
            with torch.no_grad():
                noise = worlds.noise((*inputs.rows.shape[:-1], coding.shape.action), self.own.noise_correlation)
                action, log_prob = policy.sample(torch.from_numpy(inputs.rows), noise)
            cut = worlds.step(coding, inputs, action.clamp(-1.0, 1.0).numpy())
            reward = env.part_reward - self.own.touch_cost * coding.touching(inputs)
            if self.multiplier:
                reward = reward - self.multiplier * env.part_cost
            rollout.add(inputs, action.numpy(), log_prob.numpy(), reward, worlds.start)
            for world, last in cut.items():
                rollout.truncate(world, last)
        rollout.finish(worlds.encode(coding), policy.critic)
        return self.own.n_steps * env.num_envs

    def update(self, remaining: float) -> dict[str, float]:
        """Update actor and critic from the rollout; return mean losses.

        Args:
            remaining: share of the training that remains, 1 to 0, for the learning rate.

        Raises:
            Diverged: a weight is not finite.
        """
        own = self.own
        rate, actor_learns, losses = own.rate(remaining), self.steps > self.critic_steps, list[dict[str, float]]()
        self._set_rate(self.pace * rate if actor_learns else rate)
        for batch in self.rollout.minibatches(own.batch_size, own.n_epochs):
            loss, metrics = self.loss(batch, actor_learns)
            losses.append(metrics)
            if own.target_kl is not None and actor_learns and len(losses) > 1:  # the first divergence is 0
                self._adapt_pace(metrics["kl"], own.target_kl)
                self._set_rate(self.pace * rate)
                if metrics["kl"] > STOP_KL * own.target_kl:
                    break
            self.optimizer.zero_grad()
            loss.backward()
            torch.nn.utils.clip_grad_norm_(self.policy.parameters(), MAX_GRADIENT)
            self.optimizer.step()
        if self.averaged is not None and actor_learns:
            self.averaged.update_parameters(self.policy.actor)
        self.check_finite()
        return {name: float(np.mean([terms[name] for terms in losses])) for name in losses[0]} | {"pace": self.pace}

    def loss(self, batch: dict[str, torch.Tensor], actor_learns: bool = True) -> tuple[torch.Tensor, dict[str, float]]:
        """Return the clipped surrogate loss plus the value loss, and metrics.

        Args:
            batch: ``rows``, ``mask``, ``actions``, ``log_prob``, ``advantage``, ``target``; each (samples, parts, ...).
            actor_learns: False: the value loss alone.
        """
        mask, clip = batch["mask"], self.own.clip_range
        count = mask.sum().clamp(min=1.0)
        value = self.policy.critic(batch["rows"], mask)
        value_loss = (((value - batch["target"]) ** 2) * mask).sum() / count
        metrics = {"policy": 0.0, "value": float(value_loss.detach()), "kl": 0.0, "clipped": 0.0}
        if not actor_learns:
            return value_loss, metrics
        mean, log_std = self.policy.actor(batch["rows"])
        difference = log_probability(batch["actions"], mean, log_std) - batch["log_prob"]
        ratio, advantage = difference.exp(), batch["advantage"]
        gain = torch.min(advantage * ratio, advantage * ratio.clamp(1.0 - clip, 1.0 + clip))
        policy_loss = -(gain * mask).sum() / count
        with torch.no_grad():
            metrics["policy"] = float(policy_loss.detach())
            metrics["kl"] = float((((ratio - 1.0) - difference) * mask).sum() / count)
            metrics["clipped"] = float((((ratio - 1.0).abs() > clip) * mask).sum() / count)
        return policy_loss + VALUE_WEIGHT * value_loss, metrics

    def _adapt_pace(self, kl: float, target: float) -> None:
        """Lower the learning rate after a large divergence, raise it after a small one."""
        if kl > 2.0 * target:
            self.pace = max(self.pace / PACE, MIN_PACE)
        elif kl < 0.5 * target:
            self.pace = min(self.pace * PACE, 1.0)

    def _adapt_multiplier(self) -> None:
        """Raise the multiplier of costs while the mean cost of the last episodes exceeds the limit, lower it below.

        Its parts change by ``multiplier_rate`` times, and are ``multiplier_gain`` times, the relative excess, at most 1 in
        magnitude.
        """
        limit, episodes = self.own.cost_limit, self.worlds.episodes
        if limit is not None and episodes and self.steps > self.critic_steps:
            mean = float(np.mean([cost for *_, cost in episodes]))
            excess = min(max((mean - limit) / max(limit, 1e-9), -1.0), 1.0)
            self.accumulated = max(self.accumulated + self.own.multiplier_rate * excess, 0.0)
            self.multiplier = max(self.accumulated + self.own.multiplier_gain * excess, 0.0)

    def _set_rate(self, rate: float) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = rate

    def imitate(self, settings: ImitationSettings) -> Iterator[float]:
        """Train the actor on the experts' actions; yield the error after each round. The steps count."""
        imitation = Imitation(self.policy, self.experts, settings, self.settings.seed)
        for error in imitation.rounds():
            self.steps = imitation.steps
            self.check_finite()
            yield error

    def actor(self) -> dict[str, np.ndarray]:
        """Return the actor's tensors, or their average."""
        if self.averaged is None or not self.averaged.n_averaged:
            return super().actor()
        return trained_tensors(self.averaged.module)

    def set_actor(self, tensors: Mapping[str, np.ndarray]) -> None:
        """Replace the actor's tensors; their average starts again."""
        super().set_actor(tensors)
        if self.averaged is not None:
            self.averaged.n_averaged.zero_()

    def learned(self) -> dict[str, Any]:
        """Return networks and optimizers by their names in checkpoints."""
        average = {} if self.averaged is None else {"averaged": self.averaged}
        return {"policy": self.policy, "optimizer": self.optimizer, **average}

    def get_state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on."""
        return {
            **super().get_state(),
            "pace": self.pace,
            "multiplier": self.multiplier,
            "accumulated": self.accumulated,
            "worlds": self.worlds.get_state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        super().set_state(state)
        self.pace, self.multiplier, self.accumulated = (state[name] for name in ("pace", "multiplier", "accumulated"))
        self.worlds.set_state(state["worlds"])
