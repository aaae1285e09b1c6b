"""Recorded episodes of one policy, and films of them: for pages (``film.js`` draws them) and as GIF files.

A film in a page is a JSON mapping, compressed by gzip and encoded in base64. Positions are in tenths of a millimetre and
headings in tenths of a degree, each as the difference from the frame before; an element's phase (of 32) and amplitude (of 7) is
one character. Browsers interpolate between two frames.
"""

from __future__ import annotations

import base64
import gzip
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

from vibgym.envs import VibgymVectorEnv
from vibgym.envs.shared import SharedInterface
from vibgym.envs.viewer import side_of
from vibgym.plugins.play.drawing import drawn_scene, scripts
from vibgym.policies.measures import Measured, Measures
from vibgym.policies.rollout import Step, Timing
from vibgym.rendering import Scenery, Side, SurfacePainter

WATCHED_AMONG = 30
"""The filmed world is one of the first so many, which are also those of the trajectory plot."""

LEAST_WAY = 0.010
"""m: shortest displacement for which a path efficiency is computed."""

TURN_WEIGHT = 0.1
"""m/rad: weight of a turn where the farthest goal is chosen."""

SERIES = ("position_error", "heading_error", "clearance", "parts_done")
"""Fields of ``info`` that are recorded after every step, where a task has them."""


@dataclass(frozen=True)
class Film:
    """One world of a rollout, frame by frame; frame 0 is the start, with all elements at rest."""

    seed: int
    poses: np.ndarray  # (frames, parts, 3) m, m, rad
    present: np.ndarray  # (frames, parts) bool
    phasors: np.ndarray  # (frames, rows, columns, 2) float32, fractions of full scale, of the step that led to the pose
    goals: np.ndarray  # (frames, parts, 3); zeros for tasks without goal poses
    paths: tuple[np.ndarray, ...]  # (n, 2) m, along which the goals of the parts move; empty where they stay
    captions: tuple[str, ...]  # of the frames
    done: float  # parts done at the end; nan where they are not counted
    success: bool
    sides: tuple[Side | None, ...]  # views from the side, of frames whose parts may tilt


@dataclass(frozen=True)
class Rollout(Measured):
    """Records of one policy on one task. Arrays are (episodes,) unless noted otherwise, in the order of the seeds."""

    path_lengths: np.ndarray  # (episodes, parts) m, of the centres, sampled once a step; 0 of absent parts
    straight: np.ndarray  # m, shortest way of all parts together, see path_efficiency
    poses: np.ndarray  # (episodes, most steps + 1, parts, 3) float32; nan after the end, and of absent parts
    goals: np.ndarray  # (episodes, parts, 3); zeros for tasks without goal poses
    series: (
        np.ndarray
    )  # (SERIES, episodes, most steps + 1) float32; nan after the end, and where a task lacks the field
    timing: Timing
    film: Film

    @property
    def path_length(self) -> np.ndarray:
        """Path travelled, of all parts together, m."""
        return self.path_lengths.sum(axis=1)

    @property
    def path_efficiency(self) -> np.ndarray:
        """Shortest way over path travelled, of successes; nan where the shortest way is below :data:`LEAST_WAY`.

        The shortest way is the straight line from the start to the goal, in Sort to the nearest point of the part's zone. In
        Singulate, where parts have no goals of their own, it is the one from the start to where the part ended.
        """
        path = self.path_length
        sensible = self.success & (self.straight > LEAST_WAY) & (path > 0.0)
        return np.where(sensible, self.straight / np.maximum(path, 1e-12), np.nan)

    def over_time(self, name: str) -> np.ndarray | None:
        """Return one of :data:`SERIES`, (episodes, most steps + 1); None where the task lacks it."""
        values = self.series[SERIES.index(name)]
        return values if np.isfinite(values).any() else None

    @property
    def parts_done(self) -> np.ndarray:
        """Parts done at the end; nan where they are not counted."""
        done = self.series[SERIES.index("parts_done")]
        return done[np.arange(len(self.steps)), self.steps].astype(np.float64)

    @property
    def throughput(self) -> np.ndarray:
        """Parts done at the end over the episode's simulated time, 1/s; nan where they are not counted."""
        return self.parts_done / (self.steps * self.step_time)

    @property
    def clearance(self) -> np.ndarray:
        """Smallest distance between parts during the episode, start included, m; nan without a second part."""
        clearances = self.series[SERIES.index("clearance")]
        least = np.where(np.isnan(clearances), np.inf, clearances).min(axis=1)
        return np.where(np.isfinite(least), least, np.nan).astype(np.float64)


