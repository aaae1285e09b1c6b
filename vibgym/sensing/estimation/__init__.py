"""Estimators: from readings, late, noisy and with gaps, to what is known of the parts now."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from vibgym import checks
from vibgym.registry import Registry
from vibgym.sensing.base import Sensor
from vibgym.sensing.estimation.filter import FilterEstimator
from vibgym.sensing.estimation.hold import Hold
from vibgym.sensing.estimation.predictors import FreePredictor, ModelPredictor, Plant
from vibgym.sensing.stage import Estimator


def none(sensor: Sensor, plant: Plant, latency: int, walls: Sequence[str]) -> Estimator:
    """The last reading, as it is."""
    return Hold(sensor)


def kalman(
    sensor: Sensor,
    plant: Plant,
    latency: int,
    walls: Sequence[str],
    *,
    acceleration: float = 1.5,
    unknown: float = 1.0,
    drift: float = 0.02,
    sigma: float = 1.0,
) -> Estimator:
    """A Kalman filter for parts that know of friction and of nothing else that acts; see :class:`FilterEstimator`."""
    acceleration = checks.number("sensor.estimator.acceleration", acceleration, above=0.0, most=1e3)
    return FilterEstimator(
        sensor,
        FreePredictor(sensor),
        latency,
        floor=acceleration,
        model_error=0.0,
        unknown=unknown,
        drift=drift,
        sigma=sigma,
    )


def model(
    sensor: Sensor,
    plant: Plant,
    latency: int,
    walls: Sequence[str],
    *,
    model: str = "planar",
    model_error: float = 0.06,
    acceleration: float = 0.001,
    unknown: float = 0.01,
    drift: float = 0.005,
    sigma: float = 1.0,
) -> Estimator:
    """The simulator as a model of the machine, corrected by a Kalman filter; see :class:`FilterEstimator`."""
    try:
        predictor = ModelPredictor(sensor, plant, walls, model)
    except ValueError as error:  # the environment has refused all that may be wrong but this model
        raise ValueError(f"sensor.estimator.{error}") from None
    share = checks.number("sensor.estimator.model_error", model_error, least=0.0, most=10.0)
    acceleration = checks.number("sensor.estimator.acceleration", acceleration, above=0.0, most=1e3)
    return FilterEstimator(
        sensor, predictor, latency, floor=acceleration, model_error=share, unknown=unknown, drift=drift, sigma=sigma
    )


ESTIMATORS: Registry[Any] = Registry("estimator", {"none": none, "kalman": kalman, "model": model})
"""Estimators by name; ``ESTIMATORS.register(name, make)`` adds one of your own, made as
``make(sensor, plant, latency, walls, **settings)``, which follows :class:`vibgym.sensing.Estimator`."""


def estimator_from(value: Any, sensor: Sensor, plant: Plant, latency: int, walls: Sequence[str]) -> Any:
    """An estimator from its name or a mapping with ``kind`` and its own settings."""
    kind, settings = checks.named("sensor.estimator", value, tuple(ESTIMATORS))
    return checks.called("sensor.estimator", ESTIMATORS[kind], (sensor, plant, latency, walls), settings)


__all__ = ["ESTIMATORS", "Plant", "estimator_from"]
