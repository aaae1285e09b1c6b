"""Figs. 3.15 to 3.20: tilt of a cylinder on its rim, for candidates of its lost size, on tables at rest and in motion."""

from __future__ import annotations

import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from scipy.optimize import root_scalar

from agents.evaluation.figures import FAILURE, INK, MUTED, POLICY_COLOURS, SUCCESS, new_figure, png, style
from studies.thesis.figure import Figure, figure, listed, span
from studies.thesis.rim import AZIMUTH, LEANING, NODDING, SPIN, STATES, TILT, V_X, V_Y, Motion, Rim, follow
from vibgym import Surface, checks

STILL = Surface(horizontal_amplitude=0.0)
"""Table at rest."""

DRIVE = Surface()
"""Drive of the prototype: 2.7 mm, 25 Hz."""

REVOLUTION = 2.0 * math.pi


class Start(NamedTuple):
    """Start in the thesis's Cardan angles, rad, and rates, rad/s: the orientation is ``R_y(theta) R_x(psi) R_z(phi)``."""

    theta: float
    psi: float = 0.0
    phi_rate: float = 0.0
    theta_rate: float = 0.0
    psi_rate: float = 0.0


@dataclass(frozen=True)
class Cylinder:
    """Solid homogeneous cylinder on the rim of its bottom.

    Args:
        radius: m.
        centre_height: of the centre of mass above the bottom, half the height, m; 0: thin disc.
        friction: of the rim; infinite: no slip.
    """

    radius: float
    centre_height: float
    friction: float = math.inf

    @property
    def inertia(self) -> tuple[float, float]:
        """Moments of inertia across and along the axis per unit of mass, j1 and j3, m^2."""
        return 0.25 * self.radius**2 + self.centre_height**2 / 3.0, 0.5 * self.radius**2

    def rim(self, table: Surface = STILL) -> Rim:
        """Return the arguments of the kernels for a table with the horizontal motion of a surface."""
        return Rim(
            self.radius, self.centre_height, *self.inertia, self.friction, table.gravity, table.horizontal_amplitude,
            table.angular_frequency,
        )  # fmt: skip

    def released(
        self, tilt: float, nod: float = 0.0, lean: float = 0.0, spin: float = 0.0, azimuth: float = 0.0
    ) -> np.ndarray:
        """Return a state (10,) without slip, with spins about w, u and k (see :mod:`studies.thesis.rim`).

        Args:
            tilt: of the axis, rad, in (0, pi/2].
            nod, lean, spin: rad/s.
            azimuth: direction of the lean, rad.
        """
        state = np.zeros(STATES)
        state[[TILT, AZIMUTH, SPIN, LEANING, NODDING]] = tilt, azimuth, spin, lean, nod
        forward = nod * (self.radius * math.sin(tilt) + self.centre_height * math.cos(tilt))
        sideways = -(spin * self.radius + lean * self.centre_height)
        state[V_X] = forward * math.cos(azimuth) - sideways * math.sin(azimuth)
        state[V_Y] = forward * math.sin(azimuth) + sideways * math.cos(azimuth)
        return state

    def released_as(self, start: Start) -> np.ndarray:
        """Return the state for the thesis's angles and rates."""
        theta, psi = start.theta, start.psi
        k = np.array([math.sin(theta) * math.cos(psi), -math.sin(psi), math.cos(theta) * math.cos(psi)])
        nodal = np.array([math.cos(theta), 0.0, -math.sin(theta)])  # about which psi turns
        omega = start.theta_rate * np.array([0.0, 1.0, 0.0]) + start.psi_rate * nodal + start.phi_rate * k
        azimuth, tilt = math.atan2(k[1], k[0]), math.atan2(math.hypot(k[0], k[1]), k[2])
        w = np.array([-math.sin(azimuth), math.cos(azimuth), 0.0])
        return self.released(tilt, float(omega @ w), float(omega @ np.cross(w, k)), float(omega @ k), azimuth)

    def idling(self, table: Surface, tilt: float, spin: float = 0.0, azimuth: float = 0.0) -> np.ndarray:
        """Return a state with the centre of mass at rest in the room while the table moves: the rim slides."""
        state = self.released(tilt, spin=spin, azimuth=azimuth)
        state[[V_X, V_Y]] = 0.0, -table.horizontal_amplitude * table.angular_frequency
        return state


