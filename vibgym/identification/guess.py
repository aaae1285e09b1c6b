"""First estimates of a machine's parameters, and of the initial states of segments."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from vibgym import checks
from vibgym.actuators import DataSheet
from vibgym.identification.log import Log
from vibgym.identification.machine import Camera
from vibgym.identification.plant import LOCAL, Parameters
from vibgym.identification.segments import Segment
from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface
from vibgym.simulation.plant import lead_angle

LATENCIES = 9
"""Latencies tried: 0 to 8 periods, or more with a larger nominal one."""

CANDIDATES = 3
"""Latencies compared by simulation, after a linear regression has ranked them."""

LARGEST_ZONE = 2.5e-4
"""m, largest dead zone tried; the prototype has 0.1 mm."""

MIRRORED = 0.95
"""Sum of squares of the regression with mirrored axes, over that without, below which the camera's axes are mirrored."""

AXES = {"no axis": (False, False), "x": (True, False), "y": (False, True), "x and y": (True, True)}
"""Axes of positions that are tried mirrored."""

CAMERA = np.array([1.0, 0.0, 0.0, 0.0])
"""Scale, turn and shift of an exact camera."""


def latencies_of(sheet: DataSheet) -> int:
    """Return the number of latencies to try, from 0 on."""
    return max(LATENCIES, sheet.latency + 4)


def first_estimates(
    log: Log, segments: Sequence[Segment], surface: Surface, kinds: Sequence[Part], sheet: DataSheet
) -> list[Parameters]:
    """Return first estimates for the likeliest latencies.

    Regression of second differences of positions on the mean command under the part and on its velocity: near rest the
    acceleration is ``-(i mu w^2 / 2)`` times the conjugate phasor (first order, :mod:`vibgym.physics.averaged`).

    Args:
        log: the recording.
        segments: of it.
        surface: with the frequency of the recording.
        kinds: nominal parts, by kind.
        sheet: nominal actuators.

    Raises:
        ValueError: too few images one period apart, no commands under the parts, or mirrored axes.
    """
    tried = {axes: _regressions(log, segments, surface, kinds, sheet, np.array(signs)) for axes, signs in AXES.items()}
    best, plain = min(tried, key=lambda axes: tried[axes][0][0]), tried["no axis"]
    if tried[best][0][0] < MIRRORED * plain[0][0]:
        got = f"positions that agree with the commands if {best} is mirrored (or if all phases are negated)"
        allowed = "x to the right and y upwards on the table, as the commands' columns and rows"
        raise checks.refuse("log.pose", got, allowed)
    estimates = []
    for _, latency, factor in plain[:CANDIDATES]:
        response = factor / (-0.5j * surface.angular_frequency**2)
        lead = lead_angle(surface, float(np.mean([kinds[segment.kind].friction for segment in segments])))
        zone = min(sheet.dead_zone, LARGEST_ZONE)
        estimates.append(
            Parameters(
                friction=np.array([kind.friction for kind in kinds]),
                horizontal_amplitude=surface.horizontal_amplitude,
                gain=float(np.clip(abs(response), 0.4, 1.6)),
                phase=wrapped(lead - np.angle(response)),
                dead_zone=zone,
                dead_zone_form=sheet.dead_zone_form,
                latency=latency,
                camera=CAMERA,
                elements=np.zeros((surface.rows, surface.columns, 2)),
            )
        )
    return estimates


def _regressions(
    log: Log,
    segments: Sequence[Segment],
    surface: Surface,
    kinds: Sequence[Part],
    sheet: DataSheet,
    mirrored: np.ndarray,
) -> list[tuple[float, int, complex]]:
    """Return sum of squares, latency and response of the regressions of :func:`first_estimates`, the best first.

    Args:
        mirrored: (2,) bool, axes of the positions to mirror.
    """
    commands = log.amplitude * np.exp(1j * log.phase)
    latencies = latencies_of(sheet)
    rows, accelerations, velocities, patches, frictions = [], [], [], [], []
    for segment in segments:
        position = np.where(mirrored, [surface.width, surface.depth] - segment.pose[:, :2], segment.pose[:, :2])
        x = position[:, 0] + 1j * position[:, 1]
        regular = np.abs(np.diff(segment.instant) - 1.0) < 0.2
        for k in np.flatnonzero(regular[:-1] & regular[1:]):
            rows.append(segment.first + round(segment.instant[k]))
            accelerations.append((x[k + 2] - 2.0 * x[k + 1] + x[k]) / surface.period**2)
            velocities.append((x[k + 2] - x[k]) / (2.0 * surface.period))
            place = position[k + 1] // surface.element_size
            row = int(np.clip(place[1], 0, surface.rows - 1))
            patches.append((row, int(np.clip(place[0], 0, surface.columns - 1))))
            frictions.append(kinds[segment.kind].friction)
    if len(rows) < 20:
        raise checks.refuse("log", f"{len(rows)} images one period apart", "a recording with one image a period")
    row, patch, mu = np.array(rows), np.array(patches), np.array(frictions)
    a, v = np.array(accelerations), np.array(velocities)
    near = np.zeros((latencies, len(row)), dtype=complex)
    for latency in range(latencies):
        for late in (0, 1):  # a second difference spans two periods
            at = np.clip(row + late - latency, 0, len(log) - 1)
            for i in (-1, 0, 1):
                for j in (-1, 0, 1):
                    y = np.clip(patch[:, 0] + i, 0, surface.rows - 1)
                    x = np.clip(patch[:, 1] + j, 0, surface.columns - 1)
                    near[latency] += commands[at, y, x] / 18.0
    if not np.abs(near).max() > 0.0:
        allowed = "commands under the parts (too little excitation)"
        raise checks.refuse("log.amplitude", "zeros wherever a part was", allowed)
    fits = []
    for latency in range(latencies):
        design = np.column_stack([mu * near[latency].conj(), mu * v])
        solution, *_ = np.linalg.lstsq(design, a, rcond=None)
        fits.append((float((np.abs(a - design @ solution) ** 2).sum()), latency, complex(solution[0])))
    return sorted(fits, key=lambda fit: fit[0])


def starts_of(segments: Sequence[Segment], parameters: Parameters, surface: Surface) -> np.ndarray:
    """Return initial states (segments, LOCAL) from parabolas through the first images.

    The velocity at the start of a period differs from the mean one by that of a part on elements at rest.
    """
    camera, starts = Camera(*parameters.camera.tolist()), np.zeros((len(segments), LOCAL))
    for k, segment in enumerate(segments):
        some = slice(0, 7)
        time = segment.instant[some] * surface.period
        fitted = np.polynomial.polynomial.polyfit(time, camera.corrected(segment.pose[some], surface), 2)
        starts[k, :3], starts[k, 3:] = fitted[0], fitted[1]
        starts[k, 3:5] += surface.idle_velocity(float(parameters.friction[segment.kind]))
    return starts


def wrapped(angle: float) -> float:
    """Return an angle in [-pi, pi)."""
    return float((angle + math.pi) % (2.0 * math.pi) - math.pi)
