"""Which surface, part and hardware a data sheet is about, and who moves the part."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Self

from pydantic import Field

from vibgym import checks
from vibgym.config import Settings, load_yaml, parse

SQUARE: dict[str, Any] = {
    "shape": "rectangle", "length_mm": 40.0, "width_mm": 40.0, "friction": 0.58, "name": "square part",
}  # fmt: skip
"""The part of a sheet without one: a square of aluminium."""


class DatasheetSettings(Settings):
    """What a sheet is made of.

    Attributes:
        title: of the sheet; None: the part's name.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields.
        part: the name of a shipped part or a mapping, see :class:`vibgym.config.PartSettings`.
        model, actuators, sensor: keyword arguments of the environments.
        policy: who moves the part, see :func:`vibgym.policies.make_policy`; it has to serve Transport, Align and Rotate.
        episodes: of each measurement.
        first_seed: of the episodes.
        output: directory for the page.
    """

    title: str | None = Field(default=None, min_length=1, max_length=60)
    surface: Any = "prototype"
    part: Any = SQUARE
    model: Any = "planar"
    actuators: Any = "prototype"
    sensor: Any = {"kind": "pose", "estimator": "model"}
    policy: Any = "pose"
    episodes: int = Field(default=48, ge=8, le=10_000)
    first_seed: int = Field(default=100_000, ge=0, lt=2**63)
    output: str = Field(default="runs/datasheet", min_length=1)

    @property
    def environment(self) -> dict[str, Any]:
        """Keyword arguments of the environments."""
        scene = {"surface": self.surface, "parts": [self.part], "model": self.model}
        return {**scene, "actuators": self.actuators, "sensor": self.sensor}

    @property
    def seeds(self) -> list[int]:
        """Of the episodes."""
        return list(range(self.first_seed, self.first_seed + self.episodes))

    @classmethod
    def checked(cls, data: Any, episodes: int | None = None, output: str | None = None) -> Self:
        """Checked settings from a mapping; ``episodes`` and ``output`` instead of its own.

        Raises:
            ValueError: the first fault, in one line.
        """
        settings = parse(cls, data, "datasheet")
        changes: dict[str, Any] = {} if output is None else {"output": output}
        if episodes is not None:
            changes["episodes"] = checks.count("--episodes", episodes, least=8, most=10_000)
        return settings.model_copy(update=changes)

    @classmethod
    def load(cls, path: Path | None, episodes: int | None = None, output: str | None = None) -> Self:
        """The same from a YAML file, or the prototype's with a square part. Errors name the file."""
        if path is None:
            return cls.checked({}, episodes, output)
        data = load_yaml(path)
        with checks.within(path):
            return cls.checked(data, episodes, output)


settings_from = DatasheetSettings.checked
load_settings = DatasheetSettings.load
