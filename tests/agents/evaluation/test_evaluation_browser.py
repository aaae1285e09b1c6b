"""The report in a real browser: films open, tables sort, nothing sticks out, and axe finds nothing grave."""

import pytest

from agents.evaluation.table import where
from tests.browser import chromium, faults_at_all_sizes, watch


@pytest.fixture(scope="module")
def browser():
    with chromium() as found:
        yield found


@pytest.fixture
def opened(browser):
    """Opens a page; whatever its console says is an error."""
    pages, messages = [], []

    def open_page(path):
        pages.append(browser.new_page())
        messages.append(watch(pages[-1]))
        pages[-1].goto(path.as_uri())
        return pages[-1]

    yield open_page
    for page in pages:
        page.close()
    assert not any(messages)


def test_everybody_can_read_it(opened, written, written_several):
    for directory in (written, written_several):
        assert faults_at_all_sizes(opened(directory / "report.html")) == []


def test_a_film_opens_by_its_outcome(opened, found, written):
    card = opened(written / "report.html").locator("[id='card-Align-ideal-pusher']")
    episodes = where(found.main, task="Align", policy="pusher", filmed=1.0)
    seed = episodes["seed"].item()
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
