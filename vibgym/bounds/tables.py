"""How far a part can get in so many periods: tables by dynamic programming, for ways and for turns."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from vibgym.bounds.moving import moves
from vibgym.bounds.programme import Moves, furthest, interpolated, overshoots
from vibgym.bounds.turning import Scratch, Turner, turns
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

PERIODS = 40
"""Of the tables. By then every period adds the same."""

WAY_MARGIN = 0.002
"""Added to what a period does to the velocity, as a share of ``mu g T / 2``; see docs/bound.md."""

TURN_MARGIN = 0.010
"""Added to what a period does to the spin, as a share of ``mu g T / (2 k)``; see docs/bound.md."""

PRICE = 30.0
"""Of an end that is too fast, see :func:`vibgym.bounds.programme.furthest`."""

DIRECTIONS = 4
"""In which ways are looked at; the wobble within a period makes them differ by tenths of a millimetre."""

PHASES = 48
STEPS = 24  # of a period, for ways
SPEEDS = (-0.30, 0.95, 46)  # along the way, in units of the table's speed: least, most, nodes
SLIPS = (-0.45, 0.45, 31)  # across it

HEADINGS = 12  # of a quarter turn, after which the elements look the same
SPINS = (-0.40, 0.95, 28)  # in units of the table's speed over the radius of gyration
PLACES = 4  # of the centre of mass in its element, along each side
TURN_STEPS = 12  # of a period, for turns
POINTS = 10  # along the longer side of the part, at least


class Hold(NamedTuple):
    """What it takes to stay at the goal: ``instants`` at which the part is looked at, ``stride`` periods apart."""

    instants: int
    stride: int


class Reach(NamedTuple):
    """Largest way or turn from rest at the instant at which the hold begins.

    Attributes:
        most: (headings, PERIODS + 1) m or rad, after 0, 1, ... periods; headings over a quarter turn, one for ways.
        pace: of one more period.
    """

    most: np.ndarray
    pace: float

    def periods(self, heading: np.ndarray, way: np.ndarray) -> np.ndarray:
        """Fewest periods, int64 of the shape of ``way``, for a way or turn that is left from a heading (rad).

        The heading lies between two of the table; the one from which the part gets further counts.
        """
        most = np.maximum.accumulate(self.most, axis=1)
        at = np.asarray(heading) / (0.5 * math.pi) * len(most)
        low = np.floor(at).astype(np.int64)
        table = np.maximum(most[low % len(most)], most[(low + 1) % len(most)])
        inside = (table < way[..., None]).sum(axis=-1)
        beyond = np.ceil(np.maximum(way - table[..., -1], 0.0) / self.pace).astype(np.int64)
        return np.where(inside > PERIODS, PERIODS + beyond, inside)


def way_reach(surface: Surface, friction: float, amplitude: float, tolerance: float, hold: Hold) -> Reach:
    """Of the centre of mass, m; ``amplitude`` m is the largest, ``tolerance`` m that of the goal."""
    table, period = surface.table_speed, surface.period
    full = amplitude * surface.angular_frequency**2
    along, across = np.linspace(*SPEEDS) * table, np.linspace(*SLIPS) * table
    phases = np.exp(2j * np.pi * np.arange(PHASES) / PHASES)
    phasors = full * np.concatenate([phases, *(share * phases[::4] for share in (0.75, 0.5, 0.25)), [0.0]])
    phasor = np.column_stack([phasors.real, phasors.imag])
    idle, kick = surface.idle_velocity(friction), WAY_MARGIN * friction * surface.gravity * period / 2.0
    start = -along[0] / (along[1] - along[0]), -across[0] / (across[1] - across[0])
    most = []
    for direction in 2.0 * np.pi / DIRECTIONS * np.arange(DIRECTIONS):
        e, f = np.array([[math.cos(direction), math.sin(direction)], [-math.sin(direction), math.cos(direction)]])
        velocity = idle + along[:, None, None] * e + across[None, :, None] * f
        shape = (velocity.shape[0] * velocity.shape[1], len(phasor), 2)
        travelled, after = np.empty(shape), np.empty(shape)
        moves(friction, surface.gravity, table, period, STEPS, velocity.reshape(-1, 2), phasor, travelled, after)
        nodes = (len(along), len(across), len(phasor))
        speed = (after - idle).reshape(*nodes, 2)
        reached = np.stack([(speed @ e - along[0]) / (along[1] - along[0]), (speed @ f - across[0]) / (across[1] - across[0])], -1)
        gain = np.ascontiguousarray(travelled.reshape(*nodes, 2) @ e)
        most.append(_most(Moves(gain, reached, False), kick * period, kick / (along[1] - along[0]), 0, tolerance, hold, [start]))
    return _reach(np.max(most, axis=0))


def turn_reach(surface: Surface, part: Part, amplitude: float, tolerance: float, hold: Hold) -> tuple[Reach, Reach]:
    """Of the heading, rad: counter-clockwise, and clockwise; the other arguments as for :func:`way_reach`."""
    points = sample(part, surface.element_size)
    mirrored = points * [1.0, -1.0]
    left = _turn_reach(surface, part, points, amplitude, tolerance, hold)
    same = np.allclose(_sorted(points), _sorted(mirrored))
    return left, left if same else _turn_reach(surface, part, mirrored, amplitude, tolerance, hold)


def sample(part: Part, element: float) -> np.ndarray:
    """Points (n, 2) m that stand for the contact area: about its centroid, with its planar inertia."""
    low, high = part.outline.min(axis=0), part.outline.max(axis=0)
    spacing = min((high - low).max() / POINTS, element / 4.0)
    x, y = (
        a + (np.arange(n) + 0.5) * (b - a) / n
        for a, b, n in zip(low, high, np.ceil((high - low) / spacing - 1e-9).astype(int), strict=True)
    )
    grid = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    ends = np.roll(part.outline, -1, axis=0)
    rises = (part.outline[:, 1] > grid[:, 1:]) != (ends[:, 1] > grid[:, 1:])
    with np.errstate(divide="ignore", invalid="ignore"):
        share = (grid[:, 1:] - part.outline[:, 1]) / (ends[:, 1] - part.outline[:, 1])
        crossing = part.outline[:, 0] + share * (ends[:, 0] - part.outline[:, 0])
    inside = grid[(rises & (grid[:, :1] < crossing)).sum(axis=1) % 2 == 1]
    inside = inside - inside.mean(axis=0)
    return inside * math.sqrt(part.gyration / np.mean((inside**2).sum(axis=1)))


def _turn_reach(
    surface: Surface, part: Part, points: np.ndarray, amplitude: float, tolerance: float, hold: Hold
) -> Reach:
    radius, period = math.sqrt(part.gyration), surface.period
    reach = math.ceil(np.hypot(*points.T).max() / surface.element_size) + 1
    turner = Turner(
        points=np.ascontiguousarray(points),
        lever=part.friction / part.gyration,
        gravity=surface.gravity,
        most=amplitude * surface.angular_frequency**2,
        speed=surface.table_speed,
        idle=surface.idle_velocity(part.friction),
        element=surface.element_size,
        reach=reach,
        period=period,
    )
    cells = (2 * reach + 1) ** 2
    scratch = Scratch(np.zeros(TURN_STEPS), np.zeros(TURN_STEPS), np.zeros(cells), np.zeros(cells))
    place = np.arange(PLACES) / PLACES * surface.element_size
    offsets = np.stack(np.meshgrid(place, place), axis=-1).reshape(-1, 2)
    if part.symmetry and part.symmetry % 2 == 0:  # a half turn leaves the part the same, and mirrors the place
        twin = (-np.rint(offsets / surface.element_size * PLACES)).astype(int) % PLACES
        own = np.rint(offsets / surface.element_size * PLACES).astype(int)
        offsets = offsets[own @ [PLACES, 1] <= twin @ [PLACES, 1]]
    some = np.array([[1.0, 1.0], [1.0, 0.3], [0.3, 1.0], [1.0, -0.3], [-0.3, 1.0]])
    weights = np.concatenate([some, -some, some[:1], -some[:1], some[:1]])
    shares = np.concatenate([np.ones(2 * len(some)), [0.5, 0.5, 0.0]])
    headings = np.arange(HEADINGS) * 0.5 * math.pi / HEADINGS
    spins = np.linspace(*SPINS) * surface.table_speed / radius
    gain, after = np.empty((2, len(headings), len(spins), len(shares)))
    turns(turner, scratch, offsets, weights, shares, headings, spins, gain, after)
    ahead = (headings[:, None, None] + gain) / (0.5 * math.pi) * HEADINGS
    step = spins[1] - spins[0]
    reached = np.stack([ahead, (after - spins[0]) / step], axis=-1)
    kick = TURN_MARGIN * part.friction * surface.gravity * period / (2.0 * radius)
    starts = [(float(k), -spins[0] / step) for k in range(HEADINGS)]
    return _reach(_most(Moves(gain, reached, True), kick * period, kick / step, 1, tolerance, hold, starts))


def _most(
    found: Moves, more: float, faster: float, axis: int, tolerance: float, hold: Hold, starts: list[tuple[float, float]]
) -> np.ndarray:
    """Most that is gained from ``starts``, with margins: ``more`` gained and ``faster`` (nodes) on an axis, for either end."""
    push = np.zeros(2)
    push[axis] = faster
    ahead = found._replace(gain=found.gain + more, reached=found.reached + push)
    back = found._replace(gain=found.gain - more, reached=found.reached - push)
    value = furthest(ahead, overshoots(back, hold.instants, hold.stride), 2.0 * tolerance, PRICE, PERIODS)
    return np.array([[interpolated(each, found.cyclic, *start) for each in value] for start in starts])


def _reach(most: np.ndarray) -> Reach:
    return Reach(most, float(np.diff(most[:, -10:], axis=1).max()))


def _sorted(points: np.ndarray) -> np.ndarray:
    rounded = np.round(points, 9) + 0.0
    return rounded[np.lexsort(rounded.T)]
