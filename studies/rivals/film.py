"""``docs/squeeze-line.gif``: parts that follow a moving squeeze line, and a line that is too fast for them."""

from __future__ import annotations

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from vibgym import Simulator, Surface
from vibgym.fields import MovingSqueeze
from vibgym.files import output_directory, write_atomically
from vibgym.rendering import SurfacePainter, View, Zone
from vibgym.rendering.files import gif
from vibgym.scene.parts import Part, shipped_part

FILM = Path("docs/squeeze-line.gif")

STARTS = [
    ("aluminium_block", [0.20, 0.066, 0.3]),
    ("steel_block", [0.32, 0.120, 1.2]),
    ("aluminium_block", [0.44, 0.172, -0.6]),
]
"""Parts and their initial poses, m, m, rad."""

PIXELS = 20
"""Pixels per element."""

EVERY = 2
"""Periods between frames."""

THIN = 0.002
"""m, half the drawn width of the line."""


class Sweep(NamedTuple):
    """A motion of the line."""

    start: float  # m along the table
    speed: float  # m/s
    seconds: float
    text: str


SWEEPS = (
    Sweep(0.10, 0.10, 5.8, "squeeze line at 100 mm/s: parts on it go with it"),
    Sweep(0.68, -0.40, 1.4, "at 400 mm/s: faster than parts go, it leaves them behind"),
)


def played(sweeps: tuple[Sweep, ...] = SWEEPS) -> Iterator[tuple[np.ndarray, np.ndarray, float, str]]:
    """Yield poses (parts, 3), phasors (rows, columns, 2), position of the line (m) and caption after every period."""
    surface, parts = Surface(), _parts()
    simulator = Simulator(surface, parts)
    simulator.reset([[pose for _, pose in STARTS]])
    friction, centre = float(np.mean([part.friction for part in parts])), 0.5 * surface.depth
    for sweep in sweeps:
        line = MovingSqueeze(sweep.start, centre, 0.5 * math.pi, (sweep.speed, 0.0))
        for k in range(round(sweep.seconds / surface.period)):
            field = line.at((k + 0.5) * surface.period)
            simulator.advance(*field.drive(surface, friction=friction), periods=1)
            place = float(line.place((k + 1) * surface.period)[0])
            yield simulator.state.pose[0].copy(), field.phasors(surface, friction=friction), place, sweep.text


def _parts() -> tuple[Part, ...]:
    return tuple(shipped_part(name) for name, _ in STARTS)


def frames(sweeps: tuple[Sweep, ...] = SWEEPS) -> list[np.ndarray]:
    """Return frames (height, width, 3) uint8, every :data:`EVERY` periods."""
    surface = Surface()
    size = surface.element_size
    outlines = [part.outline for part in _parts()]
    painter = SurfacePainter(surface.rows, surface.columns, size, outlines, PIXELS / size)
    result = []
    for k, (pose, phasors, place, text) in enumerate(played(sweeps)):
        if k % EVERY == 0:
            line = Zone((place - THIN, 0.0), (place + THIN, surface.depth), kind=3)
            result.append(painter.paint(View(pose, phasors, zones=(line,), caption=text)))
    return result


def write(root: Path) -> Path:
    """Write the film; return its path."""
    output_directory((root / FILM).parent)
    write_atomically(root / FILM, gif(frames(), EVERY * Surface().period))
    return root / FILM
