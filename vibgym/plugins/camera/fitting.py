"""Measurement error of the camera: sampled from synthetic images, for the statistical sensor and for estimators.

The error has two parts. The error from pixels, lens and calibration depends on the pose alone: it is constant at rest and
cannot be averaged. The error from pixel noise is independent at each sample.
"""

from __future__ import annotations

import hashlib
import math
import pickle
from typing import NamedTuple

import numpy as np

from vibgym.plugins.camera.sampling import new_seen, new_track, take_samples
from vibgym.plugins.camera.setup import Setup

SAMPLES = 400
"""Sampled poses of each kind; deviations are accurate to a tenth (the errors of whole pixels have long tails)."""

CLEAR = 3.0
"""Standard errors below which a mean counts as zero."""

SHIFT = 0.25
"""px, displacement of the part for the correlation length of its error."""

CELL = 2.0
"""Cell of the lattice of :mod:`vibgym.plugins.camera.statistical` over the length l of a correlation exp(-d^2 / 2 l^2)."""


class ErrorModel(NamedTuple):
    """Error of a measured pose, kind by kind: m, m, rad."""

    mean: np.ndarray  # (kinds, 3)
    fixed: np.ndarray  # (kinds, 3) standard deviation of the part that depends on the pose alone
    white: np.ndarray  # (kinds, 3) standard deviation of white noise
    cell: np.ndarray  # (kinds, 3) m, m, rad over which the fixed error changes


def sample_alone(setup: Setup, kind: int, pose: np.ndarray, key: int) -> tuple[np.ndarray, np.ndarray]:
    """Return errors (n, 3) of one sample of a part of that kind at each pose (n, 3), and whether it was seen (n,)."""
    rig, known = setup.alone(kind)
    count = len(pose)
    there = np.ascontiguousarray(pose[:, None])
    track = new_track(count, 1)
    track.pose[:] = there
    keys = np.stack([np.full(count, key), np.arange(count)], axis=1)
    read, velocity, seen = np.zeros_like(there), np.zeros_like(there), np.zeros((count, 1), dtype=bool)
    earlier = there.copy() if setup.lag > 0.0 else np.empty((count, 0, 3))
    take_samples(
        np.arange(count), there, earlier, np.ones((count, 1), dtype=bool), rig, known, keys,
        np.zeros(count, dtype=np.int64), new_seen(setup.shape, 1, rig.background), track, read, velocity, seen,
    )  # fmt: skip
    return read[:, 0] - pose, seen[:, 0]


def random_poses(setup: Setup, kind: int, count: int, seed: int = 1) -> np.ndarray:
    """Return random poses (count, 3) of a part of that kind wholly on the surface."""
    random = np.random.default_rng(seed)
    radius = setup.known.traits.radius[kind]
    surface = setup.surface
    low = np.minimum(radius, 0.5 * np.array([surface.width, surface.depth]))
    place = low + (np.array([surface.width, surface.depth]) - 2.0 * low) * random.random((count, 2))
    return np.column_stack([place, random.uniform(-math.pi, math.pi, count)])


_sampled: dict[bytes, ErrorModel] = {}
MAX_SAMPLED = 64
"""Number of cached error models: environments with the same settings share one."""


def fit_errors(setup: Setup) -> ErrorModel:
    """Return the camera's errors for every kind of parts, the same for the same settings; do not change them."""
    key = hashlib.sha256(pickle.dumps((*setup.alone(0), setup.lag))).digest()
    if key not in _sampled:
        if len(_sampled) == MAX_SAMPLED:
            _sampled.clear()
        _sampled[key] = sampled_errors(setup)
    return _sampled[key]


def sampled_errors(setup: Setup) -> ErrorModel:
    """Compute :func:`fit_errors` without the cache."""
    traits, grain = setup.known.traits, setup.known.grain
    kinds = len(traits.area)
    model = ErrorModel(*(np.zeros((kinds, 3)) for _ in range(4)))
    for kind in range(kinds):
        pose = random_poses(setup, kind, SAMPLES)
        steps = np.array([SHIFT * grain / setup.pitch, SHIFT * grain, SHIFT * grain / traits.radius[kind]])
        here, seen = sample_alone(setup, kind, pose, 1)
        again, still = sample_alone(setup, kind, pose, 2)
        both = seen & still
        mean = here[both].mean(axis=0) if both.any() else np.zeros(3)
        white = 0.5 * (here - again)[both].var(axis=0) if both.any() else np.zeros(3)
        fixed = np.maximum(here[both].var(axis=0) - white, 0.0) if both.any() else np.zeros(3)
        chance = CLEAR * np.sqrt((fixed + white) / max(both.sum(), 1))
        model.mean[kind] = np.where(np.abs(mean) > chance, mean, 0.0)
        model.white[kind], model.fixed[kind] = np.sqrt(white), np.sqrt(fixed)
        for axis in range(3):
            moved = pose.copy()
            moved[:, axis] += steps[axis]
            there, all_seen = sample_alone(setup, kind, moved, 3)
            common = both & all_seen
            change = ((there - here)[common] ** 2).mean(axis=0) if common.any() else np.zeros(3)
            # For components with a significant fixed error: <(e' - e)^2> = 2 (1 - rho) fixed^2 + 2 white^2.
            heavy = fixed > 0.1 * white
            rho = 1.0 - 0.5 * (change - 2.0 * white)[heavy] / np.maximum(fixed[heavy], 1e-30)
            rho = float(np.clip(rho.mean(), 0.05, 0.999)) if heavy.any() else 0.999
            model.cell[kind, axis] = CELL * steps[axis] / math.sqrt(-2.0 * math.log(rho))
        if traits.order[kind] == 0:  # a heading that is not observable
            model.mean[kind, 2] = model.fixed[kind, 2] = model.white[kind, 2] = 0.0
    return model
