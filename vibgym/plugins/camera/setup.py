"""Construction of the camera from checked settings: optics, area of interest, reference image, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Annotated, Any, Literal

import numpy as np
from annotated_types import Ge, Le
from pydantic import Field

from vibgym import checks
from vibgym.plugins.camera import image
from vibgym.plugins.camera.calibration import Grid, Template, assign_marks, find_marks, grid_of, locate_all
from vibgym.plugins.camera.edges import Grey
from vibgym.plugins.camera.objects import Interest, area_of_interest
from vibgym.plugins.camera.optics import CHIP, PIXELS, Optics, optics_of, projected
from vibgym.plugins.camera.sampling import Knowledge, Rig
from vibgym.plugins.camera.shapes import room_inside, traits_of
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.sensing.base import Sensor
from vibgym.settings import Angle, Length

LINES = {"all": 1, "interlaced": 1, "half": 2}
"""Lines of the chip per line of the image."""

SURFACE, PARTS, SURROUNDINGS = 200.0, 40.0, 90.0
"""Grey levels in full light."""

REACH = 0.005
"""m, gate around the expected position, added to the distance at full speed."""


Slope = Annotated[Angle, Ge(-1.0), Le(1.0)]
Pixels = Annotated[int, Ge(16), Le(8192)]
Tetragons = Annotated[int, Ge(1), Le(200)]


class CameraSettings(Sensor.Settings):
    """Settings of the camera; ``noise`` is that of the pixels, additional noise of poses goes under ``effects``."""

    statistical: bool = False
    """Whether errors are modelled without images: a fixed function of the pose and white noise, fitted by
    :func:`vibgym.plugins.camera.fitting.fit_errors` to images of these parts with these settings."""

    height: Length = Field(default=0.772, ge=0.01, le=1e3)
    """Of the lens above the surface."""

    position: tuple[Length, Length] | None = None
    """Of the lens over the surface; None: its middle."""

    tilt: tuple[Slope, Slope] = (0.0, 0.0)
    """Rotations about the surface's x and y axes from the vertical optical axis."""

    lens: Length = Field(default=6e-3, ge=1e-4, le=1.0)
    """Focal length."""

    chip: Length = Field(default=CHIP, ge=1e-4, le=1.0)
    """Width of the chip."""

    pixels: tuple[Pixels, Pixels] = PIXELS
    """Columns and lines of the chip."""

    distortion: float = Field(default=0.01, ge=-0.2, le=0.2)
    """Displacement of the image's corner outwards, over its distance from the centre."""

    lines: Literal["all", "interlaced", "half"] = "half"
    """``"half"``: pairs of the chip's lines are combined (as in the thesis); ``"all"`` at once; or ``"interlaced"``: even lines
    at the instant, odd ones half an oscillation before."""

    edge: Literal["grey", "threshold"] = "grey"
    """``"grey"`` uses the grey levels along the edges, ``"threshold"`` counts whole pixels (as in the thesis)."""

    blur: float = Field(default=0.5, ge=0.0, le=5.0)
    """px, standard deviation of the lens's point spread."""

    noise: float = Field(default=1.0, ge=0.0, le=20.0)
    """Grey levels, standard deviation, of each pixel at each sample."""

    light: float = Field(default=0.1, ge=0.0, le=0.5)
    """Share of the light that is missing in the image's corners; it decreases with the square of the distance."""

    threshold: float = 110.0
    """Grey level below which a pixel belongs to a part. Full light makes the surface 200, and parts 40."""

    border: Length = Field(default=0.015, ge=0.0, le=1.0)
    """Width of the light frame around the surface; the area of interest ends there."""

    tetragons: tuple[Tetragons, Tetragons] = (16, 4)
    """Of the calibration, along x and y."""

    mark: Length = Field(default=0.010, gt=0.0, le=1.0)
    """Length of the calibration's square marks."""