def height_of_constant_tilt(
    radius: float, tilt: float, lean: float, spin: float, gravity: float = STILL.gravity
) -> float:
    """Return the centre height (m) for which a cylinder rolls at constant tilt with these spins about u and k (rad/s).

    The acceleration of the tilt is zero for the roots of a quadratic equation.

    Raises:
        ValueError: no root is positive.
    """
    a, n, r, cotangent = lean, spin, radius, 1.0 / math.tan(tilt)
    roots = np.roots([
        -4.0 / 3.0 * a * a * cotangent,
        -a * n * r * cotangent - a * a * r - gravity * math.sin(tilt),
        -0.25 * a * a * r * r * cotangent - 1.5 * a * n * r * r + r * gravity * math.cos(tilt),
    ])  # fmt: skip
    heights = [float(root.real) for root in roots if root.imag == 0.0 and root.real > 0.0]
    if not heights:
        raise checks.refuse("radius", radius, "a radius with a positive root")
    return min(heights)


FREQUENCY = 10.64
"""Hz, frequency of the tilt in fig. 3.15."""

START_SPIN = -2.5 * REVOLUTION
"""rad/s, of most starts."""

START_TILT = math.radians(5.0)
"""rad, of figs. 3.17 and 3.19."""

FRICTION = 0.6
"""Of a sliding rim."""

SHOWN = 0.2
"""s, time axis of the figures."""

DIRECTIONS = 8
"""Number of initial directions of the lean on a moving table."""

DISTURBANCES = tuple(
    (along, 0.0) if first else (0.0, along)
    for along in (math.radians(100.0), math.radians(-100.0), math.radians(270.0), math.radians(-270.0))
    for first in (True, False)
)
"""Rates of theta and psi at the eight starts of fig. 3.19, rad/s; in the thesis the tilt of the last is constant."""

COARSE = {"step": 5e-5, "arc": 0.05}
"""Step limits with which the energy error of these motions is below 1e-6."""


def release(
    cylinder: Cylinder, tilt: float, spin: float = START_SPIN, azimuth: float = 0.0, radius: float = 0.0,
    duration: float = SHOWN,
) -> Motion:  # fmt: skip
    """Release a cylinder at rest except for its spin; the table moves on a circle of ``radius`` m.

    With finite friction, the centre of mass is at rest in the room at the start, otherwise at rest relative to the table.
    """
    table = replace(STILL, horizontal_amplitude=radius)
    if math.isinf(cylinder.friction):
        start = cylinder.released(tilt, spin=spin, azimuth=azimuth)
    else:
        start = cylinder.idling(table, tilt, spin, azimuth)
    return follow(cylinder.rim(table), start, duration, **COARSE)


def undriven_frequency(cylinder: Cylinder, tilt: float, spin: float = START_SPIN) -> float:
    """Return the frequency of the tilt, Hz, after a release at rest on a table at rest."""
    return release(cylinder, tilt, spin, duration=2.0 * SHOWN).frequency


