"""Films, and reports in a browser: frames are those that were painted, in time; films open, tables sort, axe is silent."""

import dataclasses
import io
import re

import numpy as np
import pytest
from PIL import Image

from agents.evaluation import films
from agents.evaluation.table import where
from tests.browser import chromium, faults_at_all_sizes, watch
from tests.envs.helpers import single
from vibgym.envs.viewer import scenery_of
from vibgym.policies.registry import make_policy
from vibgym.policies.rollout import rollout
from vibgym.policies.task_info import TaskInfo
from vibgym.rendering.files import REST, gif
from vibgym.rendering.side import HEIGHT


def scenery_at(results, place):
    return next(case.scenery for case in results.cases if case.place[1:] == place)


@pytest.fixture
def filmed(monkeypatch):
    """Returns the painted frames of a film, its interval, and the file, its frames and their durations, ms."""
    calls = []
    monkeypatch.setattr(films, "gif", lambda *arguments: calls.append(arguments) or gif(*arguments))

    def film_of(film, scenery, form=films.PAGE):
        data = films.film_gif(film, scenery, 0.04, form)
        painted, interval, _ = calls[-1]
        pictures, durations = [], []
        with Image.open(io.BytesIO(data)) as image:
            assert image.info["loop"] == 0
            for k in range(image.n_frames):
                image.seek(k)
                pictures.append(np.asarray(image.convert("RGB")))
                durations.append(image.info["duration"])
        return np.array(painted), interval, data, np.array(pictures), durations

    return film_of


def test_films_of_pages_are_small_and_true_to_time(basic, several, played, played_several, filmed):
    for results, runs in ((basic, played), (several, played_several)):
        for place, run in runs.items():
            film, scenery = run.film, scenery_at(results, place)
            painted, interval, data, pictures, durations = filmed(film, scenery)
            assert len(data) < 200_000 and len(painted) <= films.PAGE.frames, place
            assert pictures.shape == painted.shape and pictures.shape[2] <= films.PAGE.width
            assert durations == [round(1e3 * interval)] * (len(painted) - 1) + [REST]
            assert np.abs(pictures - painted.astype(float)).mean() < 3.0, place
            # Frames at equal distances, and the last one.
            stride, painter = round(interval / 0.04), films.painter_for(scenery, films.PAGE.width)
            for k, frame in ((1, stride), (-1, len(film.poses) - 1)):
                assert (painted[k] == films.picture(film, scenery, frame, painter)).all()
    # Few elements move in a picture: their hues, which are the phases, survive.
    place = "Align", "ideal", "counting"
    film, scenery = played[place].film, scenery_at(basic, place)
    painted, _, _, pictures, _ = filmed(film, scenery)
    for picture, wanted in zip(pictures[1:, 20:-84], painted[1:, 20:-84].astype(float), strict=True):
        coloured = np.ptp(wanted, axis=-1) > 60
        assert coloured.sum() > 500 and np.abs(picture - wanted)[coloured].mean() < 12.0
    for frames in (1, 2):
        short = dataclasses.replace(film, poses=film.poses[:frames])
        assert len(filmed(short, scenery, films.FILE)[3]) == frames


def test_films_show_zones_captions_and_parts_that_tilt(several, played_several, filmed):
    """A zone tints its end of the table; a view from the side is under every frame, while those of the plane are the same."""
    film = played_several["Sort", "ideal", "local_field"].film
    assert re.match(r"0\.00 s   \d of 6 parts done ", film.captions[0]) and len(film.captions) == len(film.poses)
    pictures = []
    for place in (("Sort", "ideal", "zero"), ("Singulate", "ideal", "zero")):
        film, scenery = played_several[place].film, scenery_at(several, place)
        empty = dataclasses.replace(film, present=np.zeros_like(film.present))
        pictures.append(films.picture(empty, scenery, 0, films.painter_for(scenery, 520)))
    columns = (pictures[0][:140] != pictures[1][:140]).any(axis=(0, 2))
    assert columns[40:80].all() and columns[-80:-40].all() and not columns[200:-200].any()
    frames = {}
    for model in ("planar", "tilting"):
        env = single("Align", model=model)
        film = rollout(make_policy("pose", TaskInfo.of(env)), "Align", seeds=[1], keep=films.Log, model=model).film
        frames[model] = filmed(film, scenery_of(env.unwrapped))[0]
    flat, tall = frames["planar"], frames["tilting"]
    assert tall.shape[1:] == (flat.shape[1] + HEIGHT, *flat.shape[2:])
    assert (tall[0, : flat.shape[1]] == flat[0]).all()
    side = tall[:, flat.shape[1] :]
    assert (np.ptp(side, axis=(1, 2, 3)) > 100).all() and (side[0] != side[8]).any()


