"""The moments of the pressure under eight parts against the scalar cut, and their series against friction at many points."""

import math

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

from vibgym import Part, Surface
from vibgym.kernels.jit import exact, jit
from vibgym.kernels.reference import Pinned, reference
from vibgym.kernels.vector import LANES, load, store
from vibgym.physics.core.drive import new_phasors, polar_drive
from vibgym.physics.core.records import STATE, new_state, state_at
from vibgym.physics.planar.contact_area import cells_across, new_cut, points_at
from vibgym.physics.planar.pressure_moments import MOMENT_ROWS
from vibgym.physics.planar.stepper import cut_stale, load_part
from vibgym.physics.planar.workspace import FIXED_SCENE, FixedScene, Scene, fixed_scene_at, new_workspace
from vibgym.physics.planar.wrench import LARGEST_VARIATION, expanded_wrench, sliding_wrench
from vibgym.scene.bodies import bodies_of, body_of
from vibgym.simulation.schemes import planar_scheme

SURFACE = Surface()
PARTS = {
    "block": Part.rectangle(0.05, 0.035, friction=0.6),
    "bar": Part.rectangle(0.1, 0.02, friction=0.6),
    "within one element": Part.rectangle(0.02, 0.015, friction=0.6),
    "L-shape": Part.polygon(0.03 * np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]), friction=0.6),
}


DISC = Part.disc(0.013, friction=0.6)
SLIVER = Part.polygon([[0.0, 0.0], [0.09, 0.0001], [0.03, 0.0002]], friction=0.6)
STAR = Part.polygon(
    [[0.03 / (1 + k % 2) * f(k * math.pi / 5) for f in (math.cos, math.sin)] for k in range(10)], friction=0.6
)
MIXED = [*PARTS.values(), DISC, SLIVER, STAR, DISC]


@jit
def cut_once(fixed, drive, state, alone):
    """Compute the moments under all parts of a world, or under one; returns the number of supported parts."""
    fixed = fixed_scene_at(fixed)
    scene = reference(
        Scene(fixed.table, fixed.bodies, fixed.scheme, reference(drive), state_at(state), fixed.workspace, 1)
    )
    for slot in range(LANES):
        load_part(scene, slot, 0, slot, 0 <= alone != slot)
        scene.workspace.stale[slot] = True
    cut_stale(scene, 0.0, True)


class Cutter:
    """Return the cut of eight parts by the kernel, and that of each by the scalar code."""

    def __init__(self, parts, seed=0, largest=SURFACE.max_amplitude):
        self.parts, self.table = parts, SURFACE.table()
        bodies, scheme = bodies_of(parts, SURFACE.element_size), planar_scheme(SURFACE, parts[0])
        self.workspace = new_workspace(self.table, bodies, scheme, LANES)
        self._fixed = Pinned(FIXED_SCENE, FixedScene(self.table, bodies, scheme, self.workspace))
        self.state = new_state(1, LANES)
        self._pinned = Pinned(STATE, self.state)
        self.draw(seed, largest)

    def draw(self, seed, largest=SURFACE.max_amplitude):
        """Other phasors."""
        rng, shape = np.random.default_rng(seed), (1, SURFACE.rows, SURFACE.columns)
        self.drive = polar_drive(rng.uniform(0, largest, shape), rng.uniform(-3, 3, shape), SURFACE.angular_frequency)

    def moments(self, pose, alone=-1):
        """Return moments (MOMENT_ROWS, lanes) of parts at these poses, optionally of one slot; 0: not supported."""
        self.state.pose[0], self.state.fallen[...] = pose, False
        self.workspace.moments[...] = 0.0
        cut_once(self._fixed.address, self.drive, self._pinned.address, alone)
        return np.where(self.workspace.held, self.workspace.moments.reshape(MOMENT_ROWS, LANES), 0.0)

    def points(self, lane, pose, split):
        """Return contact points of the scalar cut: weight, x, y, C and S."""
        body = body_of(self.parts[lane], SURFACE.element_size)
        cut = new_cut(len(body.outline), cells_across(self.table, body, split))
        phasors = new_phasors(1, cells_across(self.table, body, 1))
        n = points_at(self.table, body, split, self.drive, 0, *pose, cut, phasors, 0)
        return (*cut.points[:, :n], cut.phasor_c[:n], cut.phasor_s[:n])


CUTTERS = {name: Cutter([part] * LANES) for name, part in PARTS.items()}
MIXED_CUTTER = Cutter(MIXED)

