"""Estimators: measurements from readings that are delayed, noisy and incomplete."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vibgym import checks
from vibgym.registry import Registry
from vibgym.sensing.base import Sensor
from vibgym.sensing.estimation.filter import KalmanEstimator, ModelEstimator
from vibgym.sensing.estimation.predictors import Plant
from vibgym.sensing.stage import Hold

ESTIMATORS: Registry[Any] = Registry("estimator", {"none": Hold, "kalman": KalmanEstimator, "model": ModelEstimator})
"""Estimators by name. ``ESTIMATORS.register(name, make)`` adds one; ``make(sensor, plant, latency, walls, **settings)``
returns a :class:`vibgym.sensing.Estimator`."""


def estimator_from(value: Any, sensor: Sensor, plant: Plant, latency: int, walls: Sequence[str]) -> Any:
    """Return an estimator from its name or a mapping with ``kind`` and its settings."""
    kind, settings = checks.named("sensor.estimator", value, tuple(ESTIMATORS))
    return checks.made("sensor.estimator", ESTIMATORS[kind], (sensor, plant, latency, walls), settings)


__all__ = ["ESTIMATORS", "Plant", "estimator_from"]
