"""What a training needs of an algorithm: its settings, its worlds, a model that learns in them, the policy that it leaves."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any, ClassVar, Protocol

import numpy as np

from agents.training.train_settings import TrainSettings
from vibgym.adapters.sb3 import VecEnv
from vibgym.config import Settings
from vibgym.policies.protocol import Policy


class Algorithm(Protocol):
    """One algorithm, with the settings of one run; one of your own is a class like this in :data:`ALGORITHMS`.

    Training files say ``algorithm: name``, and its own settings under that name.

    Args:
        settings: of the run; ``settings.own`` are the algorithm's.
    """

    hyperparameters: ClassVar[type[Settings]]
    """What stands in a training file under the algorithm's name."""

    title: ClassVar[str]
    """What the files of its policies call it."""

    phase: ClassVar[str]
    """What learning curves call it."""

    advice: ClassVar[str]
    """Settings to lower where a training diverges."""

    log_interval: ClassVar[int]
    """Rollouts, of SAC episodes, or from data sets blocks of updates, between two lines of the log."""

    settings: TrainSettings

    def __init__(self, settings: TrainSettings) -> None: ...

    def make_env(self) -> VecEnv:
        """The worlds that it trains in.

        Raises:
            ValueError: settings of the run that it cannot follow, or that the environment refuses.
        """
        ...

    def make_model(self, env: VecEnv) -> Any:
        """An untrained model.

        It has what a training uses of Stable-Baselines3's algorithms (``learn``, ``policy``, ``num_timesteps``, ``get_env``,
        ``set_logger``, ``_get_torch_save_params``), and ``begin``, ``get_state`` and ``set_state`` as
        :class:`agents.training.resumable.Resumable` gives them to these.

        Raises:
            ValueError: settings of its own that do not fit these worlds.
        """
        ...

    def acting(self, model: Any) -> Policy:
        """The model as it acts, without torch."""
        ...

    def actor(self, model: Any) -> dict[str, np.ndarray]:
        """The tensors of what acts."""
        ...

    def take_actor(self, model: Any, tensors: Mapping[str, np.ndarray]) -> None:
        """Act as these tensors do."""
        ...

    def save_policy(self, path: Path, model: Any, training: dict[str, Any]) -> None:
        """Write what acts, for :func:`vibgym.policies.trained.trained.load_trained`.

        Args:
            path: of the policy's JSON file.
            model: whose.
            training: how it was trained, for the file.

        Raises:
            Diverged: a weight is not finite; an older policy stays.
        """
        ...
