"""Rigid parts against closed forms and the planar model's limit: Housner's block and uniform transport.

``python -m studies.tilting housner``: energy after an impact of a rocking block against its closed form. G. W. Housner: The
behavior of inverted pendulum structures during earthquakes. Bull. Seismol. Soc. Am. 53 (1963). A block that rocks on one edge
lands on the other without bouncing; angular momentum about the new edge is conserved, energy is not.

``python -m studies.tilting transport``: on plates with equal motion even pressure is exact, so the planar model with fine
steps is the reference.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.scene.outlines import rotation
from vibgym.scene.parts import shipped_part

# -- Housner -----------------------------------------------------------------------------------------------------------

STILL = Surface(rows=40, columns=40, horizontal_amplitude=0.0)
BLOCKS = (0.05, 0.15), (0.04, 0.10)
"""m, widths and heights."""

TILTS = 2.0, 5.0
"""deg, least and most at the release."""

STEPS = 100, 200, 400
"""Steps per period in both studies."""

PERIODS = 20
DROP = 0.1
"""Loss of energy in a period that indicates an impact."""


def block(width: float, height: float) -> Part:
    """Return a block that does not slip, long enough to rock about one axis only."""
    return Part.rectangle(width, 0.2, friction=3.0, height=height)


def kept(width: float, height: float) -> float:
    """Return the share of the energy after an impact, ``(1 - R^2 / I (1 - cos 2 alpha))^2``, I about the edge."""
    to_edge = 0.25 * (width**2 + height**2)
    alpha = math.atan2(width, height)
    return (1.0 - to_edge / (block(width, height).inertia[1] + to_edge) * (1.0 - math.cos(2.0 * alpha))) ** 2


def energy(simulator: Simulator) -> np.ndarray:
    """Return the energy (worlds,) J/kg of the first part, from the public state; a flat part has kinetic energy only."""
    state, part = simulator.get_state(), simulator.parts[0]
    xx, yy, xy = part.inertia
    own = np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, part.gyration]])
    names = ("pose", "velocity", "lean", "height", "climb", "rocking", "mode")
    energies = []
    for values in zip(*(state[name][:, 0] for name in names), strict=True):
        pose, velocity, lean, height, climb, rocking, mode = values
        frame = rotation(lean[0], lean[1], 0.0) @ rotation(0.0, 0.0, pose[2])
        spin, way = np.array([*rocking, velocity[2]]), np.array([*velocity[:2], climb])
        rise = height - part.centre_height if mode else 0.0
        energies.append(0.5 * way @ way + 0.5 * spin @ frame @ own @ frame.T @ spin + simulator.surface.gravity * rise)
    return np.array(energies)


def measured(width: float, height: float, tilts: np.ndarray, steps: int = 200) -> np.ndarray:
    """Return the share (n,) of the model, released from rest at ``tilts`` (n,) rad.

    Raises:
        RuntimeError: a block has had no impact within the time.
    """
    worlds = len(tilts)
    simulator = Simulator(STILL, block(width, height), worlds=worlds, model="tilting", restitution=0.0, steps=steps)
    simulator.reset([[[0.52, 0.52, 0.0]]])
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


def housner(worlds: int = 64) -> None:
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


# -- transport ---------------------------------------------------------------------------------------------------------

MOVING = Surface(rows=40, columns=40)
START = 0.52, 0.3, 0.3
"""m, m, rad."""


def transported(name: str, **settings: Any) -> np.ndarray:
    """Return the displacement (3,) m and rad of a part in a second at full amplitude; the rigid body never counts as flat."""
    part = shipped_part(name)
    simulator = Simulator(MOVING, part, **{"model": "tilting", **settings})
    simulator.reset([[START]], [[[*MOVING.idle_velocity(part.friction), 0.0]]])
    rigid = simulator.model == "tilting"
    if rigid:
        simulator.tip(0, 0.0)
    for _ in range(25):
        if rigid:
            state = simulator.get_state()
            state["calm"] = np.full_like(state["calm"], -(10**9))
            simulator.set_state(state)
        simulator.advance(MOVING.max_amplitude, math.pi)
    return simulator.pose[0, 0] - START


def errors(name: str = "steel_block") -> tuple[np.ndarray, float]:
    """Return the error (len(STEPS),) m of the displacement by steps a period, and the length of the displacement in m."""
    exact = transported(name, model="planar", steps=40, substeps=8)[:2]
    away = [float(np.hypot(*(transported(name, steps=steps)[:2] - exact))) for steps in STEPS]
    return np.array(away), float(np.hypot(*exact))


def transport() -> None:
    """Print the table."""
    for name in ("aluminium_block", "steel_block"):
        away, way = errors(name)
        orders = np.log2(away[:-1] / away[1:])
        print(f"{name}, way of {1e3 * way:.2f} mm:")
        for steps, error in zip(STEPS, away, strict=True):
            print(f"  {steps} steps: off by {1e6 * error:.3f} um, {100.0 * error / way:.4f} %")
        print(f"  order in the step: {', '.join(f'{order:.2f}' for order in orders)}", flush=True)
