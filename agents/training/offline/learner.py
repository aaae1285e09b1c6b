"""Learning from a data set alone: behaviour cloning, and implicit Q-learning (IQL).

Cloning does what was done. IQL (Kostrikov, Nair & Levine 2021, "Offline Reinforcement Learning with Implicit Q-Learning",
https://arxiv.org/abs/2110.06169) does what was done where that was better than usual: it learns values of states and actions
without ever asking for an action that is not in the data, and weighs the samples of a cloning by their advantage.
"""

from __future__ import annotations

import copy
from typing import TYPE_CHECKING, Any

import numpy as np
import torch
from stable_baselines3.common.utils import polyak_update
from torch import nn

from agents.training.checkpoint import check_finite
from agents.training.imitation import relative_error
from agents.training.networks.parts import PartsCritic
from agents.training.offline.hyperparameters import OfflineSettings
from agents.training.parts_policy import PartsPolicy
from vibgym.policies.trained.coding import Coding

if TYPE_CHECKING:
    from agents.training.offline.transitions import Transitions  # Minari is an extra

BLOCK = 100
"""Updates between two looks at the callback, as rollouts are of other algorithms."""

MOST_WEIGHT = 20.0
"""Of a sample, as multiples of the usual one."""


class ActionValues(nn.Module):
    """Two values of every part's action, of which the lower one counts (Fujimoto et al. 2018).

    A part reads its own action between its own columns and those of its neighbours.
    """

    def __init__(self, coding: Coding, settings: OfflineSettings) -> None:
        super().__init__()
        shape = coding.shape
        self.own = shape.own
        wider = shape._replace(columns=shape.columns + shape.action)
        make = (wider, list(settings.critic_net), settings.activation, settings.attention)
        self.both = nn.ModuleList(PartsCritic(*make) for _ in range(2))

    def forward(self, rows: torch.Tensor, mask: torch.Tensor, action: torch.Tensor) -> torch.Tensor:
        """(2, samples, parts)."""
        rows = torch.cat([rows[..., : self.own], action, rows[..., self.own :]], dim=-1)
        return torch.stack([each(rows, mask) for each in self.both])


