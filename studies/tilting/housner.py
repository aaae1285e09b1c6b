"""Housner's rocking block, energy after an impact against its closed form: ``python -m studies.tilting housner``.

G. W. Housner: The behavior of inverted pendulum structures during earthquakes. Bull. Seismol. Soc. Am. 53 (1963). A block that
rocks on one edge comes down on the other without bouncing; angular momentum about the new edge is kept, energy is not.
"""

from __future__ import annotations

import math

import numpy as np

from studies.tilting.states import energy
from vibgym import Part, Simulator, Surface

STILL = Surface(rows=40, columns=40, horizontal_amplitude=0.0)
MIDDLE = 0.52
BLOCKS = (0.05, 0.15), (0.04, 0.10)
"""m, widths and heights."""

STEPS = 100, 200, 400
TILTS = 2.0, 5.0
"""deg, least and most from which blocks are let go."""

PERIODS = 20
DROP = 0.1
"""Share of the energy that only an impact takes in a period."""


def block(width: float, height: float) -> Part:
    """One so rough that it does not slip, long enough to rock about one axis alone."""
    return Part.rectangle(width, 0.2, friction=3.0, height=height)


def kept(width: float, height: float) -> float:
    """Share of the energy after an impact, ``(1 - R^2 / I (1 - cos 2 alpha))^2``, I about the edge."""
    to_edge = 0.25 * (width**2 + height**2)
    alpha = math.atan2(width, height)
    return (1.0 - to_edge / (block(width, height).inertia[1] + to_edge) * (1.0 - math.cos(2.0 * alpha))) ** 2


def measured(width: float, height: float, tilts: np.ndarray, steps: int = 200) -> np.ndarray:
    """(n,) the same share of the model, let go from rest at ``tilts`` (n,) rad, at so many steps a period.

    Raises:
        RuntimeError: a block has had no impact within the time.
    """
    worlds = len(tilts)
    simulator = Simulator(STILL, block(width, height), worlds=worlds, model="tilting", restitution=0.0, steps=steps)
    simulator.reset([[[MIDDLE, MIDDLE, 0.0]]])
    simulator.tip(slice(None), np.stack([np.zeros(worlds), tilts], axis=1)[:, None, :])
    levels = []
    for _ in range(PERIODS):
        simulator.advance(0.0, 0.0)
        levels.append(energy(simulator))
    track = np.array(levels)
    fell = track < (1.0 - DROP) * track[0]
    if not fell.any(axis=0).all():
        raise RuntimeError(f"{int((~fell.any(axis=0)).sum())} of {worlds} blocks had no impact in {PERIODS} periods")
    return track[fell.argmax(axis=0), np.arange(worlds)] / track[0]


def main(worlds: int = 64) -> None:
    """Print the table."""
    tilts = np.radians(np.linspace(*TILTS, worlds))
    print(f"energy after an impact against Housner's, {worlds} tilts of {TILTS[0]:g} to {TILTS[1]:g} deg:")
    for width, height in BLOCKS:
        wanted = kept(width, height)
        for steps in STEPS:
            off = 100.0 * (measured(width, height, tilts, steps) / wanted - 1.0)
            print(
                f"{1e3 * width:.0f} x {1e3 * height:.0f} mm, {wanted:.4f} kept, {steps} steps: mean {off.mean():+.2f} %, "
                f"sd {off.std():.2f}, largest {np.abs(off).max():.2f}",
                flush=True,
            )
