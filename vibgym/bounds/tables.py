"""Tables of the largest displacement and rotation of a part in a number of periods, by dynamic programming."""

from __future__ import annotations

import functools
import math
from typing import NamedTuple

import numpy as np

from vibgym.bounds.programme import Moves, Scratch, Turner, furthest, interpolated, moves, overshoots, turns
from vibgym.scene.outlines import contains
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

PERIODS = 24
"""Periods of the tables; each later period adds the same increment."""

DISPLACEMENT_MARGIN = 0.001
"""Added to the change of velocity in a period, over ``mu g T / 2``; see docs/bound.md."""

WOBBLE = 1.0
"""Added to every displacement, in units of ``mu g / w^2``, and to every turn, in these over ``k``: the oscillation within a
period."""

TURN_MARGIN = 0.005
"""Added to the change of spin in a period, over ``mu g T / (2 k)``; see docs/bound.md."""

PRICE = 30.0
"""Price of an overshoot at the end, see :func:`vibgym.bounds.programme.furthest`."""

FREE_END = 10.0
"""m or rad, tolerance of displacements and turns that may end at any speed."""

DIRECTIONS = 8
"""Directions of displacements: the first and last period depend on the table's phase, by up to a millimetre."""

PHASES = 48
STEPS = 24  # integration steps of a period, for displacements
SPEEDS = (-0.25, 0.95, 41)  # along the displacement, in units of the table's speed: least, most, nodes
SLIPS = (-0.40, 0.40, 21)  # perpendicular to it

HEADINGS = 12  # in a quarter turn, the symmetry of the element grid
SPINS = (-0.40, 0.95, 28)  # in units of the table's speed over the radius of gyration
PLACES = 4  # positions of the centre of mass in its element, along each side
TURN_STEPS = 12  # integration steps of a period, for rotations
POINTS = 10  # at least, along the longer side of the part

_AIMS = np.array([[1.0, 1.0], [1.0, 0.3], [0.3, 1.0], [1.0, -0.3], [-0.3, 1.0]])
WEIGHTS = np.concatenate([_AIMS, -_AIMS, _AIMS[:1], -_AIMS[:1], _AIMS[:1]])
"""Weights of the angular acceleration at the start and the end of a period that controls maximize; see ``programme.aim``."""

SHARES = np.concatenate([np.ones(2 * len(_AIMS)), [0.5, 0.5, 0.0]])
"""Share of the amplitude of each control."""


