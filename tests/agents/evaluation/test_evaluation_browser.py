"""The report in a real browser: films play, tables sort, nothing sticks out, and axe finds nothing grave."""

from pathlib import Path

import numpy as np
import pytest

from agents.evaluation import films
from tests.browser import LOOKS, chromium, faults, watch


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture
def opened(browser):
    """Opens a page; whatever its console says is an error."""
    pages, said = [], []

    def open_page(path: Path, width: int = 1280, scheme: str = "light"):
        page = browser.new_page(viewport={"width": width, "height": 900}, color_scheme=scheme)
        said.append(watch(page))
        page.goto(path.as_uri())
        pages.append(page)
        return page

    yield open_page
    for page in pages:
        page.close()
    assert not any(said)


@pytest.mark.parametrize(("width", "scheme"), LOOKS)
def test_everybody_can_read_it(opened, written, written_several, width, scheme):
    for directory in (written, written_several):
        page = opened(directory / "report.html", width, scheme)
        assert faults(page) == []


def test_a_film_plays_and_pauses(opened, found, written):
    page = opened(written / "report.html")
    card = page.locator("[id='card-Align-ideal-pusher']")
    label = card.locator("figure.film img").get_attribute("alt")
    assert label == f"Film of pusher on Align, seed {found.rollout('Align', 'ideal', 'pusher').film.seed}"
    button, said = card.locator("button"), card.locator(".caption")
    assert button.inner_text().startswith("Play") and said.inner_text()
    before = card.locator("figure.film img").bounding_box()
    button.focus()
    page.keyboard.press("Enter")
    canvas = card.get_by_role("img", name=label)
    page.wait_for_function(
        "caption => document.querySelector(caption).textContent.startsWith('0.')",
        arg="[id='card-Align-ideal-pusher'] .caption",
    )
    after = canvas.bounding_box()
    assert after["width"] == pytest.approx(before["width"], abs=3) and after["height"] == pytest.approx(
        before["height"], abs=3
    )
    page.keyboard.press("Enter")
    page.wait_for_function(
        "() => [...document.querySelectorAll('button span')].every(each => each.textContent !== 'Pause')"
    )
    seen = canvas.evaluate(
        "each => new Set(each.getContext('2d').getImageData(0, 0, each.width, each.height).data).size"
    )
    assert seen > 20


def test_the_browser_reads_what_was_recorded(opened, several, written_several):
    page = opened(written_several / "report.html")
    recorded = several.rollout("Sort", "ideal", "shepherd").film
    figure = page.locator("[id='card-Sort-ideal-shepherd'] figure.film")
    content = figure.evaluate(
        """async figure => {
            const film = await vibgymFilm.read(figure.dataset.film);
            return [film.poses.map(part => part.map(each => [...each])), film.captions];
        }"""
    )
    shown = films.frames_shown(recorded)
    poses = np.array(content[0]).transpose(2, 0, 1)
    there = recorded.present[shown]
    error = poses - recorded.poses[shown]
    error[..., 2] = np.angle(np.exp(1j * error[..., 2]))
    assert np.abs(error[there][:, :2]).max() < 0.52e-4 and np.abs(error[there][:, 2]).max() < 0.9e-3
    assert content[1] == [recorded.captions[frame] for frame in shown]


def test_tables_sort_by_mouse_and_keyboard(opened, written):
    page = opened(written / "report.html")
    table = page.locator("#results ~ .scroll table").first

    def shares():
        """Of each task, as the rows stand."""
        return table.evaluate(
            """table => [...table.tBodies].map(body => [...body.rows].filter(row => row.cells.length > 1)
               .map(row => parseFloat(row.querySelector("b").textContent)))"""
        )

    before = shares()
    head = table.locator("thead th").nth(1)
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    assert shares() == [sorted(each, reverse=True) for each in before]
    page.keyboard.press("Space")
    assert head.get_attribute("aria-sort") == "ascending"
    assert shares() == [sorted(each) for each in before]
    assert table.evaluate("table => [...table.tBodies].every(body => body.rows[0].classList.contains('task'))")
    first = table.locator("thead th").first
    first.locator("button").click()
    assert head.get_attribute("aria-sort") is None and first.get_attribute("aria-sort") == "ascending"
    names = table.evaluate("table => [...table.tBodies[0].rows].slice(1).map(row => row.cells[0].textContent.trim())")
    assert names == sorted(names) and len(names) == 3


def test_a_page_of_which_scripts_are_refused_shows_still_pictures(browser, written):
    context = browser.new_context(java_script_enabled=False)
    page = context.new_page()
    page.goto((written / "report.html").as_uri())
    card = page.locator("[id='card-Align-ideal-pusher']")
    assert card.locator("figure.film img").is_visible() and not card.locator("button").is_visible()
    context.close()
