"""Starts of many parts, checked against distances by shapely."""

import math

import numpy as np
import pytest
import shapely
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import KDTree

from tests.tasks.helpers import made
from vibgym import Part, Surface
from vibgym.physics.contacts.hulls import all_gaps
from vibgym.scene.hulls import hulls_of
from vibgym.tasks import ArrangedTask, Singulate, Sort
from vibgym.tasks.starts import TRIES, lattice

ARRANGED = {"Sort": Sort, "Singulate": Singulate}

STEEL = Part.rectangle(0.050, 0.040, friction=0.64, name="steel")
ALUMINIUM = Part.rectangle(0.050, 0.035, friction=0.58, name="aluminium")
DISC = Part.disc(0.020, friction=0.6, name="disc")
ELL = Part.polygon([[0, 0], [0.06, 0], [0.06, 0.02], [0.02, 0.02], [0.02, 0.05], [0, 0.05]], friction=0.5, name="ell")
SIX = [STEEL, ALUMINIUM] * 3
MIXED = [STEEL, DISC, ELL, DISC, ELL, STEEL]
SURFACE = Surface()
BELOW_ONE = np.nextafter(1.0, 0.0)
WAYS = {"scattered": 3, "crowded": 2}


def shapes(parts, pose):
    """Return outlines at a pose (parts, 3), and radii; a disc is a point with its radius."""
    result = []
    for part, (x, y, heading) in zip(parts, pose, strict=True):
        cosine, sine = math.cos(heading), math.sin(heading)
        corners = [x, y] + part.outline @ np.array([[cosine, sine], [-sine, cosine]])
        disc = part.symmetry == 0
        result.append((shapely.Point(x, y), 0.020) if disc else (shapely.Polygon(corners), 0.0))
    return result


def distances(parts, pose):
    """Return gaps (parts, parts) m; infinite on the diagonal; 0 or less for overlaps."""
    placed = shapes(parts, pose)
    result = np.full((len(parts), len(parts)), np.inf)
    for i, (a, ra) in enumerate(placed):
        for j, (b, rb) in enumerate(placed[:i]):
            result[i, j] = result[j, i] = a.distance(b) - ra - rb
    return result


def on_surface(parts, pose, surface):
    for shape, radius in shapes(parts, pose):
        left, bottom, right, top = shape.bounds
        if min(left, bottom) < radius - 1e-12:
            return False
        if right > surface.width - radius + 1e-12 or top > surface.depth - radius + 1e-12:
            return False
    return True


def starts(task, worlds=1, seed=0, uniform=None):
    numbers = np.random.default_rng(seed).random((worlds, task.draws)) if uniform is None else uniform
    return task.start(numbers)


def linked(gaps):
    """Return the size of the largest connected group of parts."""
    seen, more = set(), {0}
    while more:
        part = more.pop()
        seen.add(part)
        more |= set(np.flatnonzero(gaps[part] < 1e-6).tolist()) - seen
    return len(seen)


def check(way, parts, pose, surface=SURFACE):
    """Assert that a start is on the surface, with parts apart or in touch."""
    between = distances(parts, pose)
    assert on_surface(parts, pose, surface)
    if way == "scattered":
        assert between.min() >= 0.002 - 1e-12
    else:
        assert between.min() > -1e-12 and linked(between) == len(parts)


@pytest.mark.parametrize("parts", [SIX, MIXED, SIX * 2], ids=["six", "mixed", "twelve"])
def test_scattered_parts_keep_clear(parts):
    start = starts(Sort(SURFACE, parts), 40)
    assert start.present.all() and (start.goal == 0).all()
    for pose in start.pose:
        check("scattered", parts, pose)
    assert np.ptp(start.pose[..., 0]) > 0.7 and np.ptp(start.pose[..., 1]) > 0.12  # all over the surface
    assert np.abs(start.pose[..., 2]).max() <= math.pi and np.ptp(start.pose[..., 2]) > 6.0


@pytest.mark.parametrize("parts", [SIX, MIXED, SIX * 2], ids=["six", "mixed", "twelve"])
@pytest.mark.parametrize("task", ["Sort", "Singulate"])
def test_crowded_parts_are_in_touch(task, parts):
    crowd = made(Sort, SURFACE, parts, start="crowded") if task == "Sort" else Singulate(SURFACE, parts)
    start = starts(crowd, 30)
    gaps = np.empty((30, len(parts), len(parts)))
    all_gaps(hulls_of(crowd.parts), start.pose, gaps)
    for pose, between in zip(start.pose, gaps, strict=True):
        assert distances(parts, pose) == pytest.approx(between, abs=1e-9)  # of which none is negative
        assert between.min() > 0.0
        check("crowded", parts, pose)
    middle = start.pose[..., :2].mean(axis=1, keepdims=True)
    assert np.ptp(middle[..., 0]) > 0.3  # different positions
    inner = np.hypot(*np.moveaxis(start.pose[..., :2] - middle, -1, 0)).argmin(axis=1)
    assert len(set(inner.tolist())) > len(parts) // 2  # and different parts in the middle


