"""The page in a real browser, with real events of mouse and keys."""

import time

import numpy as np
import pytest

from tests.browser import faults_at_all_sizes, watch


class Seen:
    """An open page."""

    def __init__(self, browser, served, task, size=(1280, 900)):
        self.address, self.server = served
        known = set(self.server.visitors)
        self.page = browser.new_page(viewport=dict(zip(("width", "height"), size, strict=True)))
        self.console = watch(self.page)
        self.page.goto(f"http://{self.address}/?id={task}")
        self.page.wait_for_function("() => window.vibgym && window.vibgym.pictures > 5", timeout=60000)
        (token,) = set(self.server.visitors) - known
        self.session = self.server.visitors[token].session

    @property
    def world(self):
        return self.session.world

    def on_screen(self, x, y):
        left, top = self.page.evaluate("([x, y]) => window.vibgym.table.at([x, y])", [float(x), float(y)])
        box = self.page.locator("#table").bounding_box()
        return box["x"] + left, box["y"] + top

    def stop(self):
        """Pause, and wait until the page shows it."""
        self.page.click("#run")
        self.page.wait_for_function("() => !window.vibgym.motion.frame.running")

    def drag(self, start, end, steps=12):
        self.page.mouse.move(*self.on_screen(*start))
        self.page.mouse.down()
        for k in range(1, steps + 1):
            share = k / steps
            self.page.mouse.move(*self.on_screen(*(np.array(start) * (1 - share) + np.array(end) * share)))
            time.sleep(0.01)
        self.page.mouse.up()

    def until(self, condition, seconds=20.0):
        end = time.monotonic() + seconds
        while not condition():
            assert time.monotonic() < end, "it does not happen"
            time.sleep(0.02)

    def pose(self, part=0):
        return self.world.core.simulator.pose[0, part]


@pytest.fixture
def look(browser, served):
    opened = []

    def at(task, **rest):
        opened.append(Seen(browser, served, task, **rest))
        return opened[-1]

    yield at
    for seen in opened:
        assert seen.console == []
        seen.page.close()


def test_a_part_is_moved_with_the_mouse(look):
    seen = look("Align")
    seen.stop()
    before = seen.pose().copy()
    seen.drag(seen.pose()[:2], (0.55, 0.1))
    seen.until(lambda: not seen.world.held)
    np.testing.assert_allclose(seen.pose()[:2], [0.55, 0.1], atol=3e-3)
    seen.page.click("#undo")
    seen.until(lambda: np.array_equal(seen.pose(), before))


DROP = """([name, content]) => {
    const data = new DataTransfer();
    data.items.add(new File([content], name));
    window.dispatchEvent(new DragEvent("drop", { dataTransfer: data, bubbles: true, cancelable: true }));
}"""


def test_a_dropped_drawing_becomes_the_part(look):
    seen = look("Align")
    size = 'width="40mm" height="30mm" viewBox="0 0 40 30"'
    square = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><path d="M0 0H40V30H0Z"/></svg>'
    seen.page.evaluate(DROP, ["plate.svg", square])
    seen.until(lambda: seen.world.core.parts[0].name == "plate")
    assert seen.world.core.parts[0].area == pytest.approx(1.2e-3)
    seen.page.evaluate(DROP, ["open.svg", square.replace("H0Z", "")])
    seen.page.wait_for_function("() => document.body.innerText.includes('open.svg')")
    assert seen.world.core.parts[0].name == "plate"
    # The line of a refused file goes with the next one, whose units can be chosen.
    seen.page.select_option("#units", "cm")
    seen.page.evaluate(
        DROP, ["small.svg", square.replace('width="40mm" height="30mm" ', "").replace("40", "4").replace("30", "3")]
    )
    seen.until(lambda: seen.world.core.parts[0].name == "small")
    assert seen.world.core.parts[0].area == pytest.approx(1.2e-3)
    assert "open.svg" not in seen.page.inner_text("body")


def test_the_controller_moves_the_part_to_the_dragged_goal(look):
    seen = look("Align")
    goal = seen.world.core.episode.goal[0, 0].copy()
    seen.page.keyboard.down("Shift")
    seen.drag(goal[:2], (0.62, 0.11))
    seen.page.keyboard.up("Shift")
    seen.until(lambda: np.hypot(*(seen.world.core.episode.goal[0, 0, :2] - [0.62, 0.11])) < 3e-3)
    seen.until(lambda: np.hypot(*(seen.pose()[:2] - seen.world.core.episode.goal[0, 0, :2])) < 2e-3)