@dataclass(frozen=True)
class Candidate:
    """Cylinder whose tilt has the frequency :data:`FREQUENCY` after a release at rest from ``tilt`` (rad)."""

    cylinder: Cylinder
    tilt: float

    @property
    def size(self) -> str:
        """Radius and centre height as text."""
        return f"{1e3 * self.cylinder.radius:.0f} mm, {1e3 * self.cylinder.centre_height:.2f} mm"

    @functools.cached_property
    def at_rest(self) -> Motion:
        """Motion on a table at rest."""
        return release(self.cylinder, self.tilt)

    @functools.cached_property
    def disturbed(self) -> list[Motion]:
        """The eight motions of fig. 3.19, on a table at rest."""
        starts = [self.cylinder.released_as(Start(START_TILT, 0.0, START_SPIN, *rates)) for rates in DISTURBANCES]
        return [follow(self.cylinder.rim(), start, SHOWN, **COARSE) for start in starts]

    def all_directions(self, radius: float, spin: float = START_SPIN, friction: float = math.inf) -> list[Motion]:
        """Release it in :data:`DIRECTIONS` directions of the lean, see :func:`release`."""
        cylinder = replace(self.cylinder, friction=friction)
        angles = np.linspace(0.0, REVOLUTION, DIRECTIONS, endpoint=False).tolist()
        return [release(cylinder, self.tilt, spin, angle, radius) for angle in angles]


def from_five_degrees(radius: float) -> Candidate:
    """Return the candidate of this radius (m) whose tilt at the release is 5 deg."""

    def off(height: float) -> float:
        return undriven_frequency(Cylinder(radius, height), START_TILT) - FREQUENCY

    return Candidate(Cylinder(radius, _root(off, 0.01, 2.0 * radius + 0.01)), START_TILT)


def of_constant_tilt(radius: float) -> Candidate:
    """Return the candidate of this radius (m) with a constant tilt in the last start of fig. 3.19."""
    cylinder = Cylinder(radius, height_of_constant_tilt(radius, START_TILT, DISTURBANCES[-1][1], START_SPIN))

    def off(tilt: float) -> float:
        return undriven_frequency(cylinder, tilt) - FREQUENCY

    return Candidate(cylinder, _root(off, math.radians(8.0), math.radians(30.0)))


def _root(off: Callable[[float], float], low: float, high: float) -> float:
    return float(root_scalar(off, bracket=(low, high), method="brentq", xtol=1e-8).root)


# -- quantities --------------------------------------------------------------------------------------------------------


def phi_change(motion: Motion) -> float:
    """Return the largest change of phi' from its initial value, revolutions per second."""
    rate = motion.phi_rate
    return float(np.abs(rate - rate[0]).max()) / REVOLUTION


def phi_range(runs: Sequence[Motion]) -> str:
    """Format the range of phi' in some motions."""
    rates = np.concatenate([run.phi_rate for run in runs]) / REVOLUTION
    return f"{rates.min():.2f} to {rates.max():.2f} rev/s"


def lifted(run: Motion) -> float:
    """Return the share of the time in which the table would have to pull, %."""
    return 100.0 * float((run.normal < 0.0).mean())


def median_friction(run: Motion) -> float:
    """Return the median of |F_R|/F_N while the table pushes."""
    return float(np.median(run.needed_friction[run.normal > 0.0]))


def held(run: Motion, friction: float = FRICTION) -> float:
    """Return the share of the time in which the table pushes and this friction suffices, %."""
    return 100.0 * float(((run.needed_friction <= friction) & (run.normal > 0.0)).mean())


def smallest(run: Motion) -> float:
    """Return the smallest tilt, deg."""
    return math.degrees(run.tilt.min())


def largest(run: Motion) -> float:
    """Return the largest tilt, deg."""
    return math.degrees(run.tilt.max())


Runs = Mapping[Candidate, Sequence[Motion]]
CIRCLES = (1e-5, 1e-4)
"""m, small radii of the table's motion, compared with the real one."""

SLIGHT = 1e-5
"""m, motion of the table that just keeps a cylinder without rotation from falling flat."""

STEPS, ARCS = (2e-4, 1e-4, 5e-5), (math.inf, 0.3, 0.03)
"""s and rad, step limits of the table of energy errors."""

TALL, FLAT = (0.015, 0.020, 0.030), (0.015, 0.020, 0.025, 0.030)
"""m, radii of candidates: with the frequency from 5 deg, and with constant tilt in fig. 3.19."""

DRAWN_TALL, DRAWN_FLAT = 0.020, 0.025
"""m, radii of the candidates in the plots."""


