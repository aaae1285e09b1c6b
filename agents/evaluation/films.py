"""Recorded episodes of one policy, and films of them as GIF files, of which pages embed small ones."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import numpy as np

from vibgym.envs import VibgymVectorEnv
from vibgym.envs.shared import SharedInterface
from vibgym.envs.viewer import side_of
from vibgym.policies.measures import MeasuredOutcomes, Measures
from vibgym.policies.rollout import RolloutStep, Timing
from vibgym.rendering import Scenery, Side, SurfacePainter
from vibgym.rendering.files import gif

WATCHED_AMONG = 30
"""The filmed world is one of the first so many, which are also those of the trajectory plot."""

MIN_WAY = 0.010
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
    sides: tuple[Side | None, ...]  # views from the side, of frames whose parts may tilt


@dataclass(frozen=True)
class Rollout(MeasuredOutcomes):
    """Records of one policy on one task. Arrays are (episodes,) unless noted otherwise, in the order of the seeds."""

    path_lengths: np.ndarray  # (episodes, parts) m, of the centres, sampled once a step; 0 of absent parts
    straight: np.ndarray  # m, shortest way of all parts together, see path_efficiency
    poses: np.ndarray  # (episodes, most steps + 1, parts, 3) float32; nan after the end, and of absent parts
    goals: np.ndarray  # (episodes, parts, 3); zeros for tasks without goal poses
    series: np.ndarray  # (SERIES, episodes, most steps + 1) float32; nan after the end, and of fields the task lacks
    film: Film

    @property
    def filmed(self) -> np.ndarray:
        """Whether it is the episode of the film."""
        return np.array(self.seeds) == self.film.seed

    @property
    def path_length(self) -> np.ndarray:
        """Path travelled, of all parts together, m."""
        return self.path_lengths.sum(axis=1)

    @property
    def path_efficiency(self) -> np.ndarray:
        """Shortest way over path travelled, of successes; nan where the shortest way is below :data:`MIN_WAY`.

        The shortest way is the straight line from the start to the goal, in Sort to the nearest point of the part's zone. In
        Singulate, where parts have no goals of their own, it is the one from the start to where the part ended.
        """
        path = self.path_length
        sensible = self.success & (self.straight > MIN_WAY) & (path > 0.0)
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
        self.several = (truth.present.sum(axis=1) > 1) | (env.task.continuous_feed and parts > 1)
        displacement = np.where(truth.present[..., None], truth.error, 0.0)
        self.fields |= {
            "path_lengths": np.zeros((worlds, parts)),
            "straight": np.hypot(displacement[..., 0], displacement[..., 1]).sum(axis=1),
            "poses": np.full((worlds, limit + 1, parts, 3), np.nan, dtype=np.float32),
            "goals": truth.goal,
            "series": np.full((len(SERIES), worlds, limit + 1), np.nan, dtype=np.float32),
        }
        self.last = np.full((worlds, parts, 2), np.nan)
        self.watched = farthest_goal(env, info.get("touching", np.zeros(worlds)))
        self.paths = tuple(env.paths(self.watched))
        self.frames: list[tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, str, Side | None]] = []
        self._keep(0, np.ones(worlds, dtype=bool), info)

    def add(self, step: RolloutStep) -> None:
        """Record a step."""
        super().add(step)
        now = int(step.age[step.playing][0])  # all episodes have begun together
        self._keep(now, step.playing, step.info)
        if step.ended.any() and not _has_ends(self.env):
            poses, present = self.fields["poses"][step.ended], self.start.present[step.ended]
            displacement = np.where(present[..., None], poses[:, now] - poses[:, 0], 0.0)
            self.fields["straight"][step.ended] = np.hypot(displacement[..., 0], displacement[..., 1]).sum(axis=1)

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
            text = f"{step * self.env.step_time:.2f} s   {caption}"
            phasors = self.env.phasors(world).astype(np.float32)
            arrays = truth.pose[world], truth.present[world], phasors, truth.goal[world]
            self.frames.append((*arrays, text, side_of(self.env, world)))

    def result(self, task: str, timing: Timing) -> Rollout:
        """Return the records of all episodes."""
        world, fields = self.watched, self.fields
        *arrays, captions, sides = zip(*self.frames, strict=True)
        poses, present, phasors, goals = (np.array(array) for array in arrays)
        film = Film(self.seeds[world], poses, present, phasors, goals, self.paths, captions, sides)
        return Rollout(task, self.seeds, self.env.step_time, timing, film=film, **fields)


class Format(NamedTuple):
    """Size of a film."""

    width: int  # pixels, at most
    frames: int  # at most
    colours: int


FILE, PAGE = Format(840, 120, 255), Format(440, 24, 64)
"""Of a GIF file, and of a film in a page: 50 to 160 kB, or 320 kB where all elements change in every frame."""

BORDER = 40
"""Width of the part of a picture that is not table, pixels."""


def painter_for(scenery: Scenery, width: int) -> SurfacePainter:
    """Return a painter whose pictures are about ``width`` pixels wide."""
    return scenery.painter(max(4, (width - BORDER) // scenery.columns) / scenery.element_size)


def picture(film: Film, scenery: Scenery, frame: int, painter: SurfacePainter) -> np.ndarray:
    """Return a frame of a film, (height, width, 3) uint8."""
    pose, present, goal, phasors = (series[frame] for series in (film.poses, film.present, film.goals, film.phasors))
    trail = film.poses[: frame + 1, :, :2]
    view = scenery.view(pose, present, goal, phasors, trail, film.captions[frame], film.paths, film.sides[frame])
    return painter.paint(view)


def film_gif(film: Film, scenery: Scenery, step_time: float, form: Format = FILE) -> bytes:
    """Return a film as a GIF file, of frames at equal distances and the last one; ``step_time`` is that of a step, s."""
    painter = painter_for(replace(scenery, side=film.sides[0] is not None), form.width)
    last = len(film.poses) - 1
    stride = max(1, math.ceil(last / (form.frames - 1)))
    frames = [picture(film, scenery, frame, painter) for frame in [*range(0, last, stride), last]]
    return gif(frames, stride * step_time, form.colours)
