"""What the tests of parts above the plane share."""

from __future__ import annotations

import math

import numpy as np

from vibgym import Part, Simulator, Surface
from vibgym.scene.outlines import rotation
from vibgym.scene.parts import shipped_part

LARGE = Surface(rows=40, columns=40)
STILL = Surface(rows=40, columns=40, horizontal_amplitude=0.0)
MIDDLE = 0.52
STEEL, ALUMINIUM = shipped_part("steel_block"), shipped_part("aluminium_block")
DISC = Part.disc(0.02, friction=0.6, height=0.012, name="squat disc")
KITE = Part.polygon([[0, 0], [0.05, 0], [0.06, 0.03], [0.02, 0.05]], friction=0.3, height=0.03, name="kite")
PARTS = [STEEL, ALUMINIUM, DISC, KITE]


def leans(angles: np.ndarray, seed: int = 0) -> np.ndarray:
    """(n, 1, 2) rad, tilts by these angles (n,) in any direction."""
    way = np.random.default_rng(seed).uniform(-math.pi, math.pi, len(angles))
    return (angles * np.stack([np.cos(way), np.sin(way)])).T[:, None, :]


def in_the_middle(simulator: Simulator, seed: int = 0) -> None:
    """Put parts down there, any heading, idling."""
    rng, parts = np.random.default_rng(seed), len(simulator.parts)
    pose = np.full((simulator.worlds, parts, 3), MIDDLE)
    pose[..., 0] += 0.08 * (np.arange(parts) - 0.5 * (parts - 1))
    pose[..., 2] = rng.uniform(-math.pi, math.pi, (simulator.worlds, parts))
    idle = [np.append(simulator.surface.idle_velocity(part.friction), 0.0) for part in simulator.parts]
    simulator.reset(pose, np.array(idle))


def kept_above_the_plane(simulator: Simulator) -> None:
    """Let no part count as flat in the next period, so that level ground, too, is the rigid body's."""
    state = simulator.get_state()
    state["calm"] = np.full_like(state["calm"], -(10**9))
    simulator.set_state(state)


def energy(simulator: Simulator) -> np.ndarray:
    """(worlds,) J/kg of the first part, from the state that anybody can read; nought for a flat part that moves."""
    state, part = simulator.get_state(), simulator.parts[0]
    xx, yy, xy = part.inertia
    own = np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, part.gyration]])
    found = []
    for pose, velocity, lean, height, climb, rocking, mode in zip(
        *(state[name][:, 0] for name in ("pose", "velocity", "lean", "height", "climb", "rocking", "mode")), strict=True
    ):
        frame = rotation(lean[0], lean[1], 0.0) @ rotation(0.0, 0.0, pose[2])
        spin, way = np.array([*rocking, velocity[2]]), np.array([*velocity[:2], climb])
        rise = height - part.centre_height if mode else 0.0
        found.append(0.5 * way @ way + 0.5 * spin @ frame @ own @ frame.T @ spin + simulator.surface.gravity * rise)
    return np.array(found)
