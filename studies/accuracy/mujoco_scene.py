"""Peer: the same scene as a MuJoCo model. Needs the extra ``mujoco``.

Every element near the part is a box on a vertical slide joint, all of them on one carriage with two horizontal slide
joints; the part is a box on a free joint, in contact with friction only (elliptic cone, ``implicitfast``).
The elements' joints are set to the drive's exact position and velocity at every step, and driven by the force that
gives their heavy bodies the drive's exact acceleration.

Two differences from the models of ``vibgym`` do not depend on knobs. The elements move on the table's circle, so the grid
swings by ``a_h`` (2.7 mm) under the part, where the planar models keep it fixed. And contact is between rigid boxes through
MuJoCo's spring and damper: a part rests on the few highest elements, while the planar models let pressure follow each
element's acceleration.
"""

from __future__ import annotations

import importlib
import math
import time
from typing import Any, NamedTuple

import numpy as np

from vibgym import checks

ELEMENT_HEIGHT = 0.020  # m; limits only the penetration of a part
_HEAVY = 1e3  # mass of an element over that of the part, so that the part does not disturb its motion within a step
_CONTACTS_NEAR = 1e-3  # m, beyond the part's circle


class Scene(NamedTuple):
    """A compiled model, the row and column of each of its elements, and the index of the part's joint in qpos and qvel."""

    model: Any
    data: Any
    row: np.ndarray
    column: np.ndarray
    part: int


class Run(NamedTuple):
    """Result: ``pose`` (periods + 1, 3) at the boundaries of the periods, ``mean_velocity`` (periods, 3) over each, and the
    wall time of the steps alone."""

    pose: np.ndarray
    mean_velocity: np.ndarray
    seconds: float


def load_mujoco() -> Any:
    """Return the package ``mujoco``; an ImportError names the extra that provides it."""
    try:
        return importlib.import_module("mujoco")
    except ImportError as error:
        raise ImportError("the MuJoCo scene needs MuJoCo: pip install vibgym[mujoco]") from error


def build(
    surface: Any,
    part: Any,
    pose: Any,
    *,
    reach: float,
    timestep: float = 1e-3,
    contact_time: float | None = None,
    impratio: float = 10.0,
) -> Scene:
    """Return the model of one rectangular part and the elements within ``reach`` of it.

    Args:
        surface, part: a ``Surface`` and a rectangular ``Part`` of ``vibgym.scene``.
        pose: (3,) of the part at the start, m and rad.
        reach: largest displacement of the part, m; elements beyond are left out.
        timestep: s.
        contact_time: time constant of the contacts' spring and damper (``solref``), s; None is 20 time steps. With two, the
            least that MuJoCo advises, a part that slides this fast bounces; with many more it lags behind the elements.
        impratio: stiffness of friction over that of the normal direction.

    Raises:
        ImportError: MuJoCo is not installed.
        ValueError: the part is not a rectangle.
    """
    mujoco = load_mujoco()
    length, width = _rectangle(part)
    contact_time = 20.0 * timestep if contact_time is None else contact_time
    x, y, heading = (float(value) for value in pose)
    size, half = surface.element_size, 0.5 * surface.element_size
    span = reach + part.radius + surface.horizontal_amplitude + _CONTACTS_NEAR
    rows = range(max(0, math.floor((y - span) / size)), min(surface.rows, math.floor((y + span) / size) + 1))
    columns = range(max(0, math.floor((x - span) / size)), min(surface.columns, math.floor((x + span) / size) + 1))
    elements = "".join(
        f'<body pos="{(j + 0.5) * size!r} {(i + 0.5) * size!r} {-0.5 * ELEMENT_HEIGHT!r}" gravcomp="1">'
        f'<joint type="slide" axis="0 0 1"/><geom class="element"/></body>'
        for i in rows
        for j in columns
    )
    heavy = _HEAVY * part.mass
    friction = f"{part.friction!r} 0 0"
    xml = f"""
    <mujoco>
      <compiler angle="radian" autolimits="true"/>
      <option timestep="{timestep!r}" gravity="0 0 {-surface.gravity!r}" integrator="implicitfast" cone="elliptic"
              tolerance="1e-10" impratio="{impratio!r}"/>
      <default>
        <geom friction="{friction}" solref="{contact_time!r} 1" condim="3"/>
        <default class="element">
          <geom type="box" size="{half!r} {half!r} {0.5 * ELEMENT_HEIGHT!r}" mass="{heavy!r}" contype="1"
                conaffinity="2"/>
        </default>
      </default>
      <worldbody>
        <body name="carriage" gravcomp="1">
          <joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 1 0"/>
          <inertial pos="0 0 0" mass="{heavy!r}" diaginertia="1 1 1"/>
          {elements}
        </body>
        <body name="part" pos="{x!r} {y!r} {0.5 * part.height!r}" euler="0 0 {heading!r}">
          <freejoint/>
          <geom type="box" size="{0.5 * length!r} {0.5 * width!r} {0.5 * part.height!r}" mass="{part.mass!r}"
                contype="2" conaffinity="1"/>
        </body>
      </worldbody>
    </mujoco>"""
    model = mujoco.MjModel.from_xml_string(xml)
    row, column = np.meshgrid(np.array(rows), np.array(columns), indexing="ij")
    return Scene(model, mujoco.MjData(model), row.ravel(), column.ravel(), 2 + row.size)