def farthest_goal(env: SharedInterface, touching: np.ndarray) -> int:
    """Return the world, among the first ones, with the farthest goals; without goals and zones, with most pairs in touch.

    It is the same for every policy.

    Args:
        env: whose episodes have just begun.
        touching: (worlds,) pairs in touch.
    """
    error = env.truth.error
    far = (np.hypot(error[..., 0], error[..., 1]) + TURN_WEIGHT * np.abs(error[..., 2])).sum(axis=1)
    return int((far if _has_ends(env) else touching)[:WATCHED_AMONG].argmax())


def _has_ends(env: SharedInterface) -> bool:
    """Return whether the task defines where parts shall end."""
    return env.task.has_goal or env.task.zones is not None


class Log(Measures):
    """Recorder of :class:`Rollout`; each episode has its own world.

    Args:
        env, info, seeds: see :class:`vibgym.policies.rollout.Ends`.

    Attributes:
        fields: arrays (episodes, ...), named as in :class:`Rollout`.
        watched: the world that is filmed.
    """

    def __init__(self, env: VibgymVectorEnv, info: dict[str, Any], seeds: Sequence[int]) -> None:
        super().__init__(env, info, seeds)
        self.start = truth = env.truth
        worlds, parts = truth.present.shape
        limit = env.max_episode_steps
        assert limit is not None  # rollouts need episodes of finite length
        self.several = (truth.present.sum(axis=1) > 1) | (env.task.flows and parts > 1)
        way = np.where(truth.present[..., None], truth.error, 0.0)
        self.fields |= {
            "path_lengths": np.zeros((worlds, parts)),
            "straight": np.hypot(way[..., 0], way[..., 1]).sum(axis=1),
            "poses": np.full((worlds, limit + 1, parts, 3), np.nan, dtype=np.float32),
            "goals": truth.goal,
            "series": np.full((len(SERIES), worlds, limit + 1), np.nan, dtype=np.float32),
        }
        self.last = np.full((worlds, parts, 2), np.nan)
        self.watched = farthest_goal(env, info.get("touching", np.zeros(worlds)))
        self.paths = tuple(env.paths(self.watched))
        self.frames: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str, Side | None]] = []
        self._keep(0, np.ones(worlds, dtype=bool), info)

    def add(self, step: Step) -> None:
        """Record a step."""
        super().add(step)
        now = int(step.age[step.playing][0])  # all episodes have begun together
        self._keep(now, step.playing, step.info)
        if step.ended.any() and not _has_ends(self.env):
            poses, present = self.fields["poses"][step.ended], self.start.present[step.ended]
            way = np.where(present[..., None], poses[:, now] - poses[:, 0], 0.0)
            self.fields["straight"][step.ended] = np.hypot(way[..., 0], way[..., 1]).sum(axis=1)

    def _keep(self, step: int, playing: np.ndarray, info: dict[str, Any]) -> None:
        fields, truth = self.fields, self.env.truth
        there = truth.present & playing[:, None]
        fields["poses"][:, step][there] = truth.pose[there]
        place = np.where(there[..., None], truth.pose[..., :2], np.nan)
        moved = np.hypot(*np.moveaxis(place - self.last, -1, 0))
        fields["path_lengths"] += np.where(np.isfinite(moved), moved, 0.0)  # an arriving part begins a new path
        self.last = place
        for name, values in zip(SERIES, fields["series"], strict=True):
            if name in info:
                which = playing & self.several if name == "clearance" else playing
                values[which, step] = info[name][which]
        if playing[self.watched]:
            world = self.watched
            caption = self.env.caption(world).removeprefix(self.env.task.name).strip()
            self.frames.append(
                (
                    truth.pose[world],
                    truth.present[world],
                    self.env.phasors(world).astype(np.float32),
                    truth.goal[world],
                    f"{step * self.env.step_time:.2f} s   {caption}",
                    side_of(self.env, world),
                )
            )

    def result(self, task: str, timing: Timing) -> Rollout:
        """Return the records of all episodes."""
        world, fields = self.watched, self.fields
        *arrays, captions, sides = zip(*self.frames, strict=True)
        poses, present, phasors, goals = (np.array(each) for each in arrays)
        done = float(fields["series"][SERIES.index("parts_done"), world, len(poses) - 1])
        success = bool(fields["success"][world])
        film = Film(self.seeds[world], poses, present, phasors, goals, self.paths, captions, done, success, sides)
        return Rollout(task, self.seeds, self.env.step_time, timing=timing, film=film, **fields)


MOST_PAGE_FRAMES = 250
"""Most frames of a film in a page; of longer films every second step is kept, or fewer."""

PER_METRE, PER_RADIAN, PER_HEIGHT = 1e4, 1800.0 / math.pi, 1e5
"""Integer steps per metre, per radian, and per metre of height."""

