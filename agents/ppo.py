"""Proximal policy optimisation (PPO) on the native batch environment, with parts as samples.

Schulman et al. 2017, "Proximal Policy Optimization Algorithms", https://arxiv.org/abs/1707.06347, with generalised advantage
estimation (GAE; Schulman et al. 2016, https://arxiv.org/abs/1506.02438). All parts of a world share one actor; every part has
its own reward, value and advantage, and the critic reads all parts of a world. A stopped run continues bit for bit.

With ``cost_limit`` costs are subtracted from rewards with a multiplier (PPO-Lagrangian with one critic).
"""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import torch
from pydantic import Field

from agents.checkpoint import Modules, Optimizers
from agents.curriculum import Curriculum, Episode
from agents.imitation import Imitation, check_memory, experts
from agents.learner import PartsLearner, Report
from agents.learning_curve import without_hold
from agents.networks import ActorCritic, log_probability
from agents.rollout import Rollout
from agents.training_settings import (
    MOST_STEPS,
    ImitationSettings,
    NetworkSettings,
    RateSettings,
    TrainSettings,
    check_bytes,
    for_seed,
)
from vibgym import checks
from vibgym.policies.measures import check_cost_limit
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Inputs
from vibgym.policies.trained.residual import CORRECTED, ResidualPolicy
from vibgym.seeds import training_seed

WINDOW = 100
"""Finished episodes over which the log averages."""

VALUE_WEIGHT, MAX_GRADIENT = 0.5, 0.5
"""Weight of the value loss, and norm to which gradients are clipped."""

PACE, LEAST_PACE, STOP_KL = 1.5, 0.01, 4.0
"""Factor by which ``target_kl`` changes the learning rate, its smallest share, and multiple at which an update ends."""

