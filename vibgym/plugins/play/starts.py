"""Starts encoded for URLs: settings of the world, and poses of parts and goals."""

from __future__ import annotations

import base64
import binascii
import hashlib
import json
import zlib
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.plugins.play.choices import settings_of
from vibgym.plugins.play.world import World

MAX_BYTES = 200_000
"""Largest size of an unpacked start."""

SEAL = 6
"""Bytes of the checksum against mistyped codes."""


def code_of(world: World) -> str:
    """Return the present start of a world as text for a URL; of the episode, if parts arrive and leave or goals move."""
    task = world.core.task
    content: dict[str, Any] = {"settings": vars(world.settings), "seed": world.seed}
    if not (task.continuous_feed or task.goal_moves):
        present = np.flatnonzero(world.core.episode.present[0])
        down = [
            int(part) for part in present if part not in world.held and not world.core.simulator.state.fallen[0, part]
        ]
        content |= {"parts": down, "pose": np.round(world.core.simulator.state.pose[0], 6).tolist()}
        if task.has_goal:
            content["goal"] = np.round(world.core.episode.goal[0], 6).tolist()
    painted = np.argwhere(np.isfinite(world.paint).all(axis=-1))
    if len(painted):
        phasors = np.round(world.paint[painted[:, 0], painted[:, 1]].astype(float), 4)
        content["paint"] = [[*where, *phasor] for where, phasor in zip(painted.tolist(), phasors.tolist(), strict=True)]
    plain = zlib.compress(json.dumps(content, separators=(",", ":")).encode(), 9)
    return base64.urlsafe_b64encode(hashlib.sha256(plain).digest()[:SEAL] + plain).decode().rstrip("=")


def world_from(code: str) -> World:
    """Return the world that a code describes.

    Raises:
        ValueError: a code that was altered or truncated, or that of an unknown environment.
    """
    content = _content(code)
    try:
        settings = settings_of(**content["settings"])
        world = World(settings, checks.count("seed", content["seed"], least=0))
        options = {name: content[name] for name in ("pose", "goal", "parts") if name in content}
        if options:
            options["pose"] = _off_the_table_allowed(world, options)
            world.begin(world.seed, options)
        paint = np.array(content.get("paint", []), dtype=float).reshape(-1, 4)
        rows, columns = world.paint.shape[:2]
        where = paint[:, :2].astype(int)
        if not (np.isfinite(paint).all() and (where >= 0).all() and (where < [rows, columns]).all()):
            raise checks.refuse("paint", "others", f"elements of the table, {rows} x {columns}")
        for place, phasor in zip(where, checks.array("paint", paint[:, 2:], paint[:, 2:].shape), strict=True):
            world.draw(place[None], np.clip(phasor, -1.0, 1.0))
    except (KeyError, TypeError, OverflowError) as error:
        raise checks.refuse("start", code[:24], f"the code of a start ({type(error).__name__}: {error})") from None
    return world


def _off_the_table_allowed(world: World, options: dict[str, Any]) -> np.ndarray:
    """Return poses with absent parts, which may be anywhere, moved onto the table, as a reset requires."""
    pose = checks.array("pose", options["pose"], (len(world.env.parts), 3)).copy()
    absent = np.setdiff1d(np.arange(len(pose)), options["parts"])
    pose[absent, :2] = 0.5 * world.env.surface.width, 0.5 * world.env.surface.depth
    return pose


def _content(code: str) -> dict[str, Any]:
    """Return the content of a code with a valid checksum."""
    allowed = "the complete, unaltered code of a start"
    try:
        packed = base64.urlsafe_b64decode(code.encode("ascii") + b"=" * (-len(code) % 4))
        seal, plain = packed[:SEAL], packed[SEAL:]
        if hashlib.sha256(plain).digest()[:SEAL] != seal:
            raise ValueError
        opened = zlib.decompressobj()
        text = opened.decompress(plain, MAX_BYTES)
        content = json.loads(text) if opened.eof else None
        if not isinstance(content, dict):
            raise ValueError
    except (ValueError, binascii.Error, zlib.error, RecursionError):
        raise checks.refuse("start", f"{code[:24]}...", allowed) from None
    return content
