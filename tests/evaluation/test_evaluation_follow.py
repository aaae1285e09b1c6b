"""Films of goals that move."""

import numpy as np
import pytest

from agents.evaluation import animation, rollout
from agents.registry import make_policy
from agents.task_info import TaskInfo
from tests.envs.helpers import single
from vibgym.envs.viewer import scenery_of

PATHS = [{"shape": "polyline", "points_mm": [[100, 80], [100, 110]]}]


def test_films_show_where_the_goal_is_at_each_instant():
    pytest.importorskip("pygame")
    env = single("Follow", paths=PATHS)
    policy = make_policy("zero", TaskInfo.of(env))
    run = rollout.run(policy, "Follow", [1, 2], {"paths": PATHS}, quiet=True)
    film = run.film
    assert film.goals.shape == (501, 1, 3) and not run.success.any() and (run.steps == 500).all()
    assert film.goals[0, 0, :2] == pytest.approx([0.1, 0.08]) and film.goals[-1, 0, :2] == pytest.approx([0.1, 0.11])
    assert (np.diff(film.goals[:, 0, 1]) >= 0).all() and (film.goals[:, 0, 2] == film.goals[0, 0, 2]).all()
    assert film.paths[0][-1] == pytest.approx([0.1, 0.11])
    scenery = scenery_of(env.unwrapped)
    painter = animation.painter_for(scenery, 400)
    first, later = (animation.picture(film, scenery, frame, painter) for frame in (0, 30))
    assert (first != later).any()
