"""Short films of the environments, each one episode of a shipped policy."""

from __future__ import annotations

import io
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, NamedTuple

import gymnasium as gym
import numpy as np
from PIL import Image

import vibgym
from vibgym import checks, files
from vibgym.registration import ENVIRONMENTS


class Take(NamedTuple):
    """Settings of a film."""

    width: int  # pixels
    longest: float  # s, duration
    every: int  # periods between frames


FEW, MANY = Take(480, 7.0, 2), Take(360, 4.0, 4)
CROWD = 12
"""Number of parts from which the settings MANY apply, which limit the size of the file."""

MAX = 90_000  # bytes of a file
QUALITIES = (72, 50, 30, 15)  # WebP qualities, best first
REST = 1500  # ms for which the last frame is shown
FEWEST = 10  # frames of a film
SEED = 3
POLICIES = {
    "Feed": "lanes", "FeedHeaps": "lanes", "Swap": "lanes", "SwapCrowded": "lanes", "Pack": "two_phases",
    "PackFull": "two_phases", "Push": "push", "PushAny": "push", "Sort": "pose", "SortTwelve": "pose",
    "SortThreeKinds": "pose", "SortShapes": "pose", "PackShapes": "two_phases", "PushShapes": "push",
    "SortCrowded": "pose", "Singulate": "learned",
}  # fmt: skip
"""Policy by environment; by default *pose*."""


def write(directory: Path, names: Sequence[str] | None = None) -> Iterator[Path]:
    """Write films of all environments, or those of ``names``, into a directory; yield each path.

    Raises:
        ValueError: an unknown environment.  vibgym.files.WriteError: a file cannot be written.
    """
    chosen = [checks.choice("--only", name, tuple(ENVIRONMENTS)) for name in (names or ENVIRONMENTS)]
    directory = files.output_directory(directory)
    for name in chosen:
        path = directory / f"{name}.webp"
        pictures, interval = shot(name)
        files.write_atomically(path, short(pictures, interval))
        yield path


def short(pictures: list[np.ndarray], interval: float) -> bytes:
    """Encode a film in the best quality with at most :data:`MAX` bytes; shorten it if the lowest quality is too large."""
    while True:
        for quality in QUALITIES:
            data = webp(pictures, interval, quality)
            if len(data) <= MAX:
                return data
        if len(pictures) < FEWEST:
            return data
        pictures = pictures[: 4 * len(pictures) // 5]


def webp(pictures: Sequence[np.ndarray], interval: float, quality: int) -> bytes:
    """Encode a looping animation of frames ``interval`` (s) apart."""
    first, *others = (Image.fromarray(picture) for picture in pictures)
    times = [round(1e3 * interval)] * len(others) + [REST]
    file = io.BytesIO()
    settings: dict[str, Any] = {"duration": times, "loop": 0, "quality": quality, "method": 4}
    first.save(file, format="WEBP", save_all=True, append_images=others, **settings)
    return file.getvalue()


def shot(name: str) -> tuple[list[np.ndarray], float]:
    """Return the frames (height, width, 3) uint8 of an episode and the time between them, s."""
    plain = gym.make(f"vibgym/{name}-v0")
    plain.reset(seed=SEED)  # draws the shapes, where they are drawn
    policy = vibgym.make_policy(POLICIES.get(name, "pose"), plain)
    settings: dict[str, Any] = {"action": policy.action, "observation": policy.observation, "render_mode": "rgb_array"}
    env: Any = gym.make(f"vibgym/{name}-v0", **settings).unwrapped
    take = MANY if len(env.parts) >= CROWD else FEW
    observation, _ = env.reset(seed=SEED)
    pictures, state = [_small(env.render(), take.width)], None
    for step in range(1, round(take.longest / env.surface.period) + 1):
        action, state = policy.predict(observation, state)
        observation, _, terminated, _, _ = env.step(action)
        if terminated or step % take.every == 0:
            pictures.append(_small(env.render(), take.width))
        if terminated:
            break
    return pictures, take.every * env.surface.period


def _small(picture: np.ndarray, width: int) -> np.ndarray:
    image = Image.fromarray(picture)
    return np.asarray(image.resize((width, round(width * image.height / image.width)), Image.Resampling.LANCZOS))
