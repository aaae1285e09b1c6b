"""Parts as bodies for kernels."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym.physics.core.records import EVEN, Bodies, Body
from vibgym.scene import outlines
from vibgym.scene.friction_laws import law_table
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part


def body_of(part: Part, element_size: float | None = None) -> Body:
    """Return a part for kernels; of a disc a polygon, with fewer corners if ``element_size`` (m) is given.

    Its coefficient of friction is the largest of the friction law, which bounds on motion require.
    """
    outline, law = np.array(part.outline), law_table(part.friction_law)
    largest = float(law.max())
    if part.symmetry == 0 and element_size is not None:
        radius = math.sqrt(part.area / math.pi)
        outline = outlines.disc_outline(radius, outlines.sliding_corners(radius, element_size))
    return Body(
        outline,
        part.area,
        float(np.hypot(*outline.T).max()),
        part.gyration,
        part.friction * largest,
        part.static_friction,
        outlines.is_convex(outline),
        part.symmetry != 0,
        part.coupling,
        law=law / largest,
    )


def bodies_of(parts: Sequence[Part], element_size: float) -> Bodies:
    """Return the parts of the worlds for kernels, on elements of that size (m)."""
    kinds = Kinds.of(parts)
    bodies = [body_of(kind, element_size) for kind in kinds.every]
    names = ("area", "radius", "gyration", "friction", "static_friction", "convex", "turns", "coupling")
    entries = max(len(body.law) for body in bodies)
    return Bodies(
        kind=kinds.kind,
        outline=np.concatenate([body.outline for body in bodies]),
        first=np.cumsum([0, *(len(body.outline) for body in bodies)]),
        even=EVEN.copy(),
        laws=np.stack([body.law if len(body.law) == entries else np.ones(entries) for body in bodies]),
        **{name: np.array([getattr(body, name) for body in bodies]) for name in names},
    )
