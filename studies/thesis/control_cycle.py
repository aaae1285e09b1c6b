"""Table 7.1 and fig. 7.7: execution time of a cycle of the control software over the number of objects."""

from __future__ import annotations

import timeit
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.camera_chain import camera
from studies.thesis.figure import Figure, figure
from studies.thesis.state_feedback import Estimate, Observer, feedback
from studies.thesis.velocity import DEAD_ZONE
from vibgym import Surface
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.plugins.camera.objects import find, new_found
from vibgym.plugins.camera.sampling import measure_object
from vibgym.scene.parts import shipped_part

OBJECTS = (1, 2, 4, 6, 8)
REPEATS = 200


class Cycle(NamedTuple):
    """Median times of the stages of a cycle, s."""

    image: float  # detection of objects, boundaries, moments, positions on the surface
    blocks: float  # observer, controller and inverse of the frictional process
    allocation: float  # phasors of the elements under the parts
    dead_zone: float  # allocation with elements that rest or exceed the dead zone

    @property
    def total(self) -> float:
        """Time with ideal elements, s."""
        return self.image + self.blocks + self.allocation


def median_time(work: Callable[[], object]) -> float:
    """Return the median time of a call, s."""
    return float(np.median(timeit.repeat(work, number=1, repeat=REPEATS)))


def cycle(objects: int) -> Cycle:
    """Measure the times for a surface with ``objects`` aluminium blocks on two lines."""
    surface, parts, random = Surface(), [shipped_part("aluminium_block")] * objects, np.random.default_rng(objects)
    start = np.array(
        [[0.13 + 0.19 * (p // 2), 0.055 + 0.1 * (p % 2), random.uniform(-3.0, 3.0)] for p in range(objects)]
    )
    pose, present = start[None], np.ones((1, objects), dtype=bool)

    sensor = camera(parts, start, "half")
    image, known = sensor.image()[0], sensor.setup.known
    blobs, measures = new_found(sensor.setup.shape, 4 * objects + 16), np.zeros((4 * objects + 16, 10))

    def look() -> None:
        find(image, known.interest, blobs)
        for k in range(int(blobs.count[0])):
            measure_object(image, known, blobs, k, measures[k])

    observer, process = Observer(surface.period), FrictionalInverse(surface, parts)
    estimate, target = Estimate(pose, np.zeros_like(pose)), pose + random.uniform(-0.1, 0.1, pose.shape)

    def control() -> np.ndarray:
        push, acceleration, _ = process.push(estimate.velocity, feedback(target, estimate))
        observer.update(estimate, pose, acceleration)
        return push

    push, limit = control(), surface.lift_off_amplitude
    ideal, real = (Allocator(surface, parts, DataSheet(limit, width)) for width in (0.0, DEAD_ZONE))
    look()  # first calls compile or load kernels
    for allocator in (ideal, real):
        allocator.actions(pose, present, push)
    return Cycle(
        median_time(look),
        median_time(control),
        median_time(lambda: ideal.actions(pose, present, push)),
        median_time(lambda: real.actions(pose, present, push)),
    )


def draw() -> Figure:
    """Measure and plot the times over the number of objects."""
    cycles = {objects: cycle(objects) for objects in OBJECTS}
    first, last = cycles[OBJECTS[0]], cycles[OBJECTS[-1]]
    values = {
        "first": 1e3 * first.total,
        "last": 1e3 * last.total,
        "share": 100.0 * last.total / Surface().period,
        "control": 1e3 * (last.blocks + last.allocation),
        "with_zone": 1e3 * (last.blocks + last.dead_zone),
    }
    heads = ("Image processing", "Observer, controller, inverse", "Allocation", "Allocation with a dead zone", "Total")
    rows = [
        {
            "Objects": str(objects),
            **{head: f"{1e3 * t:.3f} ms" for head, t in zip(heads, (*one, one.total), strict=True)},
        }
        for objects, one in cycles.items()
    ]
    return figure("control_cycle", values, [_plot(cycles)], rows)


def _plot(cycles: dict[int, Cycle]) -> bytes:
    picture = new_figure(6.2, 2.8)
    axes = picture.add_subplot()
    image, blocks, allocation, dead_zone = 1e3 * np.array(list(cycles.values())).T
    for name, times, colour, line in (
        ("total", image + blocks + allocation, INK, "-"),
        ("image processing", image, SUCCESS, "--"),
        ("control", blocks + allocation, FAILURE, "--"),
        ("control, dead zone", blocks + dead_zone, FAILURE, ":"),
    ):
        axes.plot(list(cycles), times, color=colour, linestyle=line, marker="o", markersize=3, label=name)
    style(axes, xlabel="number of objects", ylabel="time of a cycle, ms")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(picture)
