"""Measured order of convergence, and agreement with dense point sampling."""

from concurrent.futures import ThreadPoolExecutor

import numpy as np
import pytest

from studies.benchmarks import point_sampling as reference
from tests.simulation.helpers import SURFACE, random_scene, simulated
from vibgym import Part, Surface

L_SHAPE = [[0, 0], [0.06, 0], [0.06, 0.03], [0.03, 0.03], [0.03, 0.06], [0, 0.06]]
PARTS = {
    "rectangle": Part.rectangle(0.050, 0.035, friction=0.58),
    "disc": Part.disc(0.022, friction=0.6),
    "L-shape": Part.polygon(L_SHAPE, friction=0.6),
    "triangle": Part.polygon([[0, 0], [0.06, 0.005], [0.02, 0.05]], friction=0.8),
}


def run(surface, part, scene, periods, **scheme):
    simulator = simulated(surface, part, *scene, periods, **scheme)
    assert not simulator.fallen.any()
    return simulator


def slope(resolution, error):
    return -np.polyfit(np.log(resolution), np.log(error), 1)[0]


def test_fourth_order_in_substeps_on_one_element():
    surface = Surface(rows=1, columns=1, element_size=2.0)
    scene = random_scene(surface, 32, 1, 0.9)
    part = PARTS["rectangle"]
    exact = run(surface, part, scene, 10, steps=1, substeps=512).pose[:, 0, :2]
    substeps = np.array([12, 16, 24, 32, 48, 64])
    error = [
        np.median(np.hypot(*(run(surface, part, scene, 10, steps=1, substeps=n).pose[:, 0, :2] - exact).T))
        for n in substeps
    ]
    assert 3.7 < slope(substeps, error) < 4.6, error
    # cutting more often changes nothing on one element
    cut = run(surface, part, scene, 10, steps=8, substeps=6).pose[:, 0, :2]
    once = run(surface, part, scene, 10, steps=1, substeps=48).pose[:, 0, :2]
    assert np.abs(cut - once).max() < 1e-11


@pytest.mark.parametrize("name", ["rectangle", "L-shape"])
def test_second_order_in_steps_across_edges(name):
    scene = random_scene(SURFACE, 48, 2, velocity=(0.0, 0.0, 3.0))
    surface, part = SURFACE, PARTS[name]
    # 48 Runge-Kutta steps in all of them, so that the error of the edges remains
    exact = run(surface, part, scene, 10, steps=192, substeps=1, pieces=2)
    steps = np.array([6, 8, 12, 16, 24, 48])
    position, heading = [], []
    for n in steps:
        got = run(surface, part, scene, 10, steps=int(n), substeps=48 // int(n), pieces=2)
        difference = (got.pose - exact.pose)[:, 0]
        position.append(np.median(np.hypot(*difference[:, :2].T)))
        heading.append(np.median(np.abs(difference[:, 2])))
    assert 1.7 < slope(steps, position) < 2.5, position
    assert 1.7 < slope(steps, heading) < 2.5, heading


@pytest.mark.parametrize("spin", [0.0, 5.0, 30.0])
@pytest.mark.parametrize("name", PARTS)
def test_against_point_sampling(name, spin):
    surface, part, worlds, periods, n = SURFACE, PARTS[name], 4, 6, 192
    scene = random_scene(surface, worlds, 3, 0.075, (0.0, 0.0, spin))
    pose, velocity, amplitude, phase = scene
    points = reference.strew_disc(0.022, n) if name == "disc" else reference.strew(part.outline, n)

    def sample(k):
        return reference.simulate(
            points, gyration=part.gyration, friction=part.friction, pose=pose[k, 0], velocity=velocity,
            amplitude=amplitude[k], phase=phase[k], periods=periods, steps=64,
        )[-1, :3]  # fmt: skip

    with ThreadPoolExecutor(2) as pool:
        sampled = np.array(list(pool.map(sample, range(worlds))))

    def errors(**scheme):
        difference = run(surface, part, scene, periods, **scheme).pose[:, 0] - sampled
        return 1e3 * np.hypot(*difference[:, :2].T).max(), np.degrees(np.abs(difference[:, 2])).max()

    # Converged: the remaining error is that of the sampler, whose 37 000 points cross edges one by one. Measured: 0.004 mm
    # and 0.015 deg, falling with the number of points (64 x 64: 0.06 mm, 0.2 deg).
    position, heading = errors(steps=64, substeps=2, pieces=10)
    assert position < 0.01 and heading < 0.03
    # Default settings: the project's targets for the median, 0.05 mm and 0.1 deg, hold for every case here; at 30 rad/s slip
    # changes sign under the part, and the automatic cells leave 0.09 mm, and 0.33 deg of the 200 deg it turns.
    position, heading = errors()
    assert position < (0.15 if spin > 5 else 0.05)
    assert heading < (0.5 if spin > 5 else 0.1)
    turned = np.degrees(np.abs(sampled[:, 2] - pose[:, 0, 2]))
    assert spin == 0 or (turned.max() > 15 and np.hypot(*(sampled - pose[:, 0])[:, :2].T).max() > 0.003)


def test_the_sampler_itself():
    """Its points have the moments of the shapes, and it stops at the known distance."""
    for name, part in PARTS.items():
        x, y, w = reference.strew_disc(0.022, 64) if name == "disc" else reference.strew(part.outline, 64)
        assert w.sum() == pytest.approx(1.0, abs=1e-12)
        # midpoint rule in strips of 1/64: (1/64)^2 = 2.4e-4 of the part's size, and of its second moment a few times that
        assert abs(w @ x) < (part.radius / 64**2) * 2 and abs(w @ y) < (part.radius / 64**2) * 2
        assert w @ (x * x + y * y) == pytest.approx(part.gyration, rel=8 / 64**2)
    points = reference.strew(PARTS["rectangle"].outline, 8)
    zeros = np.zeros((8, 32))
    path = reference.simulate(
        points, gyration=1e-3, friction=0.5, pose=[0.3, 0.1, 0.0], velocity=[1.0, 0.0, 0.0],
        amplitude=zeros, phase=zeros, periods=3, steps=10, horizontal_amplitude=0.0,
    )  # fmt: skip
    assert path[-1] == pytest.approx([0.3 + 0.12 - 0.5 * 4.905 * 0.12**2, 0.1, 0, 1 - 4.905 * 0.12, 0, 0], abs=1e-12)
