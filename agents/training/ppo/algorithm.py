"""PPO on parts: its model, whom it may imitate beforehand, and the policy that it may begin with."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import torch

from agents.training.imitation import check_room
from agents.training.parts_algorithm import PartsAlgorithm
from agents.training.parts_policy import PartsPolicy
from agents.training.ppo.hyperparameters import PPOSettings
from agents.training.ppo.learner import PartsPPO
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.networks.acting import FLOOR
from vibgym.policies.trained.residual import load_correction
from vibgym.policies.trained.trained import TrainedPolicy, load_trained

MOST_ROLLOUT = 4e9
"""Bytes of a rollout: what is kept of ``ppo.n_steps`` steps of all worlds before a model learns from them."""


class PPO(PartsAlgorithm):
    """On-policy, with parts as samples. See :class:`agents.training.ppo.learner.PartsPPO`."""

    hyperparameters = PPOSettings
    title, phase = "PPO with parts as samples (on Stable-Baselines3)", "ppo"
    advice = "ppo.learning_rate, ppo.ent_coef, ppo.log_std_init or ppo.clip_range"
    log_interval = 1

    @property
    def own(self) -> PPOSettings:
        """PPO's own settings."""
        assert isinstance(self.settings.own, PPOSettings)
        return self.settings.own

    def make_env(self) -> VecEnv:
        if self.settings.residual is not None:
            self._check_residual()
        return super().make_env()

    def _check_residual(self) -> None:
        """Refuse what a correction cannot be trained with.

        Raises:
            ValueError: imitation, whose experts say what to do and not what to add; rows that remember or turn, in which the
                base's action would stand twice or not turned; another network or action than parts' and ``"wrench"``.
        """
        imitation = self.settings.imitation
        for name, got, allowed in (
            ("imitation", None if imitation is None else imitation.expert, None),
            ("ppo.remembers", self.own.remembers, False),
            ("ppo.turned", self.own.turned, False),
            ("ppo.network", self.own.network, "parts"),
            ("environment.action", self.settings.action, "wrench"),
        ):
            if got != allowed:
                raise checks.refuse(name, got, f"{allowed!r} with 'residual'")

    def make_model(self, env: VecEnv) -> PartsPPO:
        settings, own, base = self.settings, self.own, env.env
        if own.n_steps * settings.worlds < 2:
            raise checks.refuse("ppo.n_steps", own.n_steps, "2 or more with one world")
        coding, lessons = self.coding(base), settings.imitation
        seen = np.dtype(coding.dtype).itemsize * coding.shape.columns
        kept = own.n_steps * settings.worlds * (2 if own.overlap else 1)
        size = len(base.parts) * (seen + 4 * (coding.shape.action + 6)) * kept
        if size > MOST_ROLLOUT:
            allowed = f"a rollout of at most {MOST_ROLLOUT:.1e} bytes; with {settings.worlds} worlds it has {size:.1e}"
            raise checks.refuse("ppo.n_steps", own.n_steps, allowed)
        if lessons is not None:
            check_room(lessons, coding, settings.worlds)
        if own.noise_floor is not None and own.network != "parts":
            raise checks.refuse("ppo.noise_floor", own.noise_floor, f"none with the network {own.network!r}")
        if own.precision != "float32" and not has_bfloat16():
            raise checks.refuse(
                "ppo.precision", own.precision, "'float32' on this processor, which does not compute in it"
            )
        return PartsPPO(
            PartsPolicy,
            env,
            n_steps=own.n_steps,
            batch_size=own.batch_size,
            n_epochs=own.n_epochs,
            learning_rate=own.rate,
            gamma=own.gamma,
            gae_lambda=own.gae_lambda,
            clip_range=own.clip_range,
            ent_coef=own.ent_coef,
            target_kl=own.target_kl,
            touch_cost=own.touch_cost,
            precision=own.precision,
            overlap=own.overlap,
            driven=TaskInfo.of(base).driven,
            # Steps of lessons count, and teach the critic nothing.
            critic_steps=own.critic_steps
            + (0 if lessons is None else lessons.rounds * lessons.steps * settings.worlds),
            policy_kwargs={
                "coding": coding,
                "network": own,
                "log_std": own.log_std_init,
                "noise_floor": own.noise_floor,
            },
            seed=settings.seed,
            device="cpu",
        )

    def begin_with(self, model: PartsPPO) -> None:
        """Take the actor over from the policy that the settings name, if they do; how much it explores is theirs to say.

        Raises:
            ValueError: a policy of another form, or for another task.
        """
        settings = self.settings
        if settings.start is None:
            return
        path = Path(settings.start.replace("{seed}", str(settings.seed)))
        env = model.get_env()
        assert isinstance(env, VecEnv)
        info, mine, what = TaskInfo.of(env.env), self.acting(model), settings.residual
        found = load_trained(path, info) if what is None else load_correction(path, info, what.base, what.scale).learned
        if not isinstance(found, TrainedPolicy):
            raise checks.refuse("start", str(path), "a policy that PPO has trained")
        # Weights may fit and yet mean something else: numbers of other columns, or another action.
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
                got = f"{path} (other {name})"
                raise checks.refuse("start", got, "a policy with a network as the settings have it")
        kept = {
            name: torch.from_numpy(each.copy())
            for name, each in found.tensors.items()
            if not name.startswith("log_std")
        }
        model.policy.actor.load_state_dict({**model.policy.actor.state_dict(), **kept})


def has_bfloat16() -> bool:
    """Whether the processor has instructions for bfloat16, as far as torch tells; without, it takes longer than float32."""
    told = getattr(torch.cpu, "get_capabilities", dict)()
    return any(name.endswith("bf16") and has for name, has in told.items())


def _shapes(tensors: Mapping[str, np.ndarray]) -> dict[str, tuple[int, ...]]:
    return {name: value.shape for name, value in tensors.items() if name != FLOOR}
