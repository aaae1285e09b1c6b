"""Fig. 6.1: admissible horizontal amplitudes and frequencies of a machine."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.figures import INK, MUTED, SUCCESS, new_figure, png, style
from studies.thesis.figure import Comparison, Figure, Picture, Table, of_range
from studies.thesis.speed_ratio import ratio_map
from vibgym import Surface

GRAVITY = 9.81
FRICTION = 0.6  # the thesis's design value
MIN_SPEED = 0.1  # m/s
MAX_ACCELERATION = 100.0 * GRAVITY
MAX_RADIUS = 5e-3  # m
MIN_AMPLITUDE = 1e-4  # m, that the prototype's elements realise


def slides(radius: Any, rate: Any) -> Any:
    """Return whether a part with friction 0.6 always slides, ``a_h w^2 > 2 mu g``; radius a_h in m, rate w in rad/s."""
    return radius * rate**2 > 2.0 * FRICTION * GRAVITY


def fast_enough(radius: Any, rate: Any) -> Any:
    """Return whether the largest mean speed, 0.7 a_h w (eq. 3.41), reaches 0.1 m/s."""
    return 0.7 * radius * rate >= MIN_SPEED


def light_enough(radius: Any, rate: Any) -> Any:
    """Return whether the centripetal acceleration ``a_h w^2`` is below 100 g."""
    return radius * rate**2 < MAX_ACCELERATION


def narrow_enough(radius: Any, rate: Any) -> Any:
    """Return whether the table moves by at most 5 mm, for the transfer of parts to adjacent machines."""
    return (radius <= MAX_RADIUS) & (rate > 0.0)


def realisable(radius: Any, rate: Any) -> Any:
    """Return whether the lift-off amplitude ``g / w^2`` is at least 0.1 mm, the smallest that actuators realise."""
    return (GRAVITY / rate**2 >= MIN_AMPLITUDE) & (radius > 0.0)


class Condition(NamedTuple):
    """Condition on radius and rate, and its source."""

    title: str
    holds: Callable[[Any, Any], Any]
    source: str


CONDITIONS = (
    Condition("(a) always slides", slides, "thesis, section 6.2.1"),
    Condition("(b) 0.1 m/s or more", fast_enough, "named in section 6.5; the value is assumed"),
    Condition("(c) below 100 g", light_enough, "thesis, section 6.2.1"),
    Condition("(d) at most 5 mm", narrow_enough, "named in section 6.5; the value is assumed"),
    Condition("(e) 0.1 mm reached", realisable, "assumed, from section 7.2"),
)


def all_hold(radius: Any, rate: Any) -> np.ndarray:
    """Return whether all conditions hold."""
    return np.logical_and.reduce([each.holds(radius, rate) for each in CONDITIONS])


def frequencies(radius: float) -> tuple[float, float]:
    """Return the smallest and largest admissible frequency (Hz) for a radius (m), to 0.01 Hz; NaN without any."""
    hertz = np.arange(0.01, 1600.0, 0.01)
    good = hertz[all_hold(radius, 2.0 * math.pi * hertz)]
    return (float(good[0]), float(good[-1])) if len(good) else (math.nan, math.nan)


def draw() -> Figure:
    """Plot the five conditions and their intersection."""
    surface = Surface()
    own = surface.horizontal_amplitude, surface.angular_frequency
    slide = own[0] * own[1] ** 2 / (2.0 * FRICTION * GRAVITY)
    low, high = frequencies(own[0])
    speed = float(ratio_map(np.array([own[0]]), np.array([surface.frequency]), FRICTION)[0, 0]) * surface.table_speed
    heaviest = math.sqrt(MAX_ACCELERATION / own[0]) / (2.0 * math.pi)
    return Figure(
        title="Fig. 6.1: admissible amplitudes and frequencies of a machine",
        shows="The thesis shades, over horizontal amplitude (1 um to 1 m) and rate (10 to 10 000 rad/s), where each "
        "requirement of the machine is met: permanent sliding at full vertical amplitude, a sufficient speed, a "
        "centripetal acceleration below 100 g, and space at the interfaces. The prototype's 2.7 mm and 25 Hz meet "
        "all of them.",
        comparisons=(
            of_range("Prototype: a_h w^2 over 2 mu g (a)", 1.0, None, slide, digits=2),
            of_range("Prototype: centripetal acceleration (c)", None, 100.0, own[0] * own[1] ** 2 / GRAVITY, "g", 1),
            Comparison(
                "Prototype: largest speed (b)", "sufficiently large", f"{speed:.3f} m/s", "the required value is lost"
            ),
            Comparison(
                "Prototype within all conditions (f)", "yes", "yes" if all_hold(*own) else "no",
                "agrees" if all_hold(*own) else "differs",
            ),
            Comparison(
                "Admissible frequencies at 2.7 mm", "lost", f"{low:.1f} to {high:.1f} Hz",
                "lower bound by sliding, upper bound by the 0.1 mm of the elements; 100 g is reached at "
                f"{heaviest:.1f} Hz",
            ),
        ),
        differs=f"Conditions (a) and (c) are the thesis's; the prototype meets (a) by a factor of {slide:.1f} and (c) "
        f"with {own[0] * own[1] ** 2 / GRAVITY:.1f} g of 100. Conditions (b) and (d) are named in its summary, their "
        "values are assumed; (e) is assumed. So the only comparison with (f) is that the prototype meets all "
        "conditions.",
        assumed=(
            "The panels (b), (d) and (e) are lost. Section 6.5 names a sufficiently large velocity and interface "
            "problems: assumed are 0.1 m/s and 5 mm.",
            "Panel (e): the lift-off amplitude is at least 0.1 mm, below which the prototype's elements did not "
            "move.",
        ),
        pictures=(
            Picture(_plot(own), "Grey: the condition is met. Dot: the prototype. Both axes are logarithmic, as in the thesis."),
        ),
        tables=(
            Table("Sources of the conditions.", ("Panel", "Source"), tuple((each.title, each.source) for each in CONDITIONS)),
        ),
    )  # fmt: skip


def _plot(own: tuple[float, float]) -> bytes:
    """Plot where each condition is met, and the radius and rate of a machine."""
    radius, rate = np.geomspace(1e-6, 1.0, 301), np.geomspace(10.0, 1e4, 241)[:, None]
    figure = new_figure(7.6, 4.6)
    panels = figure.subplots(2, 3, sharex=True, sharey=True)
    for k, (axes, (title, holds, _)) in enumerate(
        zip(panels.flat, [*CONDITIONS, ("(f) all", all_hold, "")], strict=True)
    ):
        axes.pcolormesh(radius, rate[:, 0], np.where(holds(radius, rate), 0.8, 1.0), cmap="gray", vmin=0.0, vmax=1.0)
        axes.plot(*own, "o", color=SUCCESS, markersize=4)
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
    return png(figure)
