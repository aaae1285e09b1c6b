"""Checks that every page must pass in a real browser."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from typing import Any

import pytest

from studies.benchmarks import play

__all__ = ["chromium", "faults", "faults_at_all_sizes", "watch"]

LOOKS = ((1280, "light"), (390, "dark"))
"""Widths of a desktop and a phone screen, pixels, each with a colour scheme."""


@contextmanager
def chromium() -> Iterator[Any]:
    """Yield a browser; without one, skip the test, or fail if ``CI`` is set."""
    with ExitStack() as stack:
        try:
            browser = stack.enter_context(play.chromium())
        except (ImportError, RuntimeError) as error:
            if os.environ.get("CI"):
                raise
            pytest.skip(str(error))
        yield browser


def watch(page: Any) -> list[str]:
    """Return a live list of the errors and warnings in the console of a page."""
    messages: list[str] = []
    page.on("console", lambda message: messages.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: messages.append(str(error)))
    return messages


def faults(page: Any) -> list[str]:
    """Return what is wrong with a page at its present size: sideways scrolling, serious accessibility violations."""
    from axe_playwright_python.sync_playwright import Axe

    texts = []
    wide, room = page.evaluate("() => [document.documentElement.scrollWidth, window.innerWidth]")
    if wide > room:
        texts.append(f"{wide} pixels wide in a window of {room}")
    for rule in Axe().run(page, options={"preload": False}).response["violations"]:
        if rule["impact"] in ("serious", "critical"):
            texts.append(f"{rule['id']}: {rule['help']}: {rule['nodes'][0]['html'][:200]} ({len(rule['nodes'])} times)")
    return texts


def faults_at_all_sizes(page: Any) -> list[str]:
    """Return the :func:`faults` on a desktop in light colours and on a phone in dark ones."""
    texts = []
    for width, scheme in LOOKS:
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme)
        texts += [f"{width} pixels, {scheme}: {fault}" for fault in faults(page)]
    return texts
