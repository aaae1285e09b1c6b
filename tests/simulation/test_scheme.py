"""Defaults: step sizes of the planar model, number of threads."""

import math

import pytest

from vibgym import Part, Simulator, Surface
from vibgym.scene.parts import shipped_part
from vibgym.simulation import threads
from vibgym.simulation.schemes import PlanarSettings, planar_scheme

SURFACE = Surface()


def scheme(part, **given):
    chosen = planar_scheme(SURFACE, part, PlanarSettings(**given))
    return chosen.steps, chosen.substeps


def test_small_parts_are_cut_more_often():
    # The radius of gyration of a disc is r / sqrt(2); the table's speed makes 2 pi a_h = 17 mm in a period.
    limit = 2.0 * math.pi * SURFACE.horizontal_amplitude * math.sqrt(2.0)
    assert scheme(Part.disc(0.999 * limit, friction=0.5)) == (9, 2)
    assert scheme(Part.disc(1.001 * limit, friction=0.5)) == (5, 4)


@pytest.mark.parametrize("steps", [4, 5, 17, 18, 40])
def test_at_least_eighteen_runge_kutta_steps(steps):
    got, substeps = scheme(shipped_part("steel_block"), steps=steps)
    assert got == steps and steps * substeps >= 18 and steps * (substeps - 1) < 18


@pytest.mark.parametrize("steps", [1, 2, 3])
def test_too_few_cuts_are_refused(steps):
    """Their error would be millimetres in a second, without a warning (see the hard cases)."""
    with pytest.raises(ValueError, match=r"steps"):
        Simulator(SURFACE, shipped_part("steel_block"), steps=steps, substeps=20)
    one, still = Surface(rows=1, columns=1, element_size=1.0), Surface(horizontal_amplitude=0.0)
    assert Simulator(one, shipped_part("steel_block"), steps=steps, substeps=20).choice.model == "planar"
    assert Simulator(still, shipped_part("steel_block"), steps=steps, substeps=1).choice.model == "planar"


def test_too_few_substeps_are_refused():
    one = Surface(rows=1, columns=1, element_size=1.0)
    with pytest.raises(ValueError, match="substeps"):
        Simulator(one, shipped_part("steel_block"), steps=1, substeps=3)


def test_threads_are_limited_by_the_environment_variable(monkeypatch):
    monkeypatch.delenv(threads.VARIABLE, raising=False)
    available = threads.available_threads()
    assert available >= 1
    for given_value, expected in (("1", 1), ("2", min(available, 2)), ("100000", available), ("", available)):
        monkeypatch.setenv(threads.VARIABLE, given_value)
        assert threads.available_threads() == expected


@pytest.mark.parametrize("given_value", ["0", "two", "1.5"])
def test_bad_numbers_of_threads_are_refused(monkeypatch, given_value):
    monkeypatch.setenv(threads.VARIABLE, given_value)
    with pytest.raises(ValueError, match="VIBGYM_THREADS"):
        threads.available_threads()
