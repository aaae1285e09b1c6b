"""Proximal policy optimisation (PPO) on the native batch environment, with parts as samples.

Schulman et al. 2017, "Proximal Policy Optimization Algorithms", https://arxiv.org/abs/1707.06347, with generalised advantage
estimation (GAE; Schulman et al. 2016, https://arxiv.org/abs/1506.02438). All parts of a world share one actor; every part has
its own reward, value and advantage, and the critic reads all parts of a world. A stopped run continues bit for bit.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch

from agents import checkpoint
from agents.imitation import Imitation, check_memory, experts
from agents.networks import HALF_LOG_TAU, NETWORKS, ActorCritic, log_probability, trained_tensors
from agents.training_envs import ResidualEnv, make_worlds
from agents.training_settings import ImitationSettings, NetworkSettings, PPOSettings, TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.config import Settings
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding, Seen
from vibgym.policies.trained.networks.acting import FLOOR
from vibgym.policies.trained.pictures import PictureCoding
from vibgym.policies.trained.residual import ResidualPolicy, load_correction
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import (
    ANY,
    CODINGS,
    KIND,
    RESIDUAL,
    VERSION,
    TrainedPolicy,
    described,
    load_trained,
)

MOST_ROLLOUT = 4e9
"""Bytes of a rollout."""

CRITIC_BATCH = 300_000
"""Values of observations that the critic evaluates in one call, so that its intermediate results stay in the caches."""

WINDOW = 100
"""Finished episodes over which the log averages."""

VALUE_WEIGHT, MAX_GRADIENT = 0.5, 0.5
"""Weight of the value loss, and norm to which gradients are clipped."""

PACE, LEAST_PACE, STOP_KL = 1.5, 0.01, 4.0
"""Factor by which ``target_kl`` changes the learning rate, its smallest share, and multiple at which an update ends."""

Report = Callable[[dict[str, float]], None]


class PartsLearner:
    """Environment, network coding and policy file of learners whose network acts part by part (PPO, offline).

    Args:
        settings: of the run.

    Attributes:
        env: worlds of the run.
        policy: actor and critic.
        steps: done so far.
    """

    title: ClassVar[str]
    phase: ClassVar[str]
    env: VecEnv
    policy: ActorCritic
    steps = 0

    def __init__(self, settings: TrainSettings) -> None:
        self.settings = settings
        assert isinstance(settings.own, NetworkSettings)
        checks.choice(f"{settings.algorithm}.network", settings.own.network, tuple(NETWORKS))
        self.action, self.observation = settings.action, CODINGS[settings.own.network].observation

    @property
    def network(self) -> NetworkSettings:
        """Settings of the network."""
        assert isinstance(self.settings.own, NetworkSettings)
        return self.settings.own

    def coding(self, env: VibgymVectorEnv | ResidualEnv) -> Coding | PictureCoding:
        """Return how the network reads observations and how its outputs become actions.

        Raises:
            ValueError: ``blind`` names an unknown column, or the network does not support the action.
        """
        network, where = self.network, self.settings.algorithm
        layout = env.parts_layout
        for name in network.blind:
            checks.choice(f"{where}.blind", name, tuple(row.name for row in layout))
        columns = [[row.name, row.width] for row in layout if row.name not in network.blind] if network.blind else None
        flags = network.turned, network.remembers
        found = CODINGS[network.network](env.surface, env.parts, layout, self.settings.action, columns, *flags)
        if network.network == "elements" and not found.shape.has_elements:
            reason = "column 'element' is in 'blind'" if found.shape.side else f"not {self.settings.action!r}"
            raise checks.conflict(f"{where}.network 'elements' requires action 'element' or 'phasor' ({reason})")
        return found

    def acting(self) -> TrainedPolicy:
        """Return the present policy in NumPy."""
        return TrainedPolicy(self.actor(), self.policy.actor.kind, self.network.activation, self.policy.coding)

    def actor(self) -> dict[str, np.ndarray]:
        """Return the actor's tensors."""
        return trained_tensors(self.policy.actor)

    def set_actor(self, tensors: Mapping[str, np.ndarray]) -> None:
        """Replace the actor's tensors."""
        self.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions, see :meth:`vibgym.policies.protocol.Policy.predict`."""
        return self.acting().predict(observation, state, episode_start, deterministic)

    def save_policy(self, path: Path, training: dict[str, Any]) -> None:
        """Write the policy for :func:`vibgym.policies.trained.trained.load_trained`.

        Raises:
            Diverged: a weight is not finite; an older policy stays.
        """
        tensors = self.actor()
        checkpoint.check_finite(tensors)
        settings, info, coding = self.settings, TaskInfo.of(self.env.env), self.policy.coding
        serves = settings.serves
        record: dict[str, Any] = {
            "tasks": list(dict.fromkeys([info.name, *(serves.tasks or ())])),
            "surface": ANY if serves.surface == ANY else described(info.surface),
            "parts": ANY if serves.parts == ANY else len(info.parts),
            "columns": coding.columns,
            "turned": coding.turned,
            "remembers": coding.remembers,
            "action": coding.action,
            "network": self.network.network,
            "activation": self.network.activation,
            "training": training,
        }
        if settings.residual is not None:
            record[RESIDUAL] = settings.residual.model_dump(mode="json")
        save_set(path, KIND, tensors, record, VERSION)

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


class PPO(PartsLearner):
    """PPO with parts as samples; see the module and :class:`agents.training_settings.PPOSettings`.

    Attributes:
        rollout: the last ``n_steps`` steps of all worlds.
        pace: share of the learning rate, controlled by ``target_kl``.
    """

    hyperparameters: ClassVar[type[Settings]] = PPOSettings
    title, phase = "PPO with parts as samples", "ppo"
    advice = "ppo.learning_rate, ppo.ent_coef, ppo.log_std_init or ppo.clip_range"

    def __init__(self, settings: TrainSettings) -> None:
        super().__init__(settings)
        assert isinstance(settings.own, PPOSettings)
        self.own = own = settings.own
        self._check_residual()
        # A base policy reads the flat state.
        residual = settings.residual
        observation = ResidualPolicy.observation if residual is not None else CODINGS[own.network].observation
        checks.choice("observation", settings.environment.get("observation", observation), (observation,))
        with checks.within("environment"):
            self.env = make_worlds(settings, observation, self._with_base)
        try:
            self._build()
        except ValueError:
            self.env.close()
            raise

    def _build(self) -> None:
        settings, own, env = self.settings, self.own, self.env
        if own.n_steps * settings.worlds < 2:
            raise checks.refuse("ppo.n_steps", own.n_steps, "2 or more with one world")
        coding, info = self.coding(env.env), TaskInfo.of(env.env)
        row = np.dtype(coding.dtype).itemsize * coding.shape.columns
        size = len(env.env.parts) * (row + 4 * (coding.shape.action + 6)) * own.n_steps * settings.worlds
        if size > MOST_ROLLOUT:
            allowed = f"a rollout of at most {MOST_ROLLOUT:.1e} bytes ({settings.worlds} worlds: {size:.1e})"
            raise checks.refuse("ppo.n_steps", own.n_steps, allowed)
        if settings.imitation is not None:
            check_memory(settings.imitation, coding, settings.worlds)
        if own.noise_floor is not None and own.network != "parts":
            raise checks.conflict(f"ppo.noise_floor requires network 'parts', got {own.network!r}")
        torch.manual_seed(settings.seed)
        self.policy = ActorCritic(coding, own, own.log_std_init, own.noise_floor)
        self.optimizer = torch.optim.Adam(self.policy.parameters(), lr=own.learning_rate, eps=1e-5, fused=True)
        self.rollout = Rollout(own, env.num_envs, coding, np.array(info.driven))
        self.pace, self.updates = 1.0, 0
        self.episodes: deque[tuple[float, int, bool]] = deque(maxlen=WINDOW)  # return, length, success
        self._observation: Any = None
        self._start = np.ones(env.num_envs, dtype=bool)
        self._seen: Seen | None = None
        # Steps of imitation count, and teach the critic nothing.
        lessons = settings.imitation
        taught = 0 if lessons is None else lessons.rounds * lessons.steps * settings.worlds
        self.critic_steps = own.critic_steps + taught
        self.experts = [] if lessons is None else experts(lessons, settings.action, settings.seed, env)
        if settings.start is not None:
            self._start_from(Path(settings.start.replace("{seed}", str(settings.seed))))

    # -- the algorithm ---------------------------------------------------------------------------------------------------

    def learn(self, until: int, report: Report) -> None:
        """Alternate rollouts and updates until ``until`` steps of all worlds together.

        Args:
            until: steps at which training ends.
            report: called before each rollout with metrics of the last update.

        Raises:
            Diverged: a loss or a weight is not finite.
        """
        if self._observation is None:
            self.env.seed(self.settings.seed + self.steps)  # not the seeds of imitation
            self._observation = self.env.reset()
        metrics: dict[str, float] = {}
        while self.steps < until:
            report(metrics)
            self.collect()
            metrics = self.update(1.0 - self.steps / until) | self._episode_metrics()
        report(metrics)

    def collect(self) -> None:
        """Make ``n_steps`` steps in all worlds, then compute values and advantages."""
        env, coding, rollout = self.env, self.policy.coding, self.rollout
        rollout.reset()
        for _ in range(self.own.n_steps):
            seen = coding.see(self._observation, self._seen, self._start)
            with torch.no_grad():
                mean, log_std = self.policy.actor(torch.from_numpy(seen.rows))
                noise = torch.randn_like(mean)
                action = mean + log_std.exp() * noise
                log_prob = -(0.5 * noise * noise + log_std + HALF_LOG_TAU).sum(dim=-1)
            action, clipped = action.numpy(), action.clamp(-1.0, 1.0).numpy()
            observation, _, done, infos = env.step(coding.actions(seen, clipped))
            reward = env.part_reward - self.own.touch_cost * coding.touching(seen)
            rollout.add(seen, action, log_prob.numpy(), reward, done)
            self.steps += env.num_envs
            for world in np.flatnonzero(done).tolist():
                info = infos[world]
                if info["TimeLimit.truncated"]:
                    rollout.truncate(world, coding.see(info["terminal_observation"], seen.of(world)))
                self.episodes.append((info["episode"]["r"], info["episode"]["l"], info["is_success"]))
            self._observation, self._start, self._seen = observation, done, seen
        rollout.finish(coding.see(self._observation, self._seen, self._start), self.policy.critic)

    def update(self, remaining: float) -> dict[str, float]:
        """Update actor and critic from the last rollout; return mean losses.

        Args:
            remaining: share of the training that remains, 1 to 0, for the learning rate.

        Raises:
            Diverged: a weight is not finite.
        """
        own, samples = self.own, self.rollout.samples()
        rate = own.rate(remaining)
        self._set_rate(rate)
        actor_learns = self.steps > self.critic_steps
        present = samples["advantage"][samples["mask"] > 0.5]
        samples["advantage"] = (samples["advantage"] - present.mean()) / (present.std() + 1e-8)
        count = len(samples["mask"])
        size = max(own.batch_size // samples["mask"].shape[1], 1)
        losses: dict[str, list[float]] = {"policy": [], "value": [], "kl": [], "clipped": []}
        stop = False
        for _ in range(own.n_epochs):
            for chosen in torch.randperm(count).split(size):
                if len(chosen) * 2 < size and count >= size:  # a last, small minibatch would be noise
                    continue
                batch = {name: each.index_select(0, chosen) for name, each in samples.items()}
                loss, metrics = self.loss(batch, actor_learns)
                for name, value in metrics.items():
                    losses[name].append(value)
                if own.target_kl is not None and actor_learns and losses["kl"][1:]:  # the first is always 0
                    self._adapt_pace(metrics["kl"], own.target_kl)
                    self._set_rate(rate)
                    if metrics["kl"] > STOP_KL * own.target_kl:
                        stop = True
                        break
                self.optimizer.zero_grad()
                loss.backward()
                torch.nn.utils.clip_grad_norm_(self.policy.parameters(), MAX_GRADIENT)
                self.optimizer.step()
            if stop:
                break
            self.updates += 1
        self.check_finite()
        return {name: float(np.mean(each)) if each else float("nan") for name, each in losses.items()} | {
            "pace": self.pace
        }

    def loss(self, batch: dict[str, torch.Tensor], actor_learns: bool = True) -> tuple[torch.Tensor, dict[str, float]]:
        """Return the clipped surrogate loss plus the value loss, and metrics.

        Args:
            batch: ``rows``, ``mask``, ``actions``, ``log_prob``, ``advantage``, ``target``; each (samples, parts, ...).
            actor_learns: False: the value loss alone.
        """
        mask, clip = batch["mask"], self.own.clip_range
        count = mask.sum().clamp(min=1.0)
        value = self.policy.critic(batch["rows"], mask)
        mean, log_std = self.policy.actor(batch["rows"]) if actor_learns else (None, None)
        value_loss = (((value - batch["target"]) ** 2) * mask).sum() / count
        if mean is None or log_std is None:
            return value_loss, {"policy": 0.0, "value": float(value_loss.detach()), "kl": 0.0, "clipped": 0.0}
        difference = log_probability(batch["actions"], mean, log_std) - batch["log_prob"]
        ratio, advantage = difference.exp(), batch["advantage"]
        gain = torch.min(advantage * ratio, advantage * ratio.clamp(1.0 - clip, 1.0 + clip))
        policy_loss = -(gain * mask).sum() / count
        loss = policy_loss + VALUE_WEIGHT * value_loss
        if self.own.ent_coef > 0.0:
            loss = loss - self.own.ent_coef * (log_std.sum(dim=-1) * mask).sum() / count
        with torch.no_grad():
            kl = float((((ratio - 1.0) - difference) * mask).sum() / count)
            clipped = float((((ratio - 1.0).abs() > clip) * mask).sum() / count)
        return loss, {
            "policy": float(policy_loss.detach()),
            "value": float(value_loss.detach()),
            "kl": kl,
            "clipped": clipped,
        }

    def _adapt_pace(self, kl: float, target: float) -> None:
        """Lower the learning rate where an update moves the actor too far, raise it where it hardly moves."""
        if kl > 2.0 * target:
            self.pace = max(self.pace / PACE, LEAST_PACE)
        elif kl < 0.5 * target:
            self.pace = min(self.pace * PACE, 1.0)

    def _set_rate(self, rate: float) -> None:
        for group in self.optimizer.param_groups:
            group["lr"] = self.pace * rate

    def _episode_metrics(self) -> dict[str, float]:
        if not self.episodes:
            return {}
        returns, lengths, success = map(np.mean, zip(*self.episodes, strict=True))
        return {"return": float(returns), "length": float(lengths), "success": float(success)}

    # -- imitation, checkpoints ------------------------------------------------------------------------------------------

    def imitate(self, settings: ImitationSettings) -> Any:
        """Train the actor on the expert's actions; yields the error after each round. The steps count."""
        lessons = Imitation(self.policy, self.experts, settings, self.settings.seed)
        for error in lessons.rounds():
            self.steps = lessons.steps
            self.check_finite()
            yield error

    def check_finite(self) -> None:
        """Raise :class:`agents.failures.Diverged` if a weight or an optimizer state is not finite."""
        checkpoint.check_finite(checkpoint.tensors_of(*self._saved()))

    def _saved(self) -> tuple[dict[str, torch.nn.Module], dict[str, torch.optim.Optimizer]]:
        return {"policy": self.policy}, {"policy.optimizer": self.optimizer}

    def save(self, directory: Path) -> None:
        """Write a checkpoint with everything that the rest of the run depends on.

        Raises:
            Diverged: a weight is not finite; the last checkpoint stays.
        """
        state = {
            "steps": self.steps,
            "updates": self.updates,
            "pace": self.pace,
            "torch": torch.get_rng_state().numpy(),
            "observation": self._observation,
            "start": self._start,
            "seen": None if self._seen is None else list(self._seen),
            "worlds": self.env.get_state(),
            "episodes": [list(each) for each in self.episodes],
        }
        checkpoint.save(directory, *self._saved(), state)

    def load(self, directory: Path) -> bool:
        """Continue from the checkpoint in ``directory``; False if there is none.

        Raises:
            ValueError: it is damaged or belongs to other settings.
        """
        return checkpoint.load(directory, *self._saved(), self._set_state)

    def _set_state(self, state: dict[str, Any]) -> None:
        self.env.set_state(state["worlds"])
        self.steps, self.updates, self.pace = state["steps"], state["updates"], state["pace"]
        self._observation, self._start = state["observation"], np.asarray(state["start"])
        self._seen = None if state["seen"] is None else Seen(*state["seen"])
        self.episodes = deque((tuple(each) for each in state["episodes"]), maxlen=WINDOW)
        torch.set_rng_state(torch.from_numpy(np.array(state["torch"])))

    def _start_from(self, path: Path) -> None:
        """Take the actor from a policy file; exploration keeps its own settings.

        Raises:
            ValueError: a policy of another form, or for another task.
        """
        info, mine, residual = TaskInfo.of(self.env.env), self.acting(), self.settings.residual
        if residual is None:
            found: Any = load_trained(path, info)
        else:
            found = load_correction(path, info, residual.base, residual.scale).learned
        if not isinstance(found, TrainedPolicy):
            raise checks.refuse("start", str(path), "a policy trained by PPO")
        # Weights may fit and yet mean something else: other columns, or another action.
        for name, theirs, ours in (
            ("action", found.action, mine.action),
            ("columns", found.coding.columns, mine.coding.columns),
            ("ppo.turned", found.coding.turned, mine.coding.turned),
            ("ppo.remembers", found.coding.remembers, mine.coding.remembers),
            ("ppo.network", found.network, mine.network),
            ("ppo.activation", found.activation, mine.activation),
            ("layers", _shapes(found.tensors), _shapes(mine.tensors)),
        ):
            if theirs != ours:
                raise checks.conflict(f"start: {path} has other {name} than the settings")
        tensors = {name: each for name, each in found.tensors.items() if not name.startswith("log_std")}
        self.set_actor({**self.actor(), **tensors})

    def _with_base(self, env: VibgymVectorEnv) -> VibgymVectorEnv | ResidualEnv:
        residual = self.settings.residual
        if residual is None:
            return env
        with checks.within("residual"):
            return ResidualEnv(env, make_policy(residual.base, TaskInfo.of(env)), residual.scale)

    def _check_residual(self) -> None:
        """Reject settings that conflict with a residual policy.

        An expert of imitation gives actions, not corrections. In rows that remember or turn, the base's action would stand
        twice or not turned.
        """
        if self.settings.residual is None:
            return
        for name, got, allowed in (
            ("imitation", self.settings.imitation, None),
            ("ppo.remembers", self.own.remembers, False),
            ("ppo.turned", self.own.turned, False),
            ("ppo.network", self.own.network, "parts"),
            ("environment.action", self.settings.action, "wrench"),
        ):
            if got != allowed:
                raise checks.conflict(f"{name} must be {allowed!r} with 'residual'")


