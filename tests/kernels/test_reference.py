"""Records by reference and pinned in memory: kernels see what Python wrote, and copies have their own."""

import copy
import pickle
from typing import NamedTuple

import numpy as np
import pytest

from vibgym.kernels.jit import jit
from vibgym.kernels.reference import Layout, Pinned, reference


class Inner(NamedTuple):
    values: np.ndarray
    grid: np.ndarray
    count: int


class Outer(NamedTuple):
    scale: float
    inner: Inner
    same: Inner


OUTER: Layout[Outer] = Layout("OUTER", __name__)
outer_at = OUTER.at


def record():
    inner = Inner(np.arange(4.0), np.arange(6, dtype=np.int64).reshape(2, 3), 4)
    return Outer(0.5, inner, Inner(np.zeros(1), np.zeros((1, 1), np.int64), 7))


@jit
def work(outer):
    total = 0.0
    for k in range(outer.inner.count):
        outer.inner.values[k] *= outer.scale
        total += outer.inner.values[k] + outer.same.count * outer.inner.grid[1, 2]
    return total


@jit
def by_reference(outer):
    return work(reference(outer))


@jit
def pinned(address):
    return work(outer_at(address))


def test_the_same_by_value_by_reference_and_pinned():
    def when_pinned(outer):
        kept = Pinned(OUTER, outer)
        return pinned(kept.address)

    results = []
    for call in (work, by_reference, when_pinned):
        outer = record()
        results.append((call(outer), outer.inner.values.tolist()))
    assert results == [(0.5 * 6.0 + 4 * 7 * 5, [0.0, 0.5, 1.0, 1.5])] * 3


@pytest.mark.parametrize("copied", [copy.deepcopy, lambda value: pickle.loads(pickle.dumps(value))])
def test_copies_are_pinned_anew_and_keep_what_they_share(copied):
    one = Pinned(OUTER, record())
    two, values = copied((one, one.record.inner.values))
    pinned(two.address)
    assert two.address != one.address and two.layout is OUTER
    assert two.record.inner.values is values and values.tolist() == [0.0, 0.5, 1.0, 1.5]
    assert one.record.inner.values.tolist() == [0.0, 1.0, 2.0, 3.0]


def test_another_layout_is_refused():
    Pinned(OUTER, record())
    with pytest.raises(TypeError, match="^OUTER"):
        Pinned(OUTER, record()._replace(scale=1))
    with pytest.raises(TypeError, match="int64, float64, arrays and records"):
        Pinned(Layout("FLAG", __name__), Inner(np.zeros(1), np.zeros((1, 1), np.int64), True))
