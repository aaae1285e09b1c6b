"""Page of all settings of registered classes, generated from their ``Settings``."""

from __future__ import annotations

from collections.abc import Iterator

from vibgym.actuators import ACTUATORS
from vibgym.envs.actions import ACTIONS
from vibgym.envs.costs import COSTS
from vibgym.envs.observations import OBSERVATIONS
from vibgym.envs.options import Options
from vibgym.policies.task_info import POLICIES
from vibgym.registry import Registry
from vibgym.scene.friction_laws import FRICTION_LAWS
from vibgym.sensing import EFFECTS, ESTIMATORS, SENSORS
from vibgym.settings import BaseSettings, table
from vibgym.simulation.models import MODELS
from vibgym.tasks import TASKS
from vibgym.tasks.starts import STARTS

REGISTRIES: dict[str, Registry] = {
    "task": TASKS,
    "start": STARTS,
    "model": MODELS,
    "action": ACTIONS,
    "observation": OBSERVATIONS,
    "actuators": ACTUATORS,
    "sensor": SENSORS,
    "effect": EFFECTS,
    "estimator": ESTIMATORS,
    "friction law": FRICTION_LAWS,
    "cost": COSTS,
    "policy": POLICIES,
}
"""Registries of classes with settings, by what they register."""

INTRODUCTION = """# Settings

Keyword arguments of `gym.make`, and settings of all registered classes, for `task_settings=` and for mappings such as
`sensor={"kind": "pose", "delay": 2}`. Values are in SI units and radians; a length may be given in mm instead (`below_mm: 5`),
an angle in degrees (`_deg`), a mass in grams (`_g`).
"""


def page() -> str:
    """Return the page."""
    return "\n".join([INTRODUCTION, "## Environment\n", table(Options), "", *sections()])


def sections() -> Iterator[str]:
    """Yield the tables by registry, without items that have no settings."""
    for what, registry in REGISTRIES.items():
        tables = {name: table(item.Settings) for name, item in registry.items() if has_settings(item)}
        if tables:
            yield f"## {what[0].upper()}{what[1:]}\n"
            for name, text in tables.items():
                yield f"### `{name}`\n\n{text}\n"


def has_settings(item: object) -> bool:
    """Return whether a registered class has at least one setting."""
    found = getattr(item, "Settings", None)
    return isinstance(found, type) and issubclass(found, BaseSettings) and bool(found.model_fields)
