"""Residual policies: the action of a classical base policy plus a learned correction.

See Silver et al. 2018, "Residual Policy Learning", and Johannink et al. 2019. Base and network have the same action
of :data:`vibgym.envs.motions.MOTIONS`. The base reads the flat state. The network reads observations by parts, whose rows
also contain the base's action. A correction of zero gives the base's action bit for bit. Corrections are added to the values of
the action; those of network ``joint`` to the velocities that these command.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pydantic import Field

from vibgym import checks
from vibgym.envs.features import LayoutEntry
from vibgym.envs.motions import MOTIONS
from vibgym.policies.registry import make_policy
from vibgym.policies.task_info import Policy, TaskInfo
from vibgym.policies.trained.joint import root_of, share_of
from vibgym.policies.trained.networks import BASE, NEIGHBOUR
from vibgym.policies.trained.storage import load_set
from vibgym.policies.trained.trained import KIND, RESIDUAL, VERSION, Trained, TrainedPolicy, file_of, network_of
from vibgym.settings import BaseSettings, read

SCALE = 0.5
"""Default factor of the network's action."""

MAX_SCALE = 2.0  # changes any action to any other

CORRECTED = tuple(MOTIONS)
"""Actions that can be corrected: three values per part."""

CORRECTING = ("parts", "joint")
"""Networks that can correct a base policy."""

Plan = Sequence[tuple[str, int]]
"""Names and widths of columns."""

NUMBERS = 3
"""Width of the base's action in a row."""


def with_base(layout: Sequence[LayoutEntry], plan: Plan = ()) -> tuple[LayoutEntry, ...]:
    """Return a row's layout with the base's action and plan after the part's own columns, before its neighbours'.

    Args:
        layout: without them.
        plan: names and widths of the columns of the plan, see :class:`Base`.
    """
    rows = list(layout)
    at = next((k for k, row in enumerate(rows) if row.name.endswith(NEIGHBOUR)), len(rows))
    start = rows[at].start if at < len(rows) else rows[-1].start + rows[-1].width
    meaning = "action of the base policy: acceleration, velocity or target, x, y and angular"
    added = []
    for name, width in ((BASE, NUMBERS), *plan):
        about = meaning if name == BASE else "plan of the base policy"
        added.append(LayoutEntry(name, None, start, width, "1", (1.0,) * width, (-1.0, 1.0), about, "linear"))
        start += width
    shift = sum(entry.width for entry in added)
    return (*rows[:at], *added, *(row._replace(start=row.start + shift) for row in rows[at:]))


def plan_of(policy: Policy) -> Plan:
    """Return the names and widths of the columns of a base policy's plan; () without one."""
    return getattr(policy, "PLAN", ())


class ResidualMemory(NamedTuple):
    """State of the policy from step to step."""

    base: Any  # of the base policy
    learned: Any  # of the network


class Base:
    """A base policy, for the trained policy and for its training.

    Args:
        policy: with an action of :data:`CORRECTED` and observation ``"state"``, such as
            ``{"kind": "pose", "action": "wrench"}``. If it has ``acted`` (:meth:`.steering.Steering.acted`),
            this is called with the proposed and the applied action. If it has ``PLAN``, names and widths of columns, rows
            contain their values, at most 1 in magnitude, which its memory has as ``own`` (batch, parts, values).
        info: task and scene.
        scale: see :class:`ResidualPolicy`.
        velocities: add corrections to the velocities of the action ``"velocity"``, see :attr:`.coding.Coding.adds_velocities`.

    Attributes:
        layout: of the rows, with the base's action and plan.

    Raises:
        ValueError: another action or observation, or a bad scale.
    """

    def __init__(self, policy: Policy, info: TaskInfo, scale: float, velocities: bool = False) -> None:
        checks.choice("base.action", policy.action, CORRECTED)
        checks.choice("base.observation", policy.observation, ("state",))
        self.policy, self.parts = policy, len(info.parts)
        self._sum = sum_of_velocities if velocities else sum_of_values
        self.scale = np.float32(checks.number("scale", scale, above=0.0, most=MAX_SCALE))
        self._plans = bool(plan_of(policy))
        self.layout = with_base(info.parts_layout, plan_of(policy))
        self._at = next(row.start for row in self.layout if row.name == BASE)
        self._added = NUMBERS + sum(width for _, width in plan_of(policy))
        self._acted = getattr(policy, "acted", lambda memory, proposed, done: memory)

    def rows(self, rows: np.ndarray, action: np.ndarray, memory: Any) -> np.ndarray:
        """Return rows (batch, slots, columns) with the base's action and plan inserted; zeros in slots without a part.

        Args:
            rows: of the environment.
            action, memory: what the base's ``predict`` returned, (batch, n) and its memory.
        """
        at, end = self._at, self._at + self._added
        wide = np.zeros((*rows.shape[:2], rows.shape[2] + self._added), dtype=np.float32)
        wide[..., :at], wide[..., end:] = rows[..., :at], rows[..., at:]
        wide[:, : self.parts, at : at + NUMBERS] = action.reshape(len(rows), self.parts, NUMBERS)
        if self._plans:
            wide[:, : self.parts, at + NUMBERS : end] = memory.own
        return wide

    def corrected(self, proposed: np.ndarray, residual: np.ndarray, memory: Any) -> tuple[np.ndarray, Any]:
        """Return the action (batch, n) with a correction in [-1, 1] added, and the base's memory updated accordingly."""
        residual = np.asarray(residual, dtype=np.float32).reshape(proposed.shape)
        done = self._sum(proposed, self.scale * residual)
        return done, self._acted(memory, proposed, done)


