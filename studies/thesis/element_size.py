"""Fig. 6.2: how large elements may be, if fields alone shall align parts on a rectangular grid."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, kind_colour, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

PITCH = 0.052
"""m, of the grid: the next even number of millimetres above the blocks' 50 mm."""

GRID = 4  # points of the grid along each side
PERIODS = 150
PLACES = 100
ALIGNED = 2e-3  # m
SIZES = tuple(PITCH / each for each in (5, 4, 3, 2.5, 2, 1.75, 1.5, 1.25, 1))


def aligned(
    part: Part, element_size: float, pitch: float = PITCH, places: int = 100, seed: int = 62
) -> tuple[np.ndarray, np.ndarray]:
    """Distances (places,) m of parts from the nearest point of the grid in the end, and their poses (places, 3).

    Every element pushes in full towards the point of the grid that is nearest to its centre, along x, y or diagonally; one
    whose centre lies on that point rests. Parts start at random within the middle cells of the grid, one a world.
    """
    count = math.ceil(GRID * pitch / element_size - 1e-9)
    surface = Surface(rows=count, columns=count, element_size=element_size)

    def missing(x: np.ndarray) -> np.ndarray:
        return (np.floor(x / pitch + 1e-9) + 0.5) * pitch - x

    push_x, push_y = (np.sign(np.round(missing(each), 9)) for each in surface.element_centres())
    amplitude = np.where((push_x != 0.0) | (push_y != 0.0), surface.lift_off_amplitude, 0.0)
    random = np.random.default_rng(seed)
    pose = np.empty((places, 1, 3))
    pose[..., :2] = random.uniform(pitch, (GRID - 1) * pitch, (places, 1, 2))
    pose[..., 2] = random.uniform(-math.pi, math.pi, (places, 1))
    simulator = Simulator(surface, part, worlds=places)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    simulator.advance(amplitude, np.arctan2(-push_x, -push_y), PERIODS)
    pose = simulator.pose[:, 0]
    return np.hypot(missing(pose[:, 0]), missing(pose[:, 1])), pose


def draw() -> Figure:
    """Share of the parts that are aligned, by the elements' size, and where they come to rest."""
    parts = {"steel": shipped_part("steel_block"), "aluminium": shipped_part("aluminium_block")}
    results = {(name, size): aligned(part, size, places=PLACES) for name, part in parts.items() for size in SIZES}
    shares = {key: float((distance < ALIGNED).mean()) for key, (distance, _) in results.items()}
    largest = max(size for size in SIZES if min(shares[name, size] for name in parts) == 1.0)
    rows = tuple(
        (
            f"{1e3 * size:.1f} mm",
            *(
                f"{100.0 * shares[name, size]:.1f} % ({1e3 * float(np.median(results[name, size][0])):.2f} mm)"
                for name in parts
            ),
        )
        for size in SIZES
    )
    return Figure(
        title="Fig. 6.2: the largest elements that align parts on a grid",
        shows="The thesis draws the largest size of the elements with which fields alone, without a sensor, align "
        "parts on a rectangular grid. Its drawing and its formula are lost; the prototype's elements measure 26 mm.",
        comparisons=(
            Comparison(
                "Size of an element, for blocks of 50 mm on a grid of 52 mm", "26 mm (the prototype)",
                f"{1e3 * largest:.1f} mm", "none, but the pitch is our assumption",
            ),
            Comparison(
                "Largest element over the pitch of the grid", "lost", f"{largest / PITCH:.2f}",
                "the formula is lost; half the pitch fits the prototype's size",
            ),
            Comparison(
                "Blocks aligned with elements of half the pitch", "all, by intention",
                ", ".join(f"{100.0 * shares[name, 0.5 * PITCH]:.0f} % ({name})" for name in parts), "agrees",
            ),
        ),
        differs="A point of the grid attracts parts where elements that push towards it meet, so that each point "
        "needs at least two by two elements of its own: an element is at most half the pitch. The simulation bears "
        "that out, and for the prototype's blocks it gives the prototype's size; smaller elements align all parts "
        "if an even number of them makes up the pitch. Whether the thesis argued so is not known.",
        assumed=(
            "The pitch: 52 mm, at which blocks of 50 mm stand side by side.",
            "Ideal elements at the lift-off amplitude, each pushing towards the nearest point of the grid; phases "
            "are not corrected for friction.",
        ),
        pictures=(
            Picture(
                _plot(shares, results["aluminium", 0.5 * PITCH][1]),
                f"Left: share aligned after {PERIODS * Surface().period:.0f} s, by size; line: half the pitch. "
                f"Right: where aluminium blocks rest on elements of 26 mm, {PLACES} random starts; crosses: the "
                "grid.",
            ),
        ),
        tables=(
            Table("Aligned, and median distance from the grid.", ("Element", *(name.capitalize() for name in parts)), rows),
        ),
    )  # fmt: skip


def _plot(shares: dict[tuple[str, float], float], resting: np.ndarray) -> bytes:
    """Shares over the elements' size, and poses (places, 3) in which aluminium blocks rest."""
    figure = new_figure(7.6, 3.2)
    left, right = figure.subplots(1, 2)
    for name, colour, marker in (("steel", INK, "o"), ("aluminium", FAILURE, "x")):
        left.plot(
            [1e3 * size for size in SIZES], [100.0 * shares[name, size] for size in SIZES], color=colour, marker=marker,
            markersize=4, linewidth=1.0, label=name,
        )  # fmt: skip
    left.axvline(0.5e3 * PITCH, color=SUCCESS, linewidth=0.8)
    left.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    style(left, xlabel="size of an element, mm", ylabel=f"within {1e3 * ALIGNED:.0f} mm of the grid, %")
    _draw_places(right, shipped_part("aluminium_block"), resting)
    return png(figure)


def _draw_places(axes: Axes, part: Part, pose: np.ndarray) -> None:
    for x, y, heading in pose:
        c, s = math.cos(heading), math.sin(heading)
        place = part.outline @ np.array([[c, s], [-s, c]]) + (x, y)
        axes.add_patch(Polygon(1e3 * place, facecolor=(*kind_colour(0)[:3], 0.03), edgecolor=INK, linewidth=0.3))
    grid = 1e3 * PITCH * (np.arange(GRID) + 0.5)
    axes.plot(*np.meshgrid(grid, grid), "+", color=FAILURE, markersize=5)
    style(axes, xlabel="x, mm", ylabel="y, mm")
    edge = 0.5e3 * PITCH * np.arange(2 * GRID + 1)
    axes.set(xlim=(0, edge[-1]), ylim=(0, edge[-1]), aspect="equal", xticks=edge[::2], yticks=edge[::2])
