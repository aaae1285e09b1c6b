"""Human mode without a screen, and what importing the package costs."""

import subprocess
import sys

import numpy as np
import pytest

pygame = pytest.importorskip("pygame")

from vibgym.rendering import SurfacePainter, Window  # noqa: E402

BLOCK = np.array([[-25.0, -17.5], [25.0, -17.5], [25.0, 17.5], [-25.0, 17.5]]) * 1e-3


@pytest.fixture
def window(monkeypatch):
    monkeypatch.setenv("SDL_VIDEODRIVER", "dummy")
    painter = SurfacePainter(4, 6, 0.026, [BLOCK])
    shown = Window(painter, fps=500.0, title="test")
    frame = np.zeros((painter.height, painter.width, 3), dtype=np.uint8)
    frame[10, 20] = (10, 200, 30)
    yield shown, frame
    shown.close()


def test_opens_on_the_first_frame_and_shows_it(window):
    shown, frame = window
    assert not shown.is_open
    shown.show(frame)
    assert shown.is_open
    assert pygame.display.get_caption()[0] == "test"
    assert tuple(pygame.display.get_surface().get_at((20, 10)))[:3] == (10, 200, 30)
    frame.flags.writeable = False
    shown.show(frame)
    shown.close()
    shown.close()
    assert not pygame.display.get_init()


def test_user_may_close_it(window):
    shown, frame = window
    shown.show(frame)
    pygame.event.post(pygame.event.Event(pygame.QUIT))
    shown.show(frame)
    assert not shown.is_open
    shown.show(frame)
    assert not pygame.display.get_init()


def test_without_pygame_the_error_names_the_extra():
    code = """
import sys
sys.modules["pygame"] = None
from vibgym.rendering import SurfacePainter
try:
    SurfacePainter(8, 32, 0.026, [])
except ImportError as error:
    print(error)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.returncode == 0 and "pip install vibgym[render]" in done.stdout, done.stderr