FIRST_PACE = 0.03
"""Share of the learning rate with which an actor starts after the critic: the first steps of Adam change every weight by the
learning rate. An imitated actor's first update at the full rate had a divergence of 0.045."""


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

        multiplier_rate: float = Field(default=0.05, gt=0, le=100)
        """Change of the multiplier in an update, times the excess."""

        critic_steps: int = Field(default=0, ge=0, le=MOST_STEPS)
        """First steps, in which the critic alone learns."""

    title, phase = "PPO with parts as samples", "ppo"
    advice = "ppo.learning_rate, ppo.log_std_init or ppo.clip_range"

    def __init__(self, settings: TrainSettings) -> None:
        super().__init__(settings)
        assert isinstance(settings.own, PPO.Settings)
        self.own = settings.own
        self._check_residual()
        # A base policy reads the flat state.
        self._seen = ResidualPolicy.observation if settings.residual else self.observation
        self.curriculum = Curriculum(settings, self._seen, WINDOW)
        self.env = self.curriculum.first_worlds()
        try:
            self._build()
        except ValueError:
            self.env.close()
            raise

    def _check_residual(self) -> None:
        """Reject settings that conflict with ``residual``.

        An expert of imitation gives actions, not corrections. In rows that remember or turn, the base's action would be
        repeated or not turned.
        """
        run, own = self.settings, self.own
        if run.residual is None:
            return
        base = checks.choice("residual.base.action", run.residual.base["action"], CORRECTED)
        for name, got, allowed in (
            ("imitation", run.imitation, None),
            ("ppo.remembers", own.remembers, 0),
            ("ppo.turned", own.turned, False),
            ("ppo.network", own.network, "parts"),
            ("environment.action", run.action, base),
        ):
            if got != allowed:
                raise checks.conflict(f"{name} must be {allowed!r} with 'residual'")

    def _build(self) -> None:
        settings, own, env, coding = self.settings, self.own, self.env, self.coding()
        if own.n_steps * settings.worlds < 2:
            raise checks.refuse("ppo.n_steps", own.n_steps, "2 or more with one world")
        row = np.dtype(coding.dtype).itemsize * coding.shape.columns
        step = settings.worlds * len(coding.parts) * (row + 4 * (coding.shape.action + 6))
        check_bytes("ppo.n_steps", own.n_steps, step)
        if own.network == "joint":
            raise checks.conflict("ppo.network 'joint' has one row for all parts: it learns from data sets only")
        if own.noise_floor is not None and own.network != "parts":
            raise checks.conflict(f"ppo.noise_floor requires network 'parts', got {own.network!r}")
        imitation = settings.imitation
        if imitation is not None:
            check_memory(imitation, coding, settings.worlds)
        torch.manual_seed(settings.seed)
        self.policy = ActorCritic(coding, own, own.log_std_init, own.noise_floor)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=own.learning_rate, eps=1e-5, fused=True)
        self.rollout = Rollout(own, env.num_envs, coding, TaskInfo.of(env.env))
        self._noise = torch.Generator().manual_seed(settings.seed)
        self._correlated = torch.zeros(1, 1, 1)  # noise of the last step, if that of the next is correlated with it
        self.multiplier = 0.0  # of costs
        if own.cost_limit is not None:
            environment = {key: value for key, value in without_hold(settings)[0].items() if key != "action"}
            check_cost_limit(
                "ppo.cost_limit", own.cost_limit, settings.task, environment, training_seed(settings.seed, "costs")
            )
        self.pace = FIRST_PACE if own.critic_steps and own.target_kl is not None else 1.0
        self.episodes: deque[Episode] = deque(maxlen=WINDOW)
        self._observation: Any = None
        self._start = np.ones(env.num_envs, dtype=bool)
        self._inputs: Inputs | None = None
        # Steps of imitation count, but do not train the critic.
        self.critic_steps = own.critic_steps
        if imitation is not None:
            self.critic_steps += imitation.rounds * imitation.steps * settings.worlds
            self.experts = experts(imitation, settings.action, settings.seed, env)
        if settings.start is not None:
            self.start_from(Path(for_seed(settings.start, settings.seed)))

    def learn(self, until: int, report: Report) -> None:
        """Alternate rollouts and updates until ``until`` steps of all worlds together.

        Args:
            until: steps at which training ends.
            report: called before each rollout with metrics of the last update.

        Raises:
            Diverged: a loss or a weight is not finite.
        """
        if self._observation is None:
            self._observation = self._new_episodes()
        metrics: dict[str, float] = {}
        while self.steps < until:
            report(metrics)
            self._follow_curriculum()
            self.steps += self.collect()
            metrics = self.update(1.0 - self.steps / until)
            self._adapt_multiplier()
            metrics |= self._episode_metrics()
        report(metrics)

    def _follow_curriculum(self) -> None:
        """Begin the next stage of the curriculum if this one has ended."""
        limit = self.env.env.unwrapped.max_episode_steps or 0
        if self.curriculum.advance(self.steps, self.episodes, limit * self.env.num_envs):
            self.env.close()
            self.env = self.curriculum.worlds()
            self._observation, self._inputs = self._new_episodes(), None
            self._start = np.ones(self.env.num_envs, dtype=bool)
            self.episodes.clear()

    def _new_episodes(self) -> Any:
        """Reset all worlds with seeds that no other reset of the run has; return their observations."""
        # The stage, since imitation may already have made all steps of one.
        self.env.seed(training_seed(self.settings.seed, f"{self.steps} steps, stage {self.curriculum.stage}"))
        return self.env.reset()

    def collect(self) -> int:
        """Make ``n_steps`` steps in all worlds, then compute values and advantages; return the steps of all worlds together."""
        env, policy, rollout = self.env, self.policy, self.rollout
        coding = policy.coding
        rollout.reset()
        for _ in range(self.own.n_steps):
            inputs = coding.encode(self._observation, self._inputs, self._start)
            with torch.no_grad():
                noise = self._draw((*inputs.rows.shape[:-1], coding.shape.action))
                action, log_prob = policy.sample(torch.from_numpy(inputs.rows), noise)
            observation, _, done, infos = env.step(coding.decode(inputs, action.clamp(-1.0, 1.0).numpy()))
            reward = env.part_reward - self.own.touch_cost * coding.touching(inputs)
            if self.multiplier:
                reward = reward - self.multiplier * env.part_cost
            rollout.add(inputs, action.numpy(), log_prob.numpy(), reward, done)
            for world in np.flatnonzero(done).tolist():
                info = infos[world]
                if info["TimeLimit.truncated"]:
                    rollout.truncate(world, coding.encode(info["terminal_observation"], inputs.of(world)))
                episode = info["episode"]
                self.episodes.append((episode["r"], episode["l"], info["is_success"], episode.get("c", 0.0)))
            self._observation, self._start, self._inputs = observation, done, inputs
        rollout.finish(coding.encode(self._observation, self._inputs, self._start), policy.critic)
        return self.own.n_steps * env.num_envs

    def _draw(self, shape: tuple[int, ...]) -> torch.Tensor:
        """Return the noise (worlds, parts, action) of a step, which continues that of the step before within an episode."""
        noise = torch.randn(shape, generator=self._noise)
        if self.own.noise_correlation:
            share = self.own.noise_correlation * torch.from_numpy(~self._start).to(noise)[:, None, None]
            noise = self._correlated = share * self._correlated + (1.0 - share**2).sqrt() * noise
        return noise

    def update(self, remaining: float) -> dict[str, float]:
        """Update actor and critic from the rollout; return mean losses.

        Args:
            remaining: share of the training that remains, 1 to 0, for the learning rate.

        Raises:
            Diverged: a weight is not finite.
        """
        own, samples = self.own, self.rollout.samples()
        rate, actor_learns = own.rate(remaining), self.steps > self.critic_steps
        self._set_rate(self.pace * rate if actor_learns else rate)
        present = samples["advantage"][samples["mask"] > 0.5]
        samples["advantage"] = (samples["advantage"] - present.mean()) / (present.std() + 1e-8)
        losses: list[dict[str, float]] = []
        for chosen in self._minibatches(*samples["mask"].shape):
            batch = {name: each.index_select(0, chosen) for name, each in samples.items()}
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
        self.check_finite()
        means = {name: float(np.mean([each[name] for each in losses])) for name in losses[0]}
        return means | {"pace": self.pace}

    def _minibatches(self, count: int, parts: int) -> Iterator[torch.Tensor]:
        """Yield the indices of random minibatches of all epochs, without a small one at the end of an epoch."""
        size = max(self.own.batch_size // parts, 1)
        for _ in range(self.own.n_epochs):
            for chosen in torch.randperm(count).split(size):
                if len(chosen) * 2 >= size or count < size:
                    yield chosen

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
            self.pace = max(self.pace / PACE, LEAST_PACE)
        elif kl < 0.5 * target:
            self.pace = min(self.pace * PACE, 1.0)

    def _adapt_multiplier(self) -> None:
        """Raise the multiplier of costs while the mean cost of the last episodes exceeds the limit, lower it below.

        The change is ``multiplier_rate`` times the relative excess, at most 1 in magnitude.
        """
        limit = self.own.cost_limit
        if limit is not None and self.episodes and self.steps > self.critic_steps:
            mean = float(np.mean([each[3] for each in self.episodes]))
            excess = min(max((mean - limit) / max(limit, 1e-9), -1.0), 1.0)
            self.multiplier = max(self.multiplier + self.own.multiplier_rate * excess, 0.0)

    def _set_rate(self, rate: float) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = rate

    def _episode_metrics(self) -> dict[str, float]:
        if not self.episodes:
            return {}
        returns, lengths, success, cost = map(np.mean, zip(*self.episodes, strict=True))
        found = {"return": float(returns), "length": float(lengths), "success": float(success)}
        if self.own.cost_limit is not None:
            found |= {"cost": float(cost), "multiplier": self.multiplier}
        return found | ({"stage": self.curriculum.stage} if self.settings.curriculum else {})

    def imitate(self, settings: ImitationSettings) -> Iterator[float]:
        """Train the actor on the experts' actions; yield the error after each round. The steps count."""
        imitation = Imitation(self.policy, self.experts, settings, self.settings.seed)
        for error in imitation.rounds():
            self.steps = imitation.steps
            self.check_finite()
            yield error

    def learned(self) -> tuple[Modules, Optimizers]:
        """Return the modules and optimizers of a checkpoint by name."""
        return {"policy": self.policy}, {"policy.optimizer": self.optimizer}

    def get_state(self) -> dict[str, Any]:
        """Return the rest of a checkpoint."""
        return {
            "steps": self.steps,
            "pace": self.pace,
            "multiplier": self.multiplier,
            "torch": torch.get_rng_state().numpy(),
            "noise": self._noise.get_state().numpy(),
            "correlated": self._correlated.numpy(),
            "observation": self._observation,
            "start": self._start,
            "seen": None if self._inputs is None else list(self._inputs),
            "curriculum": self.curriculum.get_state(),
            "worlds": self.env.get_state(),
            "episodes": [list(each) for each in self.episodes],
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned."""
        self.curriculum.set_state(state["curriculum"])
        if self.curriculum.stage:
            self.env.close()
            self.env = self.curriculum.worlds()
        self.env.set_state(state["worlds"])
        self.steps, self.pace, self.multiplier = state["steps"], state["pace"], state["multiplier"]
        self._observation, self._start = state["observation"], np.asarray(state["start"])
        self._inputs = None if state["seen"] is None else Inputs(*state["seen"])
        self.episodes = deque((tuple(each) for each in state["episodes"]), maxlen=WINDOW)
        torch.set_rng_state(torch.from_numpy(np.array(state["torch"])))
        self._noise.set_state(torch.from_numpy(np.array(state["noise"])))
        self._correlated = torch.from_numpy(np.array(state["correlated"]))
