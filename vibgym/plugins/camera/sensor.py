"""The camera above the surface as a sensor: images through the processing chain of the thesis, or their statistics."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from vibgym import checks
from vibgym.physics.core.noise import KEY_DRAWS, keys_from
from vibgym.physics.core.records import State
from vibgym.plugins.camera.fitting import ErrorModel, fit_errors
from vibgym.plugins.camera.image import whole_image
from vibgym.plugins.camera.sampling import MISHAPS, Seen, new_seen, new_track, take_samples
from vibgym.plugins.camera.setup import CameraSettings, Setup
from vibgym.plugins.camera.statistical import Statistics, guess, normal_levels
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Sensor
from vibgym.sensing.measurement import Reading


class Picture(NamedTuple):
    """Data of an image, which is drawn on request."""

    pose: np.ndarray  # (worlds, parts, 3)
    earlier: np.ndarray  # (worlds, parts or 0, 3) when the odd lines were taken
    shown: np.ndarray  # (worlds, parts) bool
    sample: np.ndarray  # (worlds,) int64


class CameraSensor(Sensor):
    """Sensor that measures poses in synthetic images of the surface.

    Each sample renders the image around the parts: dark tops at their height, with perspective, distortion, blur, uneven light,
    noise and eight bits. It then finds and measures the objects, maps their centroids to the surface by a calibration with a
    template, and assigns objects to parts. A part that is cut off by the border of the image, or merges with another one, is
    not seen. ``info`` counts ``swaps`` (parts mistaken for others), ``merges`` and ``losses`` of each sample. At an episode's
    start the identities of parts and their headings modulo symmetry are initialised from the true poses. Fallen parts are
    reported as gone.

    Attributes:
        setup: optics, calibration and other data derived from the settings.

    Raises:
        ValueError: a camera that does not cover the whole surface; parts that cannot be detected.
    """

    class Settings(CameraSettings):
        """Settings of the camera."""

    settings: Settings

    draws = KEY_DRAWS

    resets_parts = False  # parts are tracked from sample to sample

    def __init__(
        self, surface: Surface, parts: Sequence[Part], worlds: int, periods: int, settings: Settings | None = None
    ) -> None:
        super().__init__(surface, parts, worlds, periods, settings)
        self.setup = Setup(surface, self.kinds, self.settings, self.every * periods * surface.period)
        self._model: ErrorModel | None = None
        count = len(self.parts)
        self.track = new_track(worlds, count)
        self._key = np.zeros((worlds, 2), dtype=np.int64)
        self._pictures: list[Picture] = []
        self._seen: Seen = new_seen(self.setup.shape, count, self.setup.rig.background)
        self._statistics = self._sampled() if self.settings.statistical else None

    @property
    def errors(self) -> ErrorModel:
        """Measurement errors of each kind; sampled on first use."""
        if self._model is None:
            self._model = fit_errors(self.setup)
        return self._model

    @property
    def sigma(self) -> np.ndarray:
        errors = self.errors
        return np.sqrt(errors.mean**2 + errors.fixed**2 + errors.white**2)[self.kinds.kind]

    def info(self) -> dict[str, np.ndarray]:
        return {name: self.track.count[:, k] for k, name in enumerate(MISHAPS)}

    def keep_pictures(self) -> None:
        """Store the data for :meth:`image` from the next start of an episode on, also in snapshots."""
        count = len(self.parts)
        odd = count if self.setup.lag > 0.0 else 0
        self._pictures = [
            Picture(
                np.zeros((self.worlds, count, 3)),
                np.zeros((self.worlds, odd, 3)),
                np.zeros((self.worlds, count), dtype=bool),
                np.zeros(self.worlds, dtype=np.int64),
            )
            for _ in self._readings
        ]

    def image(self) -> np.ndarray:
        """Return the latest delayed image, (worlds, lines, columns) uint8, in a new array.

        Raises:
            ValueError: :meth:`keep_pictures` has not been called.
        """
        if not self._pictures:
            raise checks.conflict("image() requires observation='camera', or keep_pictures() before the episode")
        picture, setup = self._pictures[0], self.setup
        images, bare = np.empty((self.worlds, *setup.shape), dtype=np.uint8), np.empty(setup.shape, dtype=np.float32)
        for w in range(self.worlds):
            setup.rig.shapes.kind[:] = self.kinds.kind[w if self.kinds.vary else 0]
            whole_image(
                setup.optics, setup.rig.shapes, setup.rig.exposure, picture.pose[w], picture.earlier[w],
                picture.shown[w], self._key[w], picture.sample[w], bare, images[w],
            )  # fmt: skip
        return images

    def begin(self, worlds: np.ndarray, uniform: np.ndarray) -> None:
        self._key[worlds] = keys_from(uniform)

    def reset(self, worlds: np.ndarray, state: State, uniform: np.ndarray) -> None:
        worlds = np.asarray(worlds, dtype=np.int64)
        self.track.pose[worlds] = np.where(np.isfinite(state.pose[worlds]), state.pose[worlds], 0.0)
        self.track.velocity[worlds], self.track.missed[worlds] = 0.0, 0
        super().reset(worlds, state, uniform)
        for picture in self._pictures:
            self._take(picture, worlds, state)

    def sample(self, state: State) -> None:
        super().sample(state)
        if self._pictures:
            self._pictures.append(self._pictures.pop(0))
            self._take(self._pictures[-1], self._everyone, state)

    def measure(self, state: State, reading: Reading) -> None:
        reading.gone[...] = state.fallen
        worlds = self.sampled
        if self.every > 1:
            worlds = worlds[np.asarray(self.samples[worlds] % self.every == 0)]
            if len(worlds) < len(self.sampled):  # no sample in the others
                reading.pose[...], reading.mean_velocity[...] = self.track.pose, 0.0
        if self._statistics is not None:
            guess(
                worlds, state.pose, state.mean_velocity, state.fallen, self._statistics, self._key, self.samples, self.track,
                reading.pose, reading.mean_velocity, reading.seen,
            )  # fmt: skip
            return
        pose, earlier, shown = self._scene(state)
        take_samples(
            worlds, pose, earlier, shown, self.setup.rig, self.setup.known, self._key, self.samples, self._seen, self.track,
            reading.pose, reading.mean_velocity, reading.seen,
        )  # fmt: skip

    def custom_state(self) -> dict[str, np.ndarray]:
        pictures = {
            f"picture_{name}{k}": values
            for k, picture in enumerate(self._pictures)
            for name, values in picture._asdict().items()
        }
        return {"key": self._key, **{f"track_{name}": data for name, data in self.track._asdict().items()}, **pictures}

    def _take(self, picture: Picture, worlds: np.ndarray, state: State) -> None:
        """Store the content of an image of this instant."""
        pose, earlier, shown = self._scene(state)
        picture.pose[worlds], picture.earlier[worlds] = pose[worlds], earlier[worlds]
        picture.shown[worlds], picture.sample[worlds] = shown[worlds], self.samples[worlds]

    def _scene(self, state: State) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return poses now and when the odd lines were taken, and which parts are visible."""
        finite = np.asarray(np.isfinite(state.pose).all(axis=-1))
        shown = finite & ~state.fallen
        pose = state.pose if finite.all() else np.where(finite[..., None], state.pose, 0.0)
        if self.setup.lag == 0.0:
            return pose, np.empty((self.worlds, 0, 3)), shown
        moved = self.setup.lag * state.mean_velocity
        return pose, pose - np.where(np.isfinite(moved), moved, 0.0), shown

    def _sampled(self) -> Statistics:
        """Return the statistical model of this camera."""
        setup, surface = self.setup, self.surface
        border, pixel = setup.settings.border, setup.optics.place[2] / setup.optics.focal
        return Statistics(
            shapes=setup.rig.shapes,
            kind=setup.rig.kind,
            traits=setup.known.traits,
            model=self.errors,
            frame=np.array([-border, surface.width + border, -border, surface.depth + border]),
            foot=setup.known.foot,
            pixel=np.array([pixel, setup.pitch * pixel]),
            step=setup.known.step,
            lag=setup.lag,
            quantiles=normal_levels(),
        )