places = st.one_of(
    st.floats(0.02, 0.18),
    st.integers(1, 13).map(lambda k: 0.013 * k),  # on grid lines and in the middle between them
    st.tuples(st.integers(1, 13), st.floats(-1e-12, 1e-12)).map(lambda at: 0.013 * at[0] + at[1]),
)
turns = st.one_of(
    st.floats(-7.0, 7.0),
    st.integers(-8, 8).map(lambda k: 0.25 * math.pi * k),
    st.tuples(st.integers(-4, 4), st.floats(-1e-9, 1e-9)).map(lambda at: 0.5 * math.pi * at[0] + at[1]),
)
poses = st.lists(st.tuples(places, places, turns), min_size=LANES, max_size=LANES).map(np.array)


@given(poses, st.integers(0, 9))
@example(np.tile([0.104, 0.104, 0.0], (LANES, 1)), 0)  # corners on grid corners, edges on grid lines
@example(np.tile([0.078, 0.078, 1e-17], (LANES, 1)), 1)
@example(np.tile([0.004, 0.202, 0.7], (LANES, 1)), 2)  # beyond the border
def test_eight_kinds_at_once_against_the_scalar_cut(pose, seed):
    """Up to the second order the scalar cut's points have the pieces' own moments."""
    cutter = MIXED_CUTTER
    cutter.draw(seed)
    moments = cutter.moments(pose)
    for lane, part in enumerate(cutter.parts):
        if not cutter.workspace.held[lane]:
            continue
        weight, x, y, c, s = cutter.points(lane, pose[lane], 1)
        z, size = (x + 1j * y) / part.radius, part.radius
        for k, pressure in enumerate((np.full(len(z), SURFACE.gravity), c, s)):
            w = weight * pressure
            m10, m20 = w @ z, w @ (z * z)
            expected = [w.sum(), w @ abs(z) ** 2, m10.real, m10.imag, m20.real, m20.imag]
            integrals = moments[k::3, lane][[0, 1, 3, 4, 7, 8]] / [1.0, size**2, size, size, size**2, size**2]
            # Pieces below 1e-11 of the part are omitted; rounding is relative to the element.
            bound = 2e-10 * max(1.0, (SURFACE.element_size / size) ** 2) * SURFACE.gravity
            assert integrals == pytest.approx(expected, abs=bound), (lane, k)


@given(poses, st.integers(0, 9))
def test_lanes_are_independent(pose, seed):
    MIXED_CUTTER.draw(seed)
    together = MIXED_CUTTER.moments(pose).copy()
    for lane in range(LANES):
        assert np.array_equal(MIXED_CUTTER.moments(pose, lane)[:, lane], together[:, lane])


@exact
def series(moments, cosine, sine, ux, uy, spin, out):
    for k, value in enumerate(expanded_wrench(moments, cosine, sine, load(ux, 0), load(uy, 0), load(spin, 0))):
        store(out, k * LANES, value)


def errors(name, variation, seed):
    """Return force and torque of eight lanes by the series and by 12 x 12 cells an element, relative to friction."""
    rng, cutter, part = np.random.default_rng(seed), CUTTERS[name], PARTS[name]
    cutter.draw(seed)
    pose = rng.uniform([0.2, 0.09, -3], [0.6, 0.12, 3], (LANES, 3))
    if name == "within one element":
        pose[:, :2] = 12.5 * 0.026, 4.5 * 0.026
    angle, t = rng.uniform(-math.pi, math.pi, LANES), rng.uniform(-math.pi, math.pi)
    ux, uy, c, s = 0.4 * np.cos(angle), 0.4 * np.sin(angle), math.cos(t), math.sin(t)
    spin = variation * 0.4 / part.radius * rng.choice([-1.0, 1.0], LANES)
    out = np.empty(5 * LANES)
    series(np.ascontiguousarray(cutter.moments(pose)).ravel(), -c, s, ux, uy, spin, out)
    fx, fy, torque, square, varies = out.reshape(5, LANES)
    assert square == pytest.approx(0.16) and varies * part.radius**2 == pytest.approx(variation**2)
    worst = np.zeros(2)
    for lane in range(LANES):
        weight, x, y, pc, ps = cutter.points(lane, pose[lane], 12)
        summed = sliding_wrench(
            weight, x, y, pc, ps, len(x), SURFACE.gravity, c, s, ux[lane], uy[lane], spin[lane]
        )  # fmt: skip
        force = math.hypot(fx[lane] - summed[0], fy[lane] - summed[1]) / SURFACE.gravity
        worst = np.maximum(worst, [force, abs(torque[lane] - summed[2]) / (SURFACE.gravity * math.sqrt(part.gyration))])
    return worst


@pytest.mark.parametrize("name", PARTS)
def test_against_many_points(name):
    # Exact without spin; then the first terms left out are of fifth order in force and fourth in torque.
    for variation, force, torque in ((0.0, 1e-11, 1e-11), (0.1, 1e-5, 1e-4), (LARGEST_VARIATION, 2e-3, 5e-3)):
        largest = np.array([errors(name, variation, seed) for seed in range(5)]).max(axis=0)
        assert largest[0] < force and largest[1] < torque, (variation, largest)
