"""Fig. 6.2: largest element size with which fields alone align parts on a rectangular grid."""

from __future__ import annotations

import math

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Polygon

from agents.evaluation.figures import FAILURE, INK, MUTED, SUCCESS, kind_colour, new_figure, png, style
from studies.thesis.figure import Figure, figure
from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part

PITCH = 0.052
"""m, of the grid: the next even number of mm above the 50 mm of the blocks."""

GRID = 4  # points of the grid along each side
PERIODS = 150
STARTS = 100
ALIGNED = 2e-3  # m
SIZES = tuple(PITCH / count for count in (5, 4, 3, 2.5, 2, 1.75, 1.5, 1.25, 1))


def aligned(
    part: Part, element_size: float, pitch: float = PITCH, starts: int = STARTS, seed: int = 62
) -> tuple[np.ndarray, np.ndarray]:
    """Return final distances (starts,) m of parts from the nearest point of the grid, and their poses (starts, 3).

    Every element pushes with full amplitude towards the nearest point of the grid, along x, y or diagonally; an element on that
    point rests. Parts start at random poses in the middle cells of the grid, one per world.
    """
    count = math.ceil(GRID * pitch / element_size - 1e-9)
    surface = Surface(rows=count, columns=count, element_size=element_size)

    def missing(x: np.ndarray) -> np.ndarray:
        return (np.floor(x / pitch + 1e-9) + 0.5) * pitch - x

    push_x, push_y = (np.sign(np.round(missing(centres), 9)) for centres in surface.element_centres())
    amplitude = np.where((push_x != 0.0) | (push_y != 0.0), surface.lift_off_amplitude, 0.0)
    random = np.random.default_rng(seed)
    pose = np.empty((starts, 1, 3))
    pose[..., :2] = random.uniform(pitch, (GRID - 1) * pitch, (starts, 1, 2))
    pose[..., 2] = random.uniform(-math.pi, math.pi, (starts, 1))
    simulator = Simulator(surface, part, worlds=starts)
    simulator.reset(pose, [*surface.idle_velocity(part.friction), 0.0])
    simulator.advance(amplitude, np.arctan2(-push_x, -push_y), PERIODS)
    pose = simulator.pose[:, 0]
    return np.hypot(missing(pose[:, 0]), missing(pose[:, 1])), pose


def draw() -> Figure:
    """Compute and plot the share of aligned parts over the element size, and their final poses."""
    parts = {"steel": shipped_part("steel_block"), "aluminium": shipped_part("aluminium_block")}
    results = {(name, size): aligned(part, size, starts=STARTS) for name, part in parts.items() for size in SIZES}
    shares = {key: 100.0 * float((distance < ALIGNED).mean()) for key, (distance, _) in results.items()}
    largest = max(size for size in SIZES if all(shares[name, size] == 100.0 for name in parts))
    values = {
        "largest": 1e3 * largest,
        "ratio": largest / PITCH,
        "half": ", ".join(f"{shares[name, 0.5 * PITCH]:.0f} % ({name})" for name in parts),
    }
    rows = [
        {"Element": f"{1e3 * size:.1f} mm"}
        | {
            name.capitalize(): f"{shares[name, size]:.1f} % ({1e3 * float(np.median(results[name, size][0])):.2f} mm)"
            for name in parts
        }
        for size in SIZES
    ]
    return figure("element_size", values, [_plot(shares, results["aluminium", 0.5 * PITCH][1])], rows)


def _plot(shares: dict[tuple[str, float], float], resting: np.ndarray) -> bytes:
    """Plot the shares (%) over the element size, and final poses (starts, 3) of aluminium blocks."""
    picture = new_figure(7.6, 3.2)
    left, right = picture.subplots(1, 2)
    sizes = 1e3 * np.array(SIZES)
    for name, colour, marker in (("steel", INK, "o"), ("aluminium", FAILURE, "x")):
        share = [shares[name, size] for size in SIZES]
        left.plot(sizes, share, color=colour, marker=marker, markersize=4, linewidth=1.0, label=name)
    left.axvline(0.5e3 * PITCH, color=SUCCESS, linewidth=0.8)
    left.legend(frameon=False, fontsize=7.5, labelcolor=MUTED)
    style(left, xlabel="element size, mm", ylabel=f"within {1e3 * ALIGNED:.0f} mm of the grid, %")
    _draw_poses(right, shipped_part("aluminium_block"), resting)
    return png(picture)


def _draw_poses(axes: Axes, part: Part, pose: np.ndarray) -> None:
    for x, y, heading in pose:
        c, s = math.cos(heading), math.sin(heading)
        corners = part.outline @ np.array([[c, s], [-s, c]]) + (x, y)
        axes.add_patch(Polygon(1e3 * corners, facecolor=(*kind_colour(0)[:3], 0.03), edgecolor=INK, linewidth=0.3))
    grid = 1e3 * PITCH * (np.arange(GRID) + 0.5)
    axes.plot(*np.meshgrid(grid, grid), "+", color=FAILURE, markersize=5)
    style(axes, xlabel="x, mm", ylabel="y, mm")
    edge = 0.5e3 * PITCH * np.arange(2 * GRID + 1)
    axes.set(xlim=(0, edge[-1]), ylim=(0, edge[-1]), aspect="equal", xticks=edge[::2], yticks=edge[::2])
