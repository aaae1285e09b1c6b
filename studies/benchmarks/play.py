"""The page to play on, measured: ``python -m studies.benchmarks.play [--pages 2] [--minutes 10]``, or ``--picture FILE``.

Pictures a second and the delay from the mouse to the picture with twelve parts, measured in a real browser with real mouse
events; and, with ``--minutes``, what memory grows by in server and page.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

from studies.benchmarks.browser import chromium

TASK = "SortTwelve"
WARM = "() => window.vibgym && window.vibgym.pictures > 60"


def served() -> tuple[subprocess.Popen, str]:
    """A server in a process of its own, and where its page is."""
    command = [sys.executable, "-m", "vibgym", "play", TASK, "--port", "0", "--no-browser"]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
    assert process.stdout is not None
    line = process.stdout.readline()
    return process, next(word for word in line.split() if word.startswith("http://"))


def drag(page: Any, seconds: float) -> None:
    """Take a part, and carry it to and fro."""
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
    """MB of the server, and of the page's heap after its garbage was collected."""
    pages = int(Path(f"/proc/{process.pid}/statm").read_text().split()[1])
    link = page.context.new_cdp_session(page)
    link.send("HeapProfiler.collectGarbage")
    heap = page.evaluate("() => performance.memory.usedJSHeapSize")
    link.detach()
    return pages * 4096 / 1e6, heap / 1e6


def picture(page: Any, path: Path) -> None:
    """What the page looks like with a part in the hand."""
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
    parser = argparse.ArgumentParser(prog="python -m studies.benchmarks.play")
    parser.add_argument("--pages", type=int, default=1, help="people at one server")
    parser.add_argument("--minutes", type=float, default=0.0, help="to watch memory for")
    parser.add_argument("--picture", type=Path, help="where to write a picture of the page, instead of measuring")
    given = parser.parse_args()
    process, address = served()
    try:
        with chromium() as browser:
            pages = [browser.new_page(viewport={"width": 1280, "height": 900}) for _ in range(given.pages)]
            for page in pages:
                page.goto(address)
                page.wait_for_function(WARM, timeout=180_000)
            if given.picture is not None:
                picture(pages[0], given.picture)
                return
            before, began = [page.evaluate("() => window.vibgym.pictures") for page in pages], time.monotonic()
            drag(pages[0], 10.0)
            took = time.monotonic() - began
            rates = [(page.evaluate("() => window.vibgym.pictures") - then) / took for page, then in zip(pages, before)]
            delays = sorted(pages[0].evaluate("() => window.vibgym.delays"))
            print(f"{TASK}, {given.pages} pages: " + ", ".join(f"{rate:.1f} pictures/s" for rate in rates))
            print(
                f"mouse to picture: median {delays[len(delays) // 2]:.1f} ms, 95 % {delays[int(0.95 * len(delays))]:.1f} ms"
            )
            end, k = time.monotonic() + 60.0 * given.minutes, 0
            while time.monotonic() < end:
                if k % 10 == 0:
                    print(
                        "after {:.1f} min: server {:.1f} MB, page {:.2f} MB".format(k / 10, *memory(process, pages[0]))
                    )
                pages[0].click("#reset")
                drag(pages[0], 2.0)
                time.sleep(3.7)
                k += 1
            if given.minutes:
                print("at the end: server {:.1f} MB, page {:.2f} MB".format(*memory(process, pages[0])))
    finally:
        process.terminate()
        process.wait(20)


if __name__ == "__main__":
    main()
