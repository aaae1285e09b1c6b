"""The library of shapes: fixed content, families, splits."""

import hashlib

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.scene.library import FAMILIES, FRICTION, HELD_OUT, SIZE, SPLITS, largest_dimension, shapes
from vibgym.scene.outlines import is_convex

EVERY = {split: shapes(split) for split in SPLITS}


def family(part):
    return part.name.split("-")[0]


def test_the_library_does_not_change():
    """Published scores refer to these parts."""
    digest = hashlib.sha256()
    for split, parts in EVERY.items():
        for part in parts:
            digest.update(f"{split} {part.name} {part.friction}".encode())
            digest.update(np.round(1e9 * part.outline).astype("<i8").tobytes())
    assert digest.hexdigest() == "66e6fb037d5654e98313c86a130b1eb6f5e68da5362be4148364d2e72fbd583b"


def test_splits_have_their_families_and_share_no_part():
    for split, parts in EVERY.items():
        expected = {name for name in FAMILIES if (name in HELD_OUT) == (split == "held_out")}
        assert [family(part) for part in parts].count(family(parts[0])) == SPLITS[split]
        assert {family(part) for part in parts} == expected and len(parts) == SPLITS[split] * len(expected)
    every = [part for parts in EVERY.values() for part in parts]
    assert len({part.name for part in every}) == len(every)
    assert len({(round(1e9 * part.area), round(1e15 * part.gyration)) for part in every}) == len(every)


@pytest.mark.parametrize("split", SPLITS)
def test_sizes_and_frictions_cover_their_ranges(split):
    parts = EVERY[split]
    drawn = [part for part in parts if family(part) != "real"]
    size = np.array([largest_dimension(part.outline) for part in drawn])
    friction = np.array([part.friction for part in parts])
    assert SIZE[0] - 1e-8 <= size.min() < 0.032 and 0.065 < size.max() <= SIZE[1] + 1e-8
    assert FRICTION[0] <= friction.min() < 0.4 and 0.8 < friction.max() <= FRICTION[1]
    surface = Surface()
    assert all(surface.slides_permanently(part.static_friction) for part in parts)


def test_families_have_the_forms_that_they_are_named_for():
    every = [part for parts in EVERY.values() for part in parts]
    of = {name: [part for part in every if family(part) == name] for name in FAMILIES}
    assert all(is_convex(part.outline) and part.symmetry in (2, 4) for part in [*of["block"], *of["bar"]])
    assert not any(is_convex(part.outline) for name in ("ell", "tee", "bracket", "star") for part in of[name])
    assert {part.symmetry for part in of["star"]} <= {4, 5, 6, 7}
    assert {0, 6, 12, 16} <= {part.symmetry for part in of["real"]}  # washers, nuts, gears


def test_real_parts_have_the_dimensions_of_their_standards():
    every = {part.name: part for parts in EVERY.values() for part in parts}
    nut, washer, bolt = every["real-0"], every["real-1"], every["real-2"]  # M20, M16, M10 x 40
    assert np.abs(nut.outline @ [0.0, 1.0]).max() == pytest.approx(0.015, abs=1e-8)  # 30 mm across flats, ISO 4032
    assert washer.same_as(Part.disc(0.015, friction=washer.friction, name=washer.name))  # 30 mm, ISO 7089
    along, across = np.ptp(bolt.outline, axis=0)  # head of 16 mm across flats and 6.4 mm, ISO 4017
    assert along == pytest.approx(0.0464, abs=1e-8) and across == pytest.approx(0.016 * 2 / np.sqrt(3), abs=1e-8)
    assert bolt.area == pytest.approx(0.0064 * 0.032 / np.sqrt(3) + 0.04 * 0.01, abs=1e-9)


def test_an_unknown_split_is_one_error():
    with pytest.raises(ValueError, match="unknown split 'tests'; did you mean 'test'"):
        shapes("tests")
