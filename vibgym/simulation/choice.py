"""``model="auto"``: the cheapest model and settings within a tolerance, from stored measurements.

The evidence (``evidence.json``, written by ``python -m studies.accuracy.evidence``) contains, for classes of scenes, the
deviation of every candidate from a converged run in 25 periods, and the cost of a period. Errors are in units of the table's
amplitude ``a_h``. A class is determined by

- whether the part always slides or may stick (only ``"planar"`` covers that), and whether there is one element or many,
- ``eps = mu g / (a_h w^2)``, the change of the motion by friction within a period,
- ``scale``, the smaller radius of gyration, of the part or of an element, over the displacement ``2 pi a_h`` of the table in a
  period: the rate at which the contact area of an element changes.

A scene gets the class with the next larger ``eps`` and the next smaller ``scale``, which is harder; errors are
multiplied by :data:`MARGIN`.
"""

from __future__ import annotations

import functools
import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from importlib import resources
from typing import Any

from vibgym import checks
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

PERIODS = 25
"""Periods after which an error is measured: one second at 25 Hz."""

MARGIN = 1.5
"""Factor between measured and promised errors."""

DEFAULT_TOLERANCE = 1e-4  # m


@dataclass(frozen=True)
class Choice:
    """Model and settings of a simulator, with the reason for them.

    Attributes:
        model: its name.
        knobs: settings of the model.
        tolerance: m, as requested; None if the model was named.
        error: m, promised largest deviation of a part's outline from the converged model in 25 periods, median over worlds with
            random fields; None if the model was named.
        error_95: m, the same for 95 of 100 worlds; None likewise, and where more than 5 of 100 failed.
        cost: microseconds per period, world and core on the host of the evidence; None likewise.
        reason: one sentence.
    """

    model: str
    knobs: Mapping[str, Any]
    tolerance: float | None
    error: float | None
    error_95: float | None
    cost: float | None
    reason: str

    def __str__(self) -> str:
        knobs = ", ".join(f"{name}={value}" for name, value in self.knobs.items())
        return f"{self.model}({knobs}): {self.reason}"


@functools.cache
def evidence() -> Any:
    """Return the stored evidence."""
    return json.loads(resources.files("vibgym.simulation").joinpath("evidence.json").read_text(encoding="utf-8"))


@dataclass(frozen=True)
class Traits:
    """Dimensionless quantities that determine the model errors of a scene."""

    kind: str  # "one element", "many elements", "stick-slip"
    eps: float
    scale: float


def traits(surface: Surface, part: Part) -> Traits:
    """Return the traits of a scene."""
    horizontal = surface.horizontal_amplitude * surface.angular_frequency**2
    eps = part.most_friction * surface.gravity / horizontal if horizontal > 0.0 else math.inf
    size = min(math.sqrt(part.gyration), surface.element_size / math.sqrt(6.0))
    travel = 2.0 * math.pi * surface.horizontal_amplitude
    scale = size / travel if travel > 0.0 else math.inf
    if not surface.slides_permanently(part.static_friction):
        return Traits("stick-slip", eps, scale)
    return Traits("one element" if surface.rows * surface.columns == 1 else "many elements", eps, scale)


def class_of(scene: Traits) -> Any:
    """Return the evidence class of a scene, or None if no class is at least as hard."""
    fitting = [
        evidence_class
        for evidence_class in evidence()["classes"]
        if evidence_class["kind"] == scene.kind
        and scene.eps <= evidence_class["eps"] * (1 + 1e-9)
        and scene.scale >= evidence_class["scale"] * (1 - 1e-9)
    ]
    return min(fitting, key=lambda evidence_class: (evidence_class["eps"], -evidence_class["scale"]), default=None)


def cost_of(row: Mapping[str, Any], periods_per_call: int) -> float:
    """Return microseconds per period, world and core."""
    return row["us_per_period"] + row["us_per_call"] / periods_per_call


def choose_for(surface: Surface, kinds: Sequence[Part], models: Sequence[str], **knobs: Any) -> Choice:
    """Return the choice for the kind of part that needs the finest steps, among ``models``."""
    choices = [choose(surface, part, models=models, **knobs) for part in kinds]
    return max(choices, key=lambda choice: (choice.knobs.get("steps", 0), choice.knobs.get("substeps", 0)))


def choose(
    surface: Surface,
    part: Part,
    tolerance: float = DEFAULT_TOLERANCE,
    periods_per_call: int = 1,
    models: Sequence[str] | None = None,
) -> Choice:
    """Return the cheapest candidate whose error, with the margin, is within ``tolerance``.

    Args:
        tolerance: m, see :attr:`Choice.error`.
        periods_per_call: periods of a typical call of ``advance``; the averaged model has a cost per call.
        models: allowed models; None: all.

    Raises:
        ValueError: no candidate is good enough, or no evidence covers the scene; the message names a setting that works.
    """
    scene = traits(surface, part)
    unit = surface.horizontal_amplitude
    evidence_class = class_of(scene)
    if evidence_class is None:
        kinds = [known for known in evidence()["classes"] if known["kind"] == scene.kind]
        raise checks.conflict(
            f"model='auto' requires a scene ({scene.kind}) with mu g / (a_h w^2) <= {max(known['eps'] for known in kinds):g} "
            f"and a size of part and element >= {min(known['scale'] for known in kinds):g} of the "
            f"table's displacement per period; here {scene.eps:.3g} and {scene.scale:.3g}: use model='planar' and set its steps"
        )
    rows = sorted(evidence_class["rows"], key=lambda row: cost_of(row, periods_per_call))
    able = [
        row
        for row in rows
        if row["error"] is not None
        and row["knobs"].get("stride", 1) <= periods_per_call
        and (models is None or row["model"] in models)
    ]
    for row in able:
        error = MARGIN * row["error"] * unit
        if error <= tolerance:
            cost = cost_of(row, periods_per_call)
            tail = None if row["error_95"] is None else MARGIN * row["error_95"] * unit
            return Choice(
                row["model"], row["knobs"], tolerance, error, tail, cost,
                f"the cheapest of {len(able)} candidates within {tolerance:g} m on {describe(scene)} (promised {error:.2g} m, "
                f"about {cost:.2g} us per period and core)",
            )  # fmt: skip
    best = min(able, key=lambda row: row["error"])
    knobs = ", ".join(f"{name}={value}" for name, value in best["knobs"].items())
    raise checks.refuse(
        "tolerance",
        tolerance,
        f"at least {MARGIN * best['error'] * unit:.2g} m on {describe(scene)}, where the most exact candidate is "
        f"model={best['model']!r} with {knobs}; name model='planar' with more steps and pieces for less",
    )


def describe(scene: Traits) -> str:
    """Describe a scene's traits."""
    return f"a scene with {scene.kind}, mu g / (a_h w^2) = {scene.eps:.3g}, size / displacement per period = {scene.scale:.3g}"
