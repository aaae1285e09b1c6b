"""Pose sensor: poses with white noise."""

from __future__ import annotations

import math
from typing import Any

from vibgym.sensing.ideal import IdealSensor

POSITION_NOISE, HEADING_NOISE = 1e-4, math.radians(0.2)


class PoseSensor(IdealSensor):
    """Reads every part's pose with noise; its velocity is the difference to the pose read before.

    It is the ideal sensor with an effect that is always there.

    Args:
        *scene: see :class:`Sensor`.
        noise: standard deviation anew at each look, see :class:`vibgym.sensing.effects.Noise`.
        **base: ``delay``, ``rate``, and other effects: ``bias``, ``dropout``.

    Raises:
        ValueError: a bad setting.
    """

    def __init__(self, *scene: Any, noise: Any = (POSITION_NOISE, HEADING_NOISE), **base: Any) -> None:
        super().__init__(*scene, noise=noise, **base)
