"""Estimators: measurements from readings that are delayed, noisy and incomplete."""

from __future__ import annotations

from typing import Any

from vibgym.registry import Registry
from vibgym.sensing.estimation.filter import KalmanEstimator, ModelEstimator
from vibgym.sensing.estimation.predictors import Plant
from vibgym.sensing.stage import Hold

ESTIMATORS: Registry[Any] = Registry("estimator", {"none": Hold, "kalman": KalmanEstimator, "model": ModelEstimator})
"""Estimators by name, constructed with sensor, plant, latency and walls: a :class:`vibgym.sensing.Estimator`.
``ESTIMATORS.register(name, cls)`` adds one."""

__all__ = ["ESTIMATORS", "Plant"]