class OfflineLearner:
    """Has the names of an algorithm of Stable-Baselines3 that a training uses; a step is an update.

    Args:
        policy: its actor learns, and of IQL its critic, the values of states.
        env: whose policy it is; never stepped.
        data: learned from.
        settings: how.
        steps: of the whole training, over which the learning rate falls.
    """

    def __init__(self, policy: PartsPolicy, env: Any, data: Transitions, settings: OfflineSettings, steps: int) -> None:
        self.policy, self.env, self.data, self.settings, self.steps = policy, env, data, settings, steps
        self.num_timesteps = 0
        self.ep_info_buffer: list[Any] = []  # no episodes are played
        self.logger: Any = None
        self.values: ActionValues | None = None
        learn = dict(policy.named_parameters())
        if settings.method == "iql":
            self.values = ActionValues(policy.coding, settings)  # type: ignore[arg-type] - no pictures
            self.target = copy.deepcopy(self.values).requires_grad_(False)
            learn |= {f"values.{name}": each for name, each in self.values.named_parameters()}
        else:
            learn = {name: each for name, each in learn.items() if name.startswith("actor.")}
        self.optimizer = torch.optim.Adam(learn.values(), lr=settings.learning_rate, fused=True)

    def get_env(self) -> Any:
        """Whose policy it is."""
        return self.env

    def set_logger(self, logger: Any) -> None:
        """From here on it writes there."""
        self.logger = logger

    def begin(self, seed: int) -> None:
        """No episodes begin."""

    def learn(self, total: int, callback: Any, log_interval: int, reset_num_timesteps: bool = False) -> None:
        """Make ``total`` updates.

        Raises:
            Diverged: numbers that are not finite.
        """
        until = self.num_timesteps + total
        callback.init_callback(self)
        callback.on_training_start(locals(), globals())
        blocks = 0
        while self.num_timesteps < until:
            callback.on_rollout_start()
            losses: list[dict[str, float]] = []
            while len(losses) < BLOCK - self.num_timesteps % BLOCK and self.num_timesteps + len(losses) < until:
                losses.append(self._update(self.num_timesteps + len(losses)))
            self.num_timesteps += len(losses)
            check_finite(self)
            blocks += 1
            if not callback.on_step():
                return
            if blocks % log_interval == 0:
                for name in losses[0]:
                    self.logger.record(f"train/{name}", float(np.mean([each[name] for each in losses])))
                self.logger.dump(self.num_timesteps)

    def _update(self, step: int) -> dict[str, float]:
        data, settings = self.data, self.settings
        for group in self.optimizer.param_groups:
            group["lr"] = settings.rate(1.0 - step / self.steps)
        chosen = torch.randint(len(data.at), (max(settings.batch_size // data.mask.shape[1], 1),))
        at, action = data.at[chosen], data.action[chosen]
        rows, mask = data.rows[at], data.mask[at]
        facts, loss, weight = {}, torch.zeros(()), mask
        if self.values is not None:
            advantage, loss, facts = self._values(rows, mask, action, chosen)
            here = mask > 0.5
            scale = advantage[here].std().clamp(min=1e-6) * settings.temperature
            weight = mask * (advantage / scale).exp().clamp(max=MOST_WEIGHT)
        error = relative_error(self.policy.actor(rows)[0], action, weight, settings.floor)
        self.optimizer.zero_grad()
        (error + loss).backward()
        self.optimizer.step()
        if self.values is not None:
            polyak_update(self.values.parameters(), self.target.parameters(), settings.tau)
        return {"error": float(error.detach()), **facts}

    def _values(
        self, rows: torch.Tensor, mask: torch.Tensor, action: torch.Tensor, chosen: torch.Tensor
    ) -> tuple[torch.Tensor, torch.Tensor, dict[str, float]]:
        """Advantages of what was done, the loss of all values, and what to tell of them."""
        assert self.values is not None
        data, settings, count = self.data, self.settings, mask.sum().clamp(min=1.0)
        after = data.at[chosen] + 1
        with torch.no_grad():
            worth = self.target(rows, mask, action).amin(dim=0)
            later = self.policy.critic(data.rows[after], data.mask[after])
            goes_on = (settings.gamma * (1.0 - data.ended[chosen]))[:, None]
            sought = data.reward[chosen][:, None] + goes_on * later
        value = self.policy.critic(rows, mask)
        above = worth - value
        asymmetry = torch.where(above > 0.0, settings.expectile, 1.0 - settings.expectile)
        of_states = (asymmetry.detach() * above**2 * mask).sum() / count
        of_actions = ((self.values(rows, mask, action) - sought) ** 2 * mask).sum() / count
        advantage = above.detach()
        facts = {
            "value": float(of_states.detach()),
            "action_value": float(of_actions.detach()),
            "mean_value": float((value.detach() * mask).sum() / count),
        }
        return advantage, of_states + of_actions, facts

    def _get_torch_save_params(self) -> tuple[list[str], list[str]]:
        """Names of networks and optimizers, as Stable-Baselines3's algorithms tell them."""
        return ["policy", "optimizer", *(["values", "target"] if self.values is not None else [])], []

    def get_state(self) -> dict[str, Any]:
        """What is no weight: where it is, and how the samples are drawn."""
        return {"steps": self.num_timesteps, "torch": torch.get_rng_state().numpy(), "data": self.data.facts["sha256"]}

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave.

        Raises:
            ValueError: it was learned from other data.
        """
        if state["data"] != self.data.facts["sha256"]:
            raise ValueError(f"{self.data.facts['dataset']} is another one by now")
        self.num_timesteps = state["steps"]
        torch.set_rng_state(torch.from_numpy(np.array(state["torch"])))
