"""Result of a fit."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from vibgym.scene.parts import Part
from vibgym.scene.surface import Surface

ADVICE = {
    "friction": "parts that coast on elements at rest",
    "horizontal_amplitude": "runs at full amplitude, at more than half the top speed",
    "gain": "commands at several amplitudes above the dead zone",
    "phase": "commands above the dead zone",
    "dead_zone": "amplitudes from 0 to 0.2 mm, each for some periods",
    "camera_scale": "paths over the whole surface with different commands on neighbouring elements",
    "camera_turn": "paths over the whole surface with different commands on neighbouring elements",
    "camera_x": "different commands on neighbouring elements along x",
    "camera_y": "different commands on neighbouring elements along y",
}
"""What a recording must contain to identify a parameter."""


@dataclass(frozen=True)
class Fitted:
    """Result of :func:`fit`.

    Attributes:
        values: estimates by name: ``friction``, ``frequency`` (Hz),
            ``horizontal_amplitude`` (m), ``gain``, ``phase`` (rad), ``dead_zone`` (m), ``dead_zone_form``, ``latency``
            (periods), ``gain_spread``, ``phase_spread`` (rad), ``camera_scale``, ``camera_turn`` (rad), ``camera_x``,
            ``camera_y`` (m), ``max_amplitude`` (m, of the elements), ``noise_position`` (m), ``noise_heading`` (rad),
            ``friction_law`` (kind or ``"constant"``); with a law that the recording requires ``rise`` and ``rise_speed`` (m/s),
            see :class:`vibgym.scene.friction_laws.Stribeck`. With several kinds of parts, these three and friction end in
            ``.<name>``.
        intervals: 95 % intervals (low, high) of all numbers but ``latency`` and ``max_amplitude``.
        correlation: of the estimates, by pairs of names.
        surface: the table with fitted amplitude and frequency; ``max_amplitude`` is that of the elements, which a gain above 1
            lets exceed that of commands, ``actuators["limit"]``.
        actuators: setting of environments: prototype actuators with the fitted values.
        parts: with the fitted friction, and with a friction law if the recording requires one.
        elements: (rows, columns, 2) relative gain and phase error (rad) of each element, shrunk towards 0.
        element_deviations: (rows, columns, 2) their standard deviations; those of elements without data equal the spreads.
        unidentified: what the recording does not determine, and which recording would.
        notes: gaps, assumptions and warnings.
        residuals: (n, 6) cycle, part, measured x and y (m), residual along x and y (m) of every image used.
        alternatives: for latencies and forms of the dead zone that were tried, chi squared above the best; for constant
            friction, chi squared above that of the best friction law.
    """

    values: dict[str, Any]
    intervals: dict[str, tuple[float, float]]
    correlation: dict[tuple[str, str], float]
    surface: Surface
    actuators: dict[str, Any]
    parts: tuple[Part, ...]
    elements: np.ndarray
    element_deviations: np.ndarray
    unidentified: dict[str, str]
    notes: list[str]
    residuals: np.ndarray
    alternatives: dict[str, float]
