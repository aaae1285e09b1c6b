"""What every page has to pass in a real browser."""

from __future__ import annotations

from typing import Any

from studies.benchmarks.browser import chromium

__all__ = ["chromium", "faults", "faults_at_all_sizes", "watch"]

LOOKS = ((1280, "light"), (390, "dark"))
"""Widths of a desk's screen and of a phone's, pixels, and the colours that they are looked at in."""


def watch(page: Any) -> list[str]:
    """What a page complains of in its console, from now on; a live list."""
    said: list[str] = []
    page.on("console", lambda message: said.append(message.text) if message.type in ("error", "warning") else None)
    page.on("pageerror", lambda error: said.append(str(error)))
    return said


def faults(page: Any) -> list[str]:
    """What speaks against a page as it is shown now: scrolling sideways, and what the accessibility checker finds serious."""
    from axe_playwright_python.sync_playwright import Axe

    found = []
    wide, room = page.evaluate("() => [document.documentElement.scrollWidth, window.innerWidth]")
    if wide > room:
        found.append(f"{wide} pixels wide where {room} are seen")
    for each in Axe().run(page, options={"preload": False}).response["violations"]:
        if each["impact"] in ("serious", "critical"):
            found.append(f"{each['id']}: {each['help']}: {each['nodes'][0]['html'][:200]} ({len(each['nodes'])} times)")
    return found


def faults_at_all_sizes(page: Any) -> list[str]:
    """:func:`faults` on a desk in light, and on a phone in dark."""
    found = []
    for width, scheme in LOOKS:
        page.set_viewport_size({"width": width, "height": 800})
        page.emulate_media(color_scheme=scheme)
        found += [f"{width} pixels, {scheme}: {fault}" for fault in faults(page)]
    return found
