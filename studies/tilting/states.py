"""What can be read from and done to a rigid part's public state; shared by studies and tests."""

from __future__ import annotations

import numpy as np

from vibgym import Simulator
from vibgym.scene.outlines import rotation


def kept_above_the_plane(simulator: Simulator) -> None:
    """Let no part count as flat in the next period, so that level ground, too, is the rigid body's."""
    state = simulator.get_state()
    state["calm"] = np.full_like(state["calm"], -(10**9))
    simulator.set_state(state)


def energy(simulator: Simulator) -> np.ndarray:
    """(worlds,) J/kg of the first part, from the state that anybody can read; a flat part has only that of its motion."""
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
