"""Measure the play page in a headless browser: ``python -m studies.benchmarks.play [--pages 2] [--minutes 10]``.

Frames per second, and latency from mouse to image, with twelve parts and real mouse events; with ``--minutes``, also the memory
of server and page. ``--picture FILE`` takes a screenshot instead.
"""

from __future__ import annotations

import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from studies import common

TASK = "SortTwelve"
WARM = "() => window.vibgym && window.vibgym.pictures > 60"

BROWSERS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
FLAGS = ("--no-sandbox", "--disable-gpu", "--disable-background-networking", "--disable-component-update")
NEEDED = "a browser is needed: apt-get install chromium, or .venv/bin/playwright install chromium"


@contextmanager
def chromium() -> Iterator[Any]:
    """Start a headless browser, the system's or that of Playwright.

    Raises:
        RuntimeError: no browser is installed; the message has the command that installs one.
    """
    from playwright.sync_api import Error, sync_playwright

    path = next(filter(None, map(shutil.which, BROWSERS)), None)
    with sync_playwright() as playwright:
        try:
            browser = playwright.chromium.launch(executable_path=path, args=list(FLAGS))
        except Error as error:
            raise RuntimeError(f"{NEEDED} ({str(error).splitlines()[0]})") from None
        try:
            yield browser
        finally:
            browser.close()


def served() -> tuple[subprocess.Popen, str]:
    """Start a server process; return it and the address of its page."""
    command = [sys.executable, "-m", "vibgym", "play", TASK, "--port", "0", "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    return process, next(word for word in line.split() if word.startswith("http://"))


def drag(page: Any, seconds: float) -> None:
    """Take a part and move it to and fro."""
    x, y = page.evaluate("() => window.vibgym.table.at(window.vibgym.motion.frame.pose[0])")
    box = page.locator("#table").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    end, k = time.monotonic() + seconds, 0
    while time.monotonic() < end:
        k += 1
        page.mouse.move(box["x"] + box["width"] * (0.3 + 0.004 * (k % 100)), box["y"] + box["height"] * 0.5)
        time.sleep(0.012)
    page.mouse.up()


def memory(process: subprocess.Popen, page: Any) -> tuple[float, float]:
    """Return the memory of the server and of the page's heap after garbage collection, MB."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text(encoding="utf-8").split()[1])
    link = page.context.new_cdp_session(page)
    link.send("HeapProfiler.collectGarbage")
    heap = page.evaluate("() => performance.memory.usedJSHeapSize")
    link.detach()
    return pages * 4096 / 1e6, heap / 1e6


def picture(page: Any, path: Path) -> None:
    """Write a screenshot of the page with a part held by the mouse."""
    page.click("#reset")
    x, y = page.evaluate("() => window.vibgym.table.at(window.vibgym.motion.frame.pose[2])")
    box = page.locator("#table").bounding_box()
    page.mouse.move(box["x"] + x, box["y"] + y)
    page.mouse.down()
    page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.75 * box["height"], steps=20)
    time.sleep(2.0)
    page.screenshot(path=path, type="jpeg", quality=80, clip={"x": 0, "y": 0, "width": 1280, "height": 570})
    page.mouse.up()


def main() -> None:
    """Measure and print."""
    parser = common.parser(__doc__, keep=False)
    parser.add_argument("--pages", type=int, default=1, help="number of pages on a server")
    parser.add_argument("--minutes", type=float, default=0.0, help="duration of the measurement of memory")
    parser.add_argument("--picture", type=Path, help="write a screenshot there instead of measuring")
    asked = parser.parse_args()
    process, address = served()
    try:
        with chromium() as browser:
            pages = [browser.new_page(viewport={"width": 1280, "height": 900}) for _ in range(asked.pages)]
            for page in pages:
                page.goto(address)
                page.wait_for_function(WARM, timeout=180_000)
            if asked.picture is not None:
                picture(pages[0], asked.picture)
                return
            before, began = [page.evaluate("() => window.vibgym.pictures") for page in pages], time.monotonic()
            drag(pages[0], 10.0)
            took = time.monotonic() - began
            rates = [(page.evaluate("() => window.vibgym.pictures") - then) / took for page, then in zip(pages, before)]
            delays = sorted(pages[0].evaluate("() => window.vibgym.delays"))
            print(f"{TASK}, {asked.pages} pages: " + ", ".join(f"{rate:.1f} frames/s" for rate in rates))
            print(
                f"mouse to image: median {delays[len(delays) // 2]:.1f} ms, 95 % {delays[int(0.95 * len(delays))]:.1f} ms"
            )
            end, k = time.monotonic() + 60.0 * asked.minutes, 0
            while time.monotonic() < end:
                if k % 10 == 0:
                    print(
                        "after {:.1f} min: server {:.1f} MB, page {:.2f} MB".format(k / 10, *memory(process, pages[0]))
                    )
                pages[0].click("#reset")
                drag(pages[0], 2.0)
                time.sleep(3.7)
                k += 1
            if asked.minutes:
                print("at the end: server {:.1f} MB, page {:.2f} MB".format(*memory(process, pages[0])))
    finally:
        process.terminate()
        process.wait(20)


if __name__ == "__main__":
    main()
