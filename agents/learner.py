"""Learners whose network acts part by part: inputs of the network, policy files, checkpoints."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import torch

from agents import checkpoint
from agents.actor_critic import ActorCritic
from agents.networks import NETWORKS, trained_tensors
from agents.training_settings import NetworkSettings, ServesSettings, TrainSettings
from vibgym import Surface, checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.task_info import TaskInfo
from vibgym.policies.trained.coding import Coding
from vibgym.policies.trained.networks import FLOOR
from vibgym.policies.trained.residual import load_correction
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

Report = Callable[[dict[str, float]], None]


class PartsLearner:
    """Base of PPO and offline learning.

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
        assert isinstance(settings.own, NetworkSettings)
        self.settings, self.network, self.action = settings, settings.own, settings.action
        checks.choice(f"{settings.algorithm}.network", self.network.network, tuple(NETWORKS))
        self.observation = CODINGS[self.network.network].observation
        observation = settings.environment.get("observation", self.observation)
        if observation != self.observation:
            name = f"{settings.algorithm} with network {self.network.network!r}"
            raise checks.conflict(f"{name} requires observation {self.observation!r}, got {observation!r}")

    def coding(self) -> Coding:
        """Return the conversion of observations and actions for the network.

        Raises:
            ValueError: ``dropped_columns`` names an unknown column, or the network does not support the action.
        """
        network, where, env = self.network, self.settings.algorithm, self.env.env
        layout = env.parts_layout
        for name in network.dropped_columns:
            checks.choice(f"{where}.dropped_columns", name, tuple(row.name for row in layout))
        columns = (
            [[row.name, row.width] for row in layout if row.name not in network.dropped_columns]
            if network.dropped_columns
            else None
        )
        memory = network.model_dump(include={"turned", "history", "history_columns"})
        coding = CODINGS[network.network](env.surface, env.parts, layout, self.action, columns, **memory)
        if network.network == "elements" and not coding.shape.has_elements:
            reason = "column 'element' is in 'dropped_columns'" if coding.shape.side else f"not {self.action!r}"
            raise checks.conflict(f"{where}.network 'elements' requires action 'element' or 'phasor' ({reason})")
        return coding

    # -- policies ----------------------------------------------------------------------------------------------------

    def acting(self) -> TrainedPolicy:
        """Return the present policy in NumPy."""
        policy, own = self.policy, self.network
        return TrainedPolicy(self.actor(), own.network, own.activation, policy.coding, policy.symmetric)

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions, see :meth:`vibgym.policies.task_info.Policy.predict`."""
        return self.acting().predict(observation, state, episode_start, deterministic)

    def actor(self) -> dict[str, np.ndarray]:
        """Return the actor's tensors."""
        return trained_tensors(self.policy.actor)

    def set_actor(self, tensors: Mapping[str, np.ndarray]) -> None:
        """Replace the actor's tensors."""
        self.policy.actor.load_state_dict({name: torch.from_numpy(value.copy()) for name, value in tensors.items()})

    def start_from(self, path: Path) -> None:
        """Take the actor from a policy file; exploration keeps its own settings.

        Raises:
            ValueError: a policy of another form, or for another task.
        """
        info, mine, residual = TaskInfo.of(self.env.env), self.acting(), self.settings.residual
        if residual is None:
            trained: Any = load_trained(path, info)
        else:
            trained = load_correction(path, info, residual.base, residual.scale).learned
        if not isinstance(trained, TrainedPolicy):
            raise checks.refuse("start", str(path), "a policy trained by PPO")
        # Tensors of equal shapes may have another meaning.
        theirs, ours = _form(trained), _form(mine)
        for name in ours:
            if theirs[name] != ours[name]:
                raise checks.conflict(f"start: {path} has other {name} than the settings")
        tensors = {name: tensor for name, tensor in trained.tensors.items() if not name.startswith("log_std")}
        self.set_actor({**self.actor(), **tensors})

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
            "surface": served(info.surface, serves),
            "parts": ANY if serves.parts == ANY else len(info.parts),
            **({"hardware": ANY} if serves.hardware == ANY else {}),
            "columns": coding.columns,
            "turned": coding.turned,
            "history": coding.history,
            "history_columns": coding.history_columns,
            "action": coding.action,
            "network": self.network.network,
            "activation": self.network.activation,
            "training": training,
        }
        if settings.residual is not None:
            record[RESIDUAL] = settings.residual.model_dump(mode="json")
        save_set(path, KIND, tensors, record | self.custom_entries(), VERSION)

    def custom_entries(self) -> dict[str, Any]:
        """Return the algorithm's own entries of policy files; here those of an actor and critic."""
        return {"symmetric": True} if self.policy.symmetric else {}

    # -- checkpoints -------------------------------------------------------------------------------------------------

    def learned(self) -> dict[str, Any]:
        """Return networks and optimizers by their names in checkpoints."""
        raise NotImplementedError

    def weights(self) -> dict[str, Any]:
        """Return the states of networks and optimizers."""
        return {name: network.state_dict() for name, network in self.learned().items()}

    def get_state(self) -> dict[str, Any]:
        """Return everything that the rest of the run depends on."""
        return {**self.weights(), "steps": self.steps, "torch": torch.get_rng_state()}

    def set_state(self, state: dict[str, Any]) -> None:
        """Continue from what :meth:`get_state` returned.

        Raises:
            ValueError: a state of other worlds or data.
            RuntimeError: a state of other networks.
        """
        for name, network in self.learned().items():
            network.load_state_dict(state[name])
        self.steps = state["steps"]
        torch.set_rng_state(state["torch"])

    def check_finite(self) -> None:
        """Raise :class:`agents.checkpoint.Diverged` if a weight or an optimizer state is not finite."""
        checkpoint.check_finite(self.weights())

    def save(self, directory: Path) -> None:
        """Write a checkpoint.

        Raises:
            Diverged: a weight is not finite; the last checkpoint stays.
        """
        self.check_finite()
        checkpoint.save(directory, self.get_state())

    def load(self, directory: Path) -> bool:
        """Continue from the checkpoint in ``directory``; return False if there is none.

        Raises:
            ValueError: it is damaged or belongs to other settings.
        """
        return checkpoint.restore(directory, self.set_state)

    def close(self) -> None:
        """Close the environment."""
        self.env.close()


def served(surface: Surface, serves: ServesSettings) -> dict[str, Any]:
    """Return the surfaces that a policy serves, as its file has them."""
    whole = dict.fromkeys(("rows", "columns"), ANY) if serves.surface == ANY else {}
    ranges = {"frequency": serves.frequency, "element_size": serves.element_size}
    return described(surface) | whole | {name: list(span) for name, span in ranges.items() if span is not None}


def _form(policy: TrainedPolicy) -> dict[str, Any]:
    """Return what the meaning of a policy's tensors depends on, by setting."""
    coding = policy.coding
    return {
        "action": policy.action,
        "columns": coding.columns,
        "ppo.turned": coding.turned,
        "ppo.history": coding.history,
        "ppo.history_columns": coding.history_columns,
        "ppo.network": policy.network,
        "ppo.activation": policy.activation,
        "layers": {name: tensor.shape for name, tensor in policy.tensors.items() if name != FLOOR},
    }
