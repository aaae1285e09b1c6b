"""Goals that move: their films, and how far off the parts were."""

import csv

import numpy as np
import pytest

from agents import evaluation
from agents.evaluation import films, report
from agents.evaluation.films import Log
from tests.envs.helpers import single
from vibgym.envs.viewer import scenery_of
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo

PATHS = [{"shape": "polyline", "points_mm": [[100, 80], [100, 110]]}]


def test_films_show_where_the_goal_is_at_each_instant():
    pytest.importorskip("pygame")
    env = single("Follow", paths=PATHS)
    policy = make_policy("zero", TaskInfo.of(env))
    run = rollout(policy, "Follow", seeds=[1, 2], keep=Log, paths=PATHS)
    film = run.film
    assert film.goals.shape == (501, 1, 3) and not run.success.any() and (run.steps == 500).all()
    assert film.goals[0, 0, :2] == pytest.approx([0.1, 0.08]) and film.goals[-1, 0, :2] == pytest.approx([0.1, 0.11])
    assert (np.diff(film.goals[:, 0, 1]) >= 0).all() and (film.goals[:, 0, 2] == film.goals[0, 0, 2]).all()
    assert film.paths[0][-1] == pytest.approx([0.1, 0.11])
    scenery = scenery_of(env.unwrapped)
    painter = films.painter_for(scenery, 400)
    first, later = (films.picture(film, scenery, frame, painter) for frame in (0, 30))
    assert (first != later).any()


def test_films_of_parts_that_may_tilt_show_them_from_the_side():
    """Under every frame, while those of the plane are as they were."""
    height = pytest.importorskip("vibgym.rendering.side").HEIGHT
    frames = {}
    for model in ("planar", "tilting"):
        env = single("Align", model=model)
        policy = make_policy("pose", TaskInfo.of(env))
        film = rollout(policy, "Align", seeds=[1], keep=Log, model=model).film
        frames[model], _ = films.frames_of(film, scenery_of(env.unwrapped))
    flat, above = (frames[model][0] for model in ("planar", "tilting"))
    assert len({frame.shape for frame in frames["tilting"]}) == 1
    assert above.shape == (flat.shape[0] + height, *flat.shape[1:]) and (above[: len(flat)] == flat).all()
    assert (frames["tilting"][0][len(flat) :] != frames["tilting"][8][len(flat) :]).any()


def test_path_errors_are_those_of_the_poses(tmp_path):
    """In the rollout, the table, the CSV file and on the page; a task whose goals stay has none, and no such column."""
    settings = {
        "tasks": ["Follow", "Transport"], "policies": ["pose", "zero"], "episodes": 2, "animations": False,
        "output": str(tmp_path),
    }  # fmt: skip
    results = evaluation.evaluate(evaluation.prepare(evaluation.settings_from(settings)), quiet=True)
    page = evaluation.write(results, quiet=True).read_text()
    by_trial = {(place.task, place.policy): found for (place, _), found in results.rollouts.items()}
    run = by_trial["Follow", "pose"]
    film, away = run.film, np.linalg.norm(run.film.poses[1:, 0, :2] - run.film.goals[1:, 0, :2], axis=-1)
    watched = run.seeds.index(film.seed)
    assert run.path_error[watched] == pytest.approx(np.sqrt((away**2).mean()), rel=1e-6)
    assert run.success.all() and (run.path_error < 0.5e-3).all()
    assert (by_trial["Follow", "zero"].path_error > 0.01).all()
    assert np.isnan(by_trial["Transport", "pose"].path_error).all()

    row = next(row for row in report.rows(results) if (row["task"], row["policy"]) == ("Follow", "pose"))
    assert row["path_error_median_m"] == np.median(run.path_error)
    tables = evaluation.summary_table(results).split("\n\n")
    assert ["path error" in table for table in tables] == ["Follow" in table for table in tables] == [True, False]
    assert f"{1e3 * row['path_error_median_m']:.2f} mm" in tables[0] and "Path error (rms)" in page
    with (tmp_path / "episodes.csv").open() as file:
        rows = [each for each in csv.DictReader(file) if (each["task"], each["policy"]) == ("Follow", "pose")]
    assert [float(each["path_error_m"]) for each in rows] == run.path_error.tolist()
