"""JSON messages to the page: the scene once, and a frame after every step."""

from __future__ import annotations

import base64
import math
from typing import Any

import numpy as np

from vibgym.envs.viewer import has_side, scenery_of, side_of
from vibgym.plugins.play.choices import HARDWARE, MAX_RATE, MAX_TILT, MODELS
from vibgym.plugins.play.world import World
from vibgym.rendering import colours

LENGTH, ANGLE = 1e5, 1e4
"""Resolution of frames: 10 um and 0.1 mrad."""


def scene_of(world: World) -> dict[str, Any]:
    """Return the static scene, lengths in m, and the available settings."""
    env, task = world.env, world.core.task
    scenery = scenery_of(env)
    return {
        "rows": scenery.rows,
        "columns": scenery.columns,
        "size": scenery.element_size,
        "walls": list(scenery.walls),
        "outlines": [np.round(outline, 6).tolist() for outline in scenery.outlines],
        "tints": [_tint(kind) for kind in scenery.kinds],
        "zones": [
            {"box": [*zone.low, *zone.high], "tint": _tint(zone.kind), "label": zone.label} for zone in scenery.zones
        ],
        "goalSize": scenery.goal_size,
        "tolerance": scenery.tolerance or 0.0,
        "scored": list(scenery.scored),
        "paths": [np.round(line, 5).tolist() for line in env.paths()],
        "id": world.settings.id,
        "policy": world.settings.policy,
        "policies": list(world.policies),
        "hardware": world.settings.hardware,
        "hardwares": list(HARDWARE),
        "model": world.core.simulator.model,
        "models": list(MODELS),
        "rate": world.settings.rate,
        "tilt": world.settings.tilt,
        "mostRate": MAX_RATE,
        "mostTilt": MAX_TILT,
        "stepTime": env.step_time,
        "seed": world.seed,
        "aims": bool(task.has_goal and not task.goal_moves),
        "turns": bool(task.has_heading),
        "side": has_side(env),
        "amplitude": world.core.surface.max_amplitude or 0.0,
    }


def frame_of(world: World) -> dict[str, Any]:
    """Return the present state of the world."""
    core, info = world.core, world.info
    episode, state = core.episode, core.simulator.state
    held = {str(part): world.room(part) for part in world.held}
    frame: dict[str, Any] = {
        "pose": _poses(state.pose[0]),
        "there": [bool(flag) for flag in episode.present[0]],
        "fallen": [bool(fallen) and part not in world.held for part, fallen in enumerate(state.fallen[0].tolist())],
        "done": [bool(flag) for flag in episode.done[0]],
        "field": base64.b64encode(np.rint(127.0 * world.wanted.clip(-1.0, 1.0)).astype(np.int8).tobytes()).decode(),
        "held": held,
        "painted": bool(np.isfinite(world.paint).any()),
        "error": [_number(info, "position_error", 1e3), _number(info, "heading_error", 180.0 / math.pi)],
        "success": bool(info.get("is_success", False)),
        "caption": world.env.caption(),
    }
    if core.task.has_goal:
        frame["goal"] = _poses(episode.goal[0])
    side = side_of(world.env, 0)
    if side is not None:
        frame["bottoms"] = [
            None if not np.isfinite(bottom).all() else np.round(bottom[:, ::2], 5).tolist() for bottom in side.bottoms
        ]
        frame["plates"] = np.round(side.plates, 5).tolist()
    return frame


def _tint(kind: int) -> list[str]:
    """Return the colour of a kind, and that of text on it."""
    colour = colours.PARTS[kind % len(colours.PARTS)]
    on_it = colours.INK if colours.is_light(colour) else colours.PAPER
    return ["#{:02x}{:02x}{:02x}".format(*rgb) for rgb in (colour, on_it)]


def _poses(pose: np.ndarray) -> list[list[int]]:
    """Return whole multiples of :data:`LENGTH` and :data:`ANGLE`."""
    return np.rint(pose * [LENGTH, LENGTH, ANGLE]).astype(int).tolist()


def _number(info: dict[str, Any], name: str, scale: float) -> float | None:
    """Return a value of ``info`` in display units; None where the task has none."""
    value = info.get(name)
    return None if value is None or not math.isfinite(value) else round(float(value) * scale, 4)
