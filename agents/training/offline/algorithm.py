"""Learning from data sets: what is read, and the policy that comes of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stable_baselines3.common.utils import set_random_seed

from agents.training.offline.hyperparameters import OfflineSettings
from agents.training.offline.learner import OfflineLearner
from agents.training.parts_algorithm import PartsAlgorithm
from agents.training.parts_policy import PartsPolicy
from agents.training.worlds import make_worlds
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.trained.coding import Coding


class Offline(PartsAlgorithm):
    """Nothing is played; a policy of parts, as PPO's. See :mod:`agents.training.offline.learner`."""

    hyperparameters = OfflineSettings
    title, phase = "learning from a data set", "offline"
    advice = "offline.learning_rate"
    log_interval = 1

    def make_env(self) -> VecEnv:
        """The environment that a policy is learned for, one world a scene."""
        self.settings.check_alone()
        if self.settings.network.network == "pixels":
            raise checks.refuse("offline.network", "pixels", "'parts' or 'elements', which read rows of parts")
        checks.choice("observation", self.settings.environment.get("observation", "parts"), ("parts",))
        return make_worlds(self.settings.model_copy(update={"worlds": len(self.settings.all_scenes)}), "parts")

    def make_model(self, env: VecEnv) -> OfflineLearner:
        """A learner that has read its data.

        Raises:
            ValueError: no such data set, or one of another environment, scene or version.
        """
        from agents.training.offline.transitions import read  # Minari is an extra

        settings, own = self.settings, self.settings.own
        assert isinstance(own, OfflineSettings)
        set_random_seed(settings.seed)
        coding = self.coding(env.env)
        assert isinstance(coding, Coding)  # no pictures
        data = read(own, env.env, settings.action, coding)
        # It does not explore.
        policy = PartsPolicy(
            env.observation_space, env.action_space, own.rate, coding=coding, network=own, log_std=-3.0
        )
        return OfflineLearner(policy, env, data, own, settings.steps)

    def save_policy(self, path: Path, model: OfflineLearner, training: dict[str, Any]) -> None:
        """As other policies of parts; it tells what it was learned from."""
        super().save_policy(path, model, {**training, "data": model.data.facts})
