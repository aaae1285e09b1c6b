"""The protocol of policies: the call of Stable-Baselines3 models, for one environment or a batch.

A policy gets observations only; public properties of the environment are in :class:`vibgym.policies.task_info.TaskInfo`.
"""

from __future__ import annotations

from typing import Any, Protocol

import numpy as np


class Policy(Protocol):
    """A policy, made for an environment with this ``action=`` and ``observation=``."""

    action: str
    observation: str

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions (n,) or (batch, n) for one observation or a batch, and the state for the next call.

        Args:
            observation: one observation or a batch of them.
            state: returned by the last call; None in the first one.
            episode_start: (batch,) bool, where an episode has just begun; None: nowhere, unless state is None.
            deterministic: False: a stochastic policy samples its actions.
        """
        ...
