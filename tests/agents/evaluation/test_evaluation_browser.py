"""The report in a real browser: films open, tables sort, nothing sticks out, and axe finds nothing grave."""

from pathlib import Path

import pytest

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


def test_a_film_opens_by_its_outcome(opened, found, written):
    card = opened(written / "report.html").locator("[id='card-Align-ideal-pusher']")
    seed = found.rollout("Align", "ideal", "pusher").film.seed
    film = card.get_by_role("img", name=f"Film of pusher on Align, seed {seed}")
    assert film.is_hidden()
    card.locator("summary").focus()
    card.page.keyboard.press("Enter")
    assert film.is_visible() and film.evaluate("each => each.naturalWidth") > 400


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
