"""What PPO and learning from data sets share: worlds seen by parts, how a network reads them and acts in them, its policies."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import torch

from agents.training.algorithm import Algorithm
from agents.training.checkpoint import refuse_infinite
from agents.training.parts_policy import trained_tensors
from agents.training.residual_env import ResidualEnv
from agents.training.train_settings import TrainSettings
from agents.training.worlds import make_worlds
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.envs import VibgymVectorEnv
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.pictures import PictureCoding
from vibgym.policies.trained.residual import ResidualPolicy
from vibgym.policies.trained.storage import save_set
from vibgym.policies.trained.trained import ANY, CODINGS, KIND, RESIDUAL, VERSION, TrainedPolicy, described


class PartsAlgorithm(Algorithm):
    """An algorithm whose model has a :class:`agents.training.parts_policy.PartsPolicy`."""

    def __init__(self, settings: TrainSettings) -> None:
        self.settings = settings

    def make_env(self) -> VecEnv:
        """The worlds that a run trains on; policies are trained and act on what their network reads."""
        settings, residual = self.settings, self.settings.residual
        # The flat state is what a base policy reads.
        shown = CODINGS[settings.network.network].observation if residual is None else ResidualPolicy.observation
        checks.choice("observation", settings.environment.get("observation", shown), (shown,))
        return make_worlds(settings, shown, self._corrected)

    def _corrected(self, env: VibgymVectorEnv) -> VibgymVectorEnv | ResidualEnv:
        """The worlds, in which the base acts where the run is about a correction."""
        residual = self.settings.residual
        if residual is None:
            return env
        with checks.within("residual"):
            return ResidualEnv(env, make_policy(residual.base, TaskInfo.of(env)), residual.scale)

    def coding(self, env: VibgymVectorEnv | ResidualEnv) -> Coding | PictureCoding:
        """How the run's network reads and acts in an environment.

        Raises:
            ValueError: columns to be blind to that there are not, or a network of elements, and none to read.
        """
        network, where = self.settings.network, self.settings.algorithm
        layout = env.parts_layout
        names = tuple(row.name for row in layout)
        for name in network.blind:
            checks.choice(f"{where}.blind", name, names)
        columns = [[row.name, row.width] for row in layout if row.name not in network.blind] if network.blind else None
        flags = network.turned, network.remembers
        found = CODINGS[network.network](env.surface, env.parts, layout, self.settings.action, columns, *flags)
        if network.network == "elements" and not found.shape.has_elements:
            why = "this action has no elements" if not found.shape.side else "it is blind to the column 'element'"
            raise checks.refuse(f"{where}.network", network.network, f"'parts': {why}")
        return found

    def acting(self, model: Any) -> TrainedPolicy:
        kind, activation = model.policy.actor.kind, self.settings.network.activation
        return TrainedPolicy(self.actor(model), kind, activation, model.policy.coding)

    def actor(self, model: Any) -> dict[str, np.ndarray]:
        return trained_tensors(model.policy.actor)

    def take_actor(self, model: Any, tensors: Mapping[str, np.ndarray]) -> None:
        model.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})

    def save_policy(self, path: Path, model: Any, training: dict[str, Any]) -> None:
        tensors = self.actor(model)
        refuse_infinite(tensors)
        settings, info, coding = self.settings, TaskInfo.of(model.get_env().env), model.policy.coding
        serves = settings.serves
        record: dict[str, Any] = {
            "tasks": list(dict.fromkeys([info.name, *(serves.tasks or ())])),
            "surface": ANY if serves.surface == ANY else described(info.surface),
            "parts": ANY if serves.parts == ANY else len(info.parts),
            "columns": coding.columns,
            "turned": coding.turned,
            "remembers": coding.remembers,
            "action": coding.action,
            "network": settings.network.network,
            "activation": settings.network.activation,
            "training": training,
        }
        if settings.residual is not None:
            record[RESIDUAL] = settings.residual.model_dump(mode="json")
        save_set(path, KIND, tensors, record, VERSION)
