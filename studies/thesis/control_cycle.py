"""Table 7.1 and fig. 7.7: execution time of a cycle of the control software over the number of objects."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table
from studies.thesis.state_feedback import Estimate, Observer, feedback
from studies.thesis.velocity import DEAD_ZONE
from vibgym import Surface
from vibgym.actuators import DataSheet
from vibgym.allocation import Allocator
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.physics.core.records import new_state
from vibgym.plugins.camera.objects import find, new_found
from vibgym.plugins.camera.sampling import measure_object
from vibgym.scene.parts import shipped_part
from vibgym.sensing import SENSORS

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
    taken = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        work()
        taken.append(time.perf_counter() - start)
    return float(np.median(taken))


def cycle(objects: int) -> Cycle:
    """Measure the times for a surface with ``objects`` aluminium blocks on two lines."""
    surface, parts, random = Surface(), [shipped_part("aluminium_block")] * objects, np.random.default_rng(objects)
    start = np.array(
        [[0.13 + 0.19 * (p // 2), 0.055 + 0.1 * (p % 2), random.uniform(-3.0, 3.0)] for p in range(objects)]
    )
    pose, present = start[None], np.ones((1, objects), dtype=bool)

    camera = SENSORS.make("sensor", {"kind": "camera", "lines": "half", "edge": "threshold"}, surface, parts, 1, 1)
    state = new_state(1, objects)
    state.pose[0], state.fallen[:] = start, False
    camera.keep_pictures()
    camera.reset(np.array([0]), state, np.array([[0.3, 0.6]]))
    image, known = camera.image()[0], camera.setup.known
    found, measures = new_found(camera.setup.shape, 4 * objects + 16), np.zeros((4 * objects + 16, 10))

    def look() -> None:
        find(image, known.interest, found)
        for k in range(int(found.count[0])):
            measure_object(image, known, found, k, measures[k])

    observer, process = Observer(surface.period), FrictionalInverse(surface, parts)
    estimate, target = Estimate(pose, np.zeros_like(pose)), pose + random.uniform(-0.1, 0.1, pose.shape)

    def control() -> np.ndarray:
        push, acceleration, _ = process.push(estimate.velocity, feedback(target, estimate))
        observer.update(estimate, pose, acceleration)
        return push

    push, limit = control(), surface.lift_off_amplitude
    ideal, real = (Allocator(surface, parts, DataSheet(limit, width)) for width in (0.0, DEAD_ZONE))
    look()  # first calls compile or load kernels
    for each in (ideal, real):
        each.actions(pose, present, push)
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
    period = Surface().period
    return Figure(
        title="Table 7.1 and fig. 7.7: execution time of one control cycle",
        shows="The thesis gives the average times of a cycle in ms for up to eight objects and for several shares of the image "
        "that were searched: in total, for image processing, for control (all blocks of fig. 5.23, with the inverse of the "
        "frictional process solved by iteration) and for a third stage. A cycle must fit into a period of 40 ms. All values "
        "are lost; the axes of fig. 7.7 end at 8 objects and at 80 ms.",
        comparisons=(
            Comparison(
                "A cycle with 1 and with 8 objects",
                "lost; between 0 and 80 ms",
                f"{1e3 * first.total:.2f} ms and {1e3 * last.total:.2f} ms",
                "faster by 25 years of computers; no value to compare",
            ),
            Comparison(
                "Share of a period with 8 objects",
                "lost",
                f"{100.0 * last.total / period:.1f} %",
                "it limited the number of objects in the thesis, but not here",
            ),
            Comparison(
                "Control alone, 8 objects",
                "lost",
                f"{1e3 * (last.blocks + last.allocation):.2f} ms, with a dead zone "
                f"{1e3 * (last.blocks + last.dead_zone):.2f} ms",
                "no value to compare",
            ),
        ),
        differs=f"Only the axes of fig. 7.7 are left. A cycle takes {1e3 * first.total:.2f} ms with one object and "
        f"{1e3 * last.total:.2f} ms with eight, on the computer that drew this page.",
        assumed=(
            "The whole image with half of its lines is searched, as on the prototype; the thesis varied the share.",
            "Every element under a part has its own phasor, in the simulation and in the thesis.",
            "The times of exposure and of sending amplitudes to the elements are excluded.",
        ),
        pictures=(Picture(_plot(cycles), f"Medians of {REPEATS} cycles on one core, by stage."),),
        tables=(
            Table(
                f"Medians of {REPEATS} cycles.",
                ("Objects", "Image processing", "Observer, controller, inverse", "Allocation", "Allocation with a dead zone",
                 "Total"),
                tuple(
                    (str(objects), *(f"{1e3 * each:.3f} ms" for each in (*one, one.total))) for objects, one in cycles.items()
                ),
            ),
        ),
    )  # fmt: skip


def _plot(cycles: dict[int, Cycle]) -> bytes:
    figure = new_figure(6.2, 2.8)
    axes = figure.add_subplot()
    shown = {
        "total": ([each.total for each in cycles.values()], INK, "-"),
        "image processing": ([each.image for each in cycles.values()], SUCCESS, "--"),
        "control": ([each.blocks + each.allocation for each in cycles.values()], FAILURE, "--"),
        "control, dead zone": ([each.blocks + each.dead_zone for each in cycles.values()], FAILURE, ":"),
    }
    for name, (taken, colour, line) in shown.items():
        axes.plot(
            list(cycles), 1e3 * np.array(taken), color=colour, linestyle=line, marker="o", markersize=3, label=name
        )
    style(axes, xlabel="number of objects", ylabel="time of a cycle, ms")
    axes.set_ylim(bottom=0.0)
    axes.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    return png(figure)
