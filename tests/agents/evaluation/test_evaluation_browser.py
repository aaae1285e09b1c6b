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

    def column(k):
        return table.evaluate(
            "(table, k) => [...table.tBodies[0].rows].map(row => row.cells[k].querySelector('b').textContent)", k
        )

    heads = table.locator("thead th").all_inner_texts()
    success = next(k for k, head in enumerate(heads) if head.startswith("Success"))
    head = table.locator("thead th").nth(success)
    head.locator("button").click()
    assert head.get_attribute("aria-sort") == "descending"
    shares = [float(each.removesuffix(" %")) for each in column(success)]
    assert shares == sorted(shares, reverse=True) and len(set(shares)) > 1
    page.keyboard.press("Space")
    assert head.get_attribute("aria-sort") == "ascending"
    assert [float(each.removesuffix(" %")) for each in column(success)] == sorted(shares)
    first = table.locator("thead th").nth(1)
    first.locator("button").click()
    assert head.get_attribute("aria-sort") is None and first.get_attribute("aria-sort") == "descending"
    names = column(1)
    assert names == sorted(names, reverse=True) and len(names) == 3
