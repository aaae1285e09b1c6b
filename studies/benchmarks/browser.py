"""A real browser, headless, for what measures and tests pages: where it is found, and how it is started."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
NEEDED = "a browser is needed: apt-get install chromium, or .venv/bin/playwright install chromium"


@contextmanager
def chromium() -> Iterator[Any]:
    """A browser: the system's, or the one that Playwright has installed.

    Raises:
        RuntimeError: there is none; says how to get one.
    """
    from playwright.sync_api import Error, sync_playwright

    path = next(filter(None, map(shutil.which, NAMES)), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        except Error as error:
            raise RuntimeError(f"{NEEDED} ({str(error).splitlines()[0]})") from None
        try:
            yield browser
        finally:
            browser.close()