def simulate(
    surface: Any,
    part: Any,
    pose: Any,
    velocity: Any,
    amplitude: Any,
    phase: Any,
    periods: int,
    *,
    timestep: float = 1e-3,
    contact_time: float | None = None,
    impratio: float = 10.0,
    reach: float | None = None,
) -> Run:
    """Simulate one rectangular part over whole periods under a held drive; arguments as for the reference and :func:`build`.

    Args:
        timestep: s; a period must be a whole number of steps.
        reach: None is the distance at ``0.72 a_h w``, the fastest drift, plus the initial speed.

    Raises:
        ImportError: MuJoCo is not installed.
        ValueError: the part is not a rectangle, or a period not a whole number of time steps.
        RuntimeError: MuJoCo's state is no longer finite.
    """
    mujoco = load_mujoco()
    shape = (surface.rows, surface.columns)
    amplitude, phase = np.broadcast_to(amplitude, shape), np.broadcast_to(phase, shape)
    steps = round(surface.period / timestep)
    if steps < 1 or abs(steps * timestep - surface.period) > 1e-9 * surface.period:
        raise checks.refuse("timestep", timestep, f"a whole fraction of the period {surface.period:g} s")
    drift = 0.72 * surface.table_speed + math.hypot(velocity[0], velocity[1])
    span = periods * surface.period * drift if reach is None else reach
    scene = build(surface, part, pose, reach=span, timestep=timestep, contact_time=contact_time, impratio=impratio)
    model, data = scene.model, scene.data
    driven = slice(0, scene.part)
    place, rate, push = _drive(surface, amplitude[scene.row, scene.column], phase[scene.row, scene.column], steps)
    inertia = np.full(scene.part, _HEAVY * part.mass)
    inertia[:2] *= len(scene.row) + 1.0  # the carriage carries the elements
    push *= inertia
    first = scene.part
    data.qpos[driven], data.qvel[driven] = place[0], rate[0]
    # The part starts at the mean height of the elements near it, moving with them.
    near = np.hypot(
        (scene.column + 0.5) * surface.element_size - data.qpos[first],
        (scene.row + 0.5) * surface.element_size - data.qpos[first + 1],
    ) < part.radius + 0.5 * surface.element_size  # fmt: skip
    height, climb = (array[0, 2:][near].mean() if near.any() else 0.0 for array in (place, rate))
    data.qpos[first + 2] += height
    data.qvel[first : first + 6] = [velocity[0], velocity[1], climb, 0, 0, velocity[2]]
    path, heading = np.empty((periods + 1, 3)), float(pose[2])
    path[0] = data.qpos[first], data.qpos[first + 1], heading
    began = time.perf_counter()
    for period in range(periods):
        for k in range(steps):
            data.qpos[driven], data.qvel[driven], data.qfrc_applied[driven] = place[k], rate[k], push[k]
            mujoco.mj_step(model, data)
        w, qx, qy, qz = data.qpos[first + 3 : first + 7]
        now = math.atan2(2.0 * (w * qz + qx * qy), 1.0 - 2.0 * (qy * qy + qz * qz))
        heading += math.remainder(now - heading, 2.0 * math.pi)
        path[period + 1] = data.qpos[first], data.qpos[first + 1], heading
    seconds = time.perf_counter() - began
    if not np.isfinite(path).all():
        raise RuntimeError(f"MuJoCo's state is no longer finite at a time step of {timestep:g} s")
    return Run(path, np.diff(path, axis=0) / surface.period, seconds)


def _rectangle(part: Any) -> tuple[float, float]:
    """Return length and width of a rectangular part."""
    outline = np.asarray(part.outline)
    if len(outline) == 4:
        length, width = 2.0 * np.abs(outline).max(axis=0)
        if np.allclose(np.abs(outline), [0.5 * length, 0.5 * width], rtol=0.0, atol=1e-9 * part.radius):
            return float(length), float(width)
    raise checks.refuse("part", part.name, "a rectangle along its axes; other outlines are not boxes in MuJoCo")


def _drive(surface: Any, amplitude: np.ndarray, phase: np.ndarray, steps: int) -> tuple[np.ndarray, ...]:
    """Return position, velocity and acceleration of the driven joints at every step of a period: x, y, the elements' z."""
    w, angle = surface.angular_frequency, np.arange(steps)[:, None] * (2.0 * math.pi / steps)
    radius = np.concatenate([[surface.horizontal_amplitude] * 2, amplitude])
    shift = np.concatenate([[0.0, -0.5 * math.pi], phase])
    place = radius * np.cos(angle + shift)
    return place, -w * radius * np.sin(angle + shift), -(w**2) * place
