"""Two phases: the expanded pattern, the switch to the goals, and results."""

import numpy as np
import pytest

from tests.policies.helpers import ALUMINIUM, STEEL, SURFACE
from tests.tasks.helpers import made
from vibgym.policies.classical.two_phases import EDGE, drawn_apart
from vibgym.scene.hulls import gaps_between
from vibgym.tasks import Pattern


@pytest.mark.parametrize(
    "parts", [[ALUMINIUM] * 12, [ALUMINIUM] * 20, [STEEL, ALUMINIUM] * 4], ids=["12", "20", "two kinds"]
)
@pytest.mark.parametrize("settings", [{}, {"heading_deg": 8, "rows": 2}, {"gap_mm": 20, "rows": 2}])
def test_patterns_are_expanded_on_the_table(parts, settings):
    """Expanded patterns fit, keep the distance or use the width, and paths to the goals do not cross."""
    pattern = made(Pattern, SURFACE, parts, **settings)
    of = [parts[int(np.flatnonzero(pattern._kind == kind)[0])] for kind in pattern.of_kind]
    for uniform in np.random.default_rng(0).random((10, 2)):
        goal = pattern.draw(uniform[None])[0]
        place = drawn_apart(SURFACE, of, goal[:, :2], goal[:, 2], 0.036)
        away = gaps_between(of, np.c_[place, goal[:, 2]][None])[0].min()
        assert away > (0.0359 if not (len(parts) == 20 or "heading_deg" in settings) else 0.02)
        assert (place > 0.0175 + EDGE - 1e-9).all() and (
            place < [SURFACE.width, SURFACE.depth] - np.array(0.0175)
        ).all()
        least = gaps_between(of, goal[None])[0].min()
        displacement = np.linspace(0.0, 1.0, 40)[:, None, None]
        poses = np.concatenate(
            [goal[:, :2] + displacement * (place - goal[:, :2]), np.tile(goal[:, 2:], (40, 1, 1))], axis=-1
        )
        assert gaps_between(of, poses).min() > least - 1e-9


def test_a_pattern_that_fills_the_width_is_slanted():
    goal = made(Pattern, SURFACE, [ALUMINIUM] * 12, heading_deg=90, place_mm=[416, 104]).draw(np.zeros((1, 0)))[0]
    place = drawn_apart(SURFACE, [ALUMINIUM] * 12, goal[:, :2], goal[:, 2], 0.036)
    assert gaps_between([ALUMINIUM] * 12, np.c_[place, goal[:, 2]][None])[0].min() > 0.01
    assert drawn_apart(SURFACE, [ALUMINIUM], goal[:1, :2], goal[:1, 2], 0.036) == pytest.approx(goal[:1, :2])