def sum_of_values(proposed: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """Return the action with a correction (batch, n) added to its values."""
    return np.clip(proposed + correction, -1.0, 1.0).astype(np.float32)


def sum_of_velocities(proposed: np.ndarray, correction: np.ndarray) -> np.ndarray:
    """Return the action ``"velocity"`` with a correction (batch, n), in shares of the top speed, added to its velocities."""
    changed = root_of(np.clip(share_of(proposed) + correction, -1.0, 1.0))
    return np.where(correction == 0.0, proposed, changed).astype(np.float32)


class ResidualPolicy:
    """Policy that adds ``scale`` times a network's output to a base policy's action, clipped to [-1, 1]; see the module.

    Args:
        info: task and scene.
        base: policy with an action of :data:`CORRECTED` and observation ``"state"``.
        learned: policy with the same action that reads rows of :func:`with_base`.
        scale: of its action, as in training.
        velocities: see :class:`Base`.

    Raises:
        ValueError: a base that does not fit, or a bad scale.
    """

    observation = "parts_and_state"

    def __init__(
        self, info: TaskInfo, base: Policy, learned: Any, *, scale: float = SCALE, velocities: bool = False
    ) -> None:
        self.base, self.learned, self.action = Base(base, info, scale, velocities), learned, base.action

    def predict(
        self, observation: Any, state: Any = None, episode_start: np.ndarray | None = None, deterministic: bool = True
    ) -> tuple[np.ndarray, Any]:
        """Return actions; the state is a :class:`ResidualMemory`."""
        single = np.ndim(observation["mask"]) == 1
        seen = {name: np.asarray(entry)[None] for name, entry in observation.items()} if single else observation
        if state is not None and not isinstance(state, ResidualMemory):
            raise checks.refuse("state", type(state).__name__, "None, or what predict() returned: ResidualMemory")
        memory = ResidualMemory(None, None) if state is None else state
        proposed, base = self.base.policy.predict(seen["state"], memory.base, episode_start, deterministic)
        rows = {"parts": self.base.rows(seen["parts"], proposed, base), "mask": seen["mask"]}
        residual, learned = self.learned.predict(rows, memory.learned, episode_start, deterministic)
        action, base = self.base.corrected(proposed, residual, base)
        return (action[0] if single else action), ResidualMemory(base, learned)


class Residual:
    """Maker of base policies with a learned correction (:class:`ResidualPolicy`) from files."""

    class Settings(Trained.Settings):
        """Settings of a correction, whose file contains its base and its scale."""

        base: Any = None
        """None, or the same policy as in the file: a name or a mapping."""

        scale: float | None = None
        """None, or the same as in the file."""

    def __new__(cls, info: TaskInfo, settings: Settings) -> Any:
        """Load the correction and make its base."""
        correction = load_correction(file_of(settings.path, info), info, settings.base, settings.scale)
        learned, velocities = correction.learned, correction.learned.coding.adds_velocities
        return ResidualPolicy(info, correction.base, learned, scale=correction.scale, velocities=velocities)


def base_named(base: Any) -> dict[str, Any]:
    """Return a base policy as a mapping, as policy files have it.

    Raises:
        ValueError: neither a name nor a mapping with 'kind', which a file could not store.
    """
    base = {"kind": base} if isinstance(base, str) else base
    if not isinstance(base, Mapping) or base.get("kind") in (None, RESIDUAL):
        raise checks.refuse("base", base, "a name, or a mapping with 'kind', of a policy that is itself no correction")
    return {"action": "wrench", **base}


class Record(BaseSettings):
    """What a correction's file says about it."""

    base: Mapping[str, Any]
    scale: float = Field(gt=0.0, le=MAX_SCALE)


class Correction(NamedTuple):
    """Contents of a correction's file."""

    learned: TrainedPolicy  # reads rows with the base's action and plan
    base: Policy
    scale: float  # of the correction


def load_correction(path: Path, info: TaskInfo, base: Any = None, scale: float | None = None) -> Correction:
    """Load a correction's file.

    Args:
        path: of the file.
        info: task and scene.
        base, scale: expected values, which must be those of training; None: any.

    Raises:
        ValueError: no correction for this task, or one of another base or scale.
    """
    tensors, record = load_set(path, KIND, VERSION)
    what = read(Record, record.get(RESIDUAL), f"{path}: {RESIDUAL}")
    own = base_named(what.base), what.scale
    wanted = (own[0] if base is None else base_named(base)), (own[1] if scale is None else scale)
    for name, mine, theirs in zip(("base", "scale"), wanted, own, strict=True):
        if mine != theirs:
            raise checks.refuse(name, mine, f"{theirs!r}, with which {path} was trained")
    checks.choice(f"{path}: action", record.get("action"), (own[0]["action"],))
    checks.choice(f"{path}: network", record.get("network"), CORRECTING)
    policy = make_policy(own[0], info)
    layout = with_base(info.parts_layout, plan_of(policy))
    learned = network_of(str(path), tensors, record, replace(info, parts_layout=layout))
    assert isinstance(learned, TrainedPolicy)
    return Correction(learned, policy, own[1])