PHASES, AMPLITUDES = 32, 7
"""Levels of the phase, and of the amplitude above rest."""

REST_CODE = 48
"""Character of an element at rest; those after it are phases at the least amplitude, then at the next one."""

FAINTEST = 0.03
"""Fraction of full scale from which an element is shown as moving."""


def strided(film: Film, most: int) -> list[int]:
    """Return the numbers of at most ``most`` frames at equal distances, and of the last one."""
    last = len(film.poses) - 1
    return [*range(0, last, max(1, math.ceil(last / (most - 1)))), last]


def frames_shown(film: Film) -> np.ndarray:
    """Return the numbers of the frames in a page."""
    return np.array(strided(film, MOST_PAGE_FRAMES))


def packed(film: Film, scenery: Scenery, step_time: float) -> str:
    """Return a film as ``film.js`` reads it; ``step_time`` is that between two frames, s."""
    shown = frames_shown(film)
    there = _there(film, scenery)[shown]
    stride = int(shown[1] - shown[0]) if len(shown) > 1 else 1
    content: dict[str, Any] = {
        "scene": {**drawn_scene(scenery), "paths": [_finite(path) for path in film.paths]},
        "interval": round(1e3 * stride * step_time, 3),
        "frames": len(shown),
        "trail": scenery.trail // stride,
        "captions": [film.captions[frame] for frame in shown],
        "there": ["" if each.all() else "".join("1" if one else "0" for one in each) for each in there.T],
        "poses": _changes(film.poses[shown], there),
        "field": _field(film.phasors[shown]),
    }
    if scenery.goal_size:
        content["goals"] = _changes(film.goals[shown], there)
    if any(film.sides[frame] is not None for frame in shown):
        content["sides"] = [_side(film.sides[frame]) for frame in shown]
    data = json.dumps(content, separators=(",", ":"), ensure_ascii=False, allow_nan=False).encode()
    # Without the time, so that the same film gives the same page.
    return base64.b64encode(gzip.compress(data, 9, mtime=0)).decode("ascii")


def _finite(path: np.ndarray) -> list[list[float]]:
    """Return the finite points of a path, m."""
    return path[np.isfinite(path).all(axis=1)].round(5).tolist()


def script() -> str:
    """Return the script that draws and plays the films of a page."""
    own = Path(__file__).with_name("film.js").read_text(encoding="utf-8")
    return f'(() => {{\n"use strict";\n{scripts()}\n{own}}})();'


def _there(film: Film, scenery: Scenery) -> np.ndarray:
    """Return (frames, parts) whether a part is on the table or near it; waiting parts are far from it."""
    middle = 0.5 * scenery.element_size * np.array([scenery.columns, scenery.rows])
    place = film.poses[..., :2]
    with np.errstate(invalid="ignore"):
        near = (np.abs(place - middle) <= 2.0 * middle).all(axis=-1)
    return film.present & np.isfinite(film.poses).all(axis=-1) & near


def _changes(poses: np.ndarray, there: np.ndarray) -> list[list[int]]:
    """Return poses (frames, parts, 3) as lists of differences, three per part, the first entry of a list absolute.

    Absent parts keep their last pose. A list with one entry means no change.
    """
    found = []
    for part in range(poses.shape[1]):
        own, kept = poses[:, part], there[:, part]
        for axis, factor in enumerate((PER_METRE, PER_METRE, PER_RADIAN)):
            values = np.where(kept, own[:, axis], 0.0)
            if kept.any():
                last = np.maximum.accumulate(np.where(kept, np.arange(len(kept)), int(kept.argmax())))
                values = values[last]
            whole = np.rint(factor * (np.unwrap(values) if axis == 2 else values)).astype(int)
            steps = np.diff(whole, prepend=0).tolist()
            found.append(steps if any(steps[1:]) else steps[:1])
    return found


def _field(phasors: np.ndarray) -> list[str]:
    """Return phasors (frames, rows, columns, 2) as a text per element with a character per frame, or one if all are equal."""
    strength = np.nan_to_num(np.hypot(phasors[..., 0], phasors[..., 1])).clip(0.0, 1.0)
    phase = np.nan_to_num(np.arctan2(phasors[..., 1], phasors[..., 0]))
    step = np.rint(phase * (PHASES / (2.0 * np.pi))).astype(int) % PHASES
    level = np.rint(strength * AMPLITUDES).astype(int).clip(1, AMPLITUDES)
    codes = np.where(strength >= FAINTEST, 1 + (level - 1) * PHASES + step, 0) + REST_CODE
    series = codes.reshape(len(codes), -1).T
    return ["".join(map(chr, (each[:1] if (each == each[0]).all() else each).tolist())) for each in series]


