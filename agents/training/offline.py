"""Learning from data sets, under the names that :mod:`agents.training.on_policy` has for PPO."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from stable_baselines3.common.utils import set_random_seed

from agents.training import on_policy
from agents.training.offline_learner import OfflineLearner
from agents.training.on_policy import acting, actor, take_actor  # noqa: F401 - a policy of parts, as PPO's
from agents.training.parts_policy import PartsPolicy
from agents.training.settings import OfflineSettings, TrainSettings
from vibgym import checks
from vibgym.adapters.sb3 import VecEnv
from vibgym.policies.trained.coding import Coding

TITLE, PHASE = "learning from a data set", "offline"
"""What policies' files and learning curves call it."""

ADVICE = "offline.learning_rate"
"""What to lower where a training diverges."""


def _own(settings: TrainSettings) -> OfflineSettings:
    if settings.offline is None:
        raise checks.refuse("offline", None, "a mapping with 'dataset', which 'algorithm: offline' needs")
    return settings.offline


def make_env(settings: TrainSettings) -> VecEnv:
    """The environment that a policy is learned for; nothing is played in it.

    Raises:
        ValueError: settings that the environment refuses, or that ask for what goes before PPO.
    """
    _own(settings)
    settings.check_alone()
    return on_policy.make_env(settings.model_copy(update={"worlds": len(settings.all_scenes)}))


def make_model(settings: TrainSettings, env: VecEnv) -> OfflineLearner:
    """A learner that has read its data.

    Raises:
        ValueError: no such data set, or one of another environment, scene or version.
    """
    from agents.training.transitions import read  # Minari is an extra

    offline = _own(settings)
    if offline.network == "pixels":
        raise checks.refuse("offline.network", offline.network, "'parts' or 'elements', which read rows of parts")
    set_random_seed(settings.seed)
    coding = on_policy.coding_of(settings, env.env)
    assert isinstance(coding, Coding)  # no pictures
    data = read(offline, env.env, on_policy.action_of(settings), coding)
    policy = PartsPolicy(
        env.observation_space,
        env.action_space,
        offline.rate,
        **on_policy.networks(settings, coding),
        log_std=-3.0,  # it does not explore
    )
    return OfflineLearner(policy, env, data, offline, settings.steps)


def save_policy(path: Path, model: OfflineLearner, settings: TrainSettings, training: dict[str, Any]) -> None:
    """Write the policy, see :func:`agents.training.on_policy.save_policy`; it tells what it was learned from."""
    on_policy.save_policy(path, model, settings, {**training, "data": model.data.facts})