class Rollout:
    """Steps of all worlds and their advantages; every part of a world is a sample.

    A part's return ends with the episode of its world, or when the part leaves while the world goes on: it is present at one
    step and absent at the next. It keeps the reward of the step in which it left.

    Args:
        settings: ``n_steps``, ``gamma`` and ``gae_lambda``.
        worlds: number of worlds.
        coding: of the network.
        driven: (parts,) bool, whether the action drives a part. Other parts are no samples, and their rewards go to every
            driven part.
    """

    def __init__(self, settings: PPOSettings, worlds: int, coding: Coding | PictureCoding, driven: np.ndarray) -> None:
        self.gamma, self.gae_lambda, steps = settings.gamma, settings.gae_lambda, settings.n_steps
        parts, shape = len(coding.parts), coding.shape
        lead = (steps, worlds, parts)
        self.rows = np.zeros((steps + 1, worlds, parts, shape.columns), dtype=coding.dtype)
        self.mask = np.zeros((steps + 1, worlds, parts), dtype=np.float32)
        self.actions = np.zeros((*lead, shape.action), dtype=np.float32)
        self.log_prob, self.reward = np.zeros(lead, dtype=np.float32), np.zeros(lead, dtype=np.float32)
        self.done = np.zeros((steps, worlds), dtype=np.float32)
        self.value, self.advantage = np.zeros(lead, dtype=np.float32), np.zeros(lead, dtype=np.float32)
        self.driven = driven
        self.credit = np.eye(parts) + np.outer(~driven, driven)  # rewards of parts -> of the parts credited
        self.reset()

    def reset(self) -> None:
        """Start at the first step."""
        self.position = 0
        self.truncated: list[tuple[int, int, np.ndarray, np.ndarray]] = []  # step, world, rows, mask

    def add(self, seen: Seen, action: np.ndarray, log_prob: np.ndarray, reward: np.ndarray, done: np.ndarray) -> None:
        """Add a step of all worlds: observation, action and its outcome, (worlds, parts, ...)."""
        step = self.position
        self.rows[step], self.mask[step] = seen.rows, seen.mask * self.driven
        reward = reward if self.driven.all() else reward @ self.credit
        self.actions[step], self.log_prob[step], self.reward[step], self.done[step] = action, log_prob, reward, done
        self.position += 1

    def truncate(self, world: int, seen: Seen) -> None:
        """Mark the last step of ``world`` as cut off by the limit, with the final observation to bootstrap from."""
        self.truncated.append((self.position - 1, world, seen.rows[0], seen.mask[0] * self.driven))

    def finish(self, seen: Seen, critic: Any) -> None:
        """Compute values of all observations, and advantages by GAE.

        Args:
            seen: observation after the last step.
            critic: (rows, mask) -> values (..., parts).
        """
        self.rows[-1], self.mask[-1] = seen.rows, seen.mask * self.driven
        steps, worlds, parts = self.reward.shape
        with torch.no_grad():
            flat = torch.from_numpy(self.rows.reshape(-1, *self.rows.shape[2:]))
            mask = torch.from_numpy(self.mask.reshape(-1, parts))
            size = max(CRITIC_BATCH // flat[0].numel(), 1)
            value = torch.cat([critic(*each) for each in zip(flat.split(size), mask.split(size), strict=True)])
            value = value.numpy().reshape(steps + 1, worlds, parts)
            if self.truncated:
                where, world, rows, there = zip(*self.truncated, strict=True)
                last = critic(torch.from_numpy(np.stack(rows)), torch.from_numpy(np.stack(there))).numpy()
                self.reward[list(where), list(world)] += self.gamma * last * np.stack(there)
        self.value[:] = value[:-1]
        advantage = np.zeros((worlds, parts), dtype=np.float32)
        for step in reversed(range(steps)):
            continues = (1.0 - self.done[step])[:, None] * self.mask[step + 1]
            error = self.reward[step] + self.gamma * continues * value[step + 1] - value[step]
            advantage = error + self.gamma * self.gae_lambda * continues * advantage
            self.advantage[step] = advantage

    def samples(self) -> dict[str, torch.Tensor]:
        """Return all steps of all worlds, (steps * worlds, parts, ...)."""
        named = {
            "rows": self.rows[:-1],
            "mask": self.mask[:-1],
            "actions": self.actions,
            "log_prob": self.log_prob,
            "advantage": self.advantage,
            "target": self.advantage + self.value,
        }
        return {name: torch.from_numpy(each.reshape(-1, *each.shape[2:])) for name, each in named.items()}


def _shapes(tensors: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    """Return the shapes of all tensors but the noise floor, which belongs to the exploration."""
    return {name: each.shape for name, each in tensors.items() if name != FLOOR}
