"""The keyword arguments of environments, once: for single and vector ones, specs, settings files and snapshots."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields
from typing import Any, TypedDict

from vibgym import checks
from vibgym.scene.surface import Surface


class Keywords(TypedDict, total=False):
    """Keyword arguments of :class:`Options` but the task, for type checkers: ``**options: Unpack[Keywords]``."""

    surface: str | Mapping[str, Any] | Surface
    parts: Sequence[Any] | None
    model: str | Mapping[str, Any]
    action: str
    observation: str
    actuators: str | Mapping[str, Any]
    sensor: str | Mapping[str, Any]
    randomize: Mapping[str, Any] | None
    walls: Sequence[str] | None
    start: str | Mapping[str, Any] | None
    zones: Mapping[str, Sequence[float]] | None
    slots: int | None
    paths: Any
    task_settings: Mapping[str, Any] | None
    periods_per_step: int
    max_episode_periods: int | None


@dataclass(frozen=True)
class Options:
    """What an environment is made of, see :class:`vibgym.envs.VibgymEnv`; values as they are given, checked by the core."""

    task: str
    surface: str | Mapping[str, Any] | Surface = "prototype"
    parts: Sequence[Any] | None = None
    model: str | Mapping[str, Any] = "planar"
    action: str = "element"
    observation: str = "state"
    actuators: str | Mapping[str, Any] = "ideal"
    sensor: str | Mapping[str, Any] = "ideal"
    randomize: Mapping[str, Any] | None = None
    walls: Sequence[str] | None = None
    start: str | Mapping[str, Any] | None = None
    zones: Mapping[str, Sequence[float]] | None = None
    slots: int | None = None
    paths: Any = None
    task_settings: Mapping[str, Any] | None = None
    periods_per_step: int = 1
    max_episode_periods: int | None = None

    @classmethod
    def names(cls) -> tuple[str, ...]:
        """Names of all options but the task."""
        return tuple(field.name for field in fields(cls))[1:]

    @classmethod
    def from_mapping(cls, name: str, mapping: Mapping[str, Any], more: tuple[str, ...] = ()) -> Options:
        """The options in a mapping; those that it does not name are the defaults.

        Args:
            name: what errors call the mapping.
            more: other keys that its owner takes, for errors.

        Raises:
            ValueError: no mapping, no task, or a key that no environment has.
        """
        known = ", ".join((*cls.names(), *more))
        if not isinstance(mapping, Mapping) or "task" not in mapping:
            raise checks.refuse(name, mapping, f"a mapping with 'task' and keys among {known}")
        unknown = [each for each in mapping if each not in ("task", *cls.names())]
        if unknown:
            raise checks.refuse(name, sorted(map(str, unknown)), known)
        return cls(**mapping)

    def of_state(self) -> dict[str, Any]:
        """Those that a snapshot depends on, by name: all but the limit, which ends an episode and changes nothing in it."""
        return {name: value for name, value in vars(self).items() if name != "max_episode_periods"}
