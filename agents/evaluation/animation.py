"""Films of single episodes: animated WebP for the report, GIF for the README."""

from __future__ import annotations

import io
import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from PIL import Image

from agents.evaluation.log import Film
from agents.evaluation.results import Results
from vibgym.files import write_atomically
from vibgym.rendering import SurfacePainter, View

MOST_FRAMES = 120
WIDTH = 520  # pixels of a film in the report
BORDER = 40  # pixels of a picture that are not table
REST = 1500  # ms that the last frame stays
QUALITIES = (72, 60, 45, 30, 15)
"""Of WebP, best first: a film takes the first that fits into its share of the page."""


TRAIL_STEPS = 250
"""Of several parts: older places are left out of their trails."""


def painter_for(results: Results, task: str, width: int) -> SurfacePainter:
    """A painter of a task's parts whose pictures are about ``width`` pixels wide."""
    surface, scene = results.surface, results.scenes[task]
    pixels = max(4, (width - BORDER) // surface.columns)
    return SurfacePainter(
        surface.rows,
        surface.columns,
        surface.element_size,
        [np.array(part.outline) for part in scene.parts],
        pixels / surface.element_size,
        kinds=scene.kinds,
        walls=scene.walls,
    )


def caption(results: Results, task: str, film: Film, frame: int, step_time: float) -> str:
    """Time, and what is left to do."""
    facts, scene = results.tasks[task], results.scenes[task]
    if scene.crowd:
        parts = int(np.isfinite(film.poses[0, :, 0]).sum())
        return f"{frame * step_time:.2f} s   done: {film.done[frame]:.0f} of {parts}"
    left = film.goal - film.poses[frame, 0]
    text = f"{frame * step_time:.2f} s   to go: {1e3 * math.hypot(left[0], left[1]):.1f} mm"
    if facts.heading_tolerance is None:
        return text
    turn = math.degrees(left[2])
    if task == "Align" and scene.parts[0].symmetry:  # headings that look the same are the same
        period = 360.0 / scene.parts[0].symmetry
        turn -= period * math.floor(turn / period + 0.5)
    return f"{text}, {round(turn)} deg"


def picture(results: Results, task: str, policy: str, frame: int, painter: SurfacePainter) -> np.ndarray:
    """Frame of a film, (height, width, 3) uint8."""
    rollout, facts = results.rollouts[task, policy], results.tasks[task]
    film, scene = rollout.film, results.scenes[task]
    said = caption(results, task, film, frame, rollout.step_time)
    if scene.crowd:
        trails = film.poses[max(0, frame - TRAIL_STEPS) : frame + 1, :, :2]
        view = View(
            pose=film.poses[frame],
            phasors=film.phasors[frame],
            goal_pose=None,
            goal_tolerance=None,
            caption=said,
            zones=scene.zones,
            trails=list(np.moveaxis(trails, 1, 0)),
        )
    else:
        view = View(
            pose=film.poses[frame],
            phasors=film.phasors[frame],
            goal_pose=film.goal if facts.heading_tolerance is not None else film.goal[:2],
            goal_tolerance=facts.position_tolerance,
            trail=film.poses[: frame + 1, 0, :2],
            caption=said,
        )
    return painter.paint(view)


def frames_of(results: Results, task: str, policy: str, width: int = WIDTH) -> tuple[list[np.ndarray], float]:
    """Frames of a film and the time between them in s: every step of a short one, fewer of a long one, true to time."""
    rollout = results.rollouts[task, policy]
    last = len(rollout.film.poses) - 1
    stride = max(1, math.ceil(last / (MOST_FRAMES - 1)))
    shown = [*range(0, last, stride), last]
    painter = painter_for(results, task, width)
    return [picture(results, task, policy, k, painter) for k in shown], stride * rollout.step_time


def _durations(frames: Sequence[np.ndarray], interval: float) -> list[int]:
    return [max(20, round(1e3 * interval))] * (len(frames) - 1) + [REST]


def webp(frames: Sequence[np.ndarray], interval: float, most: int) -> bytes:
    """A looping WebP animation of at most ``most`` bytes, or of the lowest quality if none is that small."""
    images = [Image.fromarray(frame) for frame in frames]
    data = b""
    for quality in QUALITIES:
        file = io.BytesIO()
        images[0].save(
            file,
            format="WEBP",
            save_all=True,
            append_images=images[1:],
            duration=_durations(frames, interval),
            loop=0,
            quality=quality,
            method=3,
        )
        data = file.getvalue()
        if len(data) <= most:
            break
    return data


def png(frame: np.ndarray) -> bytes:
    """A single picture, in 256 colours to keep the page small."""
    file = io.BytesIO()
    Image.fromarray(frame).quantize(256, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    return file.getvalue()


def write_gif(path: Path, frames: Sequence[np.ndarray], fps: float) -> None:
    """Write a looping GIF in one step.

    Args:
        path: of the file.
        frames: pictures (height, width, 3) uint8 of one size, at least one; the last one stays for a while.
        fps: frames per second; browsers show at most 50.
    """
    # One palette for all frames, from pictures spread over the film: colours do not flicker, and the file is smaller.
    chosen = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))]
    palette = Image.fromarray(np.concatenate(chosen)).quantize(255, method=Image.Quantize.MEDIANCUT)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    file = io.BytesIO()
    images[0].save(
        file,
        format="GIF",
        save_all=True,
        append_images=images[1:],
        duration=_durations(frames, 1.0 / fps),
        loop=0,
        optimize=True,
    )
    write_atomically(path, file.getvalue())


def write_film_gif(path: Path, results: Results, task: str, policy: str, width: int = 840) -> None:
    """Write the film of one policy on one task as a GIF, for the README."""
    frames, interval = frames_of(results, task, policy, width)
    write_gif(path, frames, 1.0 / interval)
