"""Fig. 6.1: admissible horizontal amplitudes and frequencies of a machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.figures import INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure
from studies.thesis.speed_ratio import ratio_map
from vibgym import Surface

GRAVITY = 9.81
FRICTION = 0.6  # the thesis's design value
MAX_ACCELERATION = 100.0 * GRAVITY


class Condition(NamedTuple):
    """Condition on the horizontal amplitude a_h (m) and the rate w (rad/s), and its source."""

    title: str
    holds: Callable[[Any, Any], Any]
    source: str


CONDITIONS = (
    Condition("(a) always slides", lambda a_h, w: a_h * w**2 > 2.0 * FRICTION * GRAVITY, "thesis, section 6.2.1"),
    # the largest mean speed is 0.7 a_h w (eq. 3.41)
    Condition("(b) 0.1 m/s or more", lambda a_h, w: 0.7 * a_h * w >= 0.1, "named in section 6.5; the value is assumed"),
    Condition("(c) below 100 g", lambda a_h, w: a_h * w**2 < MAX_ACCELERATION, "thesis, section 6.2.1"),
    # for the transfer of parts to adjacent machines
    Condition(
        "(d) at most 5 mm", lambda a_h, w: (a_h <= 5e-3) & (w > 0.0), "named in section 6.5; the value is assumed"
    ),
    # the lift-off amplitude is at least the smallest that actuators realise
    Condition("(e) 0.1 mm reached", lambda a_h, w: (GRAVITY / w**2 >= 1e-4) & (a_h > 0.0), "assumed, from section 7.2"),
)


def all_hold(radius: Any, rate: Any) -> np.ndarray:
    """Return whether all conditions hold for a_h, m, and w, rad/s."""
    return np.logical_and.reduce([condition.holds(radius, rate) for condition in CONDITIONS])


def frequencies(radius: float) -> tuple[float, float]:
    """Return the smallest and largest admissible frequency (Hz) for a radius (m), to 0.01 Hz; NaN without any."""
    hertz = np.arange(0.01, 1600.0, 0.01)
    good = hertz[all_hold(radius, 2.0 * math.pi * hertz)]
    return (float(good[0]), float(good[-1])) if len(good) else (math.nan, math.nan)


def draw() -> Figure:
    """Plot the five conditions and their intersection."""
    surface = Surface()
    radius, rate = surface.horizontal_amplitude, surface.angular_frequency
    low, high = frequencies(radius)
    ratio = ratio_map(np.array([radius]), np.array([surface.frequency]), FRICTION)[0, 0]
    holds = bool(all_hold(radius, rate))
    values = {
        "slide": radius * rate**2 / (2.0 * FRICTION * GRAVITY),
        "acceleration": radius * rate**2 / GRAVITY,
        "speed": ratio * surface.table_speed,
        "all": "yes" if holds else "no",
        "verdict": "agrees" if holds else "differs",
        "low": low,
        "high": high,
        "heaviest": math.sqrt(MAX_ACCELERATION / radius) / (2.0 * math.pi),
    }
    rows = [{"Panel": condition.title, "Source": condition.source} for condition in CONDITIONS]
    return figure("parameter_study", values, [_plot(radius, rate)], rows)


def _plot(own_radius: float, own_rate: float) -> bytes:
    """Plot where each condition is met, and the radius and rate of a machine."""
    radius, rate = np.geomspace(1e-6, 1.0, 301), np.geomspace(10.0, 1e4, 241)[:, None]
    picture = new_figure(7.6, 4.6)
    panels = picture.subplots(2, 3, sharex=True, sharey=True)
    conditions = [*CONDITIONS, Condition("(f) all", all_hold, "")]
    for k, (axes, (title, holds, _)) in enumerate(zip(panels.flat, conditions, strict=True)):
        axes.pcolormesh(radius, rate[:, 0], np.where(holds(radius, rate), 0.8, 1.0), cmap="gray", vmin=0.0, vmax=1.0)
        axes.plot(own_radius, own_rate, "o", color=SUCCESS, markersize=4)
        axes.set(xscale="log", yscale="log", title=title)
        axes.minorticks_off()
        axes.set_xticks([1e-6, 1e-4, 1e-2, 1.0], ["1 um", "0.1 mm", "10 mm", "1 m"])
        axes.set_yticks([10.0, 100.0, 1e3, 1e4], ["10", "100", "1000", "10000"])
        labels = {"xlabel": "horizontal amplitude"} if k > 2 else {}
        style(axes, **labels, **({"ylabel": "rate, rad/s"} if k % 3 == 0 else {}))
        axes.grid(False)
        axes.tick_params(colors=MUTED)
        for spine in axes.spines.values():
            spine.set(color=INK, linewidth=0.4)
    return png(picture)
