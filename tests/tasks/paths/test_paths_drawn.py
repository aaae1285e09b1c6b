"""Drawn paths: on the surface, apart, feasible, closed, and independent of other draws."""

import math

import numpy as np
import pytest

from vibgym import Part, Surface
from vibgym.tasks import paths as route
from vibgym.tasks.follow import DrawnPaths
from vibgym.tasks.paths import EFFORT, Reach

SURFACE, TALL = Surface(), Surface(rows=24, columns=10)
BLOCK = Part.rectangle(0.050, 0.035, friction=0.58)
STEEL = Part.rectangle(0.050, 0.040, friction=0.64)
APART = 0.0468
CASES = {
    "one": (SURFACE, [BLOCK], {}),
    "three": (SURFACE, [STEEL, BLOCK, STEEL], {}),
    "five": (SURFACE, [BLOCK] * 5, {"shapes": ["circle", "square"]}),
    "tall": (TALL, [BLOCK] * 4, {}),
    "along": (SURFACE, [BLOCK, BLOCK], {"heading": "along", "speed": 0.08}),
    "fast": (SURFACE, [BLOCK], {"speed": 0.2}),
}


def shape_of(path):
    """Check the properties of a path."""
    straight = np.diff(path[1:, route.START])[path[1:-1, route.CURVATURE] == 0].sum()
    turns = (path[-1, route.DIRECTION] - path[1, route.DIRECTION]) / (2 * math.pi)
    assert abs(turns) == pytest.approx(round(abs(turns)), abs=1e-9)
    return {(0, False): "figure_eight", (1, False): "circle", (1, True): "square"}[round(abs(turns)), straight > 0.005]


@pytest.mark.parametrize("surface, parts, settings", CASES.values(), ids=CASES)
def test_properties_of_drawn_paths(surface, parts, settings):
    drawn = DrawnPaths(surface, parts, settings, APART)
    paths = drawn.draw(np.random.default_rng(0).random((60, drawn.draws)))
    reach = [Reach(surface, part) for part in parts]
    times = np.linspace(0.0, drawn.lasts, 500)
    shapes = set()
    for world in paths:
        motion = np.stack([route.sample(path, times) for path in world])
        for k, part in enumerate(parts):
            place, room = motion[k, :, :2], np.array([surface.width, surface.depth])
            assert (place >= part.radius - 1e-9).all() and (place <= room - part.radius + 1e-9).all()
            assert reach[k].most_effort(motion[k]) <= EFFORT + 2e-3
            assert route.duration(world[k, 0]) <= drawn.lasts + 1e-12
            assert motion[k, -1, :2] == pytest.approx(motion[k, 0, :2], abs=1e-9)  # all of them are closed
            for j in range(k):
                gap = np.hypot(*(place - motion[j, :, :2]).T) - part.radius - parts[j].radius
                assert gap.min() >= APART - 1e-9
            shapes.add(shape_of(world[k]))
    assert shapes == set(settings.get("shapes", ["circle", "square", "figure_eight"]))


def test_draws_are_independent():
    drawn = DrawnPaths(SURFACE, [BLOCK, STEEL], {}, APART)
    uniform = np.random.default_rng(2).random((9, drawn.draws))
    together = drawn.draw(uniform)
    for k in range(9):
        assert (drawn.draw(uniform[k : k + 1])[0] == together[k]).all()


def test_longest_and_shortest_draws_are_within_bounds():
    """Uniform numbers at the ends of their range."""
    drawn = DrawnPaths(SURFACE, [BLOCK], {}, APART)
    for value in (0.0, np.nextafter(1.0, 0.0)):
        path = drawn.draw(np.full((1, drawn.draws), value))[0, 0]
        motion = route.sample(path, np.linspace(0.0, drawn.lasts, 300))
        assert motion[:, 0].min() >= BLOCK.radius - 1e-9 and motion[:, 1].max() <= SURFACE.depth - BLOCK.radius + 1e-9


@pytest.mark.parametrize("parts, settings, message", [
    (1, {"shapes": []}, "paths.shapes"), (1, {"shapes": ["star"]}, r"paths.shapes\[0\]"), (1, {"speed": 0.3}, "paths.speed"),
    (1, {"acceleration": 2.5}, "paths.acceleration"), (1, {"speed": 0.25}, "parts"), (9, {}, "parts"),
])  # fmt: skip
def test_bad_scenes_are_refused_by_name(parts, settings, message):
    with pytest.raises(ValueError, match=message):
        DrawnPaths(SURFACE, [BLOCK] * parts, settings, APART)