def draw() -> Figure:
    """Compute and plot the figures of the thesis for both kinds of cylinder, and the motion on the real drive."""
    tall = {radius: from_five_degrees(radius) for radius in TALL}
    flat = {radius: of_constant_tilt(radius) for radius in FLAT}
    both = (*tall.values(), *flat.values())
    one, other = tall[DRAWN_TALL], flat[DRAWN_FLAT]
    rolling = {case: case.all_directions(DRIVE.horizontal_amplitude) for case in both}
    sliding = {case: case.all_directions(DRIVE.horizontal_amplitude, friction=FRICTION) for case in both}
    driven = [run for runs in rolling.values() for run in runs]
    values = {
        **_sizes(tuple(tall.values()), tuple(flat.values())),
        **_trends(one, other),
        "required": span([median_friction(run) for run in driven]),
        "holds": span([held(run) for run in driven], digits=0),
        "pulled": span([lifted(run) for run in driven], digits=0),
        "left": span([abs(float(run.phi_rate[-1])) / REVOLUTION for runs in sliding.values() for run in runs]),
        "tall": one.size,
        "flat": other.size,
        "flat_tilt": math.degrees(other.tilt),
        "tilts": span([math.degrees(case.tilt) for case in flat.values()], 0),
        "steepest": other.at_rest.needed_friction.max(),
        "smallest_tall": tall[min(TALL)].size,
        "directions": DIRECTIONS,
    }
    pictures = [_thesis_plot(one, other), _drive_plot((one, other), rolling, sliding)]
    tables = _of_candidates(both), _of_circles(rolling), _of_sliding(sliding), _of_steps(tall[min(TALL)])
    return figure("cylinder", values, pictures, *tables)


def _sizes(tall: Sequence[Candidate], flat: Sequence[Candidate]) -> dict[str, object]:
    """Return the values of comparisons that depend on the size of the cylinder."""
    kinds = {"tall": tall, "flat": flat}
    change = {case: 100.0 * phi_change(case.at_rest) / 2.5 for case in (*tall, *flat)}
    fall = {case: math.degrees(float(np.ptp(case.disturbed[-1].tilt))) for case in (*tall, *flat)}
    top = {case: max(largest(run) for run in case.disturbed) for case in (*tall, *flat)}
    return {
        "fall_tall": span([fall[case] for case in tall]),
        "fall_flat": max(fall[case] for case in flat),
        **{f"top_{kind}": span([top[case] for case in some]) for kind, some in kinds.items()},
        **{f"phi_{kind}": phi_range([run for case in some for run in case.disturbed]) for kind, some in kinds.items()},
        "sizes": "; ".join(f"({case.size}) from {math.degrees(case.tilt):.1f} deg" for case in (*tall, *flat)),
        "change_tall": span([change[case] for case in tall]),
        "change_flat": ", ".join(f"{change[case]:.1f} % ({case.size})" for case in flat),
        "nearest": min(flat, key=lambda case: abs(change[case] - 9.0)).size,
    }


def _trends(tall: Candidate, flat: Candidate) -> dict[str, object]:
    """Return the values of statements of the thesis about any cylinder, for a tall and a flat one."""
    still = [phi_change(run) for run in flat.all_directions(SLIGHT, spin=0.0)]
    by_tilt = [undriven_frequency(flat.cylinder, math.radians(tilt)) for tilt in (2.0, 5.0, 10.0)]
    by_spin = [undriven_frequency(flat.cylinder, flat.tilt, spin * REVOLUTION) for spin in (1.0, 2.5, 5.0)]
    poses = [
        release(case.cylinder, math.radians(tilt), azimuth=0.25 * REVOLUTION * turn)
        for case in (tall, flat) for tilt in (2.0, 5.0) for turn in range(4)
    ]  # fmt: skip
    apart = max(float(np.abs(run.tilt - poses[k - k % 4].tilt).max()) for k, run in enumerate(poses))
    return {
        "by_tilt": listed(by_tilt, 1, "Hz"),
        "by_spin": listed(by_spin, 2, "Hz"),
        "still": span(still, 2),
        "apart": math.degrees(apart),
        "poses": phi_range(poses),
        "least_tall": [smallest(run) for run in tall.disturbed[:2]],
        "least_flat": [smallest(run) for run in flat.disturbed[:2]],
        "fading": max(release(case.cylinder, case.tilt, duration=1.0).energy_error for case in (tall, flat)),
    }


