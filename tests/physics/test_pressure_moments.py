"""The series in the pressure's moments against friction summed over many points."""

import math

import numba
import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.physics.core.drive import polar_drive
from vibgym.physics.planar.cut import cells_across, new_cut, place_outline, points_at
from vibgym.physics.planar.outline import cut_outline
from vibgym.physics.planar.phasors import new_phasors
from vibgym.physics.planar.pressure_moments import (
    LANES,
    MOMENT_ROWS,
    PIECE_FIELDS,
    collect_pieces,
    pressure_moments,
    read_phasors,
)
from vibgym.physics.planar.series import LARGEST_VARIATION
from vibgym.physics.planar.wrench import expanded_wrench, sliding_wrench

SURFACE = Surface()
PARTS = {
    "block": Part.rectangle(0.05, 0.035, friction=0.6),
    "bar": Part.rectangle(0.1, 0.02, friction=0.6),
    "within one element": Part.rectangle(0.02, 0.015, friction=0.6),
    "L-shape": Part.polygon(0.03 * np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]), friction=0.6),
}


@numba.njit
def series(moments, lane, gravity, cosine, sine, ux, uy, spin):
    return expanded_wrench(moments, lane, gravity, cosine, sine, ux, uy, spin)


def errors(part, variation, seed, lane=3):
    """Force and torque of the series and of 12 x 12 cells an element, relative to the friction there is."""
    rng = np.random.default_rng(seed)
    table, body = SURFACE.table(), part.body()
    shape = (1, SURFACE.rows, SURFACE.columns)
    drive = polar_drive(
        rng.uniform(0, SURFACE.max_amplitude, shape), rng.uniform(-3, 3, shape), SURFACE.angular_frequency
    )
    x, y, heading = rng.uniform(0.2, 0.6), rng.uniform(0.09, 0.12), rng.uniform(-3, 3)
    if part is PARTS["within one element"]:
        x, y = 12.5 * 0.026, 4.5 * 0.026
    angle, t = rng.uniform(-math.pi, math.pi, 2)
    ux, uy, c, s = 0.4 * math.cos(angle), 0.4 * math.sin(angle), math.cos(t), math.sin(t)
    spin = variation * 0.4 / part.radius * rng.choice([-1.0, 1.0])

    contact = new_cut(len(body.outline), cells_across(table, body, 12))
    phasors = new_phasors(1, cells_across(table, body, 1))
    n = points_at(table, body, 12, drive, 0, x, y, heading, contact, phasors, 0)
    exact = sliding_wrench(*contact.points, contact.phasor_c, contact.phasor_s, n, SURFACE.gravity, c, s, ux, uy, spin)

    pitch = table.element_size
    place_outline(body, x, y, heading, 1 / pitch, contact.outline_x, contact.outline_y)
    cut_outline(contact.outline_x, contact.outline_y, contact.cells, contact.box)
    pieces = np.zeros(101 * PIECE_FIELDS * LANES)
    rows, columns = np.empty(100, np.int64), np.empty(100, np.int64)
    held, area = collect_pieces(contact.cells, contact.box, table, x, y, 1e-12, pieces, rows, columns, lane)
    read_phasors(drive, 0, rows, columns, held, phasors, 0, pieces, lane)
    share = np.zeros(LANES)
    share[lane] = 1.0 / area
    moments = np.empty(MOMENT_ROWS * LANES)
    pressure_moments(pieces, held, pitch, share, moments, np.empty(MOMENT_ROWS * LANES), LANES)
    fx, fy, torque, square, varies = series(moments, lane, SURFACE.gravity, -c, s, ux, uy, spin)
    assert square == pytest.approx(0.16) and varies * part.radius**2 == pytest.approx(variation**2)
    force = math.hypot(fx - exact[0], fy - exact[1]) / SURFACE.gravity
    return force, abs(torque - exact[2]) / (SURFACE.gravity * math.sqrt(part.gyration))


@pytest.mark.parametrize("name", PARTS)
def test_against_many_points(name):
    # Exact without spin; then the first terms left out are of fifth order in force and fourth in torque.
    for variation, force, torque in ((0.0, 1e-11, 1e-11), (0.1, 1e-5, 1e-4), (LARGEST_VARIATION, 2e-3, 5e-3)):
        largest = np.array([errors(PARTS[name], variation, seed) for seed in range(40)]).max(axis=0)
        assert largest[0] < force and largest[1] < torque, (variation, largest)


def test_no_lane_looks_at_another():
    for name, part in PARTS.items():
        assert errors(part, 0.3, 1, lane=0) == errors(part, 0.3, 1, lane=LANES - 1), name