def _side(side: Any) -> list[Any]:
    """Return plates as (from, to, height), and the bottom of every part as corners (along, height), empty if it is hidden."""
    if side is None:
        return [[], []]
    scale = np.array([PER_METRE, PER_METRE, PER_HEIGHT])
    bottoms = [
        np.rint(scale[[0, 2]] * bottom[:, [0, 2]]).astype(int).ravel().tolist() if np.isfinite(bottom).all() else []
        for bottom in side.bottoms
    ]
    return [np.rint(scale * side.plates).astype(int).ravel().tolist(), bottoms]


MOST_FRAMES = 120
"""Most frames of a GIF file."""

WIDTH, BORDER = 520, 40
"""Width of a picture in the report, and of the part of it that is not table, pixels."""

REST = 1500
"""Duration of the last frame, ms."""

CUT, SIDE = 4, 110
"""Pixels under the table that are left out of a still picture, and those of a view from the side."""

STILL_COLOURS = 64


def painter_for(scenery: Scenery, width: int) -> SurfacePainter:
    """Return a painter whose pictures are about ``width`` pixels wide."""
    return scenery.painter(max(4, (width - BORDER) // scenery.columns) / scenery.element_size)


def picture(film: Film, scenery: Scenery, frame: int, painter: SurfacePainter) -> np.ndarray:
    """Return a frame of a film, (height, width, 3) uint8."""
    pose, present, goal, phasors = (each[frame] for each in (film.poses, film.present, film.goals, film.phasors))
    trail = film.poses[: frame + 1, :, :2]
    view = scenery.view(pose, present, goal, phasors, trail, film.captions[frame], film.paths, film.sides[frame])
    return painter.paint(view)


def frames_of(film: Film, scenery: Scenery, step_time: float, width: int = WIDTH) -> tuple[list[np.ndarray], float]:
    """Return at most :data:`MOST_FRAMES` frames of a film and the time between them, s."""
    shown = strided(film, MOST_FRAMES)
    painter = painter_for(replace(scenery, side=film.sides[0] is not None), width)
    stride = shown[1] - shown[0] if len(shown) > 2 else 1
    return [picture(film, scenery, k, painter) for k in shown], stride * step_time


def still(film: Film, scenery: Scenery) -> tuple[bytes, tuple[int, int]]:
    """Return the last picture of a film as a PNG file, as the canvas of a page draws it, with its width and height.

    The text under the table is left out; a view from the side is kept.
    """
    tilting = film.sides[0] is not None
    pixels, last = max(4, (WIDTH - BORDER) // scenery.columns), len(film.poses) - 1
    painter = painter_for(replace(scenery, side=tilting), WIDTH)
    whole = picture(film, scenery, last, painter)[:, : scenery.columns * pixels + BORDER]
    top = whole[: scenery.rows * pixels + BORDER - CUT]
    shown = np.concatenate([top, whole[len(whole) - SIDE :]]) if tilting else top
    return png(shown, STILL_COLOURS), (shown.shape[1], shown.shape[0])


def png(frame: np.ndarray, colours: int = 256) -> bytes:
    """Return a picture as a PNG file, with few colours to keep the page small."""
    file = io.BytesIO()
    Image.fromarray(frame).quantize(colours, dither=Image.Dither.NONE).save(file, format="PNG", optimize=True)
    return file.getvalue()


def gif(frames: Sequence[np.ndarray], fps: float) -> bytes:
    """Return a looping GIF file.

    Args:
        frames: pictures (height, width, 3) uint8 of one size, at least one; the last one has a longer duration.
        fps: frames per second; browsers show at most 50.
    """
    # One palette for all frames, from pictures spread over the film: colours do not flicker, and the file is smaller.
    chosen = [frames[k] for k in np.unique(np.linspace(0, len(frames) - 1, 8).astype(int))]
    palette = Image.fromarray(np.concatenate(chosen)).quantize(255, method=Image.Quantize.MEDIANCUT)
    images = [Image.fromarray(frame).quantize(palette=palette, dither=Image.Dither.NONE) for frame in frames]
    durations = [max(20, round(1e3 * (1.0 / fps)))] * (len(frames) - 1) + [REST]
    file = io.BytesIO()
    images[0].save(
        file, format="GIF", save_all=True, append_images=images[1:], duration=durations, loop=0, optimize=True
    )
    return file.getvalue()


def film_gif(film: Film, scenery: Scenery, step_time: float, width: int = 840) -> bytes:
    """Return a film as a GIF file."""
    frames, interval = frames_of(film, scenery, step_time, width)
    return gif(frames, 1.0 / interval)
