"""The documentation site: built without warnings, no external resources, no dead links."""

from html.parser import HTMLParser
from urllib.parse import unquote, urlsplit

import pytest

from tests.browser import chromium, faults_at_all_sizes, watch
from vibgym.registration import ENVIRONMENTS

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


@pytest.mark.parametrize("page", ["index", "play", "rivals", "environments/Sort", "api/index"])
def test_pages_fit_and_are_accessible(page, site):
    """On desktop and phone, light and dark: no sideways scrolling, silent console, no serious accessibility violation."""
    with chromium() as browser:
        seen = browser.new_page()
        messages = watch(seen)
        seen.goto((site / f"{page}.html").as_uri())
        assert faults_at_all_sizes(seen) == [] and messages == []
