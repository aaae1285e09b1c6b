"""Settings of a report: scenes, models and their knobs, peers, tolerances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field

from vibgym import checks
from vibgym.config import load_yaml
from vibgym.scene.parts import shipped_part
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings, Length, read
from vibgym.simulation.simulator import Simulator

MODELS = ("planar", "averaged")
MAX_COMBINATIONS = 1000
"""Most combinations of knobs in one entry; each is a simulator and a line of the report."""


class PointSampling(BaseSettings):
    """Knobs of point sampling: points per side of the part, and Runge-Kutta steps per period."""

    points: int = Field(default=12, ge=2, le=4096)
    steps: int = Field(default=12, ge=1, le=4096)


class Integrator(BaseSettings):
    """Knob of SciPy's integrators: their relative tolerance."""

    rtol: float = Field(default=1e-4, ge=1e-12, le=0.1)


class MuJoCo(BaseSettings):
    """Knobs of MuJoCo, see :func:`studies.accuracy.mujoco_scene.build`; times in s."""

    timestep: float = Field(default=1e-3, gt=0.0)
    contact_time: float | None = Field(default=None, gt=0.0)
    impratio: float = Field(default=10.0, gt=0.0)


PEERS: dict[str, type[BaseSettings]] = {
    "point_sampling": PointSampling, "LSODA": Integrator, "DOP853": Integrator, "mujoco": MuJoCo
}  # fmt: skip
"""Peers and their knobs."""

Lengths = tuple[Annotated[Length, Field(gt=0.0)], ...]
Shares = tuple[Annotated[float, Field(gt=0.0)], ...]


class TruthSettings(BaseSettings):
    """The planar run that counts as true, and how much of it the independent reference checks.

    Attributes:
        steps, substeps, pieces: knobs of the planar model.
        reference_worlds: worlds that the reference integrates, 0 for none.
        reference_periods: most of the scene's periods that it integrates.
        reference_tolerance: relative tolerance of the reference.
    """

    steps: int = Field(default=128, ge=8, le=4096)
    substeps: int = Field(default=2, ge=1, le=64)
    pieces: int = Field(default=6, ge=1, le=64)
    reference_worlds: int = Field(default=2, ge=0)
    reference_periods: int = Field(default=5, ge=1)
    reference_tolerance: float = Field(default=1e-8, ge=1e-12, le=1e-4)

    @property
    def knobs(self) -> dict[str, int]:
        """Knobs of the planar model."""
        return self.model_dump(include={"steps", "substeps", "pieces"})


class ReportSettings(BaseSettings):
    """A report of error against cost.

    Attributes:
        scenes: mappings, see :class:`studies.accuracy.scenes.SceneSettings`.
        models: mappings of ``model`` and its knobs; lists of values of knobs stand for all combinations.
        peers: the same with ``peer``, see :data:`PEERS`.
        strong_tolerances: of the trajectory's error, m.
        weak_tolerances: of the mean velocity's error, relative.
        auto_tolerances: of ``model="auto"`` on every scene, m; empty: no such section.
        peer_worlds: number of a scene's worlds that the slow peers (SciPy, MuJoCo) run.
        rounds: in which every setting is timed, in turn with all others.
        truth: see :class:`TruthSettings`.
        orders, hard_cases: whether the report has these sections.
        output: directory, made if needed.
    """

    scenes: tuple[Any, ...] = Field(min_length=1, max_length=100)
    models: tuple[Any, ...] = Field(min_length=1, max_length=100)
    peers: tuple[Any, ...] = ()
    strong_tolerances: Lengths = Field(default=(1e-3, 1e-4, 5e-5, 1e-5), min_length=1, max_length=12)
    weak_tolerances: Shares = Field(default=(0.05, 0.02, 0.01, 0.001), min_length=1, max_length=12)
    auto_tolerances: Lengths = ()
    peer_worlds: int = Field(default=4, ge=1)
    rounds: int = Field(default=7, ge=1, le=1000)
    truth: TruthSettings = TruthSettings()
    orders: bool = True
    hard_cases: bool = True
    output: str = Field(default="runs/accuracy", min_length=1)

    def model_settings(self) -> list[tuple[str, dict[str, Any]]]:
        """Return every model with one value for each given knob."""
        # One element accepts coarser settings than several; a scene that refuses a setting has a line with the reason.
        surface, part = Surface(rows=1, columns=1), shipped_part("aluminium_block")
        settings = []
        for where, model, knobs in _combinations("models", self.models, "model", MODELS):
            with checks.within(where, "."):
                Simulator(surface, part, model=model, **knobs)
            settings.append((model, knobs))
        return settings

    def peer_settings(self) -> list[tuple[str, dict[str, Any]]]:
        """Return every peer with one value for each knob."""
        combinations = _combinations("peers", self.peers, "peer", tuple(PEERS))
        return [(peer, read(PEERS[peer], knobs, where).model_dump()) for where, peer, knobs in combinations]


def _combinations(
    name: str, entries: Sequence[Any], key: str, allowed: tuple[str, ...]
) -> Iterator[tuple[str, str, dict[str, Any]]]:
    """Yield place, model or peer, and a value of each of its knobs, for all combinations of the lists of each entry."""
    for index, entry in enumerate(entries):
        where = f"{name}.{index}"
        if not isinstance(entry, Mapping) or not all(isinstance(knob, str) for knob in entry):
            raise checks.refuse(where, entry, f"a mapping with '{key}' and its knobs")
        kind = checks.choice(f"{where}.{key}", entry.get(key), allowed)
        choices = {knob: value if checks.listed(value) else [value] for knob, value in entry.items() if knob != key}
        number = math.prod(map(len, choices.values()))
        if number > MAX_COMBINATIONS:
            raise checks.refuse(where, f"lists of {number} combinations", f"at most {MAX_COMBINATIONS}")
        for values in itertools.product(*choices.values()):
            yield where, kind, dict(zip(choices, values, strict=True))


def settings_from(data: Any, output: str | None = None) -> ReportSettings:
    """Return checked settings from a mapping with the attributes of :class:`ReportSettings` as keys.

    Args:
        data: the mapping.
        output: another output directory.

    Raises:
        ValueError: the first fault, in one line.
    """
    settings = read(ReportSettings, data, "report")
    settings.model_settings()
    settings.peer_settings()
    return settings if output is None else settings.model_copy(update={"output": output})


def load_settings(path: Path, output: str | None = None) -> ReportSettings:
    """Return checked settings from a YAML file; see :func:`settings_from`. Errors name the file."""
    data = load_yaml(path)
    with checks.within(path):
        return settings_from(data, output)
