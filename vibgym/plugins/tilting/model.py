"""The tilting model: rigid parts on plates of different heights.

Parts that lie flat on plates with equal motion are advanced by the planar model, bit for bit. All others are rigid bodies: they
rock on the highest plates, tilt, land, or topple.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import Drive
from vibgym.physics.core.records import Scheme, State
from vibgym.physics.planar.friction import slide_rows
from vibgym.plugins.tilting.period import keep_toppled, rock_rows, sort_rows
from vibgym.plugins.tilting.records import (
    FIXED_TILTING,
    FLAT,
    MODES,
    TILT,
    TIPPED,
    FixedTilting,
    Solids,
    TiltScheme,
    new_tilt,
    new_work,
)
from vibgym.scene.bodies import bodies_of
from vibgym.scene.outlines import is_convex, rotation
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.settings import BaseSettings, Length
from vibgym.simulation import Simulator
from vibgym.simulation.alone import Alone
from vibgym.simulation.contacts import ContactModel
from vibgym.simulation.model import NO_PATHS, Conditions, Model, Setup, worlds_from
from vibgym.simulation.multibody import Multibody
from vibgym.simulation.schemes import PlanarSettings
from vibgym.simulation.threads import Pool

MIN_RAMP = 1e-6
"""m, shortest ramp."""

STRETCH = 2
"""Most periods per check for level ground."""

STEEPEST = 1.5
"""rad, largest tilt."""

MIN_SETTLING = 0.01
"""m/s, least velocity at which penetration is corrected."""


class TiltingSettings(BaseSettings):
    """Settings of the tilting model."""

    restitution: float = Field(default=0.2, ge=0.0, le=1.0)
    """Of a part's bottom on plates (Newton)."""

    ramp: Length = Field(default=3e-3, ge=0.0)
    """Length on either side of a border between plates over which their heights are blended, up to half an element; 0:
    steps."""

    steps: int = Field(default=200, ge=50, le=100_000)
    """In a period. By default energies of impacts are within 0.5 %, transport by uniform fields within 0.01 %."""


def cross_of(part: Part) -> np.ndarray:
    """Return (4, 2) m, points of equal load with the first and second moments of even pressure."""
    xx, yy, xy = part.inertia - [part.height**2 / 12.0, part.height**2 / 12.0, 0.0]
    squares, axes = np.linalg.eigh(np.array([[yy, -xy], [-xy, xx]]))  # moments x x, x y, y y
    reach = np.sqrt(np.maximum(squares, 0.0))
    signs = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])
    return (signs * reach) @ axes.T


def solids_of(kinds: Sequence[Part]) -> Solids:
    """Return the third dimension of the kinds, for the kernels."""
    return Solids(
        centre_height=np.array([kind.centre_height for kind in kinds]),
        inertia=np.array([kind.inertia for kind in kinds]),
        disc=np.array([math.sqrt(kind.area / math.pi) if kind.symmetry == 0 else 0.0 for kind in kinds]),
        cross=np.array([cross_of(kind) for kind in kinds]),
        unsteady=np.array([1.0 / max(kind.tipping_ratio, 1e-9) for kind in kinds]),
    )


def scheme_of(surface: Surface, settings: TiltingSettings) -> TiltScheme:
    """Return the model's constants, with the drive's trigonometry at the half steps."""
    ramp = max(checks.number("model.ramp", settings.ramp, most=0.5 * surface.element_size * (1.0 + 1e-12)), MIN_RAMP)
    settling = max(surface.full_scale / surface.angular_frequency, MIN_SETTLING)
    steps, fineness = settings.steps, 1.0 / surface.element_size
    phase, steepness = np.arange(2 * steps + 1) * (math.pi / steps), 0.5 * surface.element_size / ramp
    return TiltScheme(steps, np.cos(phase), np.sin(phase), settings.restitution, ramp, fineness, steepness, settling)


