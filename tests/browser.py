"""Checks that every page must pass in a real browser."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, NoReturn

import pytest

__all__ = ["chromium", "faults", "faults_at_all_sizes", "watch"]

LOOKS = ((1280, "light"), (390, "dark"))
"""Widths of a desktop and a phone screen, pixels, each with a colour scheme."""


NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
NEEDED = "a browser is needed: apt-get install chromium, or .venv/bin/playwright install chromium"


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a headless browser; without one, skip the test, or fail if ``CI`` is set."""
    try:
        from playwright.sync_api import Error, sync_playwright
    except ImportError as error:
        _skip(error)
    path = next(filter(None, map(shutil.which, NAMES)), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        except Error as error:
            _skip(RuntimeError(f"{NEEDED} ({str(error).splitlines()[0]})"))
        try:
            yield browser
        finally:
            browser.close()


def _skip(error: Exception) -> NoReturn:
    if os.environ.get("CI"):
        raise error
    pytest.skip(str(error))


def watch(page: Any) -> list[str]:
    """Return a live list of the errors and warnings in the console of a page."""
    messages: list[str] = []
    page.on("console", lambda message: messages.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    return messages


def faults(page: Any) -> list[str]:
    """Return what is wrong with a page at its present size: sideways scrolling, serious accessibility violations."""
    from axe_playwright_python.sync_playwright import Axe

    found = []
    wide, room = page.evaluate("() => [document.documentElement.scrollWidth, window.innerWidth]")
    if wide > room:
        found.append(f"{wide} pixels wide in a window of {room}")
    for each in Axe().run(page, options={"preload": False}).response["violations"]:
        if each["impact"] in ("serious", "critical"):
            found.append(f"{each['id']}: {each['help']}: {each['nodes'][0]['html'][:200]} ({len(each['nodes'])} times)")
    return found


def faults_at_all_sizes(page: Any) -> list[str]:
    """Return the :func:`faults` on a desktop in light colours and on a phone in dark ones."""
    found = []
    for width, scheme in LOOKS:
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme)
        found += [f"{width} pixels, {scheme}: {fault}" for fault in faults(page)]
    return found
