"""Recording of a run as a GIF, or as episodes of a Minari data set."""

from __future__ import annotations

import copy
import threading
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
from PIL import Image

from vibgym import checks, extras
from vibgym.datasets import create, kept_in
from vibgym.envs.viewer import Viewer
from vibgym.plugins.play.world import World

MAX_STEPS = 2500
"""Most steps of a recording: 100 s at 25 Hz. Later steps are skipped, with a message on the page."""

EVERY = 2
"""Steps per frame: GIFs play 12.5 frames per second at the table's 25 Hz."""

WIDTH = 720
"""Pixels of a GIF's pictures."""

_MINARI = threading.Lock()  # its folder is a variable of the process


class Segment:
    """Steps without intervention of the visitor: one episode of a data set."""

    def __init__(self, observation: Any) -> None:
        self.observations, self.actions = [observation], list[np.ndarray]()
        self.rewards, self.ends = list[float](), list[bool]()


class Recorder:
    """Recorder of a world."""

    def __init__(self, world: World) -> None:
        self.pictures: list[Image.Image] = []
        self.segments: list[Segment] = []
        self.steps, self.full = 0, False
        self.settings = world.settings
        self._env: Any = None
        self._cut, self._over = True, False
        self._picture(world)

    def cut(self) -> None:
        """Start another episode of the data set, after an intervention of the visitor."""
        self._cut = True

    def before(self, world: World) -> None:
        """Store the state before a step."""
        if self._cut and not self.full:
            self.segments.append(Segment(world.env.observed("state")))
            self.settings, self._cut, self._over = world.settings, False, False

    def after(self, world: World) -> None:
        """Store the result of a step."""
        if self.full:
            return
        # Steps after an episode's end belong to no episode, until an intervention starts another one.
        if not self._over:
            part = self.segments[-1]
            part.observations.append(world.observation)
            part.actions.append(world.done.reshape(-1))
            part.rewards.append(float(world.reward))
            part.ends.append(bool(world.terminated))
            self._over = bool(world.terminated)
        self.steps += 1
        self.full = self.steps >= MAX_STEPS
        if self.steps % EVERY == 0:
            self._picture(world)

    def _picture(self, world: World) -> None:
        if self._env is not world.env:
            self._env, self._viewer = world.env, Viewer(world.env, "")
        self._viewer.follow(0)
        frame = Image.fromarray(self._viewer.frame(0))
        height = round(frame.height * WIDTH / frame.width)
        self.pictures.append(frame.resize((WIDTH, height)).quantize(96, dither=Image.Dither.NONE))

    def gif(self, path: Path, step_time: float) -> None:
        """Write the frames in real time; ``step_time``: s of a step."""
        path.parent.mkdir(parents=True, exist_ok=True)
        size = max(picture.size for picture in self.pictures)
        same = [picture if picture.size == size else picture.resize(size) for picture in self.pictures]
        lasts = max(20, round(1e3 * step_time * EVERY))
        same[0].save(path, save_all=True, append_images=same[1:], duration=lasts, loop=0, optimize=False)

    def minari(self, folder: Path, name: str) -> Path:
        """Write the steps as a data set ``name`` in ``folder``; returns its directory.

        Raises:
            ValueError: nothing was recorded, or the name is taken.
            ModuleNotFoundError: the extra ``data`` is not installed.
        """
        try:
            from minari.data_collector import EpisodeBuffer
        except ModuleNotFoundError as error:
            raise extras.missing("an episode", error, "data") from None
        made = [segment for segment in self.segments if segment.actions]
        if not made:
            raise checks.conflict("record: the recording has no step")
        buffers = [
            EpisodeBuffer(
                id=k,
                seed=None,
                options=None,
                observations=list(segment.observations),
                actions=list(segment.actions),
                rewards=list(segment.rewards),
                terminations=list(segment.ends),
                truncations=[False] * (len(segment.ends) - 1) + [not segment.ends[-1]],
                infos=None,
            )
            for k, segment in enumerate(made)
        ]
        spec = copy.deepcopy(gym.spec(self.settings.id))
        spec.kwargs.update(self.settings.arguments())
        folder.mkdir(parents=True, exist_ok=True)
        with _MINARI, kept_in(str(folder)):
            description = f"Played by hand on {self.settings.id}."
            create(name, buffers, env=spec, algorithm_name=self.settings.policy, description=description)
        return folder / name
