"""A window on the screen for ``render_mode="human"``."""

from __future__ import annotations

import numpy as np

from vibgym.rendering._pygame import require_pygame
from vibgym.rendering.view import SurfacePainter


class Window:
    """Shows frames of a painter's size at a steady pace.

    pygame has one display per process, so one window can be open at a time. The user may close it at any moment:
    further frames are then dropped and nothing else happens.

    Args:
        painter: its width and height become the window's.
        fps: frames per second that :meth:`show` keeps to.
        title: of the window.
    """

    def __init__(self, painter: SurfacePainter, fps: float, title: str = "vibgym") -> None:
        self._pygame = require_pygame()
        self._size = (painter.width, painter.height)
        self._fps = fps
        self._title = title
        self._opened = False
        self._open = False
        self._clock = self._pygame.time.Clock()

    @property
    def is_open(self) -> bool:
        """Whether the window is on the screen."""
        return self._open

    def show(self, frame: np.ndarray) -> None:
        """Show ``frame`` (H, W, 3) uint8 and wait until the next one is due; the first call opens the window."""
        if not self._opened:
            self._pygame.display.init()
            self._pygame.display.set_mode(self._size)
            self._pygame.display.set_caption(self._title)
            self._opened = self._open = True
        if not self._open:
            return
        # Fetching the events also tells the window manager that this program is alive.
        if not self._pygame.display.get_init() or any(e.type == self._pygame.QUIT for e in self._pygame.event.get()):
            self.close()
            return
        picture = self._pygame.image.frombuffer(np.ascontiguousarray(frame), self._size, "RGB")
        self._pygame.display.get_surface().blit(picture, (0, 0))
        self._pygame.display.flip()
        self._clock.tick(self._fps)

    def close(self) -> None:
        """Take the window off the screen for good. May be called any number of times."""
        if self._open and self._pygame.display.get_init():
            self._pygame.display.quit()
        self._opened = True
        self._open = False