def stands(part: Part, heading: np.ndarray, lean: np.ndarray) -> np.ndarray:
    """Return (n,) whether the centre of mass is above the bottom, so that the part falls back, by headings and leans (n, 2)."""
    angle = np.hypot(lean[:, 0], lean[:, 1])
    if part.centre_height == 0.0:
        return angle < STEEPEST
    # The axis leans towards z x lean; the centre of mass projects to a point of the bottom tan(angle) times its height away.
    share = np.where(angle > 0.0, np.tan(np.minimum(angle, STEEPEST)) / np.maximum(angle, 1e-300), 0.0)
    away = part.centre_height * share[:, None] * np.column_stack([lean[:, 1], -lean[:, 0]])
    cosine, sine = np.cos(heading), np.sin(heading)
    u, v = cosine * away[:, 0] + sine * away[:, 1], -sine * away[:, 0] + cosine * away[:, 1]
    if part.symmetry == 0:
        return (np.hypot(u, v) < math.sqrt(part.area / math.pi)) & (angle < STEEPEST)
    edges = np.roll(part.outline, -1, axis=0) - part.outline
    side = edges[:, 0] * (v[:, None] - part.outline[:, 1]) - edges[:, 1] * (u[:, None] - part.outline[:, 0])
    return (side > 0.0).all(axis=1) & (angle < STEEPEST)


class AbovePlane(Model):
    """Base of the models whose parts are rigid bodies above the plane.

    Attributes:
        attitudes: live arrays of the parts in addition to the state.
        pinned: the same for kernels.
        step: s.
    """

    flat = False
    ADDS = ("lean", "tilt", "time_tilted", "toppled", "tip")

    def __init__(self, setup: Setup, scheme: TiltScheme) -> None:
        Model.__init__(self, setup)  # not super(): a subclass derives from Multibody as well
        self.cost = 190.0 * len(setup.parts)
        self.step = setup.surface.period / scheme.steps
        self.attitudes = new_tilt(setup.worlds, len(setup.parts))
        self.pinned = Pinned(TILT, self.attitudes)
        self._centres = setup.parts.values(lambda part: part.centre_height)

    def check_parts(self) -> None:
        """Raise ValueError for parts that are not convex, or whose coefficient of friction depends on speed."""
        for part in self.setup.parts.every:
            if part.friction_law is not None:
                raise checks.conflict("model='tilting' requires a constant coefficient of friction: use model='planar'")
            if not is_convex(part.outline):
                raise checks.refuse("parts", f"{part.name!r}, which is not convex", "convex with model='tilting'")

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        pass  # parts may tip by friction

    def live(self) -> dict[str, np.ndarray]:
        return self.attitudes._asdict()

    def check_live(self, values: Mapping[str, np.ndarray]) -> None:
        """Raise ValueError for unknown modes and for tilts beyond :data:`STEEPEST`."""
        mode, lean = values["mode"], np.hypot(values["lean"][..., 0], values["lean"][..., 1])
        if not ((mode >= 0) & (mode < len(MODES))).all():
            allowed = f"0 to {len(MODES) - 1} ({', '.join(MODES)})"
            raise checks.refuse("state['mode']", int(mode[(mode < 0) | (mode >= len(MODES))][0]), allowed)
        if lean.max(initial=0.0) > STEEPEST:
            raise checks.refuse("state['lean']", float(lean.max()), f"at most {STEEPEST:g} rad")

    def begin(self, worlds: Any) -> None:
        for values in self.attitudes:
            values[worlds] = 0

    def part_info(self) -> dict[str, np.ndarray]:
        return {"toppled": self.attitudes.toppled}

    def tilted(self) -> np.ndarray:
        return self.tilt > 0.0

    def bottoms(self, pose: np.ndarray, world: int) -> list[np.ndarray]:
        bottoms, lean = [], self.attitudes.lean[world]
        rise = np.where(self.attitudes.mode != FLAT, self.attitudes.height - self._centres, 0.0)[world]
        for k, part in enumerate(self.setup.parts.parts(world)):
            x, y, heading = pose[k]
            corners = np.column_stack([part.outline, np.full(len(part.outline), -part.centre_height)])
            turned = corners @ (rotation(lean[k, 0], lean[k, 1], 0.0) @ rotation(0.0, 0.0, heading)).T
            bottoms.append(turned + [x, y, rise[k] + part.centre_height])
        return bottoms

    @property
    def lean(self) -> np.ndarray:
        """(worlds, parts, 2) rad, rotation vector, about the world's x and y, applied to a part after its heading; a copy."""
        return self.attitudes.lean.copy()

    @property
    def tilt(self) -> np.ndarray:
        """(worlds, parts) rad, angle between a part's axis and the vertical."""
        return np.hypot(self.attitudes.lean[..., 0], self.attitudes.lean[..., 1])

    @property
    def time_tilted(self) -> np.ndarray:
        """(worlds, parts) s from the last tip of a part until its tilt was last above 0.05 deg."""
        return self.attitudes.landing * self.step

    @property
    def toppled(self) -> np.ndarray:
        """(worlds, parts) whether a part has tipped beyond its edge, and fallen; a copy."""
        return self.attitudes.toppled.copy()

    def tip(self, simulator: Simulator, worlds: Any, lean: Any, *, rocking: Any = 0.0, which: Any = True) -> None:
        """Tilt parts of some worlds onto an edge or a corner.

        A tipped part keeps its position, heading and velocity in the plane. Its lowest point touches the plates as they stand
        when the next period begins.

        Args:
            simulator: passed by ``simulator.tip``.
            worlds: mask (worlds,), indices, or a slice; n worlds.
            lean: rad, see :attr:`lean`, broadcastable to (n, parts, 2).
            rocking: rad/s, angular velocity about the world's x and y, likewise.
            which: (n, parts) or broadcastable, bool: the parts to tip; fallen parts are skipped.

        Raises:
            ValueError: a value is not finite, or a part would topple; nothing has changed.
        """
        rows = worlds_from(worlds, self.setup.worlds)
        shape = (len(rows), len(self.setup.parts), 2)
        lean, rocking = checks.array("lean", lean, shape), checks.array("rocking", rocking, shape)
        chosen = checks.array("which", which, shape[:2], dtype=np.bool_) & ~simulator.state.fallen[rows]
        self._tip(rows, chosen, simulator.state.pose[rows, :, 2], lean, rocking)

    def _tip(
        self, worlds: np.ndarray, which: np.ndarray, heading: np.ndarray, lean: np.ndarray, rocking: np.ndarray
    ) -> None:
        """Tip the parts ``which`` (n, parts) of ``worlds`` (n,) at these headings (n, parts), rad."""
        kinds = self.setup.parts
        index = kinds.kind[kinds.rows(worlds)]
        for kind, part in enumerate(kinds.every):
            these = which & (index == kind)
            unstable = ~stands(part, heading[these], lean[these])
            if unstable.any():
                angle = float(np.hypot(*lean[these][unstable][0]))
                most = math.atan(1.0 / part.slenderness) if part.slenderness > 0.0 else STEEPEST
                allowed = f"a tilt below the toppling angle of {part.name!r}, {most:.3g} rad or more by direction"
                raise checks.refuse("lean", f"{angle:.3g} rad", allowed)
        at = worlds[np.nonzero(which)[0]], np.nonzero(which)[1]
        live = self.attitudes
        live.mode[at], live.calm[at], live.since[at], live.landing[at] = TIPPED, 0, 0, 0
        live.lean[at], live.rocking[at] = lean[which], rocking[which]

    def disturb(self, state: State, lean: np.ndarray, impulse: np.ndarray) -> None:
        """Tip the disturbed parts."""
        which = lean.any(axis=2) & ~state.fallen
        self._tip(np.arange(len(lean)), which, state.pose[..., 2], lean, np.zeros_like(lean))


