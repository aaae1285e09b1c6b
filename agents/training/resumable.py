"""What a learner of Stable-Baselines3 knows besides weights and optimizers, so that a killed training goes on exactly."""

from __future__ import annotations

from collections import deque
from typing import Any

import numpy as np
import torch

from vibgym.snapshots import generator_from, generator_state


class Resumable:
    """Mixin of an algorithm of Stable-Baselines3: its state between two rollouts, and that of its worlds.

    Numbers that are drawn come from torch's generator, the worlds' own, the action space's, and those that :meth:`own_state`
    tells of; Python's and NumPy's global generators are used by nothing here.
    """

    def begin(self, seed: int) -> None:
        """Before the first rollout: its episodes begin with these seeds, other ones than those of lessons."""
        model: Any = self
        if model._last_obs is None:
            model.get_env().seed(seed)

    def get_state(self) -> dict[str, Any]:
        """Nested mappings of arrays and plain values; weights and optimizers are kept apart."""
        model: Any = self
        return {
            "steps": model.num_timesteps,
            "updates": model._n_updates,
            "episodes": model._episode_num,
            "torch": torch.get_rng_state().numpy(),
            "action_space": generator_state(model.action_space.np_random),
            "observation": model._last_obs,
            "starts": model._last_episode_starts,
            "worlds": model.get_env().get_state(),  # also after lessons alone: resets leave some of it as it was
            "lately": [[each["r"], each["l"], each["t"]] for each in model.ep_info_buffer or ()],
            "succeeded": list(model.ep_success_buffer or ()),
            "own": self.own_state(),
        }

    def set_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`get_state` gave on a model of the same settings.

        Raises:
            ValueError: the state is of other worlds; ``self`` has not changed, but some of its worlds may have.
        """
        model: Any = self
        model.get_env().set_state(state["worlds"])
        self.set_own_state(state["own"])
        model.num_timesteps, model._n_updates = state["steps"], state["updates"]
        model._episode_num = state["episodes"]
        model._last_obs, model._last_episode_starts = state["observation"], state["starts"]
        window = model._stats_window_size
        model.ep_info_buffer = deque((dict(zip("rlt", each, strict=True)) for each in state["lately"]), maxlen=window)
        model.ep_success_buffer = deque(state["succeeded"], maxlen=window)
        model.action_space._np_random = generator_from("action_space", state["action_space"])
        torch.set_rng_state(torch.from_numpy(np.array(state["torch"])))

    def own_state(self) -> dict[str, Any]:
        """What the algorithm itself adds."""
        return {}

    def set_own_state(self, state: dict[str, Any]) -> None:
        """Go on from what :meth:`own_state` gave."""
