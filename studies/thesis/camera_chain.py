"""Figs. 5.5 to 5.9: the image processing of the thesis on an image of eleven parts."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from scipy.ndimage import binary_erosion

from agents.evaluation.figures import FAILURE, MUTED, SUCCESS, new_figure, png
from studies.thesis.figure import Figure, figure
from vibgym import Part, Surface
from vibgym.physics.core.records import new_state
from vibgym.plugins.camera.objects import find, new_found
from vibgym.plugins.camera.optics import projected
from vibgym.plugins.camera.sampling import M00, XX, XY, YY, X, measure_object
from vibgym.scene.parts import shipped_part
from vibgym.sensing import SENSORS


def camera(parts: list[Part], pose: np.ndarray, lines: str) -> Any:
    """Return the prototype's camera above parts at poses (parts, 3), which keeps its image; ``lines``: "all" or "half"."""
    settings = {"kind": "camera", "lines": lines, "edge": "threshold"}
    sensor = SENSORS.make("sensor", settings, Surface(), parts, 1, 1)
    state = new_state(1, len(parts))
    state.pose[0], state.fallen[:] = pose, False
    sensor.keep_pictures()
    sensor.reset(np.array([0]), state, np.array([[0.3, 0.6]]))
    return sensor


class Scene:
    """Eleven parts in front of the camera, and the results of its image processing."""

    def __init__(self) -> None:
        aluminium, steel = shipped_part("aluminium_block"), shipped_part("steel_block")
        parts = [aluminium] * 4 + [steel] * 4 + [Part.disc(0.020, friction=0.5)] * 3
        random = np.random.default_rng(5)
        self.pose = np.empty((11, 3))
        for p in range(11):
            row, column = divmod(p, 6)
            x = 0.07 + 0.138 * column + 0.07 * row * 0.9
            self.pose[p] = x, 0.055 + 0.1 * row, random.uniform(-math.pi, math.pi)
        self.sensor = camera(parts, self.pose, "all")
        self.setup = self.sensor.setup
        self.image = self.sensor.image()[0]
        self.found = new_found(self.setup.shape, 64)
        find(self.image, self.setup.known.interest, self.found)
        self.measures = np.zeros((int(self.found.count[0]), 10))
        for k, measure in enumerate(self.measures):
            measure_object(self.image, self.setup.known, self.found, k, measure)


def draw() -> Figure:
    """Draw the stages, and compare the measured poses with the true ones."""
    scene = Scene()
    error = scene.sensor.due.pose[0] - scene.pose
    count = int(scene.found.count[0])
    values = {
        "count": count,
        "missed": "none" if count == 11 else f"{count - 11:+d}",
        "position": 1e3 * np.hypot(error[:, 0], error[:, 1]).max(),
        "heading": np.degrees(np.abs(error[:, 2]).max()),
    }
    pictures = [
        _picture(scene.image),
        _picture(_binary(scene, scene.image)),
        _runs(scene),
        _axes(scene),
        _template(scene),
    ]
    return figure("camera_chain", values, pictures)


def _panels(height: float, rows: int = 1) -> tuple[Any, list[Axes]]:
    picture = new_figure(6.2, height)
    panels = [picture.add_subplot(rows, 1, k + 1) for k in range(rows)]
    for axes in panels:
        axes.set(xticks=[], yticks=[])
        for spine in axes.spines.values():
            spine.set(color="#b6bcc6", linewidth=0.6)
    return picture, panels


def _binary(scene: Scene, image: np.ndarray) -> np.ndarray:
    """Return the image after the threshold, grey outside the area of interest."""
    interest = scene.setup.known.interest
    columns = np.arange(image.shape[1])
    inside = (columns >= interest.first[:, None]) & (columns <= interest.last[:, None])
    return np.where(inside, np.where(image < interest.threshold, 0, 255), 150).astype(np.uint8)


def _show(axes: Axes, image: np.ndarray) -> None:
    axes.imshow(image, cmap="gray", vmin=0, vmax=255, interpolation="nearest")


def _picture(image: np.ndarray) -> bytes:
    picture, (axes,) = _panels(4.7)
    _show(axes, image)
    return png(picture)


def _outline(scene: Scene, part: int) -> np.ndarray:
    """Return the closed outline of a part's top in the image, (n, 2) px."""
    shape, (x, y, heading) = scene.sensor.parts[part], scene.pose[part]
    c, s = math.cos(heading), math.sin(heading)
    corners = shape.outline @ np.array([[c, s], [-s, c]]) + (x, y)
    points = projected(scene.setup.optics, np.column_stack([corners, np.full(len(corners), shape.height)]))
    return np.vstack([points, points[:1]])


def _runs(scene: Scene) -> bytes:
    picture = new_figure(6.2, 3.2)
    number = int(np.argmin(np.hypot(*(scene.measures[:, X : X + 2] - scene.pose[2, :2]).T)))
    runs = scene.found.run[scene.found.first[number] : scene.found.first[number + 1]]
    inside, box = scene.found.label == number + 1, scene.found.box[number]
    edge = np.argwhere(inside & ~np.asarray(binary_erosion(inside), dtype=bool))
    outline = _outline(scene, 2)
    for k in range(2):
        axes = picture.add_subplot(1, 2, k + 1)
        axes.set(xticks=[], yticks=[], aspect="equal", xlim=(box[2] - 4, box[3] + 3), ylim=(box[1] + 3, box[0] - 4))
        if k == 0:
            lines = [[(start - 0.35, line), (end - 0.65, line)] for line, start, end, _ in runs]
            axes.add_collection(LineCollection(lines, colors=MUTED, linewidths=2.0))
        else:
            axes.plot(edge[:, 1], edge[:, 0], "s", color=MUTED, markersize=2.6)
        axes.plot(*outline.T, color=FAILURE, linewidth=1.0)
        axes.set_title(("runs", "boundary")[k], fontsize=8.5)
    return png(picture)


def _axes(scene: Scene) -> bytes:
    picture, (axes,) = _panels(1.75)
    top, bottom = 185, 385
    _show(axes, scene.image)
    axes.set_ylim(bottom, top)
    for k, measure in enumerate(scene.measures):
        u, v = scene.found.moment[k, 1:3] / scene.found.moment[k, 0]
        angle = 0.5 * math.atan2(2.0 * measure[XY], measure[XX] - measure[YY])
        axes.plot(u, v, "+", color=SUCCESS, markersize=5)
        if math.hypot(measure[XX] - measure[YY], 2.0 * measure[XY]) > 0.05 * (measure[XX] + measure[YY]):
            reach = 0.5 * math.sqrt(measure[M00])
            axes.plot(
                [u - reach * math.cos(angle), u + reach * math.cos(angle)],
                [v - reach * math.sin(angle), v + reach * math.sin(angle)], color=FAILURE, linewidth=1.0,
            )  # fmt: skip
    return png(picture)


def _template(scene: Scene) -> bytes:
    picture, panels = _panels(3.5, rows=2)
    _show(panels[0], _binary(scene, scene.setup.template_image()))
    places = scene.setup.known.grid.places
    lines = [*places, *places.transpose(1, 0, 2)]
    panels[1].add_collection(LineCollection(lines, colors=SUCCESS, linewidths=0.9))
    panels[1].set(xlim=(0, scene.setup.shape[1]), aspect="equal")
    for axes in panels:
        axes.set_ylim(385, 185)
    return png(picture)