class Tilting(AbovePlane):
    """The tilting model of one part in each world."""

    def __init__(self, setup: Setup, flat: Sequence[Scheme], scheme: TiltScheme) -> None:
        super().__init__(setup, scheme)
        self._buffers = Pool(partial(Buffers, setup, flat, scheme))
        self._rows = np.arange(setup.worlds)

    def advance(self, start: int, stop: int, drive: Pinned[Drive], state: Pinned[State], periods: int) -> None:
        def work(buffers: Buffers) -> None:
            inputs, rows, left = (drive.address, state.address), self._rows[start:stop], periods
            if periods > STRETCH:  # most parts are on level ground for all periods
                flat, rows = sorted_rows(rows, buffers.rigid.address, inputs, self.pinned.address, periods)
                slide_flat_rows(buffers.planar, flat, inputs, periods)
            while left > 0 and len(rows):
                span = min(left, STRETCH)
                self._advance(buffers, rows, inputs, span)
                left -= span

        self._buffers.lend(work)

    def _advance(self, buffers: Buffers, rows: np.ndarray, inputs: tuple[int, int], periods: int) -> None:
        """Advance some rows by a few periods."""
        rigid, tilt = buffers.rigid.address, self.pinned.address
        flat, rows = sorted_rows(rows, rigid, inputs, tilt, periods)
        slide_flat_rows(buffers.planar, flat, inputs, periods)
        for _ in range(periods if len(rows) else 0):
            flat, others = sorted_rows(rows, rigid, inputs, tilt, 1)
            rock_rows(others, True, rigid, *inputs, tilt, NO_PATHS, 0, 0)
            slide_flat_rows(buffers.planar, flat, inputs, 1)


