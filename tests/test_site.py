"""The documentation site: built without warnings, no external resources, no dead links."""

import shutil
import subprocess
import sys
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest

from studies.manual.site import write_list
from tests.browser import chromium, faults_at_all_sizes, watch
from vibgym.registration import ENVIRONMENTS

ROOT = Path(__file__).parent.parent
LOADS = {"script": "src", "img": "src", "link": "href", "iframe": "src", "source": "src", "video": "src"}
"""HTML elements that load a resource, and the attribute with its address."""


class Page(HTMLParser):
    """Ids, links and loaded resources of a page."""

    def __init__(self, path):
        super().__init__()
        self.ids, self.links, self.loads = set(), [], []
        self.text = path.read_text(encoding="utf-8")
        self.feed(self.text)

    def handle_starttag(self, tag, attributes):
        values = dict(attributes)
        self.ids.add(values.get("id"))
        if tag == "a" and values.get("href"):
            self.links.append(values["href"])
        if values.get(LOADS.get(tag, "")) and values.get("rel") not in ("next", "prev", "index", "search"):
            self.loads.append(values[LOADS[tag]])


@pytest.fixture(scope="module")
def pages(site):
    return {path.resolve(): Page(path) for path in site.rglob("*.html")}


@pytest.fixture(scope="module")
def browser():
    with chromium() as browser:
        yield browser


def target_of(path, address):
    """Return the file and the fragment of an address on a page."""
    parts = urlsplit(address)
    return (path.parent / unquote(parts.path)).resolve() if parts.path else path, unquote(parts.fragment)


def test_no_link_is_dead_and_no_resource_external(pages, site):
    dead = []
    for path, page in pages.items():
        for address in page.links:
            if not urlsplit(address).scheme:
                target, fragment = target_of(path, address)
                if not target.exists() or (fragment and target in pages and fragment not in pages[target].ids):
                    dead.append(f"{path.name}: {address}")
        for address in page.loads:
            assert not urlsplit(address).netloc, f"{path.name} loads {address}"
            if not address.startswith("data:") and not target_of(path, address)[0].exists():
                dead.append(f"{path.name}: {address}")
    assert len(pages) > 50 and not dead
    sheets = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert sheets and not any("@import" in text or "url(http" in text for text in sheets)


def test_pages_have_their_generated_parts(pages, site):
    """Films, tables and baselines of environments; tables of results; public names, and no private ones."""
    for name in ENVIRONMENTS:
        page = pages[(site / "environments" / f"{name}.html").resolve()]
        assert f"vibgym/{name}-v0" in page.text and any(f"{name}.webp" in address for address in page.loads)
        assert {"actions", "observations", "features-of-state", "reward", "baselines"} <= page.ids
        assert page.text.count("<table") >= 4
    results = pages[(site / "results.html").resolve()].text
    assert results.count("<table") >= 10 and "generated/" not in results
    api = pages[(site / "api" / "envs.html").resolve()].text
    assert "vibgym.envs.VibgymEnv" in api and "|---|" not in api and "## " not in api
    names = {name for page in pages.values() for name in page.ids if name and name.startswith("vibgym.")}
    assert len(names) > 300 and not {name for name in names if "._" in name}


@pytest.mark.parametrize("page", ["index", "play", "performance", "rivals", "environments/Sort", "api/index"])
def test_pages_fit_and_are_accessible(page, site, browser):
    """On desktop and phone, light and dark: no sideways scrolling, silent console, no serious accessibility violation."""
    tab = browser.new_page()
    messages = watch(tab)
    tab.goto((site / f"{page}.html").as_uri())
    assert faults_at_all_sizes(tab) == [] and messages == []


def test_films_stop_and_those_of_cards_move_under_the_pointer(site, browser):
    page = browser.new_page()
    page.goto((site / "index.html").as_uri())
    film, card = page.locator("article .film").first, page.locator(".cards.films > li").first
    button, still = film.get_by_role("button"), film.locator("canvas")
    assert button.inner_text() == "Stop film" and still.is_hidden()
    button.press("Enter")
    assert button.inner_text() == "Play film" and still.is_visible()
    assert still.bounding_box() == film.locator("img").bounding_box()
    assert card.locator("canvas").is_visible()
    card.get_by_role("link").focus()
    assert card.locator("canvas").is_hidden()
    calm = browser.new_page(reduced_motion="reduce")
    calm.goto((site / "index.html").as_uri())
    film, card = calm.locator("article .film").first, calm.locator(".cards.films > li").first
    assert film.locator("canvas").is_visible()
    card.hover()
    assert card.locator("canvas").is_visible()
    film.get_by_role("button").click()
    assert film.locator("canvas").is_hidden()


def test_pages_of_a_version_lead_to_the_others(tmp_path, browser):
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "index.md").write_text("# A page\n\n```{toctree}\n```\n", encoding="utf-8")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", "-c", "docs", "-A", "site_version=main"]
    subprocess.run([*command, str(tmp_path / "pages"), str(tmp_path / "site" / "main")], cwd=ROOT, check=True)
    for name in ("0.10.0", "0.9.0"):
        index = shutil.copytree(tmp_path / "site" / "main", tmp_path / "site" / name) / "index.html"
        text = index.read_text(encoding="utf-8")
        assert text.count('data-version="main"') == 1
        index.write_text(text.replace('data-version="main"', f'data-version="{name}"'), encoding="utf-8")
    first = write_list(tmp_path / "site")
    page = browser.new_page()
    messages = watch(page)
    page.goto(first.as_uri())
    page.wait_for_url("**/0.10.0/index.html")
    versions = page.get_by_label("Version")
    assert versions.input_value() == "0.10.0"
    assert versions.locator("option").all_inner_texts() == ["main", "0.10.0", "0.9.0"]
    assert faults_at_all_sizes(page) == [] and messages == []
    versions.select_option("main")
    page.wait_for_url("**/main/index.html")
