"""Counter-based random numbers: published vectors, moments and independence."""

from __future__ import annotations

import numpy as np
import pytest

from vibgym.kernels.jit import jit
from vibgym.physics.core import noise

# Known answers of Philox4x32-10 from the authors' library (Random123, file kat_vectors): counter, key, result.
KNOWN = [
    ([0, 0, 0, 0], [0, 0], [0x6627E8D5, 0xE169C58D, 0xBC57AC4C, 0x9B00DBD8]),
    ([0xFFFFFFFF] * 4, [0xFFFFFFFF] * 2, [0x408F276D, 0x41C83B0E, 0xA20BC7C6, 0x6D5451FD]),
    (
        [0x243F6A88, 0x85A308D3, 0x13198A2E, 0x03707344],
        [0xA4093822, 0x299F31D0],
        [0xD16CFE09, 0x94FDCCEB, 0x5001E420, 0x24126EA1],
    ),
]


@jit
def draw(key, counter):
    return noise.philox(key, counter[0], counter[1], counter[2], counter[3])


@jit
def fill(key, uniform, normal):
    for k in range(uniform.shape[0]):
        uniform[k, 0], uniform[k, 1], uniform[k, 2], uniform[k, 3] = noise.uniforms(key, k, 1, 0, 0)
        normal[k, 0], normal[k, 1], normal[k, 2], normal[k, 3] = noise.normals(key, k, 2, 0, 0)


@pytest.mark.parametrize(("counter", "key", "result"), KNOWN)
def test_the_published_vectors(counter, key, result):
    assert list(draw(np.array(key), np.array(counter))) == result


def test_moments_and_independence():
    n = 50_000
    uniform, normal = np.empty((n, 4)), np.empty((n, 4))
    fill(noise.keys_from(np.array([[0.3, 0.7]]))[0], uniform, normal)
    assert uniform.min() > 0.0 and uniform.max() < 1.0
    # Four standard errors each.
    assert np.abs(uniform.mean(axis=0) - 0.5).max() < 4 * np.sqrt(1 / 12 / n)
    assert np.abs(uniform.var(axis=0) - 1 / 12).max() < 4 * np.sqrt(1 / 180 / n)
    assert np.abs(normal.mean(axis=0)).max() < 4 / np.sqrt(n)
    assert np.abs(normal.var(axis=0) - 1.0).max() < 4 * np.sqrt(2 / n)
    assert np.abs((normal**4).mean(axis=0) - 3.0).max() < 4 * np.sqrt(96 / n)
    for values in (uniform, normal):
        related = np.corrcoef(np.concatenate([values[:-1], values[1:]], axis=1).T) - np.eye(8)
        assert np.abs(related).max() < 4.5 / np.sqrt(n)


def test_keys_differ_where_uniform_numbers_do():
    keys = noise.keys_from(np.random.default_rng(0).random((1000, 2)))
    assert keys.min() >= 0 and keys.max() < 2**32 and len(np.unique(keys, axis=0)) == 1000