class Anywhere(ArrangedTask):
    """Parts on a surface with hardly more room than needed."""


TIGHT = Surface(rows=7, columns=7)


@pytest.mark.parametrize("value", [0.0, 0.5, BELOW_ONE])
@pytest.mark.parametrize("way", WAYS)
@pytest.mark.parametrize("parts", [SIX[:4], MIXED[:4], [DISC] * 4], ids=["blocks", "mixed", "discs"])
def test_the_lattice_is_the_fallback(way, parts, value):
    """With equal random numbers every part tries the same poses or directions repeatedly."""
    for surface in (SURFACE, TIGHT):
        task = made(Anywhere, surface, parts, start=way)
        start = starts(task, uniform=np.full((1, task.draws), value))
        check(way, parts, start.pose[0], surface)


def test_the_lattice_is_used_if_random_placement_fails():
    parts = [DISC] * 9
    surface = Surface(rows=6, columns=6)  # 156 mm: three discs and 2 mm between them fit along a side
    task = Anywhere(surface, parts)
    cells = {tuple(cell) for cell in task.starts._room.cells.round(9).tolist()}
    assert len(cells) == 9
    start = starts(task, 50)
    met = [{tuple(at) for at in pose[:, :2].round(9).tolist()} == cells for pose in start.pose]
    assert sum(met) > 25  # nine of nine by chance is rare
    orders = {tuple(pose[:, :2].round(6).ravel()) for pose, here in zip(start.pose, met, strict=True) if here}
    assert len(orders) == sum(met)  # cells are drawn
    for pose in start.pose:
        check("scattered", parts, pose, surface)


def test_pushing_together_gives_a_crowd_in_the_corner():
    parts = MIXED * 2
    surface = Surface(rows=10, columns=17)
    task = made(Anywhere, surface, parts, start="crowded")
    uniform = np.random.default_rng(0).random((20, task.draws))
    tries = uniform[:, 1 + len(parts) :].reshape(20, len(parts), TRIES, 2)
    tries[:, :, :, 0] = 0.25  # all from below, so the column of parts soon overhangs
    start = starts(task, uniform=uniform)
    for pose in start.pose:
        check("crowded", parts, pose, surface)
        assert pose[:, 0].min() == pytest.approx(max(part.radius for part in parts))


number = st.one_of(st.sampled_from([0.0, 0.25, 0.5, BELOW_ONE]), st.floats(0.0, BELOW_ONE))


@pytest.mark.parametrize("way", WAYS)
@settings(deadline=None, max_examples=60)
@given(data=st.data())
def test_any_numbers_give_a_valid_start(way, data):
    parts = MIXED
    task = made(Sort, SURFACE, parts, start=way, randomize={"parts": [1, 6]})
    uniform = np.random.default_rng(data.draw(st.integers(0, 999))).random((1, task.draws))
    for index, value in data.draw(st.dictionaries(st.integers(0, task.draws - 1), number, max_size=40)).items():
        uniform[0, index] = value
    start = task.start(uniform)
    present = start.present[0]
    assert np.isfinite(start.pose).all()
    check(way, [part for part, there in zip(parts, present, strict=True) if there], start.pose[0, present])


@pytest.mark.parametrize("task", ARRANGED)
def test_numbers_of_parts(task):
    start = starts(made(ARRANGED[task], SURFACE, SIX, randomize={"parts": [2, 5]}), 4000)
    count = start.present.sum(axis=1)
    assert np.bincount(count, minlength=7)[2:6] / 4000 == pytest.approx(0.25, abs=0.04)  # 6 standard deviations
    assert count.min() == 2 and count.max() == 5
    share = start.present.mean(axis=0)
    assert share == pytest.approx(3.5 / 6, abs=0.05)
    together = np.corrcoef(start.present.T)
    assert np.ptp(together[~np.eye(6, dtype=bool)]) < 0.12  # any pair of parts
    off = start.pose[~start.present]
    assert (off[:, 0] < -0.1).all() and (off[:, 1] < -0.1).all()


@given(
    size=st.tuples(st.floats(0.01, 1.0), st.floats(0.01, 1.0)), radius=st.floats(0.005, 0.2), gap=st.floats(0.0, 0.05)
)
def test_lattice(size, radius, gap):
    low = np.array([0.3, -0.2])
    cells = lattice(low, low + size, radius, gap)
    across = [math.floor((length - 2 * radius) / (2 * radius + gap) + 1e-9) + 1 for length in size]
    fits = min(size) >= 2 * radius - 1e-12
    assert len(cells) == (across[0] * across[1] if fits else 0)
    if fits:
        assert (cells >= low + radius - 1e-9).all() and (cells <= low + size - radius + 1e-9).all()
        nearest = KDTree(cells).query(cells, k=2)[0][:, 1]  # inf for one alone
        assert nearest.min() >= 2 * radius + gap - 1e-8
        assert (np.lexsort((cells[:, 1], cells[:, 0])) == np.arange(len(cells))).all()  # column by column
