"""The simulator: independent worlds of one surface, each with its parts, advanced in parallel."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from vibgym import checks
from vibgym.kernels.reference import Pinned
from vibgym.physics.core.drive import DRIVE, Drive, polar_drive
from vibgym.physics.core.records import CONDITIONS, STATE, State, new_state
from vibgym.scene import overlaps
from vibgym.scene.hulls import WALLS, hulls_of
from vibgym.scene.kinds import Kinds
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation import threads as workers
from vibgym.simulation.choice import Choice
from vibgym.simulation.model import Conditions, Model, Setup, conditions_of, worlds_from
from vibgym.simulation.models import MODELS
from vibgym.simulation.tipping import TippingMargin
from vibgym.snapshots import check_keys, copied, restore, restored

BYTES_OF_WORLD, BYTES_OF_PART, BYTES_OF_ELEMENT = 80, 112, 32
"""Memory of a world's state and drive, including the copies of a caller's amplitudes and phases."""

MAX_TIME = 10**15
"""Most periods since a reset in a snapshot."""


def _copy_of(name: str, doc: str) -> Any:
    """Return a property with copies of an array of the state."""
    return property(lambda self: getattr(self._state, name).copy(), doc=doc)


class Simulator:
    """Worlds of one surface and its parts.

    Args:
        surface: the table.
        parts: the parts of every world, one or a list; :class:`vibgym.scene.kinds.Kinds` where those of worlds differ.
        walls: borders with a wall, among ``"left"``, ``"right"``, ``"bottom"``, ``"top"``; parts fall off the others.
        worlds: number of independent worlds. Results do not depend on it, on the order of worlds, or on threads.
        model: ``"planar"``, ``"averaged"`` or ``"auto"``: the cheapest of these two within a tolerance. Plug-ins add further
            names, such as ``"tilting"`` (:mod:`vibgym.plugins.tilting`).
        threads: None uses all processors of this process.
        knobs: settings of the model: the fields of :class:`vibgym.simulation.schemes.PlanarSettings`,
            :class:`vibgym.simulation.schemes.AveragedSettings` or :class:`vibgym.simulation.models.AutoSettings`.

    Attributes:
        choice: model and knobs in effect, and why (:class:`vibgym.simulation.choice.Choice`).
        kinds: the parts of every world.
        blocks: partition of the worlds into blocks for threads.

    Raises:
        ValueError: a bad argument, an unknown knob, or a scene that the model does not cover.
    """

    def __init__(
        self,
        surface: Surface,
        parts: Part | Sequence[Part],
        *,
        walls: Sequence[str] = (),
        worlds: int = 1,
        model: str = "planar",
        threads: int | None = None,
        **knobs: Any,
    ) -> None:
        checks.instance("surface", surface, Surface)
        parts = (parts,) if isinstance(parts, Part) else parts
        if not isinstance(parts, Sequence) or not parts or not all(isinstance(part, Part) for part in parts):
            raise checks.refuse("parts", parts, "a vibgym.Part or a list of them")
        largest = 2.0 * (surface.width + surface.depth)
        self.kinds = Kinds.of(parts)
        for part in self.kinds.every:
            if part.radius > largest:
                got = f"{part.name!r} with radius {part.radius:g} m"
                allowed = f"a radius of at most {largest:g} m on this surface (lengths are in m)"
                raise checks.refuse("parts", got, allowed)
        several = isinstance(walls, Sequence) and not isinstance(walls, str)
        if several:
            for name in walls:
                checks.choice("walls", name, WALLS)
        if not several or len(set(walls)) != len(walls):
            raise checks.refuse("walls", walls, f"a list of different names among {', '.join(map(repr, WALLS))}")
        self.surface = surface
        self.walls = tuple(walls)
        needed = BYTES_OF_WORLD + BYTES_OF_PART * len(parts) + BYTES_OF_ELEMENT * surface.rows * surface.columns
        self.worlds = checks.fitting("worlds", checks.count("worlds", worlds), needed)
        if self.kinds.vary and len(self.kinds.kind) != self.worlds:
            raise checks.refuse("parts", f"kinds of the parts of {len(self.kinds.kind)} worlds", f"of {self.worlds}")
        self._setup = Setup(surface, self.kinds, self.walls, self.worlds, model)
        self.hulls, self._mass = hulls_of(self.kinds), self.kinds.values(lambda part: part.mass)
        self._model: Model = MODELS.make("model", dict(kind=model, **knobs), self._setup)
        self.choice = self._model.choice or Choice(model, dict(knobs), None, None, None, None, "as requested")
        self.model = self.choice.model
        self._model.check_parts()
        threads = workers.available_threads() if threads is None else checks.count("threads", threads, most=4096)
        # Where parts differ, large blocks have more parts of a kind, which friction moves together.
        blocks = 1 if self.kinds.vary else workers.BLOCKS_PER_THREAD
        self.blocks = workers.Blocks(self.worlds, threads, self._model.cost, blocks)
        self._tipping: TippingMargin | None = None  # built on first use
        self._state = new_state(self.worlds, len(self.parts))
        self._state.pose[...] = overlaps.apart(surface, len(self.kinds))
        self._pinned = Pinned(STATE, self._state)
        self._drive: Pinned[Drive] | None = None  # the last one
        self._periods = 0
        self._counted = 0  # periods since the last reset; snapshots leave it alone

    def reset(self, pose: Any, velocity: Any = None) -> None:
        """Place the parts, set time to 0, and reset all conditions: friction and mass of the parts, a level table.

        Args:
            pose: broadcastable to (worlds, parts, 3): x and y (m) of the centre of mass, heading (rad).
            velocity: like ``pose``, m/s and rad/s, in the world frame; None is at rest.

        Raises:
            ValueError: a number is not finite, a shape does not fit, a centre of mass is off the surface, or parts overlap one
                another or a wall by more than 0.1 mm.
        """
        shape = self._state.pose.shape
        pose = checks.array("pose", pose, shape)
        velocity = checks.array("velocity", 0.0 if velocity is None else velocity, shape)
        overlaps.check_centres("pose", pose, self.surface)
        fallen = np.zeros(shape[:2], dtype=bool)
        self.check_overlaps("pose", pose, fallen, overlaps.AT_REST)
        self.place(slice(None), pose, velocity, velocity)
        self._periods = 0
        self._counted = 0
        self._model.reset()

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts of the first world."""
        return self.kinds.parts(0)

    def check_overlaps(self, name: str, pose: np.ndarray, away: np.ndarray, allowed: float) -> None:
        """Check that the parts of all worlds do not overlap one another or a wall, see :func:`vibgym.scene.overlaps.check`."""
        overlaps.check(name, self.hulls, self.surface, self.kinds, self.walls, pose, away, allowed)

    def place(self, worlds: Any, pose: Any, velocity: Any, mean_velocity: Any, fallen: Any = False) -> None:
        """Restart worlds (index or mask) from checked values and reset their conditions; the time does not change.

        ``fallen``: parts that are not simulated and touch nothing.
        """
        state = self._state
        state.pose[worlds], state.velocity[worlds], state.mean_velocity[worlds] = pose, velocity, mean_velocity
        for flag in (state.sticking, state.doubtful, state.diverged):
            flag[worlds] = False
        state.pushed[worlds], state.fallen[worlds] = 0.0, fallen
        for name, usual in CONDITIONS.items():
            getattr(state, name)[worlds] = usual
        self._model.begin(worlds)

    def __getattr__(self, name: str) -> Any:
        """Return an attribute that the model adds, see :attr:`vibgym.simulation.Model.ADDS`."""
        model = self.__dict__.get("_model")
        if model is None or name not in model.ADDS:
            where = "" if model is None else f" with model={self.model!r}"
            raise AttributeError(f"a simulator{where} has no attribute {name!r}")
        added = getattr(model, name)
        return partial(added, self) if callable(added) else added

    @property
    def flat(self) -> bool:
        """Whether the model keeps all parts flat."""
        return self._model.flat

    @property
    def quantities(self) -> dict[str, np.ndarray]:
        """Arrays (worlds, ...) by name that the model computes in addition to the properties of this class; copies."""
        return copied(self._model.quantities())

    def part_info(self) -> dict[str, np.ndarray]:
        """Return live arrays (worlds, parts) of the model that environments report in ``info["parts"]``, by name."""
        return self._model.part_info()

    def reset_parts(self, changed: np.ndarray) -> None:
        """Reset the model's live arrays of some parts, (worlds, parts) bool, which have been replaced."""
        self._model.begin(changed)

    def set_conditions(
        self, worlds: Any, *, friction: Any = None, mass: Any = None, incline: Any = None, patches: Any = None
    ) -> None:
        """Set the conditions of some worlds until their next reset; None keeps a value.

        Args:
            worlds: mask (worlds,), indices, or a slice; n worlds.
            friction: factor on the coefficients of static and sliding friction between part and table, broadcastable to
                (n, parts), 0.01 to 100. It does not apply to friction between parts.
            mass: the same for mass and planar inertia, which matter in contacts only.
            incline: constant acceleration x and y of everything on the table, m/s^2, broadcastable to (n, 2), at most the
                table's gravity in magnitude. A table inclined by a small angle has ``g sin(angle)``, downhill; the decrease of
                the load by ``cos(angle)`` is neglected.
                patches: factor of every element on friction (wear, dirt), broadcastable to (n, rows, columns), 0.01 to 100.

        Raises:
            ValueError: a bad argument, masses or friction outside the range of the contact solver, or, with the
                averaged model, conditions under which a part may stick; nothing has changed.
        """
        rows = worlds_from(worlds, self.worlds)
        now = Conditions(*(getattr(self._state, name)[rows] for name in Conditions._fields))
        wanted = {"friction": friction, "mass": mass, "incline": incline, "patches": patches}
        conditions = self.check_conditions(now, wanted, "{}")
        if patches is not None:
            self.allocate_patches()
        self.condition(rows, conditions._asdict())

    def allocate_patches(self) -> None:
        """Allocate a friction factor per element in :attr:`state`; before, all elements of a world share one."""
        elements = self.surface.rows, self.surface.columns
        if self._state.patches.shape[1:] != elements:
            patches = np.broadcast_to(self._state.patches, (self.worlds, *elements)).copy()
            self._state = self._state._replace(patches=patches)
            self._pinned = Pinned(STATE, self._state)

    def _patches_as(self, patches: Any) -> np.ndarray:
        """Return an array of the shape of a snapshot's patches, per world or per element; else the live array."""
        shapes = (self.worlds, 1, 1), (self.worlds, self.surface.rows, self.surface.columns)
        return np.empty(patches.shape) if getattr(patches, "shape", None) in shapes else self._state.patches

    def condition(self, worlds: Any, conditions: Mapping[str, np.ndarray]) -> None:
        """Set some conditions of worlds (index or mask), by name, to checked values."""
        for name, values in conditions.items():
            getattr(self._state, name)[worlds] = values

    def check_conditions(self, now: Conditions, wanted: Mapping[str, Any], where: str) -> Conditions:
        """Return checked conditions, see :func:`vibgym.simulation.model.conditions_of`.

        Raises:
            ValueError: as there.
        """
        conditions = conditions_of(now, wanted, (self.surface.rows, self.surface.columns), self.surface.gravity, where)
        self._model.check_conditions(conditions, where)
        return conditions

    def advance(self, amplitude: Any, phase: Any, periods: int = 1) -> None:
        """Advance by whole periods with the elements' motion held.

        Args:
            amplitude: a_v of every element, broadcastable to (worlds, rows, columns), m, in [0, max_amplitude].
            phase: alpha of every element, likewise, rad.
            periods: number of periods, at least 1.

        Raises:
            ValueError: a bad argument; nothing has moved.
        """
        surface = self.surface
        shape = (self.worlds, surface.rows, surface.columns)
        amplitude = checks.array("amplitude", amplitude, shape, least=0.0)
        surface.check_amplitude(amplitude)
        phase = checks.array("phase", phase, shape)
        periods = checks.count("periods", periods, most=checks.MAX_PERIODS)
        self.advance_drive(polar_drive(amplitude, phase, surface.angular_frequency), periods)

    def advance_drive(
        self, drive: Drive, periods: int = 1, stages: Sequence[Sequence[Callable[[], None]]] = ()
    ) -> None:
        """Advance under a drive of :mod:`vibgym.physics.core.drive`; nothing is checked.

        Args:
            drive: held motion of the elements.
            periods: whole periods.
            stages: of each block, called on the thread that has advanced it, several blocks at a time; empty: none.
        """
        if self._drive is None:
            self._drive = Pinned(DRIVE, drive)
        elif drive is not self._drive.record:
            self._drive.put(drive)
        advance, held, state, edges = self._model.advance, self._drive, self._pinned, self.blocks.edges
        if len(edges) == 1:
            advance(0, self.worlds, held, state, periods)
            for stage in stages[0] if stages else ():
                stage()
        else:

            def work(k: int) -> None:
                start, stop = edges[k]
                advance(start, stop, held, state, periods)
                for stage in stages[k] if stages else ():
                    stage()

            self.blocks.run(work)
        self._periods += periods
        self._counted += periods

    pose = _copy_of(
        "pose", "(worlds, parts, 3) x, y (m) and heading (rad, not wrapped) at the current instant; a copy."
    )
    velocity = _copy_of(
        "velocity", "(worlds, parts, 3) at the current instant, m/s and rad/s; a copy. It is not the mean velocity."
    )
    mean_velocity = _copy_of(
        "mean_velocity",
        "(worlds, parts, 3) mean over the last period, m/s and rad/s; before the first, the starting velocity.",
    )
    fallen = _copy_of(
        "fallen",
        "(worlds, parts) whether the part's centre of mass has left its support; the part then rests at that position.",
    )
    sticking = _copy_of(
        "sticking", "(worlds, parts) whether the part sticks to the table at the current instant; a copy."
    )
    doubtful = _copy_of(
        "doubtful",
        """(worlds, parts) whether since the reset the part has left the range for which the model is validated.

        Averaged: slip may have passed through zero within a period. Planar: never.
        """,
    )
    diverged = _copy_of(
        "diverged", "(worlds,) whether a value became non-finite; the world then keeps its last finite state."
    )
    friction = _copy_of(
        "friction", "(worlds, parts) factor on the parts' coefficients of friction with the table; a copy."
    )
    mass = _copy_of("mass", "(worlds, parts) factor on the parts' masses; a copy.")
    incline = _copy_of("incline", "(worlds, 2) acceleration x and y of everything on the table, m/s^2; a copy.")

    @property
    def contact_impulse(self) -> np.ndarray:
        """(worlds, parts, 2) N s, impulse of contacts with other parts and walls over the last period, x and y."""
        return (self._state.mass * self._mass)[..., None] * self._state.pushed

    @property
    def patches(self) -> np.ndarray:
        """(worlds, rows, columns) factor of every element on friction; a copy."""
        return np.broadcast_to(self._state.patches, (self.worlds, self.surface.rows, self.surface.columns)).copy()

    def bottoms(self, world: int) -> list[np.ndarray]:
        """Return the corners of the bottom of each part of a world, (n, 3) m; z = 0 is the middle of the plates' stroke."""
        return self._model.bottoms(self._state.pose[world], world)

    def disturb(self, lean: np.ndarray, impulse: np.ndarray) -> None:
        """Apply an impulse disturbance to parts: the impulse in models that keep parts flat, the tilt in others.

        Args:
            lean: (worlds, parts, 2) rad, rotation vector about the world's x and y, zeros for undisturbed parts.
            impulse: (worlds, parts, 3) m/s, m/s, rad/s, impulse over mass with the statistics of the tilt's effect.
        """
        self._model.disturb(self._state, lean, impulse)

    @property
    def tipping_margin(self) -> np.ndarray:
        """(worlds, parts) one minus the largest displacement of the centre of pressure in a period over that to the edge.

        For a rigid part of this height under the last drive, at its present pose and velocity
        (:mod:`vibgym.physics.planar.tipping`). Below 0 the part would tip, also in models that keep parts flat. 0 for parts
        that are tilted, minus infinity for fallen parts.
        """
        if self._tipping is None:
            self._tipping = TippingMargin(self._setup)
        drive = self._drive
        if drive is None:
            still = np.zeros((self.worlds, self.surface.rows, self.surface.columns))
            drive = Pinned(DRIVE, polar_drive(still, still, self.surface.angular_frequency))
        margin = self._tipping(drive, self._pinned)
        return np.where(self._model.tilted() & ~self._state.fallen, 0.0, margin)

    @property
    def statistics(self) -> dict[str, int]:
        """Periods of all worlds since the reset by their collision case, and calls of the contact solver.

        ``free``: no parts were near one another.  ``near``: paths were compared and did not meet.  ``contact``: friction
        and contacts were coupled, for at least some of the parts.  ``contact_steps``: steps with a call of the solver,
        summed over islands.
        """
        return self._model.statistics(self.worlds * self._counted)

    @property
    def deepest_overlap(self) -> float:
        """Largest overlap of parts with one another or with walls at the end of a contact step since the reset, m.

        It bounds the overlap at the end of periods, since steps are fractions of a period.
        """
        return self._model.deepest_overlap()

    @property
    def time(self) -> float:
        """Time since the reset, s."""
        return self._periods / self.surface.frequency

    @property
    def state(self) -> State:
        """The live arrays; do not keep or change them."""
        return self._state

    def get_state(self) -> dict[str, Any]:
        """Return a snapshot from which the simulation continues bit for bit."""
        return {**copied(self._state._asdict()), **copied(self._model.live()), "periods": self._periods}

    def set_state(self, state: Mapping[str, Any]) -> None:
        """Restore a snapshot of :meth:`get_state`, of a simulator with the same worlds and parts.

        Raises:
            ValueError: a key is missing or unknown, a value has the wrong shape or is not finite, or parts overlap by more
                than contacts allow.
        """
        live, own = self._state._asdict(), self._model.live()
        check_keys("state", state, (*live, *own, "periods"))
        live["patches"] = self._patches_as(state["patches"])
        values = restored("state", live, {name: state[name] for name in live})
        more = restored("state", own, {name: state[name] for name in own})
        periods = checks.count("state['periods']", state["periods"], least=0, most=MAX_TIME)
        if self._model.most_overlap < math.inf:
            away = values["fallen"] | values["diverged"][:, None]
            self.check_overlaps("state['pose']", values["pose"], away, self._model.most_overlap)
        conditions = Conditions(*(values[name] for name in Conditions._fields))
        self.check_conditions(conditions, conditions._asdict(), "state['{}']")
        self._model.check_live(more)
        if values["patches"].shape[1:] != (1, 1):
            self.allocate_patches()
        restore(self._state._asdict(), values)
        restore(own, more)
        self._periods = periods