def test_goals_that_move_are_where_they_are_at_each_instant():
    paths = [{"shape": "polyline", "points_mm": [[100, 80], [100, 110]]}]
    env = single("Follow", paths=paths)
    run = rollout(make_policy("zero", TaskInfo.of(env)), "Follow", seeds=[1, 2], keep=films.Log, paths=paths)
    film, scenery = run.film, scenery_of(env.unwrapped)
    assert film.goals.shape == (501, 1, 3) and not run.success.any() and (run.steps == 500).all()
    assert film.goals[0, 0, :2] == pytest.approx([0.1, 0.08]) and film.goals[-1, 0, :2] == pytest.approx([0.1, 0.11])
    assert (np.diff(film.goals[:, 0, 1]) >= 0).all() and (film.goals[:, 0, 2] == film.goals[0, 0, 2]).all()
    assert film.paths[0][-1] == pytest.approx([0.1, 0.11])
    first, later = (films.picture(film, scenery, k, films.painter_for(scenery, 400)) for k in (0, 30))
    assert (first != later).any()
    away = np.linalg.norm(film.poses[1:, 0, :2] - film.goals[1:, 0, :2], axis=-1)
    error = run.path_error[run.seeds.index(film.seed)]
    assert error == pytest.approx(np.sqrt((away**2).mean()), rel=1e-6) and error > 0.01


# -- in a browser ------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def opened():
    """Opens a page; every message of its console is an error."""
    messages = []
    with chromium() as browser:

        def open_page(path):
            page = browser.new_page()
            messages.append(watch(page))
            page.goto(path.as_uri())
            return page

        yield open_page
    assert not any(messages)


def test_reports_are_accessible_and_films_open_by_their_outcome(opened, basic, written, written_several):
    assert faults_at_all_sizes(opened(written_several / "report.html")) == []
    page = opened(written / "report.html")
    assert faults_at_all_sizes(page) == []
    episodes = where(basic.main, task="Align", policy="pusher", filmed=1.0)
    card = page.locator("[id='card-Align-ideal-pusher']")
    film = card.get_by_role("img", name=f"Film of pusher on Align, seed {episodes['seed'].item()}")
    assert film.is_hidden()
    card.locator("summary").focus()
    page.keyboard.press("Enter")
    assert film.is_visible() and film.evaluate("image => image.naturalWidth") > 400


def test_tables_sort_by_mouse_and_keyboard(opened, written):
    page = opened(written / "report.html")
    table = page.locator("#results ~ .scroll table").first

    def column(k):
        read = "(table, k) => [...table.tBodies[0].rows].map(row => row.cells[k].querySelector('b').textContent)"
        return table.evaluate(read, k)

    heads = table.locator("thead th").all_inner_texts()
    success = next(k for k, head in enumerate(heads) if head.startswith("Success"))
    head, names = table.locator("thead th").nth(success), table.locator("thead th").nth(1)
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    shares = [float(text.removesuffix(" %")) for text in column(success)]
    assert shares == sorted(shares, reverse=True) and len(set(shares)) > 1
    page.keyboard.press("Space")
    assert head.get_attribute("aria-sort") == "ascending"
    assert [float(text.removesuffix(" %")) for text in column(success)] == sorted(shares)
    names.locator("button").click()
    assert head.get_attribute("aria-sort") is None and names.get_attribute("aria-sort") == "descending"
    assert column(1) == sorted(column(1), reverse=True) and len(column(1)) == 3
