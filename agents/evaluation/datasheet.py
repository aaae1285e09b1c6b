"""Data sheet: ``python -m agents datasheet [CONFIG]`` writes one printable page on a surface with a part."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from pydantic import Field
from tqdm import tqdm

from agents.evaluation.films import Log, Rollout
from agents.evaluation.part_limits import Limits
from agents.evaluation.plan import Infos
from agents.evaluation.settings import FileSettings, Seed
from agents.training_settings import Plain
from vibgym import Part, checks
from vibgym.config import load_yaml
from vibgym.policies.applicable import tasks_with
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering import Scenery
from vibgym.scene.parts import StablePose, part_and_poses, part_from
from vibgym.scene.surface import surface_from
from vibgym.seeds import RANGES, check_seeds

RESTING = 25
"""Periods at the end of an episode over which the error of a part at its goal is averaged."""

MACHINE_KEYS = ("surface", "actuators", "sensor", "parts")
"""Keys of a machine file that a sheet uses."""

ESTIMATOR = "model"
"""Of the sensor of a machine file, which names none."""

VARIANTS: dict[str, tuple[dict[str, Any], str]] = {
    "Camera": (
        {"sensor": {"kind": "camera", "statistical": True, "estimator": ESTIMATOR}},
        "errors of the prototype's camera instead of this sensor's",
    ),
    "Rigid part": ({"model": {"kind": "tilting"}}, "tilting model: the part rocks on the elements"),
}
"""Further measurements of Align: settings that replace those of the sheet, and a note."""

SQUARE = {"shape": "rectangle", "length_mm": 40.0, "width_mm": 40.0, "friction": 0.58, "name": "square part"}
"""Default part of a data sheet."""


class DatasheetSettings(FileSettings):
    """Settings of ``python -m agents datasheet``.

    Attributes:
        title: of the sheet; None: the part's name.
        machine: settings of an identified machine, as ``python -m vibgym identify`` writes them; they replace the defaults of
            surface, actuators, sensor and part, and the friction of a part that has none is that of the machine's first part.
        surface: ``"prototype"`` or a mapping of :class:`vibgym.Surface`'s fields.
        part: the name of a shipped part, or a mapping: see :class:`vibgym.scene.part_settings.PartSettings`, and of a drawing
            :class:`vibgym.scene.part_settings.DrawingSettings`. The path of a drawing stands for ``{"file": path}``.
        model, actuators, sensor: arguments of the environments.
        policy: see :func:`vibgym.policies.make_policy`; it must serve Transport, Align and Rotate.
        episodes: of each measurement.
        first_seed: of the episodes.
        output: directory for the page.
    """

    where: ClassVar[str] = "datasheet"

    title: str | None = Field(default=None, min_length=1, max_length=60)
    machine: str | None = None
    surface: Plain = "prototype"
    part: Plain = SQUARE
    model: Plain = "planar"
    actuators: Plain = "prototype"
    sensor: Plain = {"kind": "pose", "estimator": "model"}
    policy: Plain = "pose"
    episodes: int = Field(default=48, ge=8, le=10_000)
    first_seed: Seed = RANGES["evaluation"].start
    output: str = Field(default="runs/datasheet", min_length=1)

    @classmethod
    def checked(cls, data: Any, episodes: int | None = None, output: str | None = None) -> Self:
        """Return checked settings, with those of the machine where ``data`` has none; see :meth:`FileSettings.checked`."""
        settings, machine = dict(data), {}
        if isinstance(settings.get("part"), str) and Path(settings["part"]).suffix:
            settings["part"] = {"file": settings["part"]}
        if isinstance(path := settings.get("machine"), str):
            machine = load_yaml(path)
            with checks.within(path):
                for name in machine:
                    checks.choice("key", name, MACHINE_KEYS)
                parts = machine.pop("parts", [])
                if isinstance(machine.get("sensor"), Mapping):
                    machine["sensor"] = {"estimator": ESTIMATOR, **machine["sensor"]}
                if parts:
                    part = settings.setdefault("part", parts[0])
                    if isinstance(part, Mapping) and "friction" not in part:
                        settings["part"] = {**part, "friction": part_from(parts[0]).friction}
        return super().checked({**machine, **settings}, episodes, output)

    @property
    def seeds(self) -> list[int]:
        """Seeds of the episodes."""
        return list(range(self.first_seed, self.first_seed + self.episodes))

    def check_ranges(self) -> None:
        """Check that the seeds are in a range for evaluations."""
        check_seeds(f"{self.where}.first_seed", self.first_seed, self.episodes, "evaluation", "own")

    def limited(self, episodes: int) -> dict[str, Any]:
        """Return the fields to change for another number of episodes, that of ``--episodes``."""
        return {"episodes": checks.count("--episodes", episodes, least=8, most=10_000)}


@dataclass(frozen=True)
class Sheet:
    """Measurements of a part on a surface.

    Attributes:
        settings: of the command.
        infos: task -> public information. Discs lack Rotate.
        scenery: of Align, for its picture.
        limits: see :class:`Limits`.
        played: episodes of these tasks, of "rest", which is Align without an end, and of :data:`VARIANTS`.
        unfit: variant -> why the part has none.
        poses: of a part from an STL file, most probable first.
        tasks: see :func:`vibgym.policies.applicable.tasks_with`.
    """

    settings: DatasheetSettings
    infos: dict[str, TaskInfo]
    scenery: Scenery
    limits: Limits
    played: dict[str, Rollout]
    unfit: dict[str, str]
    poses: tuple[StablePose, ...]
    tasks: dict[str, tuple[str, ...] | str]

    @property
    def speed(self) -> np.ndarray:
        """Distance over time from rest to rest, m/s, (episodes,); nan without success."""
        moved = self.played["Transport"]
        displacement = np.hypot(*np.moveaxis(moved.goals[:, 0, :2] - moved.poses[:, 0, 0, :2], -1, 0))
        return displacement / moved.time_to_goal

    @property
    def turn_speed(self) -> np.ndarray | None:
        """Turn over time from rest to rest, rad/s, (episodes,); None for discs. Goals of Rotate are not wrapped."""
        if "Rotate" not in self.played:
            return None
        turned = self.played["Rotate"]
        return np.abs(turned.goals[:, 0, 2] - turned.poses[:, 0, 0, 2]) / turned.time_to_goal

    def at_rest(self, name: str) -> np.ndarray:
        """Return the mean error at the goal, m or rad, (episodes,); nan where the part was lost."""
        rest = self.played["rest"]
        values = rest.over_time(name)
        assert values is not None  # Align reports both
        return np.where(rest.fallen, np.nan, np.abs(values[:, -RESTING:]).mean(axis=1))


def measure(settings: DatasheetSettings, quiet: bool = False) -> Sheet:
    """Measure everything of a sheet.

    Raises:
        ValueError: a surface, part, hardware or policy that does not work; the first fault, in one line.
    """
    part, poses = part_of(settings)
    hardware = {"actuators": settings.actuators, "sensor": settings.sensor}
    environment = {"surface": settings.surface, "parts": [part], "model": settings.model, **hardware}
    made = Infos()
    info, scenery = made.of("Align", environment, "datasheet")
    with checks.within("datasheet"):
        limits = Limits(info)
    # An episode at rest is a success only after all of its periods at the goal, so none ends before.
    assert info.step_limit is not None
    resting = {"task_settings": {"hold": info.step_limit * info.periods_per_step}}
    changes = {"Transport": {}, "Align": {}, "Rotate": {}, "rest": resting}
    changes |= {name: changed for name, (changed, _) in VARIANTS.items()}
    if part.symmetry == 0:
        del changes["Rotate"]
    runs, infos, unfit = {}, {}, {}
    for name, changed in changes.items():
        task, arguments = "Align" if changed else name, {**environment, **changed}
        with checks.within(f"datasheet ({task})"):
            try:
                of_task, _ = made.of(task, arguments, "environment")
            except checks.Refused as error:
                if name not in VARIANTS:
                    raise
                unfit[name] = str(error).partition(": ")[2]
                continue
            runs[name] = task, arguments, make_policy(settings.policy, of_task, settings.first_seed)
        if not changed:
            infos[name] = of_task
    played = {
        name: rollout(policy, task, seeds=settings.seeds, keep=Log, **arguments)
        for name, (task, arguments, policy) in tqdm(runs.items(), desc="measuring", disable=quiet)
    }
    tasks = tasks_with(part.to_dict(), settings.surface, **hardware)
    return Sheet(settings, infos, scenery, limits, played, unfit, poses, tasks)


def part_of(settings: DatasheetSettings) -> tuple[Part, tuple[StablePose, ...]]:
    """Return the part of a sheet and, if it is from an STL file, its stable poses."""
    surface = surface_from(settings.surface)
    if not (isinstance(settings.part, Mapping) and "file" in settings.part):
        return part_from(settings.part, "datasheet.part"), ()
    return part_and_poses(settings.part, "datasheet.part", surface)
