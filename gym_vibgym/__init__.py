"""Environments for LeRobot: ``gym_vibgym/Push-v0`` is ``vibgym/Push-v0`` with observations in LeRobot's format.

LeRobot looks for the environments of type ``vibgym`` in the package ``gym_vibgym``; ``--env.discover_packages_path=gym_vibgym``
registers the type (:mod:`gym_vibgym.config`). Importing this package requires vibgym alone.
"""

import gymnasium as gym

import vibgym  # noqa: F401  registers its own environments
from vibgym.registration import ENVIRONMENTS

for _name in ENVIRONMENTS:
    if f"gym_vibgym/{_name}-v0" not in gym.registry:
        gym.register(
            id=f"gym_vibgym/{_name}-v0",
            entry_point="vibgym.adapters.lerobot:make_env",
            kwargs={"name": f"vibgym/{_name}-v0"},
            # The environment inside has the step limit; LeRobot reads attributes of the outermost wrapper.
            disable_env_checker=True,
            order_enforce=False,
        )
