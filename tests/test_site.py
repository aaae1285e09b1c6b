"""The documentation site: built without warnings, no external resources, no dead links."""

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
        self.feed(path.read_text(encoding="utf-8"))

    def handle_starttag(self, tag, attributes):
        found = dict(attributes)
        self.ids.add(found.get("id"))
        if tag == "a" and found.get("href"):
            self.links.append(found["href"])
        if found.get(LOADS.get(tag, "")) and found.get("rel") not in ("next", "prev", "index", "search"):
            self.loads.append(found[LOADS[tag]])


@pytest.fixture(scope="module")
def pages(site):
    return {path: Page(path) for path in site.rglob("*.html")}


def leads_to(path, address):
    """Return the file and the fragment of an address on a page."""
    parts = urlsplit(address)
    return (path.parent / unquote(parts.path)).resolve() if parts.path else path, unquote(parts.fragment)


def test_no_link_is_dead(pages):
    known = {path.resolve(): page for path, page in pages.items()}
    dead = []
    for path, page in known.items():
        for address in page.links:
            if urlsplit(address).scheme:
                continue
            target, fragment = leads_to(path, address)
            if not target.exists() or (fragment and target in known and fragment not in known[target].ids):
                dead.append(f"{path.name}: {address}")
    assert len(known) > 50 and not dead


def test_no_resource_is_external(pages, site):
    for path, page in pages.items():
        for address in page.loads:
            assert not urlsplit(address).netloc, f"{path.name} loads {address}"
            if not address.startswith("data:"):
                assert leads_to(path, address)[0].exists(), f"{path.name}: {address}"
    sheets = [path.read_text(encoding="utf-8") for path in site.rglob("*.css")]
    assert sheets and not any("@import" in text or "url(http" in text for text in sheets)


def test_every_environment_has_a_page_with_film_tables_and_baselines(pages, site):
    for name in ENVIRONMENTS:
        path = site / "environments" / f"{name}.html"
        text = path.read_text(encoding="utf-8")
        assert f"vibgym/{name}-v0" in text and any(f"{name}.webp" in address for address in pages[path].loads)
        assert {"actions", "observations", "features-of-state", "reward", "baselines"} <= pages[path].ids
        assert text.count("<table") >= 4


def test_generated_tables_are_on_the_pages(site):
    results = (site / "results.html").read_text(encoding="utf-8")
    assert results.count("<table") >= 10
    assert "generated/" not in results
    api = (site / "api" / "envs.html").read_text(encoding="utf-8")
    assert "vibgym.envs.VibgymEnv" in api and "|---|" not in api and "## " not in api


def test_private_names_are_left_out(pages):
    named = {name for page in pages.values() for name in page.ids if name and name.startswith("vibgym.")}
    assert len(named) > 300
    private = {name for name in named if any(part.startswith("_") for part in name.split("."))}
    assert not private


@pytest.mark.parametrize("page", ["index", "play", "performance", "rivals", "environments/Sort", "api/index"])
def test_pages_fit_and_are_accessible(page, site):
    """On desktop and phone, light and dark: no sideways scrolling, silent console, no serious accessibility violation."""
    with chromium() as browser:
        seen = browser.new_page()
        messages = watch(seen)
        seen.goto((site / f"{page}.html").as_uri())
        assert faults_at_all_sizes(seen) == [] and messages == []


def test_films_stop_and_those_of_cards_move_under_the_pointer(site):
    with chromium() as browser:
        seen = browser.new_page()
        seen.goto((site / "index.html").as_uri())
        film, card = seen.locator("article .film").first, seen.locator(".cards.films > li").first
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
        assert calm.locator("article .film canvas").first.is_visible()
        calm.locator(".cards.films > li").first.hover()
        assert calm.locator(".cards.films canvas").first.is_visible()
        calm.locator("article .film").first.get_by_role("button").click()
        assert calm.locator("article .film canvas").first.is_hidden()


def test_pages_of_a_version_lead_to_the_others(tmp_path):
    (tmp_path / "pages").mkdir()
    (tmp_path / "pages" / "index.md").write_text("# A page\n\n```{toctree}\n```\n", encoding="utf-8")
    for name in ("main", "0.10.0", "0.9.0"):
        command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", "-c", "docs", "-A", f"site_version={name}"]
        subprocess.run([*command, str(tmp_path / "pages"), str(tmp_path / "site" / name)], cwd=ROOT, check=True)
    first = write_list(tmp_path / "site")
    with chromium() as browser:
        seen = browser.new_page()
        messages = watch(seen)
        seen.goto(first.as_uri())
        seen.wait_for_url("**/0.10.0/index.html")
        versions = seen.get_by_label("Version")
        assert versions.input_value() == "0.10.0"
        assert versions.locator("option").all_inner_texts() == ["main", "0.10.0", "0.9.0"]
        assert faults_at_all_sizes(seen) == [] and messages == []
        versions.select_option("main")
        seen.wait_for_url("**/main/index.html")
