"""Data sheet of actuators: properties known beforehand, without the values drawn for an episode."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class DataSheet:
    """Nominal numbers of the actuators, the same for all elements."""

    limit: float  # m, largest amplitude that they do
    dead_zone: float = 0.0  # m, amplitude below which they do little or nothing
    dead_zone_form: str = "hard"  # what becomes of smaller ones, see :data:`vibgym.physics.core.hardware.FORMS`
    latency: int = 0  # periods between a command and its effect
    resolution: float = 0.0  # m, of the amplitude; 0: continuous
    bandwidth: float | None = None  # Hz, of a lag of first order; None: they follow at once