class Setup:
    """The camera and the data of its image processing.

    Args:
        surface: the table.  parts: of the worlds.
        settings: of the camera.
        step: s from sample to sample.

    Attributes:
        rig, known: for the kernels.  template: of the calibration.  shape: (lines, columns) of an image.
        lag: s by which the odd lines are taken before the even ones.

    Raises:
        ValueError: a bad setting; a camera that does not cover the whole surface; a part too small or tall to be detected.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: CameraSettings, step: float) -> None:
        self.surface = surface
        self.settings = settings
        self.pitch = LINES[settings.lines]
        self.lag = 0.5 * surface.period if settings.lines == "interlaced" else 0.0
        self.optics, self.ideal = self._optics()
        frame = self._frame(settings.border)
        self._refuse_unseen(frame)
        exposure = self._exposure()
        self.kinds = Kinds.of(parts)
        kinds, kind = self.kinds.every, self.kinds.kind[0].copy()
        self._rooms = [room_inside(part) for part in kinds]
        self._refuse_unfit(kinds)
        shapes = image.Shapes(
            kind,
            np.concatenate([part.outline for part in kinds]),
            np.cumsum([0, *(len(part.outline) for part in kinds)]),
            np.array([part.height for part in kinds]),
        )
        background = np.floor(exposure.level + 0.5).astype(np.uint8)
        self.rig = Rig(self.optics, shapes, exposure, background, self.kinds.kind)
        interest, meaning = self._processing(frame, exposure, kinds)
        self.template = self._template()
        # Calibration is done once: it searches every pixel and always uses grey levels.
        self._interest, self._meaning = interest._replace(lines=1, columns=1, least=4), meaning._replace(fine=True)
        grain = self.pitch * self.optics.place[2] / self.optics.focal
        variance = (image.weights_variance(exposure.across), image.weights_variance(exposure.along))
        self.known = Knowledge(
            interest=interest,
            meaning=meaning,
            grid=self.calibrate(self.template_image()),
            traits=traits_of(kinds, kind),
            foot=self.ideal.place,
            grain=grain,
            # Second moments of shares include pixel size and blur; those of whole pixels are unbiased.
            aperture=1.0 / 12.0 + np.array(variance) if settings.edge == "grey" else np.zeros(2),
            reach=REACH,
            speed=surface.table_speed,
            step=step,
        )

    def template_image(self, missing: Sequence[tuple[int, int]] = ()) -> np.ndarray:
        """Return the image (lines, columns) uint8 of the template, without the marks ``missing`` (row, column)."""
        marks = self.template.marks()
        shown = np.ones(marks.shape[:2], dtype=bool)
        for row, column in missing:
            shown[row, column] = False
        shapes = _flat(self.template.outline(), shown.size)
        pose = np.column_stack([marks.reshape(-1, 2), np.zeros(shown.size)])
        return self._drawn(shapes, pose, shown.ravel(), self.rig.exposure)[1]

    def calibrate(self, picture: Any) -> Grid:
        """Return the map from the image to the surface, from a picture of the template.

        Raises:
            ValueError: not a picture of this camera, or a mark is missing.
        """
        picture = np.ascontiguousarray(checks.array("template", picture, self.shape, dtype=np.uint8, least=0, most=255))
        marks = self.template.marks()
        points = np.column_stack([marks.reshape(-1, 2), np.zeros(marks.size // 2)])
        expected = projected(self.ideal, points).reshape(marks.shape)
        seen = find_marks(picture, self._interest, self._meaning, 2 * marks.size)
        return grid_of(self.template, assign_marks(seen, expected))

    def alone(self, kind: int) -> tuple[Rig, Knowledge]:
        """Return the camera for worlds of one part each, of that kind."""
        only = np.array([kind])
        rig = self.rig._replace(shapes=self.rig.shapes._replace(kind=only), kind=only[None])
        return rig, self.known._replace(traits=self.known.traits._replace(kind=only))

    def residual(self, points: np.ndarray) -> np.ndarray:
        """Return (n,) px, error of the calibrated map at points (n, 2) of the surface, by the local scale."""
        there = np.empty_like(points)
        locate_all(self.known.grid, projected(self.optics, np.column_stack([points, np.zeros(len(points))])), there)
        return np.hypot(*(there - points).T) * self.optics.focal / self.optics.place[2]

    def _optics(self) -> tuple[Optics, Optics]:
        """Return the true camera, and the nominal one without distortion."""
        surface, settings = self.surface, self.settings
        middle = (0.5 * surface.width, 0.5 * surface.depth)
        place, height = middle if settings.position is None else settings.position, settings.height
        common = {**settings.model_dump(include={"tilt", "lens", "chip", "pixels"}), "pitch": self.pitch}
        self.shape = (settings.pixels[1] // self.pitch, settings.pixels[0])
        return optics_of(place, height, distortion=settings.distortion, **common), optics_of(place, height, **common)

    def _corners(self, border: float) -> np.ndarray:
        """Return (4, 2) m, of the surface with a border around it."""
        right, top = self.surface.width + border, self.surface.depth + border
        return np.array([[-border, -border], [right, -border], [right, top], [-border, top]])

    def _frame(self, border: float) -> np.ndarray:
        """Return (n, 2) px, outline of the surface and its light border in the image."""
        corners = self._corners(border)
        t = np.linspace(0.0, 1.0, 65)[:-1, None]
        sides = [a + t * (b - a) for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True)]
        points = np.concatenate(sides)
        return projected(self.optics, np.column_stack([points, np.zeros(len(points))]))

    def _drawn(
        self, shapes: image.Shapes, pose: np.ndarray, shown: np.ndarray, exposure: image.Exposure
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the uncovered share of pixels with shapes at poses (n, 3), and the image; each (lines, columns)."""
        bare, picture = np.empty(self.shape, dtype=np.float32), np.empty(self.shape, dtype=np.uint8)
        no_key = np.zeros(2, dtype=np.int64)
        image.whole_image(self.optics, shapes, exposure, pose, np.empty((0, 3)), shown, no_key, 0, bare, picture)
        return bare, picture

    def _refuse_unseen(self, frame: np.ndarray) -> None:
        """Raise ValueError for a camera that does not cover the whole surface with its border."""
        lines, columns = self.shape
        inside = (frame > -0.5) & (frame < (columns - 0.5, lines - 0.5))  # False for NaN, too
        if inside.all():
            return
        place = self.optics.place
        got = f"a camera {place[2]:g} m above ({place[0]:g}, {place[1]:g}) m that does not see the whole surface"
        if np.isfinite(frame).all():
            low, high = frame.min(axis=0), frame.max(axis=0)
            got += f": columns {low[0]:.0f} to {high[0]:.0f}, lines {low[1]:.0f} to {high[1]:.0f}"
        change = "change height, position, tilt, lens or border"
        raise checks.conflict(f"sensor: {got}; the image has {columns} x {lines} px: {change}")

    def _refuse_unfit(self, kinds: Sequence[Part]) -> None:
        """Raise ValueError for parts that cannot be detected."""
        for part, room in zip(kinds, self._rooms, strict=True):
            if part.height > 0.5 * self.optics.place[2]:
                got = f"{part.name}, {part.height:g} m high"
                raise checks.refuse("parts", got, f"at most half as high as the camera, {self.optics.place[2]:g} m")
            if room / self._pixel() < 1.0:
                got = f"{part.name}, {2e3 * room:.3g} mm wide within"
                allowed = f"wide enough for a circle of a pixel's radius, {1e3 * self._pixel():.3g} mm"
                raise checks.refuse("parts", got, allowed)

    def _pixel(self) -> float:
        """Return the size of a pixel on the surface along a line, m."""
        return self.optics.place[2] / self.optics.focal

    def _exposure(self) -> image.Exposure:
        settings, blur, (lines, columns) = self.settings, self.settings.blur, self.shape
        across, along = image.blur_weights(blur), image.blur_weights(blur / self.pitch)
        u = np.arange(columns) - self.optics.column
        v = (np.arange(lines) + 0.5) * self.pitch - 0.5 - self.optics.line
        from_centre = (u**2 + v[:, None] ** 2) / (0.25 * (columns**2 + (lines * self.pitch) ** 2))
        brightness = 1.0 - settings.light * from_centre
        # The border extends a little farther, so that the blurred surroundings stay outside the area of interest.
        beyond = (1 + len(along) // 2) * self.pitch * self._pixel()
        bare = image.Exposure(np.ones(self.shape, np.float32), 0.0, across, along, 0.0, image.normal_quantiles())
        frame = _flat(self._corners(settings.border + beyond), 1)
        outside, _ = self._drawn(frame, np.zeros((1, 3)), np.ones(1, dtype=bool), bare)
        level = brightness * (SURFACE + (SURROUNDINGS - SURFACE) * outside)
        return bare._replace(level=level.astype(np.float32), dark=PARTS / SURFACE, noise=settings.noise)

    def _processing(self, frame: np.ndarray, exposure: image.Exposure, kinds: Sequence[Part]) -> tuple[Interest, Grey]:
        first, last = area_of_interest(frame, self.shape)
        columns = np.arange(self.shape[1])
        inside = (columns >= first[:, None]) & (columns <= last[:, None])
        darkest = float(exposure.level[inside].min())
        threshold = self.settings.threshold
        low, high = PARTS + 4.0 * exposure.noise, darkest - 4.0 * exposure.noise
        if not low < threshold < high:
            allowed = "between the grey levels of parts and surface, four sigma of noise from both"
            raise checks.refuse("sensor.threshold", threshold, f"{allowed}: {low:.4g} to {high:.4g}")
        least = min(part.area for part in kinds) / (self.pitch * self._pixel() ** 2)
        # A square grid hits every circle of 1 / sqrt 2 of its spacing; half a pixel is lost to the threshold.
        spacing = min(1.4 * (room / self._pixel() - 0.5) for room in self._rooms)
        grid = max(int(spacing / self.pitch), 1), max(int(spacing), 1)
        interest = Interest(first, last, threshold, *grid, max(int(0.25 * least), 1))
        band = 1 + len(exposure.along) // 2, 1 + len(exposure.across) // 2
        fine = self.settings.edge == "grey"
        return interest, Grey(exposure.level, 1.0 - exposure.dark, band[0], band[1], fine)

    def _template(self) -> Template:
        border, (along, across) = self.settings.border, self.settings.tetragons
        surface = self.surface
        mark = checks.number("sensor.mark", self.settings.mark, least=4.0 * self._pixel())
        template = Template(surface.width / along, surface.depth / across, across + 1, along + 1, mark)
        needed = 0.5 * mark + 2.0 * self.pitch * self._pixel()
        if border < needed:
            allowed = f"at least {needed:.4g} m, so that marks on the surface's border are visible"
            raise checks.refuse("sensor.border", border, allowed)
        most = 0.5 * min(template.width, template.height)
        if mark > most:
            raise checks.refuse("sensor.mark", mark, f"at most half the distance of marks, {most:g} m")
        return template


def _flat(outline: np.ndarray, count: int) -> image.Shapes:
    """Return ``count`` equal shapes without height."""
    return image.Shapes(np.zeros(count, dtype=np.int64), outline, np.array([0, len(outline)]), np.zeros(1))