def _of_candidates(candidates: Sequence[Candidate]) -> list[dict[str, str]]:
    return [
        {
            "Radius, centre height": case.size,
            "Start": f"{math.degrees(case.tilt):.2f} deg",
            "Smallest tilt": f"{smallest(case.at_rest):.2f} deg",
            "Change of phi'": f"{100.0 * phi_change(case.at_rest) / 2.5:.1f} %",
            "|F_R|/F_N, median, largest": f"{median_friction(case.at_rest):.2f}, {case.at_rest.needed_friction.max():.2f}",
            "Largest tilt of 8": f"{max(largest(run) for run in case.disturbed):.1f} deg",
            "Tilt, last start": f"{smallest(case.disturbed[-1]):.1f} to {largest(case.disturbed[-1]):.1f} deg",
            "phi' of 8": phi_range(case.disturbed),
        }
        for case in candidates
    ]


def _of_circles(rolling: Runs) -> list[dict[str, str]]:
    """Return the table of moving tables, without slip; ``rolling`` has the motions for the real drive."""
    rows = []
    for case, real in rolling.items():
        tables = {radius: case.all_directions(radius) for radius in CIRCLES} | {DRIVE.horizontal_amplitude: real}
        rows += [
            {
                "Radius, centre height": case.size,
                "Table's radius": f"{1e3 * radius:.2f} mm",
                "Change of phi'": f"{span([100.0 * phi_change(run) / 2.5 for run in runs])} %",
                "|F_R|/F_N, median": span([median_friction(run) for run in runs], 2),
                "F_N < 0": f"{span([lifted(run) for run in runs])} %",
                "0.6 holds": f"{span([held(run) for run in runs])} %",
            }
            for radius, runs in tables.items()
        ]
    return rows


def _of_sliding(sliding: Runs) -> list[dict[str, str]]:
    return [
        {
            "Radius, centre height": case.size,
            "Start": f"{math.degrees(case.tilt):.2f} deg",
            "Smallest tilt": f"{span([smallest(run) for run in runs])} deg",
            "Largest tilt": f"{span([largest(run) for run in runs])} deg",
            "phi' at the end": f"{span([float(run.phi_rate[-1]) / REVOLUTION for run in runs])} rev/s",
            "Smallest slip": f"{span([1e3 * float(run.slip.min()) for run in runs], 0)} mm/s",
            "Energy error": f"{max(run.energy_error for run in runs):.0e}",
        }
        for case, runs in sliding.items()
    ]


def _of_steps(candidate: Candidate) -> list[dict[str, str]]:
    """Return the table of energy errors over RK4's step and the limit on the arc."""
    rim, start = candidate.cylinder.rim(), candidate.cylinder.released(candidate.tilt, spin=START_SPIN)
    heads = ("no limit", *(f"{arc:g} rad" for arc in ARCS[1:]))
    rows = []
    for step in STEPS:
        runs = [follow(rim, start, 1.0, sampled=max(STEPS), step=step, arc=arc) for arc in ARCS]
        errors = [f"{run.energy_error:.0e}" for run in runs]
        rows.append({"Step": f"{1e6 * step:.0f} us", **dict(zip(heads, errors, strict=True))})
    return rows


# -- pictures ----------------------------------------------------------------------------------------------------------

SPINS = (-5.0, -2.5, 0.0, 2.5, 5.0)
"""rev/s, of fig. 3.16."""

RATIOS = np.linspace(0.0, 4.0, 161)
"""|F_R|/F_N, along the axis."""