def test_a_stroke_of_the_brush_pushes_along_itself(look):
    seen = look("Align")
    seen.page.check("[value=brush]")
    seen.drag((0.2, 0.104), (0.5, 0.104), steps=20)
    seen.until(lambda: np.isfinite(seen.world.paint).any())
    painted = seen.world.paint[np.isfinite(seen.world.paint).all(axis=-1)]
    np.testing.assert_allclose(painted, np.tile([0.0, -1.0], (len(painted), 1)), atol=0.05)
    seen.page.click("#wipe")
    seen.until(lambda: np.isnan(seen.world.paint).all())


def test_keys_have_the_effect_of_the_mouse(look):
    seen = look("Align")
    seen.page.focus("#table")
    seen.page.keyboard.press("Space")
    seen.page.wait_for_function("() => !window.vibgym.motion.frame.running")
    before = seen.pose().copy()
    for key in ("n", "Enter", *["ArrowRight"] * 4, "q"):
        seen.page.keyboard.press(key)
    seen.until(lambda: 0 in seen.world.held)
    seen.page.keyboard.press("Enter")
    seen.until(lambda: not seen.world.held)
    np.testing.assert_allclose(seen.pose() - before, [0.02, 0.0, np.pi / 36], atol=1e-4)
    time_before = seen.world.core.simulator.time
    seen.page.keyboard.press(".")
    seen.until(lambda: seen.world.core.simulator.time > time_before)
    seen.page.keyboard.press("u")
    seen.page.keyboard.press("u")
    seen.until(lambda: np.allclose(seen.pose(), before))


def test_choices_record_and_share(look):
    seen = look("Align")
    seen.page.select_option("#hardware", "prototype")
    seen.page.select_option("#policy", "learned")
    seen.page.fill("#rate", "0.5")
    seen.page.press("#rate", "Tab")
    seen.until(lambda: seen.world.settings.rate == 0.5)
    assert (seen.world.settings.hardware, seen.world.settings.policy) == ("prototype", "learned")
    seen.page.select_option("#model", "averaged")
    seen.page.click("#record")
    seen.page.wait_for_function("() => parseInt(document.getElementById('recorded').textContent) > 5")
    seen.page.click("#gif")
    with seen.page.expect_download() as download:
        seen.page.click("#kept a")
    assert download.value.path().read_bytes()[:6] == b"GIF89a"
    seen.page.click("#share-start")
    seen.page.wait_for_selector("#url")
    url = seen.page.input_value("#url")
    seen.page.goto(url)
    seen.page.wait_for_function("() => window.vibgym && window.vibgym.pictures > 5")
    assert seen.page.input_value("#hardware") == "prototype"
    seen.page.fill("#id", "Nothing")
    seen.page.click("#open")
    seen.page.wait_for_function("() => document.getElementById('line').textContent.includes(\"Nothing\")")


def test_a_lost_connection_is_restored_and_pending_messages_are_applied(look):
    seen = look("Align")
    seen.stop()
    seen.page.evaluate("() => { window.vibgym.link.tries = 4; window.vibgym.link.socket.close(); }")
    seen.page.wait_for_function("() => document.getElementById('state').textContent.includes('lost')")
    seen.drag(seen.pose()[:2], (0.4, 0.1))
    assert not seen.world.held, "not sent yet"
    seen.page.wait_for_function("() => document.getElementById('state').textContent === 'connected'")
    seen.until(lambda: abs(seen.pose()[0] - 0.4) < 3e-3 and not seen.world.held)
    seen.page.reload()
    seen.page.wait_for_function("() => window.vibgym && window.vibgym.pictures > 5")
    assert seen.page.locator("#run").inner_text() == "Resume", "the same world, as it was left"
    seen.page.click("#run")
    seen.until(lambda: seen.session.running)


@pytest.mark.parametrize("task", ["Sort", "Push"])
def test_the_page_is_accessible_on_desk_and_phone(look, task):
    seen = look(task)
    assert faults_at_all_sizes(seen.page) == []
