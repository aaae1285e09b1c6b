"""Films: the frames of a GIF are those that were painted, in time, and small in pages."""

import dataclasses
import io

import numpy as np
import pytest
from PIL import Image

from agents.evaluation import films
from vibgym.rendering import Side
from vibgym.rendering.side import HEIGHT


def watched(results):
    return [
        (place, one.film, results.scenery[place.task], one.step_time) for (place, _), one in results.rollouts.items()
    ]


def read(data):
    """Frames (frames, height, width, 3) of a GIF file and their durations, ms."""
    with Image.open(io.BytesIO(data)) as image:
        assert image.info["loop"] == 0
        frames = []
        for k in range(image.n_frames):
            image.seek(k)
            frames.append((np.asarray(image.convert("RGB")), image.info["duration"]))
    pictures, durations = zip(*frames, strict=True)
    return np.array(pictures), durations


def test_films_of_pages_are_small_and_true_to_time(found, several):
    for trial, film, scenery, step_time in watched(found) + watched(several):
        data = films.film_gif(film, scenery, step_time, films.PAGE)
        pictures, durations = read(data)
        painted, stride = films.frames_of(film, scenery, films.PAGE)
        assert len(data) < 200_000 and len(painted) <= films.PAGE.frames, trial
        assert pictures.shape == (len(painted), *painted[0].shape) and pictures.shape[2] <= films.PAGE.width
        assert durations == (round(1e3 * stride * step_time),) * (len(painted) - 1) + (films.REST,)
        assert np.abs(pictures - np.array(painted).astype(float)).mean() < 3.0, trial
        painter = films.painter_for(scenery, films.PAGE.width)
        assert (painted[-1] == films.picture(film, scenery, len(film.poses) - 1, painter)).all()


def test_colours_of_elements_survive(found):
    """Few elements move in a picture: their hues are the phases."""
    film, scenery = found.rollout("Align", "ideal", "counting").film, found.scenery["Align"]
    pictures, _ = read(films.film_gif(film, scenery, 0.04, films.PAGE))
    painted, _ = films.frames_of(film, scenery, films.PAGE)
    for picture, wanted in zip(pictures[1:], painted[1:], strict=True):
        table = wanted[20:-84].astype(float)
        coloured = np.ptp(table, axis=-1) > 60
        assert coloured.sum() > 500
        assert np.abs(picture[20:-84] - table)[coloured].mean() < 12.0


def test_the_view_from_the_side_is_under_every_frame(found):
    film, scenery = found.rollout("Align", "ideal", "pusher").film, found.scenery["Align"]
    side = Side([np.array([[0.1, 0.05, 1e-4], [0.12, 0.05, -2e-4], [0.11, 0.07, 0.0]])], np.array([[0.1, 0.126, 3e-4]]))
    tilting = dataclasses.replace(film, sides=(side,) * len(film.sides))
    tall, flat = (read(films.film_gif(each, scenery, 0.04, films.PAGE))[0] for each in (tilting, film))
    assert tall.shape[1] == flat.shape[1] + HEIGHT and np.ptp(tall[:, flat.shape[1] :]) > 100


@pytest.mark.parametrize("frames", [1, 2])
def test_short_films(found, frames):
    film, scenery = found.rollout("Align", "ideal", "pusher").film, found.scenery["Align"]
    short = dataclasses.replace(film, poses=film.poses[:frames])
    assert len(read(films.film_gif(short, scenery, 0.04))[0]) == frames