def _thesis_plot(tall: Candidate, flat: Candidate) -> bytes:
    """Plot the motions of the thesis for a tall and a flat cylinder."""
    picture = new_figure(7.6, 5.4)
    grid = picture.subplots(2, 2)
    start, rotation, slow, fast = grid.ravel()
    for case, colour, name in ((tall, FAILURE, "tall"), (flat, SUCCESS, "flat")):
        start.plot(case.at_rest.times, np.degrees(case.at_rest.tilt), color=colour, linewidth=1.4, label=name)
    style(start, title=f"3.15: both at {FREQUENCY} Hz, released with -2.5 rev/s", xlabel="t, s", ylabel="tilt, deg")
    for spin, colour in zip(SPINS, POLICY_COLOURS[1:]):
        run = release(flat.cylinder, flat.tilt, spin * REVOLUTION, radius=SLIGHT)
        rotation.plot(run.times, run.phi_rate / REVOLUTION, color=colour, linewidth=1.4)
    style(rotation, title="3.16: phi' for five initial values (flat)", xlabel="t, s", ylabel="phi', rev/s")
    for axes, rate, shown in ((slow, 100, range(4)), (fast, 270, range(4, 8))):
        for k, colour in zip(shown, (FAILURE, INK, MUTED, SUCCESS), strict=True):
            theta, psi = (round(math.degrees(angle)) for angle in DISTURBANCES[k])
            name = f"theta' = {theta}" if theta else f"psi' = {psi}"
            run, peer = flat.disturbed[k], tall.disturbed[k]
            axes.plot(run.times, np.degrees(run.tilt), color=colour, linewidth=1.4, label=f"{name} deg/s")
            axes.plot(peer.times, np.degrees(peer.tilt), color=colour, linewidth=0.7, linestyle=":")
        style(axes, title=f"3.19: from 5 deg with {rate} deg/s (dotted: tall)", xlabel="t, s", ylabel="tilt, deg")
        axes.set_ylim(0.0, 17.0)
    for axes in (start, slow, fast):
        axes.legend(frameon=False, fontsize=7, labelcolor=MUTED, ncols=2, loc="upper right")
    start.set_ylim(0.0, 22.0)
    for axes in grid.ravel():
        axes.set_xlim(0.0, SHOWN)
    return png(picture)


def _drive_plot(candidates: Sequence[Candidate], rolling: Runs, sliding: Runs) -> bytes:
    """Plot the share of the time in which a friction holds the rim, and the tilt of a sliding rim."""
    picture = new_figure(7.6, 5.0)
    grid = picture.subplots(2, len(candidates))
    for (above, below), case, kind in zip(grid.T, candidates, ("tall", "flat"), strict=True):
        tables = {"at rest": [case.at_rest], "0.1 mm": case.all_directions(CIRCLES[-1]), "2.7 mm": rolling[case]}
        for (name, runs), colour in zip(tables.items(), (MUTED, INK, FAILURE), strict=True):
            shares = [[held(run, ratio) for run in runs] for ratio in RATIOS]
            above.plot(RATIOS, np.mean(shares, axis=1), color=colour, linewidth=1.4, label=f"table {name}")
        above.axvline(FRICTION, color=MUTED, linewidth=0.8, linestyle=":")
        for run in sliding[case]:
            below.plot(run.times, np.degrees(run.tilt), color=SUCCESS, linewidth=0.8)
        style(above, title=f"{kind}: sufficient friction", ylabel="share of time, %", xlabel="friction")
        style(below, title=f"{kind}: sliding, 2.7 mm", ylabel="tilt, deg", xlabel="t, s")
        above.set(xlim=(0.0, RATIOS[-1]), ylim=(0.0, 104.0))
        below.set_xlim(0.0, SHOWN)
        below.set_ylim(0.0)
    grid[0, 0].legend(frameon=False, fontsize=7, labelcolor=MUTED, loc="lower right")
    return png(picture)
