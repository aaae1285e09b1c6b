"""Settings of a report: scenes, models and their knobs, peers, tolerances."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
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

PEERS: dict[str, dict[str, Any]] = {
    "point_sampling": {"points": 12, "steps": 12},
    "LSODA": {"rtol": 1e-4},
    "DOP853": {"rtol": 1e-4},
    "mujoco": {"timestep": 1e-3, "contact_time": None, "impratio": 10.0},
}
"""Peers, their knobs and defaults."""

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
        found: list[tuple[str, dict[str, Any]]] = []
        for index, given in enumerate(self.models):
            where = f"models.{index}"
            model, choices = _named(given, where, "model", MODELS)
            for knobs in _combinations(choices, where):
                with checks.within(where, "."):
                    Simulator(surface, part, model=model, **knobs)
                found.append((model, knobs))
        return found

    def peer_settings(self) -> list[tuple[str, dict[str, Any]]]:
        """Return every peer with one value for each knob."""
        found: list[tuple[str, dict[str, Any]]] = []
        for index, given in enumerate(self.peers):
            where = f"peers.{index}"
            peer, choices = _named(given, where, "peer", tuple(PEERS))
            for knobs in _combinations(choices, where):
                for name, value in knobs.items():
                    _check_peer_knob(peer, name, value, where)
                found.append((peer, PEERS[peer] | knobs))
        return found


def _named(given: Any, where: str, key: str, allowed: tuple[str, ...]) -> tuple[str, dict[str, Any]]:
    if not isinstance(given, Mapping):
        raise checks.refuse(where, given, f"a mapping with '{key}' and its knobs")
    content = dict(given)
    name = checks.choice(f"{where}.{key}", content.pop(key, None), allowed)
    for knob in content:
        if not isinstance(knob, str):
            raise checks.refuse(where, knob, "keys that are strings")
    return name, content


def _combinations(choices: Mapping[str, Any], where: str) -> list[dict[str, Any]]:
    lists = [value if checks.listed(value) else [value] for value in choices.values()]
    number = math.prod(map(len, lists))
    if number > MAX_COMBINATIONS:
        raise checks.refuse(where, f"lists of {number} combinations", f"at most {MAX_COMBINATIONS}")
    return [dict(zip(choices, values, strict=True)) for values in itertools.product(*lists)]


def _check_peer_knob(peer: str, name: str, value: Any, where: str) -> None:
    if name not in PEERS[peer]:
        raise checks.refuse(f"{where}.{name}", value, f"the knobs of {peer!r}: {', '.join(PEERS[peer])}")
    if name in ("points", "steps"):
        checks.count(f"{where}.{name}", value, least=2 if name == "points" else 1, most=4096)
    elif name == "rtol":
        checks.number(f"{where}.{name}", value, least=1e-12, most=0.1)
    elif value is not None or name != "contact_time":
        checks.number(f"{where}.{name}", value, above=0.0)


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