def slide_flat_rows(planar: Alone, rows: np.ndarray, inputs: tuple[int, int], periods: int) -> None:
    """Advance some rows by the planar model; ``inputs``: addresses of drive and state."""
    for alone, chosen in planar.sort(rows):
        slide_rows(chosen, alone.address, *inputs, periods, NO_PATHS, 0)


class TiltingMultibody(AbovePlane, Multibody):
    """The tilting model of several parts in a world, or with walls: contacts of the planar model, rigid bodies between them.

    For contacts a tilted part has its flat footprint. In a period in which it touches another part or a wall, the planar model
    computes its motion in the plane as that of a flat part; height and tilt are integrated without the contacts.
    """

    def __init__(self, setup: Setup, scheme: TiltScheme) -> None:
        Multibody.__init__(self, setup, PlanarSettings())
        AbovePlane.__init__(self, setup, scheme)
        self._rigid = Pool(partial(rigid_buffers, setup, scheme))

    def check_conditions(self, conditions: Conditions, where: str) -> None:
        self.check_contacts(conditions, where)

    def slide(self, start: int, contacts: ContactModel, drive: int, state: int, near: bool) -> None:
        paths, base, tilt = contacts.paths if near else NO_PATHS, start * len(self.setup.parts), self.pinned.address
        block, inputs = contacts.block.record, (drive, state)

        def work(rigid: Pinned[FixedTilting]) -> None:
            _, others = sorted_rows(base + np.flatnonzero(block.driven), rigid.address, inputs, tilt, 1)
            rock_rows(others, False, rigid.address, *inputs, tilt, NO_PATHS, 0, 0)
            for alone, rows in contacts.alone.split(block.rows, block.count):
                flat, others = sorted_rows(rows, rigid.address, inputs, tilt, 1)
                rock_rows(others, True, rigid.address, *inputs, tilt, paths, base, alone.record.scheme.steps)
                slide_rows(flat, alone.address, *inputs, 1, paths, base)

        self._rigid.lend(work)

    def end_period(self, start: int, stop: int, state: int) -> None:
        keep_toppled(start, stop, state, self.pinned.address)


def sorted_rows(
    rows: np.ndarray, rigid: int, inputs: tuple[int, int], tilt: int, periods: int
) -> tuple[np.ndarray, np.ndarray]:
    """Return the rows whose parts lie flat on level ground for ``periods`` periods, and the others; see :func:`sort_rows`.

    Args:
        rigid, inputs, tilt: addresses of pinned records; ``inputs`` of drive and state.
    """
    flat, others = np.empty_like(rows), np.empty_like(rows)
    n = sort_rows(rows, flat, others, rigid, *inputs, tilt, periods)
    return flat[:n], others[: len(rows) - n]


class Buffers:
    """Constants and working arrays of one thread.

    Attributes:
        planar: for parts that lie flat.
        rigid: for all others.
    """

    def __init__(self, setup: Setup, flat: Sequence[Scheme], scheme: TiltScheme) -> None:
        self.planar = Alone(setup, flat)
        self.rigid = rigid_buffers(setup, scheme)


def rigid_buffers(setup: Setup, scheme: TiltScheme) -> Pinned[FixedTilting]:
    """Return constants and working arrays of one thread for parts above the plane."""
    table = setup.surface.table(setup.walls)
    bodies = bodies_of(setup.parts, setup.surface.element_size)
    work = new_work(table, bodies)
    return Pinned(FIXED_TILTING, FixedTilting(table, bodies, solids_of(setup.parts.every), scheme, work))
