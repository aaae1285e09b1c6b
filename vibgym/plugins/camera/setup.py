"""Construction of the camera from checked settings: optics, area of interest, reference image, calibration."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.plugins.camera import image
from vibgym.plugins.camera.calibration import Grid, Template, assign_marks, find_marks, grid_of, locate_all
from vibgym.plugins.camera.edges import Grey
from vibgym.plugins.camera.look import Knowledge, Rig
from vibgym.plugins.camera.objects import Interest, area_of_interest
from vibgym.plugins.camera.optics import CHIP, PIXELS, Optics, optics_of, projected
from vibgym.plugins.camera.shapes import room_inside, traits_of
from vibgym.scene.parts import Part, kinds_of
from vibgym.scene.surface import Surface

LINES = {"all": 1, "interlaced": 1, "half": 2}
"""Lines of the chip per line of the image."""

EDGES = ("grey", "threshold")

SURFACE, PARTS, SURROUNDINGS = 200.0, 40.0, 90.0
"""Grey levels in full light."""

REACH = 0.005
"""m, gate around the expected position, added to the distance at full speed."""


@dataclass(frozen=True)
class Settings:
    """Settings of the camera.

    Args:
        edge: ``"grey"`` uses the grey levels along the edges, ``"threshold"`` counts whole pixels (as in the thesis).
        lines: ``"half"``: pairs of the chip's lines are combined (as in the thesis); ``"all"`` at once; or
            ``"interlaced"``: even lines at the instant, odd ones half an oscillation before.
        noise: grey levels, standard deviation, of each pixel at each sample.
        blur: px, standard deviation of the lens's point spread.
        distortion: displacement of the image's corner outwards, over its distance from the centre.
        light: share of the light that is missing in the image's corners; it decreases with the square of the distance.
        threshold: grey level below which a pixel belongs to a part. Full light makes the surface 200, and parts 40.
        height: of the lens above the surface, m.  position: of the lens over the surface, m; None: its middle.
        tilt: rotations about the surface's x and y axes from the vertical optical axis, rad.
        lens: focal length, m.  chip: width of the chip, m.  pixels: its columns and lines.
        border: m, width of the light frame around the surface; the area of interest ends there.
        tetragons: of the calibration, along x and y.  mark: length of its square marks, m.
    """

    height: Any = 0.772
    position: Any = None
    tilt: Any = (0.0, 0.0)
    lens: Any = 6e-3
    chip: Any = CHIP
    pixels: Any = PIXELS
    distortion: Any = 0.01
    lines: Any = "half"
    edge: Any = "grey"
    blur: Any = 0.5
    noise: Any = 1.0
    light: Any = 0.1
    threshold: Any = 110.0
    border: Any = 0.015
    tetragons: Any = (16, 4)
    mark: Any = 0.010


class Setup:
    """The camera and the data of its image processing.

    Args:
        surface: the table.  parts: of every world.
        settings: of the camera.
        step: s from sample to sample.

    Attributes:
        rig, known: for the kernels.  template: of the calibration.  shape: (lines, columns) of an image.
        lag: s by which the odd lines are taken before the even ones.

    Raises:
        ValueError: a bad setting; a camera that does not cover the whole surface; a part too small or tall to be detected.
    """

    def __init__(self, surface: Surface, parts: Sequence[Part], settings: Settings, step: float) -> None:
        self.surface, self.parts = surface, tuple(parts)
        self.lines = checks.choice("sensor.lines", settings.lines, tuple(LINES))
        self.edge = checks.choice("sensor.edge", settings.edge, EDGES)
        self.pitch = LINES[self.lines]
        self.lag = 0.5 * surface.period if self.lines == "interlaced" else 0.0
        self.optics, self.ideal = self._optics(settings)
        self.border = border = checks.number("sensor.border", settings.border, least=0.0, most=1.0)
        frame = self._frame(border)
        self._refuse_unseen(frame)
        exposure = self._exposure(settings)
        kinds, kind = kinds_of(self.parts, Part.same_as)
        self._refuse_unfit(kinds)
        shapes = image.Shapes(
            kind,
            np.concatenate([part.outline for part in kinds]),
            np.cumsum([0, *(len(part.outline) for part in kinds)]),
            np.array([part.height for part in kinds]),
        )
        background = np.floor(exposure.level + 0.5).astype(np.uint8)
        self.rig = Rig(self.optics, shapes, exposure, background)
        interest, meaning = self._processing(settings, frame, exposure, kinds)
        self.template = self._template(settings, border)
        # Calibration is done once: it searches every pixel and always uses grey levels.
        self._interest, self._meaning = interest._replace(lines=1, columns=1, least=4), meaning._replace(fine=True)
        grain = self.pitch * self.optics.place[2] / self.optics.focal
        variance = (image.weights_variance(exposure.across), image.weights_variance(exposure.along))
        self.known = Knowledge(
            interest=interest,
            meaning=meaning,
            grid=self.calibrate(self.template_image()),
            traits=traits_of(self.parts),
            foot=self.ideal.place,
            grain=grain,
            # Second moments of shares include pixel size and blur; those of whole pixels are unbiased.
            aperture=1.0 / 12.0 + np.array(variance) if self.edge == "grey" else np.zeros(2),
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
        outline = self.template.outline()
        shapes = image.Shapes(
            np.zeros(shown.size, dtype=np.int64), outline, np.array([0, len(outline)]), np.zeros(1)
        )  # fmt: skip
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
        rig = self.rig._replace(shapes=self.rig.shapes._replace(kind=only))
        return rig, self.known._replace(traits=self.known.traits._replace(kind=only))

    def residual(self, points: np.ndarray) -> np.ndarray:
        """Return (n,) px, error of the calibrated map at points (n, 2) of the surface, by the local scale."""
        there = np.empty_like(points)
        locate_all(self.known.grid, projected(self.optics, np.column_stack([points, np.zeros(len(points))])), there)
        return np.hypot(*(there - points).T) * self.optics.focal / self.optics.place[2]

    def _optics(self, settings: Settings) -> tuple[Optics, Optics]:
        """Return the true camera, and the nominal one without distortion."""
        surface = self.surface
        height = checks.number("sensor.height", settings.height, least=0.01, most=1e3)
        middle = (0.5 * surface.width, 0.5 * surface.depth)
        x, y = middle if settings.position is None else _pair("sensor.position", settings.position)
        tilt = _pair("sensor.tilt", settings.tilt)
        tilt = tuple(checks.number("sensor.tilt", each, least=-1.0, most=1.0) for each in tilt)
        columns, lines = _pair("sensor.pixels", settings.pixels)
        pixels = tuple(checks.count("sensor.pixels", each, least=16, most=8192) for each in (columns, lines))
        given: dict[str, Any] = {
            "tilt": tilt,
            "lens": checks.number("sensor.lens", settings.lens, least=1e-4, most=1.0),
            "chip": checks.number("sensor.chip", settings.chip, least=1e-4, most=1.0),
            "pixels": pixels,
            "pitch": self.pitch,
        }
        distortion = checks.number("sensor.distortion", settings.distortion, least=-0.2, most=0.2)
        place = checks.number("sensor.position", x), checks.number("sensor.position", y)
        self.shape = (pixels[1] // self.pitch, pixels[0])
        return optics_of(place, height, distortion=distortion, **given), optics_of(place, height, **given)

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
        raise checks.conflict(
            f"sensor: {got}; the image has {columns} x {lines} px: change height, position, tilt, lens or border"
        )

    def _refuse_unfit(self, kinds: Sequence[Part]) -> None:
        """Raise ValueError for parts that cannot be detected."""
        for part in kinds:
            if part.height > 0.5 * self.optics.place[2]:
                got = f"{part.name}, {part.height:g} m high"
                raise checks.refuse("parts", got, f"at most half as high as the camera, {self.optics.place[2]:g} m")
            if self._inner(part) < 1.0:
                got = f"{part.name}, {2e3 * room_inside(part):.3g} mm wide within"
                allowed = f"wide enough for a circle of a pixel's radius, {1e3 * self._pixel():.3g} mm"
                raise checks.refuse("parts", got, allowed)

    def _pixel(self) -> float:
        """Return the size of a pixel on the surface along a line, m."""
        return self.optics.place[2] / self.optics.focal

    def _inner(self, part: Part) -> float:
        """Return the radius of the largest circle inside a part in the image, px."""
        return room_inside(part) / self._pixel()

    def _exposure(self, settings: Settings) -> image.Exposure:
        blur = checks.number("sensor.blur", settings.blur, least=0.0, most=5.0)
        noise = checks.number("sensor.noise", settings.noise, least=0.0, most=20.0)
        light = checks.number("sensor.light", settings.light, least=0.0, most=0.5)
        lines, columns = self.shape
        across, along = image.blur_weights(blur), image.blur_weights(blur / self.pitch)
        u = np.arange(columns) - self.optics.column
        v = (np.arange(lines) + 0.5) * self.pitch - 0.5 - self.optics.line
        from_centre = (u**2 + v[:, None] ** 2) / (0.25 * (columns**2 + (lines * self.pitch) ** 2))
        brightness = 1.0 - light * from_centre
        # The border extends a little farther, so that the blurred surroundings stay outside the area of interest.
        beyond = (1 + len(along) // 2) * self.pitch * self._pixel()
        bare = image.Exposure(np.ones(self.shape, np.float32), 0.0, across, along, 0.0, image.normal_quantiles())
        frame = image.Shapes(
            np.zeros(1, dtype=np.int64), self._corners(self.border + beyond), np.array([0, 4]), np.zeros(1)
        )  # fmt: skip
        outside, _ = self._drawn(frame, np.zeros((1, 3)), np.ones(1, dtype=bool), bare)
        level = brightness * (SURFACE + (SURROUNDINGS - SURFACE) * outside)
        return bare._replace(level=level.astype(np.float32), dark=PARTS / SURFACE, noise=noise)

    def _processing(
        self, settings: Settings, frame: np.ndarray, exposure: image.Exposure, kinds: Sequence[Part]
    ) -> tuple[Interest, Grey]:
        first, last = area_of_interest(frame, self.shape)
        columns = np.arange(self.shape[1])
        inside = (columns >= first[:, None]) & (columns <= last[:, None])
        darkest = float(exposure.level[inside].min())
        threshold = checks.number("sensor.threshold", settings.threshold)
        low, high = PARTS + 4.0 * exposure.noise, darkest - 4.0 * exposure.noise
        if not low < threshold < high:
            allowed = (
                f"between the grey levels of parts and surface, four sigma of noise from both: {low:.4g} to {high:.4g}"
            )
            raise checks.refuse("sensor.threshold", threshold, allowed)
        least = min(part.area for part in kinds) / (self.pitch * self._pixel() ** 2)
        # A square grid hits every circle of 1 / sqrt 2 of its spacing; half a pixel is lost to the threshold.
        spacing = min(1.4 * (self._inner(part) - 0.5) for part in kinds)
        interest = Interest(
            first, last, threshold, max(int(spacing / self.pitch), 1), max(int(spacing), 1), max(int(0.25 * least), 1)
        )
        band = 1 + len(exposure.along) // 2, 1 + len(exposure.across) // 2
        fine = self.edge == "grey"
        return interest, Grey(exposure.level, 1.0 - exposure.dark, band[0], band[1], fine)

    def _template(self, settings: Settings, border: float) -> Template:
        tetragons = _pair("sensor.tetragons", settings.tetragons)
        along, across = (checks.count("sensor.tetragons", each, least=1, most=200) for each in tetragons)
        surface = self.surface
        mark = checks.number("sensor.mark", settings.mark, least=4.0 * self._pixel(), most=1.0)
        template = Template(surface.width / along, surface.depth / across, across + 1, along + 1, mark)
        needed = 0.5 * mark + 2.0 * self.pitch * self._pixel()
        if border < needed:
            allowed = f"at least {needed:.4g} m, so that marks on the surface's border are visible"
            raise checks.refuse("sensor.border", border, allowed)
        most = 0.5 * min(template.width, template.height)
        if mark > most:
            raise checks.refuse("sensor.mark", mark, f"at most half the distance of marks, {most:g} m")
        return template


def _pair(name: str, value: Any) -> tuple[Any, Any]:
    """Return the two items of a setting."""
    items = value.tolist() if isinstance(value, np.ndarray) else value
    if isinstance(items, str) or not isinstance(items, Sequence) or len(items) != 2:
        raise checks.refuse(name, value, "two numbers")
    return items[0], items[1]
