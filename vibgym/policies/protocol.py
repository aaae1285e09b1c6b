"""The protocol that every policy follows, and nothing else.

A policy has the call that Stable-Baselines3 models have, for one environment or a batch. It sees observations only; what it
may know beforehand is in :class:`vibgym.policies.task_info.TaskInfo`.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Policy(Protocol):
    """What can act in an environment."""

    action: str
    """Value of the environment's ``action=`` that the policy speaks."""

    observation: str
    """Value of the environment's ``observation=`` that the policy reads."""

    def predict(
        self,
        observation: Any,
        state: Any = None,
        episode_start: np.ndarray | None = None,
        deterministic: bool = True,
    ) -> tuple[np.ndarray, Any]:
        """Actions (n,) or (batch, n) for one observation or a batch, and the state to hand back at the next call.

        Args:
            observation: one observation or a batch of them.
            state: what the last call returned; None at the very start.
            episode_start: (batch,) bool, where an episode has just begun; None: nowhere but where state is None.
            deterministic: False lets a stochastic policy explore.
        """
        ...
