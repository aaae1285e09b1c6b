"""Temporary first-order inverse (to be replaced)."""

from __future__ import annotations

import numpy as np

from vibgym.fields import lead_angle

DRAG_GROWTH = 0.8


class FrictionalInverse:
    def __init__(self, surface, parts, most):
        friction = np.array([part.friction for part in parts])
        self.push = 0.5 * friction * surface.full_scale
        self.drag = 0.5 * friction * surface.gravity / max(surface.table_speed, 1e-3)
        self.arm = np.sqrt([part.gyration for part in parts])
        self.most, self.speed = most, max(surface.table_speed, 1e-3)
        self.lead = np.array([lead_angle(surface, part.friction) for part in parts])

    def _drag(self, velocity):
        slip = (velocity[..., :2] ** 2).sum(axis=-1, keepdims=True) / self.speed**2
        growth = np.concatenate([np.repeat(1 + DRAG_GROWTH * slip, 2, -1), np.ones_like(slip)], axis=-1)
        return self.drag[:, None] * growth * velocity

    def __call__(self, velocity, wanted):
        scale = np.stack([1 / self.push, 1 / self.push, self.arm / self.push], -1)
        drag = self._drag(velocity)
        push = (wanted + drag) * scale
        force = np.sqrt((push[..., :2] ** 2).sum(-1, keepdims=True)) / self.most
        push[..., :2] /= np.maximum(force, 1.0)
        push[..., 2] = np.clip(push[..., 2], -self.most, self.most)
        acceleration = push / scale - drag
        c, s = np.cos(self.lead), np.sin(self.lead)
        x, y = push[..., 0], push[..., 1]
        return np.stack([x * c + y * s, y * c - x * s, push[..., 2]], -1), acceleration

    def coasting(self, velocity):
        return -self._drag(velocity)
