"""Section 3.5.4 and eq. 3.41: largest speed of a part relative to the table's, over the table's radius and frequency."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from agents.evaluation.figures import INK, MUTED, new_figure, png, style
from studies.thesis.figure import Figure, figure
from studies.thesis.sliding import simulated_velocity, steady
from vibgym import Surface

FRICTION = 0.6
RADIUS, FREQUENCY = 10e-3, 150.0  # m, Hz; ends of the axes
FINEST, LIMIT = 1e-5, 0.4999
"""Ratios of friction to the table's acceleration: smallest on the axes, and limit of permanent sliding (0.5)."""

POINTS = 200
CHECKED = ((2.7e-3, 25.0), (2.7e-3, 12.0), (1e-3, 25.0), (0.5e-3, 25.0), (10e-3, 25.0), (10e-3, 150.0))
"""Radius (m) and frequency (Hz) of the comparison with the simulator."""


def largest_ratio(friction_ratio: Any) -> np.ndarray:
    """Return lambda_v (n,), mean speed over table speed at the lift-off amplitude, for ``mu g / (a_h w^2)`` (n,) below 0.5."""
    return np.hypot(*steady(friction_ratio, 1.0, 1.5 * math.pi).T)


def ratio_map(radius: np.ndarray, frequency: np.ndarray, friction: float) -> np.ndarray:
    """Return lambda_v over radii (m,) in m and frequencies (k,) in Hz, (k, m); NaN where a part may stick."""
    ratio = friction * 9.81 / (radius * (2.0 * math.pi * frequency[:, None]) ** 2)
    nodes = np.append(np.geomspace(FINEST, 0.05, 20), np.linspace(0.06, LIMIT, 45))
    return np.where(ratio < nodes[-1], np.interp(ratio, nodes, largest_ratio(nodes)), np.nan)


def draw() -> Figure:
    """Plot the map, and compare some points with the simulator."""
    radius, frequency = np.linspace(0.0, RADIUS, POINTS + 1)[1:], np.linspace(0.0, FREQUENCY, POINTS + 1)[1:]
    ratios = ratio_map(radius, frequency, FRICTION)
    rows, off = [], 0.0
    for a_h, hertz in CHECKED:
        surface = Surface(horizontal_amplitude=a_h, frequency=hertz)
        ours = np.hypot(*simulated_velocity(surface, FRICTION, [surface.lift_off_amplitude], [1.5 * math.pi])[0])
        ratio = FRICTION * surface.gravity / (surface.table_speed * surface.angular_frequency)
        simulated, solved = float(ours / surface.table_speed), float(largest_ratio([ratio])[0])
        off = max(off, abs(simulated / solved - 1.0))
        rows.append({
            "Amplitude, frequency": f"{1e3 * a_h:.1f} mm, {hertz:.0f} Hz", "mu g / (a_h w^2)": f"{ratio:.4f}",
            "Equation": f"{solved:.4f}", "Simulator": f"{simulated:.4f}",
        })  # fmt: skip
    values = {
        "fastest": float(np.nanmax(ratios)),
        "slowest": float(largest_ratio([LIMIT])[0]),
        "share": 100.0 * (ratios[np.isfinite(ratios)] > 0.70).mean(),
        "prototype": float(ratio_map(np.array([2.7e-3]), np.array([25.0]), FRICTION)[0, 0]),
        "off": 100.0 * off,
    }
    return figure("speed_ratio", values, [_plot(radius, frequency, ratios)], rows)


def _plot(radius: np.ndarray, frequency: np.ndarray, ratios: np.ndarray) -> bytes:
    picture = new_figure(6.2, 3.4)
    axes = picture.add_subplot()
    image = axes.pcolormesh(1e3 * radius, frequency, ratios, cmap="viridis", vmin=0.66, vmax=0.72, shading="nearest")
    axes.contour(1e3 * radius, frequency, np.nan_to_num(ratios), levels=[0.70], colors="white", linewidths=1.0)
    axes.plot(2.7, 25.0, "o", color=INK, markersize=4, markerfacecolor="white")
    style(axes, xlabel="horizontal amplitude, mm", ylabel="frequency, Hz")
    axes.grid(False)
    bar = picture.colorbar(image, ax=axes)
    bar.ax.tick_params(colors=MUTED, labelsize=7.5)
    bar.set_label("largest mean speed / table speed", color=MUTED, fontsize=8)
    return png(picture)
