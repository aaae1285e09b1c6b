"""Learning algorithms by name, and the protocol of user-registered ones."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from agents.flow import Flow
from agents.offline import Offline
from agents.ppo import PPO
from agents.sb3 import SB3
from agents.training_settings import TrainSettings
from vibgym.registry import Registry
from vibgym.settings import BaseSettings


class Algorithm(Protocol):
    """A learning algorithm; register a class with ``ALGORITHMS.register("mine", Mine)``.

    Training files then have ``algorithm: mine``, and its own settings under ``mine``. It makes its environment itself, for
    example with :func:`agents.training_envs.make_worlds`. Optional members, used if present:

    - ``title`` and ``phase``: names in policy files and learning curves.
    - ``actor()``, ``set_actor(tensors)``: tensors of the policy, to keep the best one of the learning curve.
    - ``save_policy(path, training)``: write a policy file at the end, and return its path if it is another one; without it the
      last checkpoint is the result.
    - ``check_finite()``: raise :class:`agents.checkpoint.Diverged`.
    - ``close()``.

    Args:
        settings: of the run; ``settings.own`` are the algorithm's. Those that it does not support are a ValueError.
    """

    Settings: ClassVar[type[BaseSettings]]
    """Settings under the algorithm's name in a training file."""

    action: str
    observation: str
    """Those of the environment that the policy acts in."""

    def __init__(self, settings: TrainSettings) -> None: ...

    @property
    def steps(self) -> int:
        """Environment steps done so far, of all worlds together."""
        ...

    def learn(self, until: int, report: Callable[[dict[str, float]], None]) -> None:
        """Train until ``steps`` is at least ``until``.

        Between two updates, and at the end, call ``report(metrics)``: the learning curve is measured and checkpoints are
        written there.
        """
        ...

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions for a batch of observations, and the policy's state (None without memory)."""
        ...

    def save(self, directory: Path) -> None:
        """Write everything that continuing the run needs into files in ``directory``."""
        ...

    def load(self, directory: Path) -> bool:
        """Continue from what :meth:`save` wrote; return False if there is nothing."""
        ...


ALGORITHMS: Registry[Any] = Registry("algorithm", {"ppo": PPO, "offline": Offline, "flow": Flow, "sb3": SB3})
"""Algorithms by name."""
