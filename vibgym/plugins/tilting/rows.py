"""Selection of the model of each part: planar if it lies flat on plates with equal motion, rigid body otherwise."""

from __future__ import annotations

from vibgym.kernels.jit import borrowing
from vibgym.kernels.reference import reference
from vibgym.physics.core.drive import pinned_drive
from vibgym.physics.core.records import state_at
from vibgym.plugins.tilting.period import lies_level, rest, rock_period
from vibgym.plugins.tilting.records import FLAT, Rigid, fixed_tilting_at, tilt_at


@borrowing
def is_flat(rigid, world, part, periods):
    """Return whether the planar model can take a part through so many periods; it also lets those rest that are out of play."""
    if rigid.state.fallen[world, part] or rigid.state.diverged[world]:
        return True
    return rigid.tilt.mode[world, part] == FLAT and lies_level(rigid, world, part, periods)


@borrowing
def sort_rows(rows, flat, other, fixed, drive, state, tilt, periods):
    """Find the parts that lie flat on level ground for so many periods.

    Args:
        rows: (n,) parts, as ``world * parts + part``.
        flat, other: (n at least,) overwritten with the rows that do, and those that may not.
        fixed, drive, state, tilt: addresses of pinned records.

    Returns:
        How many do.
    """
    fixed = fixed_tilting_at(fixed)
    rigid = reference(
        Rigid(
            fixed.table, fixed.bodies, fixed.solids, fixed.scheme, fixed.work, reference(pinned_drive(drive)), state_at(state),
            tilt_at(tilt),
        )
    )  # fmt: skip
    parts, n = rigid.state.pose.shape[1], 0
    for k in range(rows.shape[0]):
        if is_flat(rigid, rows[k] // parts, rows[k] % parts, periods):
            flat[n] = rows[k]
            n += 1
        else:
            other[k - n] = rows[k]
    return n


@borrowing
def rock_rows(rows, follows, fixed, drive, state, tilt, paths, base, nodes):
    """Take parts through a period as rigid bodies.

    Args:
        rows: (n,) those that :func:`sort_rows` has found not to lie flat.
        follows: whether their motion in the plane is this one, or what contacts with other parts make of it.
        fixed, drive, state, tilt: addresses of pinned records.
        paths, base, nodes: see :func:`vibgym.plugins.tilting.period.rock_period`.
    """
    fixed = fixed_tilting_at(fixed)
    rigid = reference(
        Rigid(
            fixed.table, fixed.bodies, fixed.solids, fixed.scheme, fixed.work, reference(pinned_drive(drive)), state_at(state),
            tilt_at(tilt),
        )
    )  # fmt: skip
    parts = rigid.state.pose.shape[1]
    for k in range(rows.shape[0]):
        rock_period(rigid, rows[k] // parts, rows[k] % parts, follows, paths, base, nodes)


@borrowing
def keep_toppled(start, stop, state, tilt):
    """Let parts of worlds ``start`` to ``stop`` rest that have toppled, also after contacts.

    Args:
        state, tilt: addresses of pinned records.
    """
    state, tilt = state_at(state), tilt_at(tilt)
    for world in range(start, stop):
        for part in range(state.pose.shape[1]):
            if tilt.toppled[world, part]:
                rest(state, tilt, world, part)