class Hold(NamedTuple):
    """Hold at the goal: ``instants`` at which the part must be within tolerance, ``stride`` periods apart."""

    instants: int
    stride: int

    @classmethod
    def of(cls, hold: int, stride: int) -> Hold:
        """Return the instants of a hold of so many periods with steps of ``stride`` periods: at least two for more than one."""
        return cls(max(-(-hold // stride), min(hold, 2)), stride)


class Values(NamedTuple):
    """Value function over a grid of states.

    Attributes:
        value: (PERIODS + 1, n, m) with 0, 1, ... periods left; -``PRICE`` per unit of overshoot at the end.
        first, step: (2,) state at the first node, and step between nodes.
        cyclic: whether the first axis is periodic (headings).
    """

    value: np.ndarray
    first: np.ndarray
    step: np.ndarray
    cyclic: bool

    def at(self, periods: int, state: np.ndarray) -> np.ndarray:
        """Return the values of states (k, 2) with ``periods`` left."""
        nodes = (np.asarray(state) - self.first) / self.step
        return np.array([interpolated(self.value[periods], self.cyclic, *node) for node in nodes.tolist()])


class Reach(NamedTuple):
    """Largest displacement or turn from rest at the instant at which the hold begins.

    Attributes:
        most: (angles, PERIODS + 1) m or rad, after 0, 1, ... periods, by direction of the displacement or initial heading.
        circle: rad, range of these angles.
        pace: m or rad of each further period.
    """

    most: np.ndarray
    circle: float
    pace: float

    def periods(self, angle: np.ndarray, displacement: np.ndarray) -> np.ndarray:
        """Return the fewest periods, int64 of the shape of ``displacement``, for displacements or turns at an angle (rad).

        Of the two neighbouring angles of the table, the one with the larger reach counts.
        """
        most = np.maximum.accumulate(self.most, axis=1)
        at = np.asarray(angle) / self.circle * len(most)
        low = np.floor(at).astype(np.int64)
        table = np.maximum(most[low % len(most)], most[(low + 1) % len(most)])
        inside = (table < displacement[..., None]).sum(axis=-1)
        beyond = np.ceil(np.maximum(displacement - table[..., -1], 0.0) / self.pace).astype(np.int64)
        return np.where(inside > PERIODS, PERIODS + beyond, inside)


def fewest_periods(reach: Reach, displacement: np.ndarray) -> np.ndarray:
    """Return the fewest periods, int64 (n,), for ``displacement`` (n,) in the best direction or from the best heading."""
    angles = reach.circle / len(reach.most) * np.arange(len(reach.most))
    return np.min([reach.periods(np.full(len(displacement), angle), displacement) for angle in angles], axis=0)


@functools.lru_cache(maxsize=64)
def displacement_reach(surface: Surface, friction: float, amplitude: float, tolerance: float, hold: Hold) -> Reach:
    """Return the reach of the centre of mass, m, for a largest amplitude and a tolerance of the goal, m."""
    directions = 2.0 * np.pi / DIRECTIONS * np.arange(DIRECTIONS)
    tables = [displacement_values(surface, friction, amplitude, tolerance, hold, direction) for direction in directions]
    rest = np.zeros((1, 2))
    most = np.array([[table.at(periods, rest)[0] for periods in range(PERIODS + 1)] for table in tables])
    return _reach(most + _wobble(surface, friction), 2.0 * math.pi)


def displacement_values(
    surface: Surface, friction: float, amplitude: float, tolerance: float, hold: Hold, direction: float
) -> Values:
    """Return the values of a direction (rad), by velocity along and across it minus that of a part sliding in place, m/s."""
    _, _, first, step = _displacement_grid(surface)
    impulse = DISPLACEMENT_MARGIN * friction * surface.gravity * surface.period / 2.0
    motions = _displacement_moves(surface, friction, amplitude, direction)
    value = _values(motions, impulse * surface.period, [impulse / step[0], 0.0], tolerance, hold)
    return Values(value, first, step, False)


def _displacement_grid(surface: Surface) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Return velocities along and across, m/s, and first node and step of their grid."""
    along, across = np.linspace(*SPEEDS) * surface.table_speed, np.linspace(*SLIPS) * surface.table_speed
    return along, across, np.array([along[0], across[0]]), np.array([along[1] - along[0], across[1] - across[0]])


@functools.lru_cache(maxsize=64)
def _displacement_moves(surface: Surface, friction: float, amplitude: float, direction: float) -> Moves:
    """Return the moves of a period on the grid of :func:`displacement_values`."""
    table, period = surface.table_speed, surface.period
    full = amplitude * surface.angular_frequency**2
    along, across, first, step = _displacement_grid(surface)
    phases = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
    phasors = full * np.concatenate([phases, *(share * phases[::4] for share in (0.75, 0.5, 0.25)), [0.0]])
    phasor = np.column_stack([phasors.real, phasors.imag])
    idle = surface.idle_velocity(friction)
    axes = np.array([[math.cos(direction), math.sin(direction)], [-math.sin(direction), math.cos(direction)]])
    velocity = idle + along[:, None, None] * axes[0] + across[None, :, None] * axes[1]
    nodes = (len(along), len(across), len(phasor))
    travelled, after = np.empty((2, nodes[0] * nodes[1], nodes[2], 2))
    at = math.pi / STEPS * np.arange(2 * STEPS + 1)
    drive = friction, surface.gravity, table, period
    moves(*drive, np.cos(at), np.sin(at), velocity.reshape(-1, 2), phasor, travelled, after)
    reached = (((after - idle) @ axes.T - first) / step).reshape(*nodes, 2)
    return Moves(np.ascontiguousarray((travelled @ axes[0]).reshape(nodes)), reached, False)


def turn_reach(surface: Surface, part: Part, amplitude: float, tolerance: float, hold: Hold) -> tuple[Reach, Reach]:
    """Return the reach of the heading, rad, counter-clockwise and clockwise; see :func:`displacement_reach`."""
    points = sample(part, surface.element_size)
    mirrored = points * [1.0, -1.0]
    if np.allclose(_sorted(points), _sorted(mirrored)):
        mirrored = points
    even = part.symmetry > 0 and part.symmetry % 2 == 0
    known = surface, part.friction, part.gyration, even
    one, other = (_turn_reach(*known, outline.tobytes(), amplitude, tolerance, hold) for outline in (points, mirrored))
    return one, other


@functools.lru_cache(maxsize=64)
def _turn_reach(
    surface: Surface, friction: float, gyration: float, even: bool, points: bytes, amplitude: float, tolerance: float,
    hold: Hold,
) -> Reach:  # fmt: skip
    """Return the reach of turns counter-clockwise."""
    values = turn_values(surface, friction, gyration, even, points, amplitude, tolerance, hold)
    rest = np.column_stack([values.step[0] * np.arange(HEADINGS), np.zeros(HEADINGS)])
    most = np.array([values.at(periods, rest) for periods in range(PERIODS + 1)]).T
    return _reach(most + _wobble(surface, friction) / math.sqrt(gyration), 0.5 * math.pi)


def sample(part: Part, element: float) -> np.ndarray:
    """Return points (n, 2) m that represent the contact area, about its centroid, with its planar inertia."""
    low, high = part.outline.min(axis=0), part.outline.max(axis=0)
    spacing = min((high - low).max() / POINTS, element / 4.0)
    x, y = (
        a + (np.arange(n) + 0.5) * (b - a) / n
        for a, b, n in zip(low, high, np.ceil((high - low) / spacing - 1e-9).astype(int), strict=True)
    )
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    inside = grid[contains(part.outline, grid)]
    inside = inside - inside.mean(axis=0)
    return inside * math.sqrt(part.gyration / np.mean((inside**2).sum(axis=1)))


def turner_for(surface: Surface, friction: float, gyration: float, amplitude: float, points: np.ndarray) -> Turner:
    """Return the kernels' record of a part with such points."""
    return Turner(
        points=np.ascontiguousarray(points),
        lever=friction / gyration,
        gravity=surface.gravity,
        most=amplitude * surface.angular_frequency**2,
        speed=surface.table_speed,
        idle=surface.idle_velocity(friction),
        element=surface.element_size,
        reach=math.ceil(np.hypot(*points.T).max() / surface.element_size) + 1,
        period=surface.period,
    )


def scratch_for(turner: Turner) -> Scratch:
    """Return scratch memory for the kernels."""
    cells = (2 * turner.reach + 1) ** 2
    return Scratch(np.zeros(TURN_STEPS), np.zeros(TURN_STEPS), np.zeros(cells), np.zeros(cells))


def turn_values(
    surface: Surface, friction: float, gyration: float, even: bool, points: bytes, amplitude: float, tolerance: float,
    hold: Hold,
) -> Values:  # fmt: skip
    """Return the values of turns counter-clockwise, by heading (rad, over a quarter turn) and spin (rad/s).

    Args:
        even: whether the part is the same after half a turn.
        points: of :func:`sample`, as bytes.
    """
    radius = math.sqrt(gyration)
    motions = _turn_moves(surface, friction, gyration, amplitude, even, points)
    spins = np.linspace(*SPINS) * surface.table_speed / radius
    first, step = np.array([0.0, spins[0]]), np.array([0.5 * math.pi / HEADINGS, spins[1] - spins[0]])
    impulse = TURN_MARGIN * friction * surface.gravity * surface.period / (2.0 * radius)
    value = _values(motions, impulse * surface.period, [0.0, impulse / step[1]], tolerance, hold)
    return Values(value, first, step, True)


@functools.lru_cache(maxsize=16)
def _turn_moves(
    surface: Surface, friction: float, gyration: float, amplitude: float, even: bool, points: bytes
) -> Moves:
    """Return the moves of a period on the grid of :func:`turn_values`."""
    turner = turner_for(surface, friction, gyration, amplitude, np.frombuffer(points).reshape(-1, 2))
    place = np.stack(np.meshgrid(np.arange(PLACES), np.arange(PLACES)), axis=-1).reshape(-1, 2)
    if even:  # a half turn also mirrors the position in the element
        place = place[place @ [PLACES, 1] <= (-place % PLACES) @ [PLACES, 1]]
    headings = np.arange(HEADINGS) * 0.5 * math.pi / HEADINGS
    spins = np.linspace(*SPINS) * surface.table_speed / math.sqrt(gyration)
    gain, after = np.empty((2, len(headings), len(spins), len(SHARES)))
    offsets = place / PLACES * surface.element_size
    turns(turner, scratch_for(turner), offsets, WEIGHTS, SHARES, headings, spins, gain, after)
    first, step = np.array([0.0, spins[0]]), np.array([headings[1], spins[1] - spins[0]])
    return Moves(gain, (np.stack([headings[:, None, None] + gain, after], axis=-1) - first) / step, True)


def _values(motions: Moves, more: float, faster: list[float], tolerance: float, hold: Hold) -> np.ndarray:
    """Return the values with margins in every period: ``more`` gained, and ``faster`` (nodes)."""
    ahead = motions._replace(gain=motions.gain + more, reached=motions.reached + faster)
    back = motions._replace(gain=motions.gain - more, reached=motions.reached - faster)
    return furthest(ahead, overshoots(back, hold.instants, hold.stride), 2.0 * tolerance, PRICE, PERIODS)


def _wobble(surface: Surface, friction: float) -> float:
    return WOBBLE * friction * surface.gravity / surface.angular_frequency**2


def _reach(most: np.ndarray, circle: float) -> Reach:
    return Reach(most, circle, float((most[:, -1] - most[:, -11]).max()) / 10.0)


def _sorted(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 9) + 0.0
    return rounded[np.lexsort(rounded.T)]
