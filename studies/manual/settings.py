"""Page of all settings of registered classes, generated from their ``Settings``."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator

from vibgym.actuators import ACTUATORS
from vibgym.envs.actions import ACTIONS
from vibgym.envs.costs import COSTS
from vibgym.envs.observations import OBSERVATIONS
from vibgym.envs.options import Options
from vibgym.envs.randomization import Randomization
from vibgym.policies.task_info import POLICIES
from vibgym.registry import Registry
from vibgym.scene.friction_laws import FRICTION_LAWS
from vibgym.scene.part_settings import DrawingSettings, PartSettings
from vibgym.scene.surface import SurfaceSettings
from vibgym.sensing import EFFECTS, ESTIMATORS, SENSORS
from vibgym.settings import BaseSettings, table
from vibgym.simulation.models import MODELS
from vibgym.tasks import TASKS
from vibgym.tasks.pack import Pack
from vibgym.tasks.patterns import Pattern
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


ALONE: dict[str, type[BaseSettings]] = {
    "Environment": Options, "Surface": SurfaceSettings, "Part": PartSettings, "Randomized values": Randomization.Settings
}  # fmt: skip
"""Settings that belong to no registry."""

INCLUDED: dict[str, tuple[type[BaseSettings], Collection[str]]] = {
    "pattern": (Pack.Settings, (*Pattern.Settings.model_fields, "free")),
    "drawing": (
        DrawingSettings,
        [name for name in DrawingSettings.model_fields if name not in PartSettings.model_fields],
    ),
    "randomize": (Randomization.Settings, Randomization.Settings.model_fields),
}
"""File name in ``docs/generated/settings``, without suffix -> settings, and the names that other pages show."""


def page() -> str:
    """Return the page."""
    alone = [f"## {title}\n\n{shown(settings)}\n" for title, settings in ALONE.items()]
    return "\n".join([INTRODUCTION, *alone, *sections()])


def shown(settings: type[BaseSettings], names: Collection[str] | None = None) -> str:
    """Return the table of all settings, or those of ``names``, with roles of reST as code."""
    head, rule, *lines = table(settings).splitlines()
    chosen = [line for name, line in zip(settings.model_fields, lines, strict=True) if names is None or name in names]
    return re.sub(r":\w+:`~?([^`]+)`", r"`\1`", "\n".join([head, rule, *chosen]))


def included() -> dict[str, str]:
    """Return the tables that other pages include, by file name."""
    return {name: shown(*which) for name, which in INCLUDED.items()}


def sections() -> Iterator[str]:
    """Yield the tables by registry, without items that have no settings."""
    for what, registry in REGISTRIES.items():
        tables = {name: shown(item.Settings) for name, item in registry.items() if has_settings(item)}
        if tables:
            yield f"## {what[0].upper()}{what[1:]}\n"
            for name, text in tables.items():
                yield f"### `{name}`\n\n{text}\n"


def has_settings(item: object) -> bool:
    """Return whether a registered class has at least one setting."""
    own = getattr(item, "Settings", None)
    return isinstance(own, type) and issubclass(own, BaseSettings) and bool(own.model_fields)
